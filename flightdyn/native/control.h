/* The outer loop: where the reference wants to be against where the aircraft believes it is.

   Position P and velocity PI give an acceleration; the reference's acceleration is fed forward, led
   by the lag of the attitude loop. What the air does is measured, not modelled: the accelerometers'
   x and y axes feel no thrust, so what they show is drag and wind; the z axis shows what the ordered
   thrust is worth (battery, air density, inflow). */
#ifndef CONTROL_H
#define CONTROL_H

#include "flight.h"
#include "vectors.h"

static const double LEAST_LIFT = 0.2; /* thrust over weight below which nothing turns: the ground */

/* Forget what was learnt in the air; motors turn without lift where armed. */
static void idle(Guide *g, const Gains *k, int armed)
{
    for (int i = 0; i < 3; i++) g->integral[i] = g->thrust[i] = g->error[i] = g->feed[i] = 0;
    g->thrust[2] = -1;
    g->drag[0] = g->drag[1] = g->lagged = g->lift = 0;
    g->saturated = 0;
    g->effectiveness = 1;
    g->collective = armed ? k->idle : 0;
}

/* Thrust over mass (m/s2, NED) within lean and strength; height goes before position. Whether it had
   to be cut by more than a hundredth. */
static int limit_thrust(double thrust[3], double slope, double least, double most)
{
    const double up = limited(-thrust[2], least, most);
    const double across = size3(thrust[0], thrust[1], 0), rest = most * most - up * up;
    double room = rest > 0 ? __builtin_sqrt(rest) : 0;
    if (room > up * slope) room = up * slope;
    thrust[2] = -up;
    if (!(across > room)) return 0;
    thrust[0] *= room / across;
    thrust[1] *= room / across;
    return across > 1.01 * room;
}

/* Rotation vector (rad, body) that turns the thrust axis onto `thrust` the short way and, about the
   body's own z axis, towards the wanted heading. */
static void attitude_error(double error[3], double r[3][3], const double thrust[3], double wanted)
{
    const double size = size3(thrust[0], thrust[1], thrust[2]);
    double axis[3] = {0}; /* wanted body z axis, body axes */
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) axis[i] -= r[j][i] * thrust[j] / size;
    const double sine = size3(axis[0], axis[1], 0), angle = arc_tangent2(sine, axis[2]);
    const double scale = sine > 1e-9 ? angle / sine : 1;
    const double turn = wrapped(wanted - arc_tangent2(r[1][0], r[0][0]));
    error[0] = -axis[1] * scale;
    error[1] = axis[0] * scale;
    error[2] = turn * (r[2][2] > 0 ? r[2][2] : 0);
}

/* What the ordered thrust is worth, by the accelerometer. */
static void measure_thrust(Guide *g, const Gains *k, const double force[3])
{
    if (!(g->lagged > 0.05)) return;
    const double ratio = limited(-force[2] / (k->full * g->lagged), 0.3, 2.0);
    const double share = k->dt / k->thrust_lag; /* of few samples no more: they are noisy */
    g->effectiveness += (share < 0.4 ? share : 0.4) * (ratio - g->effectiveness);
}

/* Order a thrust (over mass), and remember it as the motors will follow it. */
static void lift(Guide *g, const Gains *k, double collective, double full)
{
    g->lagged += k->dt / k->motor_lag * (collective - g->lagged);
    g->lift = collective * full / k->gravity;
    g->collective = collective;
}

/* One step. Where it may stand on the ground (not `flying`) it stays level and learns nothing. */
static void fly(Guide *g, const Gains *k, const State *nav, const double force[3], int flying)
{
    double r[3][3], wanted[3];
    matrix(r, nav->q);
    if (flying) {
        for (int i = 0; i < 2; i++) {
            g->drag[i] += k->dt / k->drag_lag * (force[i] - g->drag[i]);
            g->drag[i] = limited(g->drag[i], -k->drag_limit, k->drag_limit);
        }
        measure_thrust(g, k, force);
    }
    const int learning = flying && !g->saturated;
    for (int i = 0; i < 3; i++) {
        const double slip = g->v[i] + k->position * (g->p[i] - nav->p[i]) - nav->v[i];
        if (learning) {
            g->integral[i] += k->integral * k->dt * slip;
            g->integral[i] = limited(g->integral[i], -k->integral_limit, k->integral_limit);
        }
        const double drag = r[i][0] * g->drag[0] + r[i][1] * g->drag[1];
        wanted[i] = g->a[i] + k->velocity * slip + g->integral[i] - drag;
        if (i < 2 && !flying) wanted[i] = 0;
    }
    wanted[2] -= k->gravity;
    const double full = k->full * g->effectiveness;
    g->saturated = limit_thrust(wanted, k->slope, 0.25 * k->gravity, k->most_thrust * full);
    double along = 0;
    for (int i = 0; i < 3; i++) along -= wanted[i] * r[i][2];
    lift(g, k, limited(along / full, 0.02, k->most_thrust), full);
    attitude_error(g->error, r, wanted, g->yaw);
    for (int i = 0; i < 3; i++) {
        g->thrust[i] = wanted[i];
        g->feed[i] = r[2][i] * g->yaw_rate;
    }
    g->wanted_yaw = g->yaw;
}

/* Thrust over mass (m/s2) that keeps the climb ordered, whatever the lean. */
static double climb(Guide *g, const Gains *k, const State *nav, double upright, int learning)
{
    const double gap = -g->climb - nav->v[2];
    if (learning) {
        g->integral[2] += k->integral * k->dt * gap;
        g->integral[2] = limited(g->integral[2], -k->integral_limit, k->integral_limit);
    }
    return (k->gravity - k->velocity * gap - g->integral[2]) / (upright > 0.5 ? upright : 0.5);
}

/* One step of an attitude order: no position, no velocity but that of a climb. */
static void keep_attitude(Guide *g, const Gains *k, const State *nav, const double force[3],
                          int flying)
{
    double r[3][3], w[3][3];
    matrix(r, nav->q);
    const double full = k->full * g->effectiveness;
    double collective = g->thrust_order;
    if (!(collective == collective)) collective = climb(g, k, nav, r[2][2], flying) / full;
    if (flying) measure_thrust(g, k, force);
    lift(g, k, limited(collective, k->idle, k->most_thrust), full);
    for (int i = 0; i < 3; i++) g->error[i] = g->feed[i] = 0;
    if (!(g->lift > LEAST_LIFT)) return;
    for (int i = 0; i < 3; i++) g->feed[i] = g->rates[i];
    if (!g->oriented) return;
    matrix(w, g->q);
    for (int i = 0; i < 3; i++) g->thrust[i] = -w[i][2];
    g->wanted_yaw = arc_tangent2(w[1][0], w[0][0]);
    attitude_error(g->error, r, g->thrust, g->wanted_yaw);
}

#endif
