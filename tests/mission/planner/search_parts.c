/* Parts of the search by themselves, for tests that look at them. */
#include "cells.h"
#include "exported.h"
#include "search.h"
#include "zones.h"

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

/* Bounds of chains through squares (x, y, half), those of stop n from first[n] on: of each square's stop
   alone, of all up to there, of what follows. A metre costs mu, and legs lean as `lean` says. */
EXPORTED void chain_bounds(
    const Devices *devices, const Limits *limits, const int64_t *first, const double *square, double mu,
    const Point *lean, double *stop, double *ahead, double *behind)
{
    const int64_t stops = limits->steps - 1, count = first[stops];
    const size_t size = (size_t)count * sizeof(double);
    Arena arena = {0};
    Programme all;
    for (int pass = 0; pass < 2; pass++) {
        all = lay_out_programme(&arena, devices, limits, count, count + 1);
        if (pass == 0 && !provide(&arena)) return;
    }
    Zones *zones = new_zones(&all.sizes, count);
    if (zones) {
        fill_rises(&all.cells);
        zones->mu = mu;
        memcpy(zones->first, first, (size_t)(stops + 1) * sizeof(int64_t));
        memcpy(zones->lean, lean, (size_t)stops * sizeof(Point));
        for (int64_t j = 0; j < count; j++) {
            const double *at = square + 3 * j;
            zones->square[j] = (int32_t)add_cell(&all.cells, at[0], at[1], at[2]);
        }
        load_squares(zones, &all);
        bound_of(zones, &all);
        memcpy(stop, all.stop, size);
        look_back(zones, &all);
        memcpy(ahead, all.ahead, size);
        memcpy(behind, all.behind, size);
    }
    free(zones);
    release(&arena);
}

static WidePoint wide_point(const double *at) { return (WidePoint){all_of(at[0]), all_of(at[1])}; }
static WideSym wide_sym(const double *of) { return (WideSym){all_of(of[0]), all_of(of[1]), all_of(of[2])}; }

/* The share of a step (m, 2), and of mu's, that may be gone from y (m, 2) within cones c^2 (m,). */
EXPORTED double limit_of_step(
    int64_t m, const double *cone, const double *y, const double *step, double mu, double mu_step)
{
    static Lanes all;
    all.size = m;
    all.mu = all_of(mu);
    all.mu_step = all_of(mu_step);
    for (int64_t k = 0; k < m; k++) {
        all.link[k].cone = all_of(cone[k]);
        all.link[k].y = wide_point(y + 2 * k);
        all.link[k].a = wide_point(step + 2 * k);
    }
    return step_limit(&all)[LENGTH - 1];
}

/* The Newton step (m, 2), that of mu, and its decrement, from gradients and rows of mu (m, 2), blocks of the
   diagonal and those of devices (m, 3), and the two derivatives by mu. */
EXPORTED void newton_step(
    int64_t m, const double *gradient, const double *cross, const double *block, const double *device,
    double slope, double bend, double *step, double *of_mu)
{
    static Lanes all;
    all.size = m;
    all.slope = all_of(slope);
    all.bend = all_of(bend);
    for (int64_t k = 0; k < m; k++) {
        Link *link = all.link + k;
        link->gradient = wide_point(gradient + 2 * k);
        link->cross = wide_point(cross + 2 * k);
        link->block = wide_sym(block + 3 * k);
        link->device = wide_sym(device + 3 * k);
    }
    step_newton(&all);
    for (int64_t k = 0; k < m; k++) {
        step[2 * k] = all.link[k].a.x[LENGTH - 1];
        step[2 * k + 1] = all.link[k].a.y[LENGTH - 1];
    }
    of_mu[0] = all.mu_step[LENGTH - 1];
    of_mu[1] = all.decrement[LENGTH - 1];
}

/* The barrier of cones c^2 (m,) at y (m, 2) and mu, and what comes with it: bound, value, the two derivatives
   by mu; of each stop (m, 7) gradient, mixed derivatives, block. */
EXPORTED void barrier_at(
    int64_t m, const double *cone, const double *y, double mu, double eps, double length, double *whole,
    double *parts)
{
    static Lanes all;
    all.size = m;
    all.trial_mu = all_of(mu);
    all.weight = all_of(eps);
    all.length = all_of(length);
    for (int64_t k = 0; k < m; k++) {
        all.link[k].cone = all_of(cone[k]);
        all.link[k].trial = wide_point(y + 2 * k);
    }
    look_at_barrier(&all);
    const Wide found[] = {all.bound, all.barrier, all.slope, all.bend};
    for (int i = 0; i < 4; i++) whole[i] = found[i][LENGTH - 1];
    for (int64_t k = 0; k < m; k++) {
        const Link *of = all.link + k;
        const Wide seven[] = {of->gradient.x, of->gradient.y, of->cross.x, of->cross.y,
                              of->block.xx, of->block.xy, of->block.yy};
        for (int i = 0; i < 7; i++) parts[7 * k + i] = seven[i][LENGTH - 1];
    }
}

/* Whether a search is hopeless after so many nodes, and when it looks again; `look` (2,) of number and gap. */
EXPORTED int hopeless(double *look, int64_t nodes, double gap, double goal, int64_t most_nodes)
{
    Progress progress = {(int64_t)look[0], look[1]};
    const int found = is_hopeless(&progress, nodes, gap, goal, most_nodes);
    look[0] = (double)progress.look;
    look[1] = progress.gap;
    return found;
}

/* Leave nodes with bounds (count,) open where there is room for so many, then take them out again, into
   `bound`; returns what was closed. */
EXPORTED double queued(int64_t count, double *bound, int64_t room)
{
    double closed = 0.0, *open[64];
    Queue queue = {open, 0, room};
    for (int64_t i = 0; i < count; i++) {
        double *node = malloc(sizeof(double));
        if (node) *node = bound[i];
        leave_open(&queue, node, bound[i], &closed);
    }
    for (int64_t i = 0; i < count; i++) {
        double *node = queue.count > 0 ? dequeue(&queue) : NULL;
        bound[i] = node ? *node : -1.0;
        free(node);
    }
    return closed;
}

/* How many devices would be at one stop if an edge of these (size,) were merged; those beyond are none. */
EXPORTED int64_t merged_run(int64_t size, int64_t all, const int64_t *edges, int64_t edge)
{
    static Node node;
    node.size = size;
    for (int64_t i = 0; i < all; i++) node.edge[i] = (int8_t)edges[i];
    return run_with(&node, edge);
}
