/* From a rough path to a local optimum: Newton ascent on the chain of waypoints.

   For a fixed assignment the reward is sum_k delta_k f(|v_n(k) - u_k|), smooth but not concave, and
   the path may be L long. One step solves the chain's block-tridiagonal system with the clipped
   Hessian of the reward, the curvature of the length weighed by its multiplier, and damping; the
   path is then shrunk about the start onto L, and kept if it earns more. */
#ifndef ASCENT_H
#define ASCENT_H

#include "chain.h"
#include "matching.h"

static const double SMOOTHING_M = 0.5; /* a leg of length e counts as sqrt(e^2 + smoothing^2) */
static const double RISE = 1e-6;       /* relative rise that is worth another step */
static const double FINE = 1e-5;       /* and another turn of assignment and ascent */
enum { MAX_ROUNDS = 12, MAX_STEPS = 12, MAX_DAMPINGS = 6 };

/* A symmetric 2x2 matrix. */
typedef struct {
    double xx, xy, yy;
} Sym;

/* One waypoint of the chain's quadratic model. */
typedef struct {
    Point slope, length_slope;
    Sym here, next; /* diagonal block, and that to the next waypoint */
} Knot;

/* Its row of the system's solution. */
typedef struct {
    Point step, length_step; /* towards more reward, and towards more length */
    Sym inverse;             /* of the pivot */
} Solved;

/* Memory for polishing. */
typedef struct {
    Point *draft; /* (N or more,) */
    Plan present;
    unsigned char *used; /* (N,) steps that serve somebody */
    Point *trial;        /* (N,) */
    Knot *knot;          /* (N,) */
    Solved *solved;      /* (N,) */
    Spare spare;
    Matching matching;
} Polish;

static Polish lay_out_polish(Arena *arena, int64_t devices, const Limits *limits, int64_t points)
{
    int64_t steps = limits->steps;
    return (Polish){
        .draft = claim(arena, points > steps ? points : steps, sizeof(Point)),
        .present = lay_out_plan(arena, devices, steps),
        .used = claim(arena, steps, 1),
        .trial = claim(arena, steps, sizeof(Point)),
        .knot = claim(arena, steps, sizeof(Knot)),
        .solved = claim(arena, steps, sizeof(Solved)),
        .spare = lay_out_spare(arena, devices, steps),
        .matching = lay_out_matching(arena, devices, limits),
    };
}

static inline void add_to(Sym *sum, Sym part)
{
    sum->xx += part.xx;
    sum->xy += part.xy;
    sum->yy += part.yy;
}

/* around I + (radial - around) n n', for a unit vector n. */
static inline Sym along(double radial, double around, double nx, double ny)
{
    return (Sym){
        around + (radial - around) * nx * nx, (radial - around) * nx * ny,
        around + (radial - around) * ny * ny};
}

