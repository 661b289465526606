/* Who is served at which step, for fixed positions. */
#ifndef MATCHING_H
#define MATCHING_H

#include "assignment.h"

/* Memory for the assignment of K devices to N steps. */
typedef struct {
    int64_t *load; /* (N,) */
    double *best;  /* (K,) what each earns at its nearest step */
    double *x, *y; /* (N,) of the path, filled up with a point out of reach */
    Places places;
} Matching;

static Matching lay_out_matching(Arena *arena, int64_t devices, const Limits *limits)
{
    return (Matching){
        .load = claim(arena, limits->steps, sizeof(int64_t)),
        .best = claim(arena, devices, sizeof(double)),
        .x = claim(arena, wides(limits->steps), sizeof(Wide)),
        .y = claim(arena, wides(limits->steps), sizeof(Wide)),
        .places = lay_out_places(arena, devices, limits->steps, limits->per_step),
    };
}

/* A path, who is served from its points (-1: not at all), and what that earns. */
typedef struct {
    Point *way;        /* (N,) */
    int64_t *assigned; /* (K,) */
    double value;
} Plan;

static Plan lay_out_plan(Arena *arena, int64_t devices, int64_t steps)
{
    return (Plan){
        .way = claim(arena, steps, sizeof(Point)),
        .assigned = claim(arena, devices, sizeof(int64_t)),
    };
}

static void copy_plan(const Plan *from, Plan *to, int64_t devices, int64_t steps)
{
    memcpy(to->way, from->way, (size_t)steps * sizeof(Point));
    memcpy(to->assigned, from->assigned, (size_t)devices * sizeof(int64_t));
    to->value = from->value;
}

/* The step nearest to a point, the first of equals, and the square of its distance. */
static inline int64_t nearest_step(const Matching *memory, int64_t steps, Point p, double *square)
{
    const Wide *x = (const Wide *)memory->x, *y = (const Wide *)memory->y;
    const Mask all = (Mask){0} - 1;
    Least least = begin_least(INFINITY);
    for (int64_t n = 0, end = wides(steps); n < end; n++) {
        const Wide dx = x[n] - p.x, dy = y[n] - p.y;
        offer_wide(&least, dx * dx + dy * dy, all);
    }
    return end_least(&least, square);
}

/* Coincident steps share the load: a later one only if the earlier ones are full. */
static int64_t with_room(
    const Matching *memory, const Limits *limits, Point p, int64_t nearest, double square)
{
    for (int64_t n = nearest + 1; n < limits->steps; n++) {
        if (memory->load[nearest] < limits->per_step) return nearest;
        const double dx = memory->x[n] - p.x, dy = memory->y[n] - p.y;
        if (dx * dx + dy * dy == square) nearest = n;
    }
    return nearest;
}

/* Assign every device to a step of the plan's path so that the most is earned.

   Every device goes to its nearest step; where that overfills one, the assignment problem is
   solved. */
static void match(Plan *plan, const Limits *limits, const Devices *devices, const Matching *memory)
{
    int64_t *load = memory->load, *assigned = plan->assigned;
    double *best = memory->best, total = 0.0;
    int fits = 1;
    for (int64_t n = 0; n < LENGTH * wides(limits->steps); n++) {
        memory->x[n] = n < limits->steps ? plan->way[n].x : INFINITY;
        memory->y[n] = n < limits->steps ? plan->way[n].y : INFINITY;
    }
    for (int64_t n = 0; n < limits->steps; n++) load[n] = 0;
    for (int64_t k = 0; k < devices->count; k++) {
        double near;
        int64_t nearest = nearest_step(memory, limits->steps, devices->at[k], &near);
        if (load[nearest] >= limits->per_step)
            nearest = with_room(memory, limits, devices->at[k], nearest, near);
        double f = reward(sqrt(near), devices).f;
        if (f <= 0.0) {
            assigned[k] = -1;
            best[k] = 0.0;
            continue;
        }
        assigned[k] = nearest;
        load[nearest] += 1;
        best[k] = devices->delta[k] * f;
        total += best[k];
        if (load[nearest] > limits->per_step) fits = 0;
    }
    if (!fits) {
        memset(memory->places.known, 0, (size_t)devices->count);
        solve_assignment(plan->way, devices, devices->count, best, assigned, &memory->places);
        total = earned(plan->way, assigned, devices);
    }
    plan->value = total;
}

/* The n-th largest (n from 1) of the values, by quickselect (Hoare 1961); reorders them so that no
   larger one stands behind it. */
static double nth_largest(double *values, int64_t count, int64_t n)
{
    int64_t low = 0, high = count - 1, target = n - 1;
    while (low < high) {
        double pivot = values[(low + high) / 2];
        int64_t i = low, j = high;
        while (i <= j) {
            while (values[i] > pivot) i++;
            while (values[j] < pivot) j--;
            if (i <= j) {
                double value = values[i];
                values[i++] = values[j];
                values[j--] = value;
            }
        }
        if (target <= j)
            high = j;
        else if (target >= i)
            low = i;
        else
            break;
    }
    return values[target];
}

#endif
