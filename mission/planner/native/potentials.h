/* A bound from potentials, for any number of devices and steps.

   Let phi_k >= 0 and psi be functions of the place, phi_k(v_0) = psi(v_0) = 0. On a path that serves
   device k at x_k, phi_k(x_k) is what phi_k gains until then, hence

       sum_k phi_k(x_k) + psi(end) <= integral of h over the path,
       h = most over directions t of sum_k (grad phi_k . t)+ + grad psi . t,

   at most mu L where h <= mu everywhere. As k earns delta f = [delta f - phi_k] + phi_k at x_k,

       mu L - least psi + nu N K_bar + sum_k most over x of (delta_k f(|x - u_k|) - phi_k(x) - nu)+

   bounds any plan, nu >= 0 being a price of a place. This is the dual of the flow relaxation of a
   path: what is served somewhere must have been passed, and each metre only serves one direction.

   The functions are linear on the triangles of a mesh, so that h is known exactly but for the
   polygon that stands for the circle of directions. psi is kept as chi = psi + sum_k phi_k / 2, since

       h(t) = sum_k |grad phi_k . t| / 2 + grad chi . t. */
#ifndef POTENTIALS_H
#define POTENTIALS_H

#include "blocks.h"
#include "cells.h"

enum { DEEP = 8 }; /* halvings of a cell where a peak is looked for */
static const double CLOSE = 1e-4; /* share of the best f to which peaks are known */

typedef struct {
    Cells cells; /* for bounds of f */
    Limits limits;
    Mesh mesh; /* the present one */
    int64_t blocks; /* of all devices; the last is filled up */
    int32_t *every; /* (blocks,) their numbers */
    Stored *phi; /* (vertices, blocks) */
    double *chi; /* (vertices,) */
    double nu;
} Potentials;

/* On the first of so many meshes. */
static Potentials lay_out_potentials(
    Arena *arena, const Devices *devices, const Limits *limits, int meshes)
{
    const Mesh first = mesh_of(devices, limits->length), last = finest_mesh(&first, meshes);
    return (Potentials){
        .cells = lay_out_cells(arena, devices, limits, 0),
        .limits = *limits,
        .mesh = first,
        .blocks = blocks_of(devices),
        .every = claim(arena, blocks_of(devices), sizeof(int32_t)),
        .phi = claim(arena, last.vertices * blocks_of(devices), sizeof(Stored)),
        .chi = claim(arena, last.vertices, sizeof(double)),
    };
}

/* Fill what does not depend on potentials. */
static void set_up_potentials(const Potentials *all)
{
    fill_rises(&all->cells);
    for (int64_t b = 0; b < all->blocks; b++) all->every[b] = (int32_t)b;
}

static inline Stored *stored_at(const Potentials *all, Stored *of, int64_t vertex)
{
    return of + vertex * all->blocks;
}

/* Rises of the potentials of a block along the two sides of a triangle. */
typedef struct {
    Eight first, second;
} Rises;

static inline Rises rises_over(const Potentials *all, const int64_t *corner, int32_t block)
{
    const Eight middle = taken(stored_at(all, all->phi, corner[1])[block]);
    return (Rises){
        middle - taken(stored_at(all, all->phi, corner[0])[block]),
        taken(stored_at(all, all->phi, corner[2])[block]) - middle};
}

/* h of a triangle along eight axes, by the side of a cell: half the sums over the devices of some
   blocks are added to `slopes`, and `lean` is what chi adds one way and takes the other. Returns the
   largest. */
static double steepness(
    const Potentials *all, Triangle at, const Directions *ways, Blocks blocks, Eight *slopes,
    Eight *lean)
{
    const Eight x = ways->x[at.group], y = ways->y[at.group];
    const Eight first = at.shape == 0 ? x : y, second = at.shape == 0 ? y : x;
    int64_t corner[TRIANGLE];
    corners_of(&all->mesh, at, corner);
    Eight sum[EIGHT] = {0};
    for (int64_t b = 0; b < blocks.count; b++) {
        const Rises rises = rises_over(all, corner, blocks.block[b]);
        for (int i = 0; i < EIGHT; i++)
            sum[i] += absolute(first[i] * rises.first + second[i] * rises.second);
    }
    for (int i = 0; i < EIGHT; i++) (*slopes)[i] += 0.5 * sum_of_eight(sum[i]);
    *lean = first * (all->chi[corner[1]] - all->chi[corner[0]]) +
            second * (all->chi[corner[2]] - all->chi[corner[1]]);
    const Eight h = *slopes + absolute(*lean);
    double highest = 0.0;
    for (int i = 0; i < EIGHT; i++) highest = most(highest, h[i]);
    return highest;
}

/* Half the sum over the potentials of some blocks. */
static double half_sum_at(const Potentials *all, int64_t v, Blocks blocks)
{
    const Stored *phi = stored_at(all, all->phi, v);
    Eight sum = {0};
    for (int64_t b = 0; b < blocks.count; b++) sum += taken(phi[blocks.block[b]]);
    return 0.5 * sum_of_eight(sum);
}

/* Go on with the same potentials on the finer mesh. The last come first, so that what they are made
   of is still there. */
static void refine_potentials(Potentials *all)
{
    const Mesh coarse = all->mesh, fine = finer_mesh(&coarse);
    for (int64_t v = fine.vertices - 1; v >= 0; v--) {
        const Parents from = parents_of(&coarse, v);
        all->chi[v] = 0.5 * (all->chi[from.one] + all->chi[from.other]);
        for (int64_t b = 0; b < all->blocks; b++)
            stored_at(all, all->phi, v)[b] = 0.5f * (stored_at(all, all->phi, from.one)[b] +
                                                    stored_at(all, all->phi, from.other)[b]);
    }
    all->mesh = fine;
}