/* Fill `knot` for a path; returns the mean curvature of the reward. */
static double model(
    const Plan *plan, int64_t steps, const Devices *devices, double mu, Knot *knot)
{
    const Point *way = plan->way;
    memset(knot, 0, (size_t)steps * sizeof(Knot));
    double trace = 0.0;
    for (int64_t k = 0; k < devices->count; k++) {
        int64_t n = plan->assigned[k];
        if (n < 1) continue;
        double dx = way[n].x - devices->at[k].x, dy = way[n].y - devices->at[k].y;
        double r = sqrt(dx * dx + dy * dy), delta = devices->delta[k];
        if (devices->grid) { /* steps of about a patch at most: what is beyond it is another matter */
            const Point slope = spot_at(devices->grid, k, way[n]).slope;
            const double bend = delta * between(slope, (Point){0.0, 0.0}) / devices->grid->cell;
            knot[n].slope.x += delta * slope.x;
            knot[n].slope.y += delta * slope.y;
            add_to(&knot[n].here, (Sym){bend, 0.0, bend});
            trace += 2.0 * bend;
            continue;
        }
        Reward at = reward(r, devices);
        double radial = most(0.0, -delta * at.bend), around = radial, nx = 1.0, ny = 0.0;
        if (r > 1e-6) {
            nx = dx / r;
            ny = dy / r;
            around = most(0.0, -delta * at.slope / r);
        }
        knot[n].slope.x += delta * at.slope * nx;
        knot[n].slope.y += delta * at.slope * ny;
        add_to(&knot[n].here, along(radial, around, nx, ny));
        trace += radial + around;
    }
    for (int64_t n = 1; n < steps; n++) {
        double ex = way[n].x - way[n - 1].x, ey = way[n].y - way[n - 1].y;
        double q = sqrt(ex * ex + ey * ey + SMOOTHING_M * SMOOTHING_M);
        double gx = ex / q, gy = ey / q;
        Sym bend = {mu * (1.0 - gx * gx) / q, -mu * gx * gy / q, mu * (1.0 - gy * gy) / q};
        knot[n].length_slope.x += gx;
        knot[n].length_slope.y += gy;
        add_to(&knot[n].here, bend);
        if (n > 1) {
            knot[n - 1].length_slope.x -= gx;
            knot[n - 1].length_slope.y -= gy;
            add_to(&knot[n - 1].here, bend);
            knot[n - 1].next = (Sym){-bend.xx, -bend.xy, -bend.yy};
        }
    }
    return trace / (2.0 * (double)(steps > 2 ? steps - 1 : 1));
}

static inline Point times(Sym a, Point p)
{
    return (Point){a.xx * p.x + a.xy * p.y, a.xy * p.x + a.yy * p.y};
}

static inline Point less(Point a, Point b) { return (Point){a.x - b.x, a.y - b.y}; }

static inline Sym inverse_of(Sym a)
{
    double det = a.xx * a.yy - a.xy * a.xy;
    return (Sym){a.yy / det, -a.xy / det, a.xx / det};
}

/* (blocks + damping) solved = slope and length slope, by block elimination. */
static void solve_chain(int64_t steps, const Knot *knot, double damping, Solved *solved)
{
    for (int64_t n = 1; n < steps; n++) {
        Sym pivot = knot[n].here;
        pivot.xx += damping;
        pivot.yy += damping;
        solved[n].step = knot[n].slope;
        solved[n].length_step = knot[n].length_slope;
        if (n > 1) {
            Sym o = knot[n - 1].next, i = solved[n - 1].inverse;
            double mxx = o.xx * i.xx + o.xy * i.xy, mxy = o.xx * i.xy + o.xy * i.yy;
            double myx = o.xy * i.xx + o.yy * i.xy, myy = o.xy * i.xy + o.yy * i.yy;
            Point p = solved[n - 1].step, q = solved[n - 1].length_step;
            pivot.xx -= mxx * o.xx + mxy * o.xy;
            pivot.xy -= mxx * o.xy + mxy * o.yy;
            pivot.yy -= myx * o.xy + myy * o.yy;
            solved[n].step.x -= mxx * p.x + mxy * p.y;
            solved[n].step.y -= myx * p.x + myy * p.y;
            solved[n].length_step.x -= mxx * q.x + mxy * q.y;
            solved[n].length_step.y -= myx * q.x + myy * q.y;
        }
        solved[n].inverse = inverse_of(pivot);
    }
    for (int64_t n = steps - 1; n > 0; n--) {
        Solved *s = &solved[n];
        if (n + 1 < steps) {
            s->step = less(s->step, times(knot[n].next, s[1].step));
            s->length_step = less(s->length_step, times(knot[n].next, s[1].length_step));
        }
        s->step = times(s->inverse, s->step);
        s->length_step = times(s->inverse, s->length_step);
    }
}

/* Newton ascent of the plan's path for a fixed assignment; raises its value, and leaves the
   length's multiplier in `mu`. The path starts within the length, and stays so. */
