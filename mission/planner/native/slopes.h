/* Slopes of the bound by the potentials, its maxima made smooth. Only those triangles and samples
   are visited that were near a maximum when all were last looked at; the others have no part in it.
   On fine meshes only potentials near their devices change (`blocks.h`). */
#ifndef SLOPES_H
#define SLOPES_H

#include "samples.h"

enum { MOST_WIDE = 150000 }; /* values: fewer change everywhere */
static const double VISITED = 1.25; /* margin on what takes part in a maximum */
static const double NOTHING = 1e-5; /* share of the largest slope that is left out */
static const double LOW_HEAT = 0.02; /* of the least psi, as a share of the best reward */

typedef struct {
    Potentials now;
    Nearby near_vertex, near_cell; /* whose potentials change there */
    Eight *fixed;                 /* of `slopes`, by potentials that do not change */
    double *fixed_sum, *half_sum; /* (vertices,) over these and over all of them */
    Stored *slope;                /* (vertices, blocks) by phi */
    double *chi_slope;            /* (vertices,) */
    Eight *price_slope;           /* (blocks,) */
    double *low;                  /* (vertices,) psi, then its share in the least */
    int32_t *other;               /* (blocks,) */
    Directions ways;
    Eight *slopes, *lean;         /* (cells, SHAPES, groups) */
    double *steep;                /* of the same shape: the largest h */
    int64_t *visited, visits;     /* numbers of those that are visited */
    Samples samples;
} Slopes;

static Slopes lay_out_slopes(
    Arena *arena, const Devices *devices, const Limits *limits, int meshes, const Samples *counted)
{
    const Mesh first = mesh_of(devices, limits->length);
    const Mesh mesh = finest_mesh(&first, meshes);
    const int64_t v = mesh.vertices, triangles = v * SHAPES * MORE_GROUPS;
    return (Slopes){
        .now = lay_out_potentials(arena, devices, limits, meshes),
        .near_vertex = lay_out_nearby(arena, v, blocks_of(devices)),
        .near_cell = lay_out_nearby(arena, v, blocks_of(devices)),
        .fixed = claim(arena, triangles, sizeof(Eight)),
        .fixed_sum = claim(arena, v, sizeof(double)),
        .half_sum = claim(arena, v, sizeof(double)),
        .slope = claim(arena, v * blocks_of(devices), sizeof(Stored)),
        .chi_slope = claim(arena, v, sizeof(double)),
        .price_slope = claim(arena, blocks_of(devices), sizeof(Eight)),
        .other = claim(arena, blocks_of(devices), sizeof(int32_t)),
        .low = claim(arena, v, sizeof(double)),
        .ways = directions(GROUPS),
        .slopes = claim(arena, triangles, sizeof(Eight)),
        .lean = claim(arena, triangles, sizeof(Eight)),
        .steep = claim(arena, triangles, sizeof(double)),
        .visited = claim(arena, triangles, sizeof(int64_t)),
        .samples = lay_out_samples(arena, devices, limits, counted),
    };
}

/* Triangles, once for every eight axes. */
static int64_t count_triangles(const Slopes *all)
{
    return all->now.mesh.vertices * SHAPES * all->ways.groups;
}

/* The blocks that do not change at a place, of which `changing` is the list. */
static Blocks others(const Slopes *all, Blocks changing)
{
    int32_t *block = all->other;
    int64_t count = 0, next = 0;
    for (int64_t b = 0; b < all->now.blocks; b++)
        if (next < changing.count && changing.block[next] == b)
            next++;
        else
            block[count++] = (int32_t)b;
    return (Blocks){count, block};
}

/* Let potentials change on the present mesh: everywhere, or where there are too many values for that,
   within `radius` of their devices. */
static void open_mesh(Slopes *all, double radius)
{
    const Mesh *mesh = &all->now.mesh;
    const Devices *devices = &all->now.cells.devices;
    if (mesh->vertices * devices->count <= MOST_WIDE) radius = INFINITY;
    list_blocks(&all->near_vertex, devices, mesh, 0.0, radius);
    list_blocks(&all->near_cell, devices, mesh, mesh->side, radius);
    fill_samples(&all->samples, devices, mesh, all->now.limits.length);
    for (int64_t v = 0; v < mesh->vertices; v++) {
        const Blocks near = blocks_near(&all->near_vertex, v);
        all->fixed_sum[v] = half_sum_at(&all->now, v, others(all, near));
        all->half_sum[v] = all->fixed_sum[v] + half_sum_at(&all->now, v, near);
        memset(stored_at(&all->now, all->slope, v), 0, (size_t)all->now.blocks * sizeof(Stored));
    }
    for (int64_t i = 0; i < count_triangles(all); i++) {
        const Triangle at = triangle_at(i, all->ways.groups);
        if (!is_cell(mesh, at.cell)) continue;
        const Blocks fixed = others(all, blocks_near(&all->near_cell, at.cell));
        all->fixed[i] = eight(0.0);
        steepness(&all->now, at, &all->ways, fixed, all->fixed + i, all->lean + i);
    }
}

