/* Parts of the search by themselves, for tests that look at them. */
#include "cells.h"
#include "exported.h"
#include "search.h"

/* The least bound of the order in which the devices stand, with the rows of their distance intervals, and 1
   where a stop is one with the one before; -1 if its steps did not end well. With `outwards` they begin again
   there, but so far (1: all) of the way from the axis of each cone to its boundary. */
EXPORTED double order_bound(
    const Devices *devices, const Limits *limits, const Relaxation *relaxation,
    const int64_t *interval, const int64_t *merged, double eps, double outwards)
{
    const Problem problem = {*devices, *limits, *relaxation};
    Node node = {.size = devices->count, .mu = 0.003};
    Order order = {.node = &node, .enough = -INFINITY, .pointed = -1};
    static Solver solver;
    memset(&solver, 0, sizeof solver);
    for (int64_t i = 0; i < node.size; i++) {
        node.order[i] = (int16_t)i;
        node.interval[i] = (int16_t)interval[i];
        node.edge[i] = merged[i] ? MERGED : UNDECIDED;
    }
    set_up_solver(&solver, &problem);
    minimise(&order, 1, (Aim){eps, 0.0}, &solver);
    if (outwards > 0.0) {
        for (int64_t i = 0; i < node.size; i++) {
            const double share = outwards * node.mu / between(node.y[i], (Point){0.0, 0.0});
            node.y[i] = (Point){share * node.y[i].x, share * node.y[i].y};
        }
        order.done = 0;
        minimise(&order, 1, (Aim){eps, 0.0}, &solver);
    }
    return order.centred ? order.bound : -1.0;
}

/* Bound of what a stop earns somewhere in the square around (x, y), its side 2 `half` long. */
EXPORTED double square_bound(
    const Devices *devices, const Limits *limits, double x, double y, double half)
{
    Arena arena = {0};
    double *price, bound = 0.0;
    Cells cells;
    for (int pass = 0; pass < 2; pass++) {
        cells = lay_out_cells(&arena, devices, limits, 1);
        price = claim(&arena, devices->count, sizeof(double));
        if (pass == 0 && !provide(&arena)) return NAN;
    }
    fill_rises(&cells);
    const Corners best = rated(&cells, add_cell(&cells, x, y, half), price);
    for (int i = 0; i < 4; i++) bound = most(bound, best[i]);
    release(&arena);
    return bound;
}

/* H of a distance interval at s >= 0. */
EXPORTED double conjugate(const Relaxation *relaxation, int64_t row, double s)
{
    return conjugate_at(s, row, relaxation).h;
}

/* Distance of (x, y) from the polyline through the first `count` points. */
EXPORTED double away_from_way(double x, double y, const Point *way, int64_t count)
{
    return distance_to((Point){x, y}, way, count);
}
