/* The bound of given potentials and prices. Where the best stop is, is looked for square by square:
   what devices bring at most is linear within a square, as potentials are, and the sum of the
   largest of such is convex, hence largest at a corner. */
#ifndef STOPS_H
#define STOPS_H

#include "potentials.h"

static const double CLOSE = 1e-4; /* share of the best reward to which the best stop is known */

/* A part of a cell, by what of the cell's side lies before it, and its own side. */
typedef struct {
    int64_t cell;
    double east, north, side;
} Part;

/* What is known of the best stop: reached somewhere, and exceeded nowhere. Where prices are raised, it
   is what they are raised for. */
typedef struct {
    double reached, bound;
    int raising;
} Peak;

/* The best stop in a part: what it brings at most, who brings the most of that, and how many devices
   may bring anything. */
typedef struct {
    double bound, highest;
    int32_t first;
    int64_t left;
} Best;

/* By the devices that the whole heard; those that are left come after them. */
static Best best_in_part(
    const Potentials *all, Part part, Point middle, const int32_t *heard, int64_t count,
    int32_t *kept)
{
    const Cells *cells = &all->cells;
    const double half = 0.5 * part.side * all->mesh.side;
    const int size = size_of(half);
    Best best = {0};
    Sample at[4];
    for (int i = 0; i < 4; i++)
        at[i] = sample_at(
            &all->mesh, part.cell, part.east + part.side * (i & 1),
            part.north + part.side * (i >> 1));
    memset(cells->top, 0, (size_t)cells->per_step * sizeof(Corners));
    for (int64_t j = 0; j < count; j++) {
        const int32_t k = heard[j];
        Corners gain = reward_at_corners(cells, k, middle, half, size) - price_of(all, k);
        for (int i = 0; i < 4; i++) gain[i] -= phi_at(all, k, at + i);
        const double here = most(most(gain[0], gain[1]), most(gain[2], gain[3]));
        if (!(here > 0.0)) continue;
        if (here > best.highest) {
            best.highest = here;
            best.first = k;
        }
        kept[best.left++] = k;
        keep_largest(cells->top, cells->per_step, gain);
    }
    const Corners sum = sum_of_largest(cells);
    best.bound = most(most(sum[0], sum[1]), most(sum[2], sum[3]));
    return best;
}

/* What the best stop at a place earns. */
static double best_at(
    const Potentials *all, Point place, const Sample *at, const int32_t *heard, int64_t count)
{
    const Cells *cells = &all->cells;
    memset(cells->top, 0, (size_t)cells->per_step * sizeof(Corners));
    for (int64_t j = 0; j < count; j++) {
        const int64_t k = heard[j];
        const double gain =
            worth(&cells->devices, k, place) - phi_at(all, k, at) - price_of(all, k);
        keep_largest(cells->top, cells->per_step, gain - (Corners){0.0});
    }
    return sum_of_largest(cells)[0];
}

/* Look for a better stop in a part of a cell. */
static void look_into(
    Potentials *all, Part part, int depth, int32_t *heard, int64_t count, Peak *peak)
{
    const Point corner = vertex_at(&all->mesh, part.cell);
    const double side = all->mesh.side, half = 0.5 * part.side * side, step = 0.5 * part.side;
    const Point middle = {
        corner.x + side * part.east + half, corner.y + side * part.north + half};
    if (from_start(middle, half, -1.0) > all->limits.length) return;
    int32_t *kept = heard + all->cells.devices.count;
    Best best = best_in_part(all, part, middle, heard, count, kept);
    const double enough = peak->reached + CLOSE * all->highest;
    if (depth > 0 && best.bound > enough) {
        const Sample at = sample_at(&all->mesh, part.cell, part.east + step, part.north + step);
        if (!peak->raising && from_start(middle, 0.0, 1.0) <= all->limits.length)
            peak->reached = most(peak->reached, best_at(all, middle, &at, kept, best.left));
        for (int i = 0; i < 4; i++)
            look_into(
                all,
                (Part){part.cell, part.east + step * (i & 1), part.north + step * (i >> 1), step},
                depth - 1, kept, best.left, peak);
        return;
    }
    for (int64_t i = 0; peak->raising && best.bound > enough && i < count; i++) {
        all->price[best.first / EIGHT][best.first % EIGHT] +=
            least(best.highest, best.bound - enough);
        best = best_in_part(all, part, middle, heard, count, kept);
    }
    peak->bound = most(peak->bound, best.bound);
}

