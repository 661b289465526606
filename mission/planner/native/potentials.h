/* A bound from potentials, for any number of devices and steps.

   Let phi_k >= 0 and psi be functions of the place, phi_k(v_0) = psi(v_0) = 0. On a path that serves
   device k at x_k, phi_k(x_k) is what phi_k gains until then, hence

       sum_k phi_k(x_k) + psi(end) <= integral of h over the path,
       h = most over directions t of sum_k (grad phi_k . t)+ + grad psi . t,

   at most mu L where h <= mu everywhere. Any device earns a floor >= 0 at most, at each of the N K_bar
   places, or is one of those that are given. What k of these earns, delta_k f, is the floor, phi_k, a
   price pi_k >= 0 that is paid once, and what is left. A stop has what is left of K_bar devices at one
   place, at most

       best(x) = sum of the K_bar largest (delta_k f(|x - u_k|) - phi_k(x) - pi_k - floor)+.

   The first stop is at the start, N - 1 are anywhere. So no plan earns more than

       mu L - least psi(end) + floor N K_bar + sum_k pi_k + best(v_0) + (N - 1) most over x of best(x).

   This is the dual of the flow relaxation of a path: what is served somewhere must have been passed,
   each metre only serves one direction, and stops are few, each at one place.

   The functions are linear on the triangles of a mesh, so that h is known exactly but for the
   polygon that stands for the circle of directions. psi is kept as chi = psi + sum_k phi_k / 2, since

       h(t) = sum_k |grad phi_k . t| / 2 + grad chi . t. */
#ifndef POTENTIALS_H
#define POTENTIALS_H

#include "blocks.h"
#include "cells.h"

enum { DEEP = 8 }; /* halvings of a cell where the best stop is looked for */

typedef struct {
    Cells cells; /* for bounds of f */
    Limits limits;
    Mesh mesh;       /* the present one */
    Box ends;        /* where paths end, between lines of the mesh */
    int64_t blocks;  /* of all devices; the last is filled up */
    int32_t *every;  /* (blocks,) their numbers */
    Stored *phi;     /* (vertices, blocks) */
    double *chi;     /* (vertices,) */
    Eight *price;    /* (blocks,) pi and the floor */
    double floor;    /* what devices that are not given earn at most */
    double highest;  /* the best reward */
    int32_t *heard;  /* (DEEP + 2, K) devices that a stop in a cell, or in its parts, may serve */
    double *radius;  /* (K,) metres from which on a device is not worth its price */
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
        .ends = PLANE,
        .blocks = blocks_of(devices),
        .every = claim(arena, blocks_of(devices), sizeof(int32_t)),
        .phi = claim(arena, last.vertices * blocks_of(devices), sizeof(Stored)),
        .chi = claim(arena, last.vertices, sizeof(double)),
        .price = claim(arena, blocks_of(devices), sizeof(Eight)),
        .heard = claim(arena, (DEEP + 2) * devices->count, sizeof(int32_t)),
        .radius = claim(arena, devices->count, sizeof(double)),
    };
}

/* Fill what does not depend on potentials. */
static void set_up_potentials(Potentials *all, double left_out)
{
    const Devices *devices = &all->cells.devices;
    fill_rises(&all->cells);
    all->floor = left_out * all->cells.upper[0];
    for (int64_t k = 0; k < devices->count; k++)
        all->highest = most(all->highest, devices->delta[k] * all->cells.upper[0]);
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

/* A place in a triangle. */
typedef struct {
    int32_t vertex[TRIANGLE];
    double share[TRIANGLE];
} Sample;

/* A place in a cell, from its south-west corner (0, 0) to the north-east (1, 1). */
static Sample sample_at(const Mesh *mesh, int64_t cell, double east, double north)
{
    const int32_t v = (int32_t)cell, across = (int32_t)mesh->across;
    if (east >= north)
        return (Sample){{v, v + 1, v + across + 1}, {1.0 - east, east - north, north}};
    return (Sample){{v, v + across, v + across + 1}, {1.0 - north, north - east, east}};
}

static inline double phi_at(const Potentials *all, int64_t k, const Sample *at)
{
    const int64_t wide = all->blocks * EIGHT;
    const float *phi = (const float *)all->phi + k;
    double sum = 0.0;
    for (int i = 0; i < TRIANGLE; i++) sum += at->share[i] * (double)phi[at->vertex[i] * wide];
    return sum;
}

static inline double price_of(const Potentials *all, int64_t k)
{
    return all->price[k / EIGHT][k % EIGHT];
}

#endif
