/* Along a trajectory: a clock that waits for an aircraft that cannot keep up, the reference at its
   time, the heading; guidance steps, what the log has of them, and the ticks between them. */
#ifndef GUIDANCE_H
#define GUIDANCE_H

#include "control.h"
#include "flight.h"
#include "landing.h"
#include "strapdown.h"
#include "vectors.h"

static const double LAG_FREE_M = 1.5;   /* lag along the path that the governor lets pass */
static const double LAG_STOP_M = 6.0;   /* lag at which the reference waits */
static const double YIELD_PER_S = 0.3;  /* of the reference's rate, while saturated or not */
static const double LEAST_ROOM = 0.2;
static const double LIMITED_RATE = 0.9; /* a clock slower than that: the speed cannot be held */
static const double STALL_S = 30.0;     /* it moves on by less than a second: waited for in vain */
static const double STOPPED_MPS = 0.3, STOPPED_M = 0.5, STOPPED_S = 10.0;
static const double NEAR_M = 0.2;       /* to a corner's plane, beyond what is flown by then */
static const double COURSE_MPS = 1.5;   /* slower than that the course does not say where to look */
static const double PRESSED_LIFT = 0.9; /* below it an attitude order means to come down */

static void reference(const Trajectory *path, double t, double lead, double *pva)
{
    const double h = path->half;
    const Piece *piece = piece_at(path, t - h), *end = path->pieces + path->count;
    const double s = t - piece->t0;
    if (s >= h && (piece + 1 == end || t + h + lead < piece[1].t0)) { /* within one piece */
        for (int i = 0; i < 3; i++) {
            const double u = piece->v[i] + piece->a[i] * s;
            pva[i] = piece->p[i] + (piece->v[i] + u) * (s / 2) + piece->a[i] * (h * h / 6);
            pva[3 + i] = u;
            pva[6 + i] = piece->a[i];
        }
        return;
    }
    double area[2][3], p[2][3], v[2][3], unused[3];
    unsmoothed(path, t - h, area[0], p[0], unused);
    unsmoothed(path, t + h, area[1], p[1], unused);
    unsmoothed(path, t + lead - h, unused, unused, v[0]);
    unsmoothed(path, t + lead + h, unused, unused, v[1]);
    for (int i = 0; i < 3; i++) {
        pva[i] = (area[1][i] - area[0][i]) * (0.5 / h);
        pva[3 + i] = (p[1][i] - p[0][i]) * (0.5 / h);
        pva[6 + i] = (v[1][i] - v[0][i]) * (0.5 / h);
    }
}

/* Rate of the reference's clock. */
static double governed(Guide *g, const Gains *k, const State *nav)
{
    double target = 1, square = 0, ahead = 0;
    for (int i = 0; i < 3; i++) {
        square += g->along[i] * g->along[i];
        ahead += (g->p[i] - nav->p[i]) * g->along[i];
    }
    if (square > 0.25 && g->pointed) {
        const double lag = ahead / __builtin_sqrt(square);
        if (lag > LAG_FREE_M)
            target = limited(1 - (lag - LAG_FREE_M) / (LAG_STOP_M - LAG_FREE_M), 0, 1);
    }
    /* At the limit of lean or thrust nothing is left to keep to the line with: slower, before the
       lag shows. */
    g->room += (g->saturated ? -YIELD_PER_S : YIELD_PER_S) * k->dt;
    g->room = limited(g->room, LEAST_ROOM, 1);
    if (g->room < target) target = g->room;
    g->smooth_rate += k->dt / 1.5 * (target - g->smooth_rate);
    const double most = 0.5 * k->dt; /* the clock itself may not jump */
    return limited(target, g->rate - 2 * most, g->rate + most);
}

/* The heading one step towards an order, which itself turns at a rate; eased in and out, so that
   the rate fed forward does not jump. */
static void turn(Guide *g, const Gains *k)
{
    const double gap = wrapped(g->yaw_order - g->yaw), most = 4 * k->yaw_rate * k->dt;
    const double rate = limited(g->spin + 2 * gap, -k->yaw_rate, k->yaw_rate);
    g->yaw_rate = limited(rate, g->yaw_rate - most, g->yaw_rate + most);
    g->yaw = wrapped(g->yaw + g->yaw_rate * k->dt);
}