/* The distance from which on device k is worth no more than that, whatever its potential. */
static double audible(const Cells *cells, int64_t k, double value)
{
    for (int64_t row = 0; row < cells->devices.rows; row++)
        if (cells->devices.delta[k] * cells->upper[row] <= value) return (double)row;
    return INFINITY;
}

/* List the devices that may be worth their price in a square; returns how many. */
static int64_t list_heard(const Potentials *all, Point middle, double half)
{
    const Devices *devices = &all->cells.devices;
    int64_t count = 0;
    for (int64_t k = 0; k < devices->count; k++)
        if (between(middle, devices->at[k]) - 1.4142136 * half < all->radius[k])
            all->heard[count++] = (int32_t)k;
    return count;
}

/* Look for the best stop in all cells: only in the middle of each, or in its parts. */
static void look_everywhere(Potentials *all, int depth, Peak *peak)
{
    const double half = 0.5 * all->mesh.side;
    for (int64_t v = 0; v < all->mesh.vertices; v++) {
        if (!is_cell(&all->mesh, v)) continue;
        const Point low = vertex_at(&all->mesh, v), middle = {low.x + half, low.y + half};
        const int64_t count = list_heard(all, middle, half);
        const Sample at = sample_at(&all->mesh, v, 0.5, 0.5);
        if (depth > 0)
            look_into(all, (Part){v, 0.0, 0.0, 1.0}, depth, all->heard, count, peak);
        else if (from_start(middle, 0.0, 1.0) <= all->limits.length)
            peak->reached = most(peak->reached, best_at(all, middle, &at, all->heard, count));
    }
}

/* Bound of the stop at the start, where potentials are 0. */
static double best_at_start(const Potentials *all)
{
    const Cells *cells = &all->cells;
    memset(cells->top, 0, (size_t)cells->per_step * sizeof(Corners));
    for (int64_t k = 0; k < cells->devices.count; k++) {
        const Corners gain = reward_at_corners(cells, k, (Point){0.0, 0.0}, 0.0, SIZES - 1);
        keep_largest(cells->top, cells->per_step, gain - price_of(all, k));
    }
    return sum_of_largest(cells)[0];
}

/* What all prices and stops add to the bound; prices may be raised, and stay so. */
static double cost_of_stops(Potentials *all, Peak peak)
{
    for (int64_t k = 0; k < all->cells.devices.count; k++)
        all->radius[k] = audible(&all->cells, k, price_of(all, k));
    if (!peak.raising) look_everywhere(all, 0, &peak);
    look_everywhere(all, DEEP, &peak);
    double cost = best_at_start(all) + (double)(all->limits.steps - 1) * peak.bound;
    for (int64_t k = 0; k < all->cells.devices.count; k++) cost += price_of(all, k) - all->floor;
    return cost;
}

/* The bound of the present potentials; where they are no numbers, there is none. With few stops the
   best of them may be worth more anywhere than `sampled`; with many it is better to raise the prices
   of the devices where it is, which then stay so. */
static double bound_by_potentials(Potentials *all, double sampled)
{
    const Blocks every = {all->blocks, all->every};
    const Directions ways = directions(FINE_GROUPS);
    const double places = (double)(all->limits.steps * all->limits.per_step);
    double steepest = 0.0, lowest = INFINITY, zero = 0.0;
    for (int64_t i = 0; i < all->mesh.vertices * SHAPES * ways.groups; i++) {
        const Triangle at = triangle_at(i, ways.groups);
        if (!is_cell(&all->mesh, at.cell)) continue;
        Eight slopes = {0}, lean;
        steepest = most(steepest, steepness(all, at, &ways, every, &slopes, &lean));
    }
    for (int64_t v = 0; v < all->mesh.vertices; v++) {
        const double psi = all->chi[v] - half_sum_at(all, v, every);
        if (is_in(&all->ends, vertex_at(&all->mesh, v))) lowest = least(lowest, psi);
        zero += 0.0 * psi; /* comparing would pass a NaN */
    }
    const double as_it_is = cost_of_stops(all, (Peak){0.0, 0.0, 0});
    const double raised = cost_of_stops(all, (Peak){sampled, sampled, 1});
    const double bound = steepest * all->limits.length / all->mesh.side - lowest +
                         all->floor * places + least(as_it_is, raised);
    return isfinite(bound + zero) ? bound : INFINITY;
}

#endif