/* h of a triangle by its number: the largest. */
static double work_out_triangle(const Slopes *all, int64_t i)
{
    const Triangle at = triangle_at(i, all->ways.groups);
    const Blocks near = blocks_near(&all->near_cell, at.cell);
    all->slopes[i] = all->fixed[i];
    return steepness(&all->now, at, &all->ways, near, all->slopes + i, all->lean + i);
}

/* Work out h where it may be near mu, or in all triangles; returns mu. */
static double work_out(Slopes *all, int everywhere, double heat)
{
    double steepest = 1e-9 * all->now.highest;
    if (everywhere) {
        all->visits = 0;
        for (int64_t i = 0; i < count_triangles(all); i++)
            if (is_cell(&all->now.mesh, triangle_at(i, all->ways.groups).cell))
                all->visited[all->visits++] = i;
    }
    for (int64_t j = 0; j < all->visits; j++) {
        const int64_t i = all->visited[j];
        all->steep[i] = work_out_triangle(all, i);
        steepest = most(steepest, all->steep[i]);
    }
    if (everywhere) {
        const double enough = steepest * (1.0 - VISITED * SOFT * heat);
        int64_t kept = 0;
        for (int64_t j = 0; j < all->visits; j++)
            if (all->steep[all->visited[j]] > enough) all->visited[kept++] = all->visited[j];
        all->visits = kept;
    }
    return steepest;
}

/* Turn h into the slopes of its smooth maximum: `slopes` by |grad phi . t|, `lean` by grad chi . t.
   Returns their sum. */
static double soften(Slopes *all, double steepest, double heat)
{
    const double scale = 1.0 / (heat * steepest);
    Eight total = {0};
    for (int64_t j = 0; j < all->visits; j++) {
        Eight *slopes = all->slopes + all->visited[j], *lean = all->lean + all->visited[j];
        const Eight with = soft_eight((*slopes + *lean - steepest) * scale);
        const Eight against = soft_eight((*slopes - *lean - steepest) * scale);
        *slopes = with + against;
        *lean = with - against;
        total += *slopes;
    }
    return sum_of_eight(total);
}

/* Add the slopes of the smooth mu L by the values at a triangle's vertices, `scale` times. */
static void add_triangle(Slopes *all, int64_t number, double scale)
{
    const Triangle at = triangle_at(number, all->ways.groups);
    const Eight x = all->ways.x[at.group], y = all->ways.y[at.group];
    int64_t corner[TRIANGLE], count = 0;
    Point way[EIGHT];
    double weight[EIGHT], first = 0.0, second = 0.0;
    for (int i = 0; i < EIGHT; i++) {
        if (all->slopes[number][i] < NOTHING) continue;
        way[count] = at.shape == 0 ? (Point){x[i], y[i]} : (Point){y[i], x[i]};
        first += scale * all->lean[number][i] * way[count].x;
        second += scale * all->lean[number][i] * way[count].y;
        weight[count++] = 0.5 * scale * all->slopes[number][i];
    }
    if (count == 0) return;
    corners_of(&all->now.mesh, at, corner);
    all->chi_slope[corner[0]] -= first;
    all->chi_slope[corner[1]] += first - second;
    all->chi_slope[corner[2]] += second;
    Stored *a = stored_at(&all->now, all->slope, corner[0]);
    Stored *b = stored_at(&all->now, all->slope, corner[1]);
    Stored *c = stored_at(&all->now, all->slope, corner[2]);
    const Blocks near = blocks_near(&all->near_cell, at.cell);
    for (int64_t j = 0; j < near.count; j++) {
        const int32_t block = near.block[j];
        const Rises rises = rises_over(&all->now, corner, block);
        Eight by_first = {0}, by_second = {0};
        for (int64_t i = 0; i < count; i++) {
            const Eight share =
                with_signs(weight[i], way[i].x * rises.first + way[i].y * rises.second);
            by_first += share * way[i].x;
            by_second += share * way[i].y;
        }
        a[block] -= stored(by_first);
        b[block] += stored(by_first - by_second);
        c[block] += stored(by_second);
    }
}

/* Begin all slopes, which are 0 where potentials change, with those of the smooth minimum of psi
   where paths end. */