/* At the end of the trajectory: done once the aircraft stands there, or not in good time. */
static void finish(Guide *g, const Gains *k, const Trajectory *path, const State *nav)
{
    if (g->t < path->end || g->finished) return;
    g->over += k->dt;
    const double off = size3(g->p[0] - nav->p[0], g->p[1] - nav->p[1], g->p[2] - nav->p[2]);
    const double speed = size3(nav->v[0], nav->v[1], nav->v[2]);
    if ((off < STOPPED_M && speed < STOPPED_MPS) || g->over > STOPPED_S) {
        g->finished = 1;
        g->missed = off;
    }
}

static void track(Guide *g, const Gains *k, const Trajectory *path, const State *nav)
{
    double pva[9];
    const double rate = governed(g, k, nav), step = k->dt * rate;
    g->t += step;
    if (g->t > path->end + 1) g->t = path->end + 1;
    g->waited += k->dt;
    g->went += step;
    if (g->went >= 1 || g->finished) g->waited = g->went = 0;
    else if (g->waited >= STALL_S) g->stalled = 1;
    reference(path, g->t, k->lead * rate, pva);
    for (int i = 0; i < 3; i++) {
        g->p[i] = pva[i];
        g->along[i] = pva[3 + i];
        g->v[i] = pva[3 + i] * rate;
        /* Slowing the clock decelerates the reference along its own course. */
        g->a[i] = pva[6 + i] * (rate * rate) + pva[3 + i] * ((rate - g->rate) / k->dt);
    }
    g->rate = rate;
    g->pointed = 1;
    if (g->course && size3(g->v[0], g->v[1], 0) > COURSE_MPS)
        g->yaw_order = arc_tangent2(g->v[1], g->v[0]);
    if (g->interested)
        g->yaw_order = arc_tangent2(g->interest[1] - g->p[1], g->interest[0] - g->p[0]);
    g->spin = 0;
    turn(g, k);
    finish(g, k, path, nav);
}

/* Whether the next corner's plane may be passed before the next step. */
static int near_corner(const Guide *g, const Gains *k, const State *nav)
{
    if (!(g->t >= g->soon - k->dt)) return 0;
    double beyond = 0, speed = 0;
    for (int i = 0; i < 3; i++) {
        beyond += (nav->p[i] - g->corner[i]) * g->normal[i];
        speed += nav->v[i] < 0 ? -nav->v[i] : nav->v[i];
    }
    return beyond + 2 * k->dt * speed + NEAR_M > 0;
}

/* Whether the plane of closest approach to the next corner is crossed, or it is too late for that. */
static int passed(const Guide *g, const double p[3], const double v[3])
{
    if (!(g->t >= g->soon)) return 0;
    const double *n = g->normal;
    if (n[0] == 0 && n[1] == 0 && n[2] == 0) n = v; /* at a reversal */
    double beyond = 0;
    for (int i = 0; i < 3; i++) beyond += (p[i] - g->corner[i]) * n[i];
    return !(beyond < 0 && g->t < g->late);
}

/* Add a row of what is believed and ordered to the log's, where it is time to. Whether it went well;
   where not, Python has an error set. */
static int note(Trace *trace, const Guide *g, const State *nav, const Inner *inner)
{
    const int64_t step = ++trace->steps;
    if (!g->armed || step % trace->every || trace->count == trace->room) return 1;
    double *row = trace->rows[trace->count], turn[4], seen[ACTUATORS];
    if (!read_gauges(inner->python, trace->gauges, ACTUATORS, seen)) return 0;
    rotation(turn, g->error);
    *row++ = (double)(step * trace->step_ns);
    for (int i = 0; i < 4; i++) row[i] = nav->q[i];
    for (int i = 0; i < 3; i++) row[4 + i] = inner->rate[i];
    product(row + 7, nav->q, turn);
    for (int i = 0; i < 3; i++) row[11 + i] = seen[i];
    row[14] = g->collective;
    for (int i = 0; i < 4; i++) row[15 + i] = seen[3 + i];
    for (int i = 0; i < 3; i++) {
        row[19 + i] = g->p[i];
        row[22 + i] = g->v[i];
        row[25 + i] = g->a[i];
    }
    row[28] = g->yaw;
    row[29] = g->yaw_rate;
    for (int i = 19; i < 30 && !g->pointed; i++) row[i] = __builtin_nan("");
    trace->count++;
    return 1;
}

