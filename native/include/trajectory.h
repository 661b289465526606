/* From a path to the trajectory that flies it, and what that takes: runs along the legs, blends at the
   corners, all of it averaged over a window so that acceleration ramps instead of jumping.

   A corner is cut by a parabola: constant acceleration a along the bisector. A blend at speed v
   through the course change phi takes the time T = 2 v s / a with s = sin(phi / 2), begins
   v T / 2 = v^2 s / a before the corner and misses it by v T s / 4 = v^2 s^2 / (2 a), which bounds v
   by the cut allowed. */
#ifndef TRAJECTORY_H
#define TRAJECTORY_H

#include "elementary.h"

static const double SAME_POINT_M = 1e-3; /* closer points are one corner */
static const double ACROSS_MPS = 4.0;    /* more speed across the first leg is braked off at first */
static const double ALONG_MPS = 1.0;     /* so is more along it than its first corner allows */
static const double SPILL = 0.2;         /* of the acceptance radius: how far off the legs a blend may be
                                            outside of it */
static const double GRAVITY_MPS2 = 9.81;
static const double SAMPLE_S = 0.1; /* of power, where energy is summed */

/* Constant acceleration from `t0` on; `area` is the integral of position up to then. */
typedef struct {
    double t0, p[3], v[3], a[3], area[3];
} Piece;

/* Pieces (count,) averaged over twice `half`. */
typedef struct {
    const Piece *pieces;
    int64_t count;
    double half, start, end; /* s */
} Trajectory;

/* What guidance keeps to, by the names of `flightdyn.config.LimitsConfig`. */
typedef struct {
    double acceleration_mps2, vertical_acceleration_mps2, smoothing_s;
    double speed_mps, climb_mps, descent_mps, corner_cut;
} Steering;

/* A point of the path, several where they coincide, and the leg that ends there. */
typedef struct {
    double p[3], radius;
    int64_t passed;                  /* points of the path that are passed once it is */
    double u[3], length, top, accel; /* of the leg: direction, metres, m/s at most, m/s2 */
    double v, sine, bend;            /* speed here, sin(phi / 2), m/s2 of the blend */
    double normal[3]; /* of the plane of closest approach; zeros at a reversal and at the ends */
    double t, half;   /* when the reference is closest, half of the blend's duration */
} Vertex;

/* Straight legs, `flightdyn.guidance.path.FlightPath`, and what is made of them. */
typedef struct {
    int64_t count;
    double (*points)[3];         /* (count,) NED, two or more */
    double *speeds, *acceptance; /* (count - 1,) of the leg that ends at the next point, (count,) m */
    Vertex *at;                  /* (count,) */
    Piece *pieces;               /* (4 count,) */
    int64_t piece_count, legs;   /* pieces, and legs between vertices */
} PathProfile;

/* The air, and what flying in it takes: watts at 0, 1, 2, ... m/s at sea level. */
typedef struct {
    double density, wind[3]; /* over that at sea level; m/s */
    const double *watts;     /* (rows,) */
    int64_t rows;
} Air;

/* Whether a blend that misses its corner by `cut` is further than `SPILL` off the leg where it enters
   the circle of `radius` about the corner.

   With a = 1: v^2 = 2 cut / s^2; along the leg the blend is v^2 s - (v t - s t^2 / 2) before the
   corner, and off it by cos(phi / 2) t^2 / 2. It comes nearer up to its middle, at t = v s. */
static inline int strays(double cut, double sine, double radius)
{
    const double v = sqrt(2 * cut) / sine, before = v * v * sine;
    const double square = 1 - sine * sine, cosine = sqrt(square > 0 ? square : 0);
    const double off = SPILL * radius;
    if (before <= radius || cosine * (v * sine) * (v * sine) / 2 <= off) return 0;
    const double t = sqrt(2 * off / cosine);
    return size3(before - v * t + sine * t * t / 2, off, 0) > radius;
}

/* The largest cut, at most `share` of the acceptance radius, that strays from the legs by at most
   `SPILL` of it outside. */
static inline double allowed_cut(double sine, double radius, double share)
{
    double cut = share * radius;
    while (cut > 1e-6 && strays(cut, sine, radius)) cut *= 0.95;
    return cut;
}

