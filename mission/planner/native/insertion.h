/* Paths made of stops above devices: the best insertions, and stretches taken out again. */
#ifndef INSERTION_H
#define INSERTION_H

#include "arena.h"
#include "rewards.h"

/* Neighbour lists: who is served well by a stop above a device. */

enum { MOST_NEIGHBOURS = 24 };
static const double LEAST_SHARE = 1e-3; /* of the best f: where a neighbour is too far to matter */

/* A stop above device k serves `neighbour[begin[k]..begin[k + 1]]`, the nearest first. */
typedef struct {
    int64_t *begin;     /* (K + 1,) */
    int64_t *neighbour; /* (E,) */
    double *share;      /* (E,) f at their distance */
} Lists;

static Lists lay_out_lists(Arena *arena, int64_t devices)
{
    const int64_t entries = devices * fewer(MOST_NEIGHBOURS, devices);
    return (Lists){
        .begin = claim(arena, devices + 1, sizeof(int64_t)),
        .neighbour = claim(arena, entries, sizeof(int64_t)),
        .share = claim(arena, entries, sizeof(double)),
    };
}

/* f at a distance, between the rows of the table. */
static double share_at(double r, const Devices *devices)
{
    const int64_t i = (int64_t)r;
    if (i + 1 >= devices->rows) return devices->table[3 * (devices->rows - 1)];
    const double f = devices->table[3 * i];
    return f + (devices->table[3 * (i + 1)] - f) * (r - (double)i);
}

static double reach_of(const Devices *devices)
{
    int64_t row = 0;
    while (row < devices->rows && !(devices->table[3 * row] < LEAST_SHARE * devices->table[0])) row++;
    return (double)row;
}

/* The nearest devices within reach of device k, itself among them; returns how many. */
static int64_t nearest_devices(
    int64_t k, double reach, const Devices *devices, int64_t *who, double *square)
{
    int64_t count = 0;
    for (int64_t j = 0; j < devices->count; j++) {
        const double here = square_between(devices->at[j], devices->at[k]);
        if (!(here < reach * reach) || (count == MOST_NEIGHBOURS && here >= square[count - 1]))
            continue;
        int64_t i = count < MOST_NEIGHBOURS ? count++ : count - 1;
        for (; i > 0 && square[i - 1] > here; i--) {
            square[i] = square[i - 1];
            who[i] = who[i - 1];
        }
        square[i] = here;
        who[i] = j;
    }
    return count;
}

static void fill_lists(const Devices *devices, const Lists *lists)
{
    const double reach = devices->grid ? INFINITY : reach_of(devices);
    int64_t who[MOST_NEIGHBOURS];
    double square[MOST_NEIGHBOURS];
    for (int64_t k = 0; k < devices->count; k++) {
        const int64_t count = nearest_devices(k, reach, devices, who, square), at = lists->begin[k];
        for (int64_t i = 0; i < count; i++) {
            lists->neighbour[at + i] = who[i];
            lists->share[at + i] = devices->grid ? spot_at(devices->grid, who[i], devices->at[k]).f
                                                 : share_at(sqrt(square[i]), devices);
        }
        lists->begin[k + 1] = at + count;
    }
}

/* A path under construction. */
typedef struct {
    int64_t count, places; /* points so far; devices that a stop serves at most */
    Point *points;         /* (N,) the start first */
    double *have;          /* (K,) what each device brings so far, or its price if that is more */
    double *worth;         /* (K,) what a stop above the device would add; below 0: not known */
    double *metres;        /* (K,) shortest detour to it */
    double *ease;          /* (K,) metres^-power */
    int64_t *leg;          /* (K,) where that detour leaves the path */
    double *legs;          /* (N,) length of the leg behind each point */
    double *top;           /* (places,) */
} Draft;

static Draft lay_out_draft(Arena *arena, int64_t devices, const Limits *limits)
{
    int64_t places = fewer(limits->per_step, devices);
    return (Draft){
        .count = 1,
        .places = places,
        .points = claim(arena, limits->steps, sizeof(Point)),
        .have = claim(arena, devices, sizeof(double)),
        .worth = claim(arena, devices, sizeof(double)),
        .metres = claim(arena, devices, sizeof(double)),
        .ease = claim(arena, devices, sizeof(double)),
        .leg = claim(arena, devices, sizeof(int64_t)),
        .legs = claim(arena, limits->steps, sizeof(double)),
        .top = claim(arena, places, sizeof(double)),
    };
}

/* Work out the worths that are below 0: the best total gain of `places` devices each. */
static void rate(const Devices *devices, const Lists *lists, const Draft *draft)
{
    double *top = draft->top;
    for (int64_t k = 0; k < devices->count; k++) {
        if (draft->worth[k] >= 0.0) continue;
        for (int64_t i = 0; i < draft->places; i++) top[i] = 0.0;
        for (int64_t e = lists->begin[k]; e < lists->begin[k + 1]; e++) {
            int64_t j = lists->neighbour[e], i = 0;
            double gain = devices->delta[j] * lists->share[e] - draft->have[j];
            if (gain <= top[0]) continue;
            for (; i + 1 < draft->places && top[i + 1] < gain; i++) top[i] = top[i + 1];
            top[i] = gain;
        }
        double total = 0.0;
        for (int64_t i = 0; i < draft->places; i++) total += top[i];
        draft->worth[k] = total;
    }
}