static int guide(const Guidance *guidance, const Strapdown *carried, Inner *inner)
{
    Guide *g = guidance->memory;
    const Gains *k = guidance->gains;
    const State *nav = &carried->state;
    const double *force = carried->force;
    double r[3][3];
    matrix(r, nav->q);
    const double heading = arc_tangent2(r[1][0], r[0][0]);
    const int64_t mode = g->armed ? g->mode : NOTHING;
    if (!g->armed) { /* what it stands on may have been turned: no heading to come back to */
        g->yaw = g->yaw_order = heading;
        g->yaw_rate = 0;
    }
    g->descend = 0;
    if (mode == TRACK || mode == TARGET) {
        if (mode == TRACK) track(g, k, guidance->path, nav);
        else turn(g, k);
        g->pointed = 1;
        g->descend = g->v[2];
        if (g->contact && g->v[2] > 0) idle(g, k, 1);
        else fly(g, k, nav, force, !g->touching);
    } else {
        g->pointed = 0;
        if (mode == ATTITUDE) {
            keep_attitude(g, k, nav, force, !g->landed);
            g->yaw = g->yaw_order = heading;
            g->descend = g->lift < PRESSED_LIFT ? 1 : 0; /* m/s, of any size */
        } else {
            idle(g, k, g->armed != 0);
        }
    }
    g->sink = nav->v[2];
    /* Against what the motors give by now, not against an order that they have yet to follow. */
    g->knock = -force[2] - g->lagged * k->full * g->effectiveness;
    land(g, k->dt);
    const int slow = g->too_fast || g->smooth_rate < LIMITED_RATE;
    g->noted = (g->finished ? FINISHED : 0) | (g->stalled ? STALLED : 0) |
               (slow && g->path && mode == TRACK && !g->finished ? LIMITED : 0) |
               (near_corner(g, k, nav) ? NEAR : 0);
    return order(inner, g->error, g->feed, g->collective) &&
           (!guidance->trace || note(guidance->trace, g, nav, inner));
}

static inline int read_probe(Probe *probe, const Interpreter *python)
{
    if (!probe || ++probe->waited < probe->every) return 1;
    probe->waited = 0;
    return read_gauges(python, probe->gauge, 1, probe->values + probe->count++);
}

/* A tick of the physics, sampled by the IMU; its rates go to the inner loops. */
static inline int tick(Loop *loop, Object run)
{
    Imu *imu = loop->imu;
    double *values = loop->samples + AXES * loop->taken++;
    return call(imu->python, run) && sample(imu, values) && feed(loop->inner, imu->rates) &&
           read_probe(loop->probe, imu->python);
}

/* Whether a corner is passed at this tick. */
static inline int at_corner(const Loop *loop, const Guide *g)
{
    if (!loop->ahead || !(g->noted & NEAR)) return 0;
    Increment sum;
    *loop->ahead = *loop->carried;
    if (loop->taken)
        integrate((const Sample *)loop->samples, loop->taken, loop->dt, &sum, loop->ahead);
    return passed(g, loop->ahead->state.p, loop->ahead->state.v);
}

/* From tick to tick, and over the guidance steps on the way, while nobody has anything else to do. */
static int64_t cruise(Loop *loop, Object run, int64_t ticks, Increment *sums, const Guidance *guidance)
{
    const int64_t noted = guidance->memory->noted;
    for (int64_t flown = 0; flown < ticks;) {
        if (!tick(loop, run)) return -1;
        flown++;
        const int whole = loop->taken == loop->interval;
        if (whole) {
            integrate((const Sample *)loop->samples, loop->interval, loop->dt, sums++, loop->carried);
            loop->taken = 0;
        }
        if (flown == ticks || at_corner(loop, guidance->memory)) return flown;
        if (!whole) continue;
        if (!guide(guidance, loop->carried, loop->inner)) return -1;
        if (guidance->memory->noted != noted) return flown;
    }
    return ticks;
}

#endif