/* The path's vertices when it is begun from `start` instead of its first point; returns the legs. */
static inline int64_t vertices_of(
    const PathProfile *path, const double start[3], const Steering *steering)
{
    Vertex *at = path->at;
    int64_t n = 0;
    at[0] = (Vertex){.p = {start[0], start[1], start[2]}, .radius = path->acceptance[0], .passed = 1};
    for (int64_t i = 1; i < path->count; i++) {
        const double *q = path->points[i], *p = at[n].p;
        const double d[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]}, length = size3(d[0], d[1], d[2]);
        const double radius = path->acceptance[i];
        if (length < SAME_POINT_M) {
            at[n].passed = i + 1;
            if (radius < at[n].radius) at[n].radius = radius;
            continue;
        }
        Vertex *end = at + ++n;
        *end = (Vertex){.p = {q[0], q[1], q[2]}, .radius = radius, .passed = i + 1, .length = length};
        for (int j = 0; j < 3; j++) end->u[j] = d[j] / length;
        end->top = fmin(path->speeds[i - 1], steering->speed_mps);
        end->accel = steering->acceleration_mps2;
        const double steep = fabs(end->u[2]);
        if (steep > 1e-6) {
            const double fastest = end->u[2] < 0 ? steering->climb_mps : steering->descent_mps;
            end->top = fmin(end->top, fastest / steep);
            end->accel = fmin(end->accel, steering->vertical_acceleration_mps2 / steep);
        }
    }
    return n;
}

/* Lower the speed at one end of a leg to what can be had from the other; whether it was higher. */
static inline int lower(const Vertex *leg, const Vertex *here, Vertex *there)
{
    const double v2 = here->v * here->v, room = leg->length - v2 * here->sine / here->bend;
    const double best =
        (v2 + 2 * leg->accel * room) / (1 + 2 * there->sine * leg->accel / there->bend);
    const double v = best > 0 ? sqrt(best) : 0;
    if (v >= there->v) return 0;
    there->v = v;
    return 1;
}

/* Set the speed at every vertex of one or more legs, 0 at the last; 0 where the velocity at the start
   does not fit the path. */
static inline int set_speeds(Vertex *at, int64_t legs, const Steering *steering, const double velocity[3])
{
    const double *u = at[1].u;
    const double along = velocity[0] * u[0] + velocity[1] * u[1] + velocity[2] * u[2];
    const double across =
        size3(velocity[0] - along * u[0], velocity[1] - along * u[1], velocity[2] - along * u[2]);
    at[0].v = fmin(along > 0 ? along : 0, at[1].top);
    at[0].bend = at[legs].bend = at[1].accel;
    for (int64_t i = 1; i < legs; i++) {
        const Vertex *a = at + i, *b = at + i + 1;
        const double s = size3(a->u[0] - b->u[0], a->u[1] - b->u[1], a->u[2] - b->u[2]) / 2;
        const double accel = fmin(a->accel, b->accel);
        double v = fmin(a->top, b->top);
        if (s > 1e-9) {
            const double cut = allowed_cut(s, a->radius, steering->corner_cut);
            v = fmin(v, sqrt(2 * accel * cut) / s);
            v = fmin(v, sqrt(accel * fmin(a->length, b->length) / (2 * s)));
        }
        at[i].v = v;
        at[i].sine = s;
        at[i].bend = accel;
    }
    /* What acceleration allows between corners: v1^2 <= v0^2 + 2 a (length - both half blends).
       Lowering a speed may shorten its blend, so that one sweep there and back need not do. */
    for (int64_t sweep = 0, lowered = 1; lowered && sweep < 2 * legs; sweep++) {
        lowered = 0;
        for (int64_t i = 0; i < legs; i++) lowered |= lower(at + i + 1, at + i, at + i + 1);
        for (int64_t i = legs; i > 0; i--) lowered |= lower(at + i, at + i, at + i - 1);
    }
    for (int64_t i = 0; i <= legs; i++) at[i].half = at[i].v * at[i].sine / at[i].bend;
    return across <= ACROSS_MPS && fabs(along - at[0].v) <= ALONG_MPS;
}

typedef struct {
    double v, a, s; /* speed at first, acceleration, duration */
} Part;

/* Speeding up, cruising and slowing down on the straight between the blends at a leg's ends. */
static inline void parts_of(const Vertex *end, Part parts[3])
{
    const Vertex *begin = end - 1;
    const double v0 = begin->v, v1 = end->v, a = end->accel;
    const double length = fmax(end->length - v0 * begin->half - v1 * end->half, 0);
    double top = fmin(end->top, sqrt(fmax((v0 * v0 + v1 * v1) / 2 + a * length, 0)));
    top = fmax(fmax(top, v0), v1);
    const double up = (top * top - v0 * v0) / (2 * a), down = (top * top - v1 * v1) / (2 * a);
    const double cruise = fmax(length - up - down, 0);
    parts[0] = (Part){v0, a, (top - v0) / a};
    parts[1] = (Part){top, 0, top > 0 ? cruise / top : 0};
    parts[2] = (Part){top, -a, (top - v1) / a};
}

