/* Neighbour lists: who is served well by a stop above a device. */
#ifndef LISTS_H
#define LISTS_H

#include "arena.h"
#include "rewards.h"

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
    const double reach = reach_of(devices);
    int64_t who[MOST_NEIGHBOURS];
    double square[MOST_NEIGHBOURS];
    for (int64_t k = 0; k < devices->count; k++) {
        const int64_t count = nearest_devices(k, reach, devices, who, square), at = lists->begin[k];
        for (int64_t i = 0; i < count; i++) {
            lists->neighbour[at + i] = who[i];
            lists->share[at + i] = share_at(sqrt(square[i]), devices);
        }
        lists->begin[k + 1] = at + count;
    }
}

#endif
