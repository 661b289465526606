/* Nodes of the search of orders: what is decided of each chain, and whether its stops are enough. */
#ifndef NODE_H
#define NODE_H

#include <stdlib.h>

#include "planner.h"

/* State of the edge before a stop: may its two stops be one? */
enum { UNDECIDED, MERGED, BARRED };

enum { PLACED = -1 }; /* level of a device that stands in the order */

/* The chain of an aircraft. The first `size` entries of what goes by position count. */
typedef struct {
    double bound, dual; /* what no plan of the node exceeds; the share of it that the path gives */
    double mu;          /* multiplier of the length */
    double price;       /* of a metre, where `dual` was found; of timed ones */
    int64_t size;       /* devices in the order */
    Point y[MOST_DEVICES];          /* by position: dual of the edge before it */
    double wait[MOST_DEVICES];      /* by position: multiplier of what may come after it, over mu */
    uint64_t mask[MOST_DEVICES];    /* by device: gaps that it may still be inserted in */
    int16_t order[MOST_DEVICES];    /* by position: device */
    int16_t interval[MOST_DEVICES]; /* by position: row of the distance interval */
    int8_t edge[MOST_DEVICES];  /* by position: edge to the stop before it, or to the start */
    int8_t level[MOST_DEVICES]; /* by device: PLACED, or the radius that it is out of reach of */
} Node;

/* Put a device in a gap of the order, with a distance interval; its y is left to the caller.

   Between two merged stops it belongs to the same stop. A bar between two stops says nothing
   about either new edge alone and is forgotten. */
static void insert(Node *node, int64_t devices, int64_t device, int64_t gap, int64_t row)
{
    const int64_t m = node->size++;
    const int8_t edge = gap < m && node->edge[gap] == MERGED ? MERGED : UNDECIDED;
    for (int64_t i = m; i > gap; i--) {
        node->order[i] = node->order[i - 1];
        node->interval[i] = node->interval[i - 1];
        node->edge[i] = node->edge[i - 1];
        node->y[i] = node->y[i - 1];
        node->wait[i] = node->wait[i - 1];
    }
    node->wait[gap] = 0.0;
    node->order[gap] = (int16_t)device;
    node->interval[gap] = (int16_t)row;
    node->edge[gap] = edge;
    if (gap < m) node->edge[gap + 1] = edge;
    node->level[device] = PLACED;
    const uint64_t low = ((uint64_t)1 << gap) - 1;
    for (int64_t k = 0; k < devices; k++)
        if (node->level[k] != PLACED) {
            const uint64_t mask = node->mask[k], bit = mask >> gap & 1;
            node->mask[k] = (mask & low) | bit << gap | bit << (gap + 1) | mask >> (gap + 1) << (gap + 2);
        }
}

/* Whether a stop and the one before it are never one. Devices of one stop stand in the order of
   their numbers: other orders of them are the same plans. */
static int apart(const Node *node, int64_t i)
{
    return node->edge[i] == BARRED || (i > 0 && node->order[i - 1] > node->order[i]);
}

/* Whether merged stops are only near each other: those that take time of their own. */
static int is_loose(const Limits *limits) { return limits->stop.brake > 0.0; }

/* Fewest stops after the start that serve the order; -1 if the merges overfill one, or put devices
   together that are apart.

   Stops serve stretches of the order, so that filling each as far as it goes is optimal. */
static int64_t stops_needed(const Node *node, const Limits *limits)
{
    const int64_t per_step = limits->per_step;
    const int loose = is_loose(limits);
    int64_t needed = 0, load = 0;
    for (int64_t i = 0, run; i < node->size; i += run) {
        for (run = 1; i + run < node->size && node->edge[i + run] == MERGED && !loose; run++)
            if (apart(node, i + run)) return -1;
        if (run > per_step) return -1;
        if (!apart(node, i) && load + run <= per_step) {
            load += run;
        } else {
            needed++;
            load = run;
        }
    }
    return needed;
}

static int enough_stops(const Node *node, const Limits *limits)
{
    const int64_t needed = stops_needed(node, limits);
    return needed >= 0 && needed < limits->steps;
}

/* Stops after the start if no more are merged. */
static int64_t stops_now(const Node *node)
{
    int64_t count = 0;
    for (int64_t i = 0; i < node->size; i++) count += node->edge[i] != MERGED;
    return count;
}

/* How many devices would be at one stop if an edge were merged. */
static int64_t run_with(const Node *node, int64_t edge)
{
    int64_t first = edge - 1, last = edge;
    while (first >= 0 && node->edge[first] == MERGED) first--;
    while (last + 1 < node->size && node->edge[last + 1] == MERGED) last++;
    return last - first + (first >= 0);
}

/* Decide the edges that leave no choice; 0 where there are not stops enough for the order. */
static int settle(Node *node, const Limits *limits)
{
    if (!enough_stops(node, limits)) return 0;
    if (is_loose(limits) && node->size < limits->steps) return 1;
    const int plenty = stops_now(node) < limits->steps && !is_loose(limits);
    for (int64_t i = 0; i < node->size; i++) {
        if (node->edge[i] != UNDECIDED || apart(node, i)) continue;
        if (plenty) { /* none need be merged, and all may that one stop has places for */
            if (run_with(node, i) > limits->per_step) node->edge[i] = BARRED;
            continue;
        }
        node->edge[i] = MERGED;
        const int may_merge = enough_stops(node, limits);
        node->edge[i] = BARRED;
        if (may_merge) node->edge[i] = enough_stops(node, limits) ? UNDECIDED : MERGED;
    }
    return 1;
}

/* A node. The bound comes first (`queue.h`); every chain has it, too. */
typedef struct {
    double bound;
    Node chain[];
} Crew;

static size_t size_of_crew(int64_t aircraft) { return sizeof(Crew) + (size_t)aircraft * sizeof(Node); }

static double others_dual(const Crew *crew, int64_t own, int64_t aircraft)
{
    double total = 0.0;
    for (int64_t a = 0; a < aircraft; a++)
        if (a != own) total += crew->chain[a].dual;
    return total;
}

static int64_t placed_in(const Crew *crew, int64_t aircraft)
{
    int64_t count = 0;
    for (int64_t a = 0; a < aircraft; a++) count += crew->chain[a].size;
    return count;
}

/* NULL where memory is short. */
static Crew *copy_of(const Crew *crew, size_t size)
{
    Crew *copy = malloc(size);
    if (copy) memcpy(copy, crew, size);
    return copy;
}

#endif