static void climb(
    Plan *plan, const Devices *devices, const Limits *limits, double *mu, const Polish *memory)
{
    int64_t steps = limits->steps;
    Point *way = plan->way, *trial = memory->trial;
    const Knot *knot = memory->knot;
    const Solved *solved = memory->solved;
    double damping = 0.01;
    trial[0] = way[0];
    plan->value = earned(way, plan->assigned, devices);
    for (int step = 0; step < MAX_STEPS; step++) {
        double curvature = model(plan, steps, devices, *mu, memory->knot);
        double slack = limits->length - chain_length(way, steps), before = plan->value;
        int moved = 0;
        for (int attempt = 0; attempt < MAX_DAMPINGS && !moved; attempt++) {
            solve_chain(steps, knot, damping * curvature + 1e-12, memory->solved);
            double along_reward = 0.0, along_length = 0.0, nu = 0.0;
            for (int64_t n = 1; n < steps; n++) {
                Point l = knot[n].length_slope, s = solved[n].step, t = solved[n].length_step;
                along_reward += l.x * s.x + l.y * s.y;
                along_length += l.x * t.x + l.y * t.y;
            }
            if (along_length > 0.0) nu = most(0.0, (along_reward - slack) / along_length);
            for (int64_t n = 1; n < steps; n++) {
                trial[n].x = way[n].x + solved[n].step.x - nu * solved[n].length_step.x;
                trial[n].y = way[n].y + solved[n].step.y - nu * solved[n].length_step.y;
            }
            shrink(trial, steps, limits->length);
            double better = earned(trial, plan->assigned, devices);
            if (better > plan->value) {
                memcpy(way, trial, (size_t)steps * sizeof(Point));
                plan->value = better;
                *mu = nu;
                damping = most(damping * 0.2, 1e-6);
                moved = 1;
            } else {
                damping = most(damping * 8.0, 1e-3);
            }
        }
        if (!moved || plan->value - before <= RISE * plan->value) return;
    }
}

/* Take the steps of the present plan that serve nobody out, and put them to better use. */
static void use_idle_steps(const Polish *memory, const Limits *limits, const Devices *devices)
{
    const Plan *present = &memory->present;
    int64_t kept = 0;
    for (int64_t n = 0; n < limits->steps; n++) memory->used[n] = n == 0;
    for (int64_t k = 0; k < devices->count; k++)
        if (present->assigned[k] >= 0) memory->used[present->assigned[k]] = 1;
    for (int64_t n = 0; n < limits->steps; n++)
        if (memory->used[n]) memory->draft[kept++] = present->way[n];
    fill_spare(memory->draft, kept, limits->steps, devices, &memory->spare);
    memcpy(present->way, memory->draft, (size_t)limits->steps * sizeof(Point));
}

/* The best plan near a path of `count` points (the first is the start), into `plan`.

   Points too many are merged, spare ones put to use, then assignment and ascent alternate until
   a turn raises the value by less than the share `rise`; no further if an ascent ends under
   `hopeless`. */
static void polish(
    const Point *points, int64_t count, const Limits *limits, const Devices *devices,
    double hopeless, double rise, Plan *plan, Polish *memory)
{
    int64_t steps = limits->steps;
    Point *draft = memory->draft;
    Plan *present = &memory->present;
    double best = -1.0, mu = 0.0;
    memcpy(draft, points, (size_t)count * sizeof(Point));
    for (; count > steps; count--) merge_nearest(draft, count);
    fill_spare(draft, count, steps, devices, &memory->spare);
    shrink(draft, steps, limits->length);
    memcpy(present->way, draft, (size_t)steps * sizeof(Point));
    for (int turn = 0; turn < MAX_ROUNDS; turn++) {
        match(present, limits, devices, &memory->matching);
        if (present->value > best) copy_plan(present, plan, devices->count, steps);
        if (present->value <= best * (1.0 + rise)) {
            best = most(best, present->value);
            break;
        }
        best = present->value;
        climb(present, devices, limits, &mu, memory);
        if (present->value > best) {
            best = present->value;
            copy_plan(present, plan, devices->count, steps);
        }
        if (best < hopeless) break;
        use_idle_steps(memory, limits, devices);
    }
    plan->value = best;
}

#endif