/* A place in a triangle, and what a device earns there. */
typedef struct {
    int32_t vertex[TRIANGLE];
    double share[TRIANGLE];
    double reward;
} Sample;

/* A place in a cell, from its south-west corner (0, 0) to the north-east (1, 1). */
static Sample sample_at(const Mesh *mesh, int64_t cell, double east, double north)
{
    const int32_t v = (int32_t)cell, across = (int32_t)mesh->across;
    if (east >= north)
        return (Sample){{v, v + 1, v + across + 1}, {1.0 - east, east - north, north}, 0.0};
    return (Sample){{v, v + across, v + across + 1}, {1.0 - north, north - east, east}, 0.0};
}

static inline double phi_at(const Potentials *all, int64_t k, const Sample *at)
{
    const int64_t wide = all->blocks * EIGHT;
    const float *phi = (const float *)all->phi + k;
    double sum = 0.0;
    for (int i = 0; i < TRIANGLE; i++) sum += at->share[i] * (double)phi[at->vertex[i] * wide];
    return sum;
}

/* A part of a cell, by what of the cell's side lies before it, and its own side. */
typedef struct {
    int64_t cell;
    double east, north, side;
} Part;

/* What is known of the most of delta f - phi: reached somewhere, and exceeded nowhere. */
typedef struct {
    int64_t device;
    double reached, bound, close;
} Peak;

/* Look for more in a part of a cell. */
static void look_into(const Potentials *all, Part part, int depth, Peak *peak)
{
    const Point corner = vertex_at(&all->mesh, part.cell);
    const double side = all->mesh.side, half = 0.5 * part.side * side;
    const Point middle = {
        corner.x + side * part.east + half, corner.y + side * part.north + half};
    if (from_start(middle, half, -1.0) > all->limits.length) return;
    const Corners reward = reward_at_corners(
        &all->cells, peak->device, middle, half, size_of(half));
    double bound = -INFINITY;
    for (int i = 0; i < 4; i++) {
        const Sample at = sample_at(
            &all->mesh, part.cell, part.east + part.side * (i & 1),
            part.north + part.side * (i >> 1));
        bound = most(bound, reward[i] - phi_at(all, peak->device, &at));
    }
    if (bound <= peak->reached + peak->close || depth == 0) {
        peak->bound = most(peak->bound, bound);
        return;
    }
    const double step = 0.5 * part.side;
    const Sample at = sample_at(&all->mesh, part.cell, part.east + step, part.north + step);
    const double here =
        worth(&all->cells.devices, peak->device, middle) - phi_at(all, peak->device, &at);
    if (from_start(middle, 0.0, 1.0) <= all->limits.length)
        peak->reached = most(peak->reached, here);
    for (int i = 0; i < 4; i++)
        look_into(
            all, (Part){part.cell, part.east + step * (i & 1), part.north + step * (i >> 1), step},
            depth - 1, peak);
}

/* The distance from which on device k is worth no more than that, whatever its potential. */
static double audible(const Cells *cells, int64_t k, double value)
{
    for (int64_t row = 0; row < cells->devices.rows; row++)
        if (cells->devices.delta[k] * cells->upper[row] <= value) return (double)row;
    return INFINITY;
}

/* Bound of the most that device k earns beyond its potential and the price, anywhere; 0 where there
   is none. */
static double most_beyond(const Potentials *all, int64_t k)
{
    const Devices *devices = &all->cells.devices;
    const double highest = devices->delta[k] * all->cells.upper[0], close = CLOSE * highest;
    if (highest <= all->nu) return 0.0;
    const double radius = audible(&all->cells, k, all->nu + close) + 2.0 * all->mesh.side;
    const float *phi = (const float *)all->phi + k;
    Peak peak = {k, all->nu, all->nu, close};
    if (isfinite(radius)) peak.bound += close;
    for (int64_t v = 0; v < all->mesh.vertices; v++) {
        const Point place = vertex_at(&all->mesh, v);
        if (between(place, devices->at[k]) > radius) continue;
        const double here = worth(devices, k, place) - (double)phi[v * all->blocks * EIGHT];
        peak.reached = most(peak.reached, here);
    }
    for (int64_t v = 0; v < all->mesh.vertices; v++)
        if (is_cell(&all->mesh, v) && !(between(vertex_at(&all->mesh, v), devices->at[k]) > radius))
            look_into(all, (Part){v, 0.0, 0.0, 1.0}, DEEP, &peak);
    return peak.bound - all->nu;
}

/* The bound of the present potentials; where they are no numbers, there is none. */
static double bound_by_potentials(const Potentials *all)
{
    const Blocks every = {all->blocks, all->every};
    const Directions ways = directions(FINE_GROUPS);
    double steepest = 0.0, lowest = 0.0, zero = 0.0;
    for (int64_t i = 0; i < all->mesh.vertices * SHAPES * ways.groups; i++) {
        const Triangle at = triangle_at(i, ways.groups);
        if (!is_cell(&all->mesh, at.cell)) continue;
        Eight slopes = {0}, lean;
        steepest = most(steepest, steepness(all, at, &ways, every, &slopes, &lean));
    }
    for (int64_t v = 0; v < all->mesh.vertices; v++) {
        const double psi = all->chi[v] - half_sum_at(all, v, every);
        lowest = least(lowest, psi);
        zero += 0.0 * psi; /* comparing would pass a NaN */
    }
    double bound = steepest * all->limits.length / all->mesh.side - lowest +
                   all->nu * (double)(all->limits.steps * all->limits.per_step);
    for (int64_t k = 0; k < all->cells.devices.count; k++) bound += most_beyond(all, k);
    return isfinite(bound + zero) ? bound : INFINITY;
}

#endif