static void begin_slopes(Slopes *all)
{
    const int64_t v = all->now.mesh.vertices;
    const double heat = 1.0 / (LOW_HEAT * all->now.highest);
    double lowest = INFINITY, total = 0.0;
    for (int64_t i = 0; i < v; i++) {
        const int is_end = is_in(&all->now.ends, vertex_at(&all->now.mesh, i));
        all->low[i] = is_end ? all->now.chi[i] - all->half_sum[i] : INFINITY;
        lowest = least(lowest, all->low[i]);
    }
    for (int64_t i = 0; i < v; i++) {
        all->low[i] = soft((lowest - all->low[i]) * heat);
        total += all->low[i];
    }
    for (int64_t i = 0; i < v; i++) {
        const double share = all->low[i] / total;
        all->chi_slope[i] = -share;
        if (!(share > 0.0)) continue;
        const Blocks near = blocks_near(&all->near_vertex, i);
        for (int64_t b = 0; b < near.count; b++)
            stored_at(&all->now, all->slope, i)[near.block[b]] = stored(eight(0.5 * share));
    }
}

/* Work out the best stops where they may be near the best of all, or at all samples; returns that. */
static double work_out_stops(Slopes *all, int everywhere, double heat)
{
    Samples *samples = &all->samples;
    double highest = 0.0;
    if (everywhere) {
        samples->near_count = samples->count;
        for (int64_t i = 0; i < samples->count; i++) samples->near_best[i] = i;
    }
    for (int64_t j = 0; j < samples->near_count; j++) {
        const int64_t i = samples->near_best[j];
        samples->best[i] = find_stop(samples, &all->now, i);
        highest = most(highest, samples->best[i]);
    }
    if (everywhere) {
        const double enough = highest - VISITED * SOFT * heat;
        int64_t kept = 0;
        for (int64_t j = 0; j < samples->near_count; j++)
            if (samples->best[samples->near_best[j]] > enough)
                samples->near_best[kept++] = samples->near_best[j];
        samples->near_count = kept;
    }
    return highest;
}

/* Add the slopes of the smooth best of all stops, by potentials and prices. */
static void add_stops(Slopes *all, int everywhere, double heat)
{
    Samples *samples = &all->samples;
    const double highest = work_out_stops(all, everywhere, heat);
    double total = 0.0;
    for (int64_t j = 0; j < samples->near_count; j++) {
        double *best = samples->best + samples->near_best[j];
        *best = soft((*best - highest) / heat);
        total += *best;
    }
    const double scale = (double)(all->now.limits.steps - 1) / most(total, 1e-300);
    for (int64_t j = 0; j < samples->near_count; j++) {
        const int64_t i = samples->near_best[j];
        const double share = scale * samples->best[i];
        if (share < NOTHING) continue;
        find_stop(samples, &all->now, i);
        for (int64_t n = 0; n < samples->stop.count; n++) {
            const int32_t k = samples->stop.device[n];
            float *slope = (float *)all->slope + k;
            all->price_slope[k / EIGHT][k % EIGHT] -= share;
            for (int c = 0; c < TRIANGLE; c++)
                slope[samples->sample[i].vertex[c] * all->now.blocks * EIGHT] -=
                    (float)(share * samples->sample[i].share[c]);
        }
    }
}

/* Add the slopes of the stop at the start, by prices. */
static void add_start(Slopes *all)
{
    const Devices *devices = &all->now.cells.devices;
    Stop *stop = &all->samples.stop;
    stop->count = 0;
    for (int64_t k = 0; k < devices->count; k++) {
        const double gain = worth(devices, k, (Point){0.0, 0.0}) - price_of(&all->now, k);
        if (gain > least_gain(stop)) serve_at(stop, (int32_t)k, gain);
    }
    for (int64_t n = 0; n < stop->count; n++)
        all->price_slope[stop->device[n] / EIGHT][stop->device[n] % EIGHT] -= 1.0;
}

/* Work out all slopes. The heat of mu is a share of it; that of a stop, of what the bound has for it. */
static void find_slopes(Slopes *all, int everywhere, double heat, double stop_heat)
{
    const Potentials *now = &all->now;
    const double steepest = work_out(all, everywhere, heat);
    const double sum = most(soften(all, steepest, heat), 1e-300);
    const double by_side = now->limits.length / now->mesh.side;
    Eight prices = {0};
    begin_slopes(all);
    for (int64_t j = 0; j < all->visits; j++)
        add_triangle(all, all->visited[j], by_side / sum);
    for (int64_t b = 0; b < now->blocks; b++) {
        prices += now->price[b] - now->floor;
        all->price_slope[b] = eight(1.0);
    }
    const double bound = steepest * by_side + sum_of_eight(prices);
    add_stops(all, everywhere, stop_heat * bound / (double)(now->limits.steps - 1));
    add_start(all);
}

#endif