/* Seconds (count,) after which each point of a path is passed from rest to rest; the last, which is
   returned, stands for its end. */
static inline double passing_times(const Vertex *at, int64_t legs, double smoothing, double *passed)
{
    double now = smoothing / 2;
    int64_t i = 1;
    passed[0] = 0;
    for (int64_t n = 1; n <= legs; n++) {
        Part parts[3];
        parts_of(at + n, parts);
        now += at[n - 1].half + parts[0].s + parts[1].s + parts[2].s + at[n].half;
        for (; i < at[n].passed; i++)
            passed[i] = n < legs || i < at[n - 1].passed ? now : now + smoothing / 2;
    }
    for (; i < at[legs].passed; i++) passed[i] = smoothing;
    return now + smoothing / 2;
}

/* A trajectory as far as it has been drawn. */
typedef struct {
    Piece *pieces;
    int64_t count;
    double t, p[3], area[3];
} Pen;

/* Append a piece of so many seconds; `end` is where it leads exactly, so that rounding does not add
   up, or NULL. */
static inline void draw(Pen *pen, const double v[3], const double a[3], double s, const double *end)
{
    if (!(s > 0)) return;
    Piece *piece = pen->pieces + pen->count++;
    const double s2 = s * s / 2, s3 = s2 * s / 3;
    piece->t0 = pen->t;
    pen->t += s;
    for (int i = 0; i < 3; i++) {
        const double p = pen->p[i];
        piece->p[i] = p;
        piece->v[i] = v[i];
        piece->a[i] = a[i];
        piece->area[i] = pen->area[i];
        pen->area[i] += p * s + v[i] * s2 + a[i] * s3;
        pen->p[i] = end ? end[i] : p + v[i] * s + a[i] * s2;
    }
}

/* The leg that ends at a vertex up to its blend, and half of the plane and all of the blend there. */
static inline void draw_leg(Pen *pen, Vertex *end, int is_last)
{
    Part parts[3];
    parts_of(end, parts);
    const double *u = end->u, v = end->v, before = v * v * end->sine / end->bend;
    const double stop[3] = {
        end->p[0] - u[0] * before, end->p[1] - u[1] * before, end->p[2] - u[2] * before};
    int final = 0;
    for (int i = 0; i < 3; i++)
        if (parts[i].s > 0) final = i;
    for (int i = 0; i < 3; i++) {
        const Part *part = parts + i;
        const double speed[3] = {u[0] * part->v, u[1] * part->v, u[2] * part->v};
        const double accel[3] = {u[0] * part->a, u[1] * part->a, u[2] * part->a};
        draw(pen, speed, accel, part->s, i == final ? stop : NULL);
    }
    end->t = pen->t;
    if (is_last) return;
    const double *out = end[1].u;
    double speed[3], accel[3], beyond[3];
    const double size = size3(out[0] + u[0], out[1] + u[1], out[2] + u[2]);
    for (int i = 0; i < 3; i++) {
        speed[i] = u[i] * v;
        accel[i] = end->half > 0 ? (out[i] - u[i]) * (v / (2 * end->half)) : 0;
        beyond[i] = end->p[i] + out[i] * before;
        end->normal[i] = size > 0.2 ? (out[i] + u[i]) / size : 0;
    }
    draw(pen, speed, accel, 2 * end->half, beyond);
    end->t = pen->t - end->half;
}

/* Draw the legs between vertices whose speeds are set; returns when the trajectory ends, before averaging. */
static inline double draw_legs(PathProfile *path, int64_t legs, Pen pen)
{
    static const double STILL[3] = {0, 0, 0};
    Vertex *at = path->at;
    at[0].t = pen.t;
    for (int64_t i = 1; i <= legs; i++) draw_leg(&pen, at + i, i == legs);
    const double end = pen.t; /* it stands still from then on */
    for (int i = 0; i < 3; i++) pen.p[i] = at[legs].p[i];
    draw(&pen, STILL, STILL, 1, NULL);
    path->piece_count = pen.count;
    path->legs = legs;
    return end;
}

/* Compute the trajectory along a path from its first point. A velocity at the start that leads along the
   first leg is kept, unless it is `braking`; any other is braked off first, on the present course.
   Returns when it ends, before averaging. */
