/* Good plans for any number of devices: many rough ones, of which the best are mended.

   Where the path heads decides most of what it earns, and no small change turns it round: paths
   are built towards devices all over the area, and the best few kept. Those are improved by taking
   a stretch out, filling the gap by insertions that look at the nearest neighbours of a device
   only, polishing, and keeping the result unless it earns less by more than a tolerance that falls
   to nothing (threshold accepting, Dueck and Scheuer 1990). */
#ifndef EXPLORATION_H
#define EXPLORATION_H

#include "ascent.h"
#include "insertion.h"

enum { POOL = 4 };                     /* rough plans that are mended */
static const double TOLERANCE = 0.01;  /* of the value, at the first try */
static const int64_t LONGEST_CUT = 20; /* stops */
static const double HOPELESS = 0.85; /* of the present value: below it after one ascent, give up */
static const double ROUGH = 1e-4;    /* relative rise worth a turn while plans are compared */
static const double SAME = 1e-6;     /* relative difference under which two plans are one */
static const double EXCESS = 0.05;   /* of the length: polishing rounds corners */

/* Memory for an exploration, and what it has found so far. */
typedef struct {
    Lists lists;
    Draft draft;
    Plan pool[POOL]; /* the best plans so far, best first; of value -1 where there is none */
    int64_t *anchors; /* (starts,) */
    double *away;     /* (K,) */
    uint64_t state;   /* of the random numbers */
    Polish polish;
    Plan made, present; /* the plan last made, and the one that is mended */
} Exploration;

static void lay_out_exploration(
    Exploration *all, Arena *arena, int64_t devices, const Limits *limits, int64_t starts)
{
    all->lists = lay_out_lists(arena, devices);
    all->draft = lay_out_draft(arena, devices, limits);
    for (int p = 0; p < POOL; p++) {
        all->pool[p] = lay_out_plan(arena, devices, limits->steps);
        all->pool[p].value = -1.0;
    }
    all->anchors = claim(arena, starts, sizeof(int64_t));
    all->away = claim(arena, devices, sizeof(double));
    all->state = 0x9E3779B97F4A7C15u;
    all->polish = lay_out_polish(arena, devices, limits, limits->steps);
    all->made = lay_out_plan(arena, devices, limits->steps);
    all->present = lay_out_plan(arena, devices, limits->steps);
}

/* Uniform in [0, 1) from a 64-bit xorshift (Marsaglia 2003): the same on every machine. */
static double next_random(uint64_t *state)
{
    uint64_t x = *state;
    x ^= x << 13;
    x ^= x >> 7;
    x ^= x << 17;
    *state = x;
    return (double)(x >> 11) / 9007199254740992.0;
}

/* Fill `anchors` with devices in reach, each as far as can be from the start and the ones before
   it; returns how many there are. */
static int64_t spread_out(const Devices *devices, double length, int64_t wanted, Exploration *all)
{
    double *away = all->away;
    for (int64_t k = 0; k < devices->count; k++) {
        away[k] = between(devices->at[k], (Point){0.0, 0.0});
        if (away[k] > length) away[k] = -1.0;
    }
    for (int64_t i = 0; i < wanted; i++) {
        int64_t far = 0;
        for (int64_t k = 0; k < devices->count; k++)
            if (away[k] > away[far]) far = k;
        if (away[far] <= 1.0) return i;
        all->anchors[i] = far;
        for (int64_t k = 0; k < devices->count; k++)
            away[k] = least(away[k], between(devices->at[k], devices->at[far]));
    }
    return wanted;
}

/* Take the plan last made into the pool, unless that has better ones only, or this one already. */
static void enter(Exploration *all, int64_t devices, int64_t steps)
{
    Plan *pool = all->pool;
    double value = all->made.value;
    int p = POOL - 1;
    if (value <= pool[p].value) return;
    for (int i = 0; i < POOL; i++)
        if (fabs(value - pool[i].value) <= SAME * value) return;
    Plan last = pool[p];
    for (; p > 0 && pool[p - 1].value < value; p--) pool[p] = pool[p - 1];
    pool[p] = last;
    copy_plan(&all->made, &pool[p], devices, steps);
}

/* Improve a plan by `tries` stretches taken out and filled anew. */
static void mend(
    const Devices *devices, const Limits *limits, int64_t tries, Plan *plan, Exploration *all)
{
    int64_t steps = limits->steps;
    Plan *present = &all->present, *made = &all->made;
    copy_plan(plan, present, devices->count, steps);
    for (int64_t attempt = 0; attempt < tries; attempt++) {
        int64_t cut =
            1 + (int64_t)(next_random(&all->state) * (double)fewer(LONGEST_CUT, steps - 1));
        int64_t first = 1 + (int64_t)(next_random(&all->state) * (double)(steps - cut));
        double power = 0.5 * (double)(int64_t)(next_random(&all->state) * 3.0);
        double length = limits->length * (1.0 + 2.0 * EXCESS * next_random(&all->state));
        cut_out(
            present->way, present->assigned, devices, steps, first, first + cut, &all->draft);
        extend(devices, limits, &all->lists, length, power, &all->draft);
        polish(
            all->draft.points, all->draft.count, limits, devices, HOPELESS * present->value, ROUGH,
            made, &all->polish);
        double tolerance = TOLERANCE * (1.0 - (double)attempt / (double)tries);
        if (made->value > present->value * (1.0 - tolerance * next_random(&all->state))) {
            copy_plan(made, present, devices->count, steps);
            if (made->value > plan->value) copy_plan(made, plan, devices->count, steps);
        }
    }
}

/* A first path towards anchor i, or towards none where i < 0, into the pool. */
static void start(
    int64_t i, const Devices *devices, const Limits *limits, Exploration *all)
{
    Draft *draft = &all->draft;
    double power = 0.0, length = limits->length * (1.0 + EXCESS);
    for (int64_t k = 0; k < devices->count; k++) draft->have[k] = cost_of(devices, k);
    draft->points[0] = (Point){0.0, 0.0};
    draft->count = 1;
    if (i >= 0) {
        draft->points[draft->count++] = devices->at[all->anchors[i]];
        serve(all->anchors[i], devices, &all->lists, draft);
    } else {
        power = -0.5 * (double)(i + 1);
        length = limits->length;
    }
    extend(devices, limits, &all->lists, length, power, draft);
    polish(
        draft->points, draft->count, limits, devices, HOPELESS * all->pool[POOL - 1].value, ROUGH,
        &all->made, &all->polish);
    enter(all, devices->count, limits->steps);
}

/* The best of paths towards devices all over the area, after `tries` changes, into `plan`. */
static void find_plan(
    const Devices *devices, const Limits *limits, int64_t starts, int64_t tries, Plan *plan,
    Exploration *all)
{
    fill_lists(devices, &all->lists);
    int64_t reachable = spread_out(devices, limits->length, starts, all);
    for (int64_t i = -3; i < reachable; i++) start(i, devices, limits, all);
    Plan *best = &all->pool[0];
    for (Plan *one = all->pool; one < all->pool + POOL; one++)
        if (one->value > 0.0) {
            mend(devices, limits, tries / (2 * POOL), one, all);
            if (one->value > best->value) best = one;
        }
    mend(devices, limits, tries - tries / 2, best, all);
    polish(
        best->way, limits->steps, limits, devices, 0.0, FINE, &all->made, &all->polish);
    copy_plan(all->made.value > best->value ? &all->made : best, plan, devices->count, limits->steps);
}

#endif