/* Serve the devices that gain most from above device k; their neighbours' worths fall. */
static void serve(int64_t k, const Devices *devices, const Lists *lists, const Draft *draft)
{
    for (int64_t i = 0; i < draft->places; i++) {
        int64_t best = -1;
        double highest = 0.0;
        for (int64_t e = lists->begin[k]; e < lists->begin[k + 1]; e++) {
            int64_t j = lists->neighbour[e];
            double gain = devices->delta[j] * lists->share[e] - draft->have[j];
            if (gain > highest) {
                best = j;
                highest = gain;
            }
        }
        if (best < 0) return;
        draft->have[best] += highest;
        for (int64_t g = lists->begin[best]; g < lists->begin[best + 1]; g++)
            draft->worth[lists->neighbour[g]] = -1.0;
    }
}

/* Bring the lengths of the legs first..last-1 up to date. */
static void measure(const Draft *draft, int64_t first, int64_t last)
{
    for (int64_t n = first; n < fewer(last, draft->count - 1); n++)
        draft->legs[n] = between(draft->points[n + 1], draft->points[n]);
}

/* Find the shortest detour to each device, after point `at` was inserted; 0 for all anew.

   A leg is named by the point it leaves; behind the last point only the way there counts. */
static void find_legs(int64_t at, double power, const Devices *devices, const Draft *draft)
{
    const Point *points = draft->points;
    for (int64_t k = 0; k < devices->count; k++) {
        int64_t first = at - 1, last = at + 1, found = -1;
        if (at == 0 || draft->leg[k] == at - 1) { /* the leg it had is no more */
            draft->metres[k] = INFINITY;
            first = 0;
            last = draft->count;
        } else if (draft->leg[k] >= at) {
            draft->leg[k] += 1;
        }
        double shortest = draft->metres[k], out = between(devices->at[k], points[first]);
        for (int64_t leg = first; leg < last; leg++) {
            double metres = out, back = 0.0;
            if (leg + 1 < draft->count) {
                back = between(devices->at[k], points[leg + 1]);
                metres = out + back - draft->legs[leg];
            }
            if (metres < shortest) {
                shortest = metres;
                found = leg;
            }
            out = back;
        }
        if (found < 0) continue;
        draft->metres[k] = shortest;
        draft->leg[k] = found;
        draft->ease[k] = power == 0.0   ? 1.0
                         : power == 0.5 ? 1.0 / sqrt(most(shortest, 1.0))
                                        : 1.0 / most(shortest, 1.0);
    }
}

/* Insert stops above devices while the length allows. `have` is given; each insertion has the most
   worth per added metre^power, with a power of 0, 1/2 or 1. */
static void extend(
    const Devices *devices, const Limits *limits, const Lists *lists, double length, double power,
    Draft *draft)
{
    double used = 0.0;
    measure(draft, 0, draft->count);
    for (int64_t n = 0; n + 1 < draft->count; n++) used += draft->legs[n];
    for (int64_t k = 0; k < devices->count; k++) draft->worth[k] = -1.0;
    rate(devices, lists, draft);
    find_legs(0, power, devices, draft);
    while (draft->count < limits->steps) {
        int64_t best = -1;
        double rating = 0.0;
        for (int64_t k = 0; k < devices->count; k++)
            if (draft->worth[k] > 1e-9 * devices->delta[k] && used + draft->metres[k] <= length) {
                double value = draft->worth[k] * draft->ease[k];
                if (value > rating) {
                    best = k;
                    rating = value;
                }
            }
        if (best < 0) return;
        int64_t at = draft->leg[best] + 1;
        size_t behind = (size_t)(draft->count - at);
        used += draft->metres[best];
        memmove(draft->points + at + 1, draft->points + at, behind * sizeof(Point));
        memmove(draft->legs + at + 1, draft->legs + at, behind * sizeof(double));
        draft->points[at] = devices->at[best];
        draft->count++;
        measure(draft, at - 1, at + 1);
        serve(best, devices, lists, draft);
        rate(devices, lists, draft);
        find_legs(at, power, devices, draft);
    }
}

/* Begin a draft with a plan without the points first..last-1, and what its devices earn. */
static void cut_out(
    const Point *way, const int64_t *assigned, const Devices *devices, int64_t steps, int64_t first,
    int64_t last, Draft *draft)
{
    draft->count = 0;
    for (int64_t n = 0; n < steps; n++) {
        int repeated = n > 0 && way[n].x == way[n - 1].x && way[n].y == way[n - 1].y;
        if (!(first <= n && n < last) && !repeated) draft->points[draft->count++] = way[n];
    }
    for (int64_t k = 0; k < devices->count; k++) {
        int64_t n = assigned[k];
        draft->have[k] = cost_of(devices, k);
        if (n >= 0 && !(first <= n && n < last))
            draft->have[k] = most(draft->have[k], brings(devices, k, way[n]));
    }
}

#endif