static inline double compute_trajectory(
    PathProfile *path, const Steering *steering, const double velocity[3], int braking)
{
    static const double STILL[3] = {0, 0, 0};
    const double *start = path->points[0];
    Vertex *at = path->at;
    Pen pen = {.pieces = path->pieces, .p = {start[0], start[1], start[2]}};
    int64_t n = vertices_of(path, start, steering);
    if (braking || !n || !set_speeds(at, n, steering, velocity)) {
        const double speed = size3(velocity[0], velocity[1], velocity[2]);
        const double share = -steering->acceleration_mps2 / speed;
        const double accel[3] = {velocity[0] * share, velocity[1] * share, velocity[2] * share};
        if (speed > 0.05) draw(&pen, velocity, accel, speed / steering->acceleration_mps2, NULL);
        n = vertices_of(path, pen.p, steering);
        if (n) set_speeds(at, n, steering, STILL);
    }
    return draw_legs(path, n, pen);
}

/* The piece of an instant, or the first one. */
static inline const Piece *piece_at(const Trajectory *path, double t)
{
    int64_t low = 0, high = path->count; /* the first that begins later lies from low to high */
    while (low < high) {
        const int64_t middle = (low + high) / 2;
        if (path->pieces[middle].t0 <= t) low = middle + 1;
        else high = middle;
    }
    return path->pieces + (low ? low - 1 : 0);
}

/* Before averaging: the integral of position, position and velocity, on the instant's piece. */
static inline void drawn_at(const Piece *piece, double t, double area[3], double p[3], double v[3])
{
    const double s = t - piece->t0, s2 = s * s / 2, s3 = s2 * s / 3;
    for (int i = 0; i < 3; i++) {
        const double a = s < 0 ? 0 : piece->a[i]; /* before the first piece: at its speed */
        area[i] = piece->area[i] + piece->p[i] * s + piece->v[i] * s2 + a * s3;
        p[i] = piece->p[i] + piece->v[i] * s + a * s2;
        v[i] = piece->v[i] + a * s;
    }
}

static inline void unsmoothed(const Trajectory *path, double t, double area[3], double p[3], double v[3])
{
    drawn_at(piece_at(path, t), t, area, p, v);
}

/* Watts of level flight at a speed through the air: a table; other air scales it by equivalent airspeed. */
static inline double level_power_at(double speed, double root, const Air *air)
{
    const double x = speed * root, last = (double)(air->rows - 1);
    const double within = x < last ? x : last;
    const int64_t row = (int64_t)within, i = row < air->rows - 2 ? row : air->rows - 2;
    return air->watts[i] + (air->watts[i + 1] - air->watts[i]) * (within - (double)i);
}

/* Watts of the whole aircraft at a speed through the air and a size of acceleration.

   Rotors that also accelerate the mass push with m sqrt(g^2 + a^2). That adds to level flight what it adds
   in a hover, where power goes with thrust to 3/2 (momentum theory): drag takes no more. */
static inline double power_at(double speed, double accel, const Air *air)
{
    const double root = sqrt(air->density), level = level_power_at(speed, root, air);
    const double push = sqrt(1 + accel * accel / (GRAVITY_MPS2 * GRAVITY_MPS2));
    return (level + air->watts[0] * (push * sqrt(push) - 1)) / root;
}

/* Samples of power worked out at once, those of one turn of vector instructions, and room for a turn more. */
enum { SOME = 64, FEW = 8, ROOM = SOME + FEW };

/* Fill in position (rows 0 to 2) and velocity (3 to 5) at times `t`, shifted by `away`, of samples on a piece
   from `s` on, of `some`, along so many axes; returns the first one after it. What is written beyond is
   written again. */
static inline int64_t fill_along(
    const Piece *piece, const Piece *last, int axes, double away, double step, int64_t s, int64_t some,
    const double *t, double (*at)[ROOM])
{
    const int early = t[s] + away < piece->t0; /* before the first piece: at its speed */
    const double until = early ? piece->t0 : piece < last ? piece[1].t0 : INFINITY;
    const double guess = (until - away - t[s]) / step;
    int64_t end = guess < (double)(some - s) ? s + 1 + (int64_t)guess : some;
    end = end < some ? end : some;
    while (end > s + 1 && !(t[end - 1] + away < until)) end--;
    while (end < some && t[end] + away < until) end++;
    for (int i = 0; i < axes; i++) {
        const double t0 = piece->t0, from = piece->p[i], speed = piece->v[i], a = early ? 0 : piece->a[i];
        for (int64_t first = s; first < end; first += FEW)
            for (int64_t n = first; n < first + FEW; n++) {
                const double since = t[n] + away - t0;
                at[i][n] = from + speed * since + a * (since * since / 2);
                at[i + 3][n] = speed + a * since;
            }
    }
    return end;
}

