/* Inertial navigation without a filter: summing IMU ticks, and carrying a state forward.

   Coning and rotation terms: P. Savage, Strapdown Inertial Navigation Integration Algorithm Design
   (J. Guidance 21, 1998). A sample holds until the next one is taken, and its force acts in the
   axes of its own instant, which is how the physics advances attitude and velocity too: with exact
   sensors the two agree. */

#ifndef STRAPDOWN_H
#define STRAPDOWN_H

#include "flight.h"
#include "vectors.h"

/* The quaternion of a rotation vector (rad): cosine and sine of half of it by their series, which
   are exact to the last digits up to a whole turn. */
static inline void rotation(double q[4], const double r[3])
{
    const double s = -(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) / 4;
    double cosine = 1, sine = 1;
    for (int k = 32; k > 0; k -= 2) {
        cosine = 1 + cosine * s / (k * (k - 1));
        sine = 1 + sine * s / (k * (k + 1));
    }
    q[0] = cosine;
    for (int i = 0; i < 3; i++) q[1 + i] = r[i] * (sine / 2);
}

/* The rotation `b` after `a`, as quaternions. */
static inline void product(double q[4], const double a[4], const double b[4])
{
    q[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    q[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    q[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    q[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

static void carry(Strapdown *carried, const Increment *step, int64_t count)
{
    const ImuBias *bias = &carried->bias;
    const Earth *earth = &carried->earth;
    double *p = carried->state.p, *v = carried->state.v, *q = carried->state.q;
    double *gained = carried->gained, *force = carried->force, *down = carried->down;
    gained[0] = gained[1] = gained[2] = 0;
    for (const Increment *end = step + count; step < end; step++) {
        const double dt = step->dt;
        double angle[3], body[3], c[3], d[3], g[3], r[4], turned[4];
        for (int i = 0; i < 3; i++) {
            angle[i] = step->angle[i] - bias->gyro[i] * dt;
            body[i] = step->velocity[i] - bias->accel[i] * dt;
            force[i] = body[i] / dt;
        }
        /* The gained velocity turned by the attitude: b + 2 w (u x b) + 2 u x (u x b). */
        cross(c, q + 1, body);
        cross(d, q + 1, c);
        for (int i = 0; i < 3; i++) gained[i] += g[i] = body[i] + 2 * (q[0] * c[i] + d[i]);
        const double north = 2 * earth->rate_north * dt, below = 2 * earth->rate_down * dt;
        const double u[3] = {
            v[0] + g[0] + below * v[1],
            v[1] + g[1] - below * v[0] + north * v[2],
            v[2] + g[2] - north * v[1] + earth->gravity * dt,
        };
        for (int i = 0; i < 3; i++) {
            p[i] += (v[i] + u[i]) * (dt / 2);
            v[i] = u[i];
        }
        rotation(r, angle);
        product(turned, q, r);
        double size = 0;
        for (int i = 0; i < 4; i++) size += turned[i] * turned[i];
        for (int i = 0; i < 4; i++) q[i] = turned[i] * (1.5 - size / 2); /* unit, first order */
        *down++ = p[2];
    }
}

static void integrate(const Sample *sample, int64_t count, double dt, Increment *sum,
                      Strapdown *carried)
{
    double angle[3] = {0}, velocity[3] = {0}, half[3], sculling[3], coning[3];
    for (const Sample *end = sample + count; sample < end; sample++) {
        cross(sculling, angle, sample->force);
        for (int i = 0; i < 3; i++) {
            velocity[i] += sample->force[i] + sculling[i];
            half[i] = sample->rate[i] * (dt / 2);
        }
        cross(coning, angle, half);
        for (int i = 0; i < 3; i++) angle[i] += 2 * half[i] + coning[i];
    }
    sum->dt = (double)count * dt;
    for (int i = 0; i < 3; i++) {
        sum->angle[i] = angle[i];
        sum->velocity[i] = velocity[i] * dt;
    }
    if (carried) carry(carried, sum, 1);
}

#endif