/* Watts of a few samples from `s` on, from both ends of the window about each. */
static inline void watts_of(
    double (*before)[ROOM], double (*after)[ROOM], int axes, int64_t s, double half, const Air *air,
    double *watts)
{
    const double root = sqrt(air->density);
    double speed[FEW], accel[FEW];
    int64_t steady = 1; /* the table alone says what it takes */
    for (int n = 0; n < FEW; n++) {
        double flown[3] = {0}, gained[3] = {0};
        for (int i = 0; i < axes; i++) {
            flown[i] = (after[i][s + n] - before[i][s + n]) / (2 * half);
            gained[i] = after[i + 3][s + n] - before[i + 3][s + n];
        }
        steady &= gained[0] == 0 && gained[1] == 0 && gained[2] == 0;
        speed[n] = size3(flown[0] - air->wind[0], flown[1] - air->wind[1], flown[2] - air->wind[2]);
    }
    if (steady) {
        for (int n = 0; n < FEW; n++) watts[n] = level_power_at(speed[n], root, air) / root;
        return;
    }
    for (int n = 0; n < FEW; n++) {
        double gained[3] = {0};
        for (int i = 0; i < axes; i++)
            gained[i] = (after[i + 3][s + n] - before[i + 3][s + n]) / (2 * half);
        accel[n] = size3(gained[0], gained[1], gained[2]);
    }
    for (int n = 0; n < FEW; n++) watts[n] = power_at(speed[n], accel[n], air);
}

/* Joules of a trajectory from its start to its end, in samples of power; several at once are worked out
   by vector instructions. */
static inline double joules_of(const Trajectory *path, const Air *air)
{
    const double moving = path->end - path->start;
    const int64_t count = (int64_t)ceil(moving / SAMPLE_S);
    const double step = moving / (double)count;
    const Piece *at[2] = {path->pieces, path->pieces}, *last = path->pieces + path->count - 1;
    double total = 0, t[ROOM], ends[2][6][ROOM] = {{{0}}}, watts[SOME];
    int level = 1;
    for (const Piece *piece = path->pieces; piece <= last; piece++)
        level &= piece->p[2] == 0 && piece->v[2] == 0 && piece->a[2] == 0;
    for (int64_t first = 0; first <= count; first += SOME) {
        const int64_t some = count + 1 - first < SOME ? count + 1 - first : SOME;
        for (int64_t s = 0; s < ROOM; s++) t[s] = path->start + step * (double)(first + s);
        if (first + some > count) t[some - 1] = path->end;
        for (int side = 0; side < 2; side++) {
            const double away = side ? path->half : -path->half;
            for (int64_t s = 0; s < some;) {
                while (at[side] < last && at[side][1].t0 <= t[s] + away) at[side]++;
                s = fill_along(at[side], last, level ? 2 : 3, away, step, s, some, t, ends[side]);
            }
        }
        for (int64_t s = 0; s < some; s += FEW)
            if (level) watts_of(ends[0], ends[1], 2, s, path->half, air, watts + s);
            else watts_of(ends[0], ends[1], 3, s, path->half, air, watts + s);
        if (!first) watts[0] /= 2;
        if (first + some > count) watts[some - 1] /= 2;
        for (int64_t s = 0; s < some; s++) total += watts[s];
    }
    return total * step;
}

/* What the flight along a path takes from rest to rest: when each point is passed (count,), and, where
   there is air, its joules; returns its seconds. */
static inline double foresee_path(
    PathProfile *path, const Steering *steering, const Air *air, double *passed, double *joules)
{
    static const double STILL[3] = {0, 0, 0};
    const int64_t legs = vertices_of(path, path->points[0], steering);
    if (legs) set_speeds(path->at, legs, steering, STILL);
    const double moving = passing_times(path->at, legs, steering->smoothing_s, passed);
    if (air) {
        const double half = fmax(steering->smoothing_s / 2, 1e-3);
        const double *start = path->points[0];
        const Pen pen = {.pieces = path->pieces, .p = {start[0], start[1], start[2]}};
        const double end = draw_legs(path, legs, pen);
        const Trajectory trajectory = {
            .pieces = path->pieces, .count = path->piece_count, .half = half, .start = -half,
            .end = end + half};
        *joules = joules_of(&trajectory, air);
    }
    return moving;
}

#endif
