/* Where stops are looked at while potentials are lowered: vertices, devices, and more where f bends
   within a cell. */
#ifndef SAMPLES_H
#define SAMPLES_H

#include "stops.h"

enum { SPLITS = 3 };               /* of a cell's side, where f bends */
static const double BENT = 0.01;   /* share of the best f that it bends by within a cell */
static const double FAINT = 0.004; /* share of the best f that is not sampled */

/* The devices of a stop, from the one that brings the most. */
typedef struct {
    int32_t *device; /* (K_bar,) */
    double *gain;    /* (K_bar,) what they bring beyond potential and price */
    int64_t count, most;
} Stop;

typedef struct {
    Sample *sample;
    int64_t *first; /* (samples + 1,) of what is heard at each */
    int32_t *block; /* (heard,) heard there, */
    Stored *reward; /* and what its devices earn */
    double *best;   /* (samples,) what a stop is worth */
    int64_t *near_best; /* (samples,) numbers of those near the best stop */
    int64_t count, heard, near_count;
    Stop stop;
} Samples;

/* Add a place, if anything is heard there. Without memory places are only counted. */
static void add_sample(
    Samples *all, const Devices *devices, double length, Point place, Sample sample)
{
    const double faint = FAINT * devices->table[0];
    const int64_t before = all->heard;
    if (from_start(place, 0.0, 1.0) > length) return;
    for (int64_t b = 0; b < blocks_of(devices); b++) {
        Eight rewards = {0};
        int is_heard = 0;
        for (int64_t k = b * EIGHT; k < fewer((b + 1) * EIGHT, devices->count); k++) {
            const double f = reward(between(place, devices->at[k]), devices).f;
            rewards[k % EIGHT] = devices->delta[k] * f;
            is_heard |= f >= faint;
        }
        if (!is_heard) continue;
        if (all->block) {
            all->block[all->heard] = (int32_t)b;
            all->reward[all->heard] = stored(rewards);
        }
        all->heard++;
    }
    if (all->heard == before) return;
    if (all->sample) {
        all->sample[all->count] = sample;
        all->first[all->count + 1] = all->heard;
    }
    all->count++;
}

/* Into how many parts a side of a cell is split: by the devices around it. */
static int splits_of(const Devices *devices, const Mesh *mesh, Point corner)
{
    const double best = devices->table[0], side = mesh->side;
    const Point middle = {corner.x + 0.5 * side, corner.y + 0.5 * side};
    for (int64_t k = 0; k < devices->count; k++) {
        const double r = between(middle, devices->at[k]);
        const Reward at = reward(r, devices);
        const double bend = most(-at.bend, -at.slope / most(r, 1.0));
        if (at.f >= FAINT * best && bend * side * side > 8.0 * BENT * best) return SPLITS;
    }
    return 1;
}

static void fill_samples(
    Samples *all, const Devices *devices, const Mesh *mesh, double length)
{
    all->count = all->heard = 0;
    for (int64_t v = 0; v < mesh->vertices; v++) {
        const Point corner = vertex_at(mesh, v);
        if (!is_cell(mesh, v)) {
            const int32_t alone = (int32_t)v; /* at the edge of the mesh */
            const Sample sample = {{alone, alone, alone}, {1.0, 0.0, 0.0}};
            add_sample(all, devices, length, corner, sample);
            continue;
        }
        const int splits = splits_of(devices, mesh, corner);
        for (int i = 0; i < splits * splits; i++) {
            const double east = (double)(i % splits) / splits;
            const double north = (double)(i / splits) / splits;
            const Point place = {corner.x + mesh->side * east, corner.y + mesh->side * north};
            add_sample(all, devices, length, place, sample_at(mesh, v, east, north));
        }
    }
    for (int64_t k = 0; k < devices->count; k++) {
        const Point u = devices->at[k];
        const double east = (u.x - mesh->low.x) / mesh->side;
        const double north = (u.y - mesh->low.y) / mesh->side;
        if (!(east >= 0.0 && north >= 0.0)) continue; /* out of reach */
        const int64_t column = fewer((int64_t)east, mesh->across - 2);
        const int64_t row = fewer((int64_t)north, mesh->up - 2);
        const double x = least(1.0, east - (double)column), y = least(1.0, north - (double)row);
        add_sample(all, devices, length, u, sample_at(mesh, row * mesh->across + column, x, y));
    }
}

/* The samples that there has to be room for, on any of the meshes. */
static Samples count_samples(const Devices *devices, const Limits *limits, int meshes)
{
    Mesh mesh = mesh_of(devices, limits->length);
    Samples largest = {0};
    for (int i = 0; i < meshes; i++) {
        Samples all = {0};
        fill_samples(&all, devices, &mesh, limits->length);
        if (all.count > largest.count) largest.count = all.count;
        if (all.heard > largest.heard) largest.heard = all.heard;
        mesh = finer_mesh(&mesh);
    }
    return largest;
}

static Samples lay_out_samples(
    Arena *arena, const Devices *devices, const Limits *limits, const Samples *counted)
{
    const int64_t most = fewer(limits->per_step, devices->count);
    return (Samples){
        .sample = claim(arena, counted->count, sizeof(Sample)),
        .first = claim(arena, counted->count + 1, sizeof(int64_t)),
        .block = claim(arena, counted->heard, sizeof(int32_t)),
        .reward = claim(arena, counted->heard, sizeof(Stored)),
        .best = claim(arena, counted->count, sizeof(double)),
        .near_best = claim(arena, counted->count, sizeof(int64_t)),
        .stop = {
            .device = claim(arena, most, sizeof(int32_t)),
            .gain = claim(arena, most, sizeof(double)),
            .most = most,
        },
    };
}

/* What a device has to bring more than to be served. */
static inline double least_gain(const Stop *stop)
{
    return stop->count == stop->most ? stop->gain[stop->most - 1] : 0.0;
}

static inline void serve_at(Stop *stop, int32_t device, double gain)
{
    int64_t i = stop->count < stop->most ? stop->count++ : stop->most - 1;
    for (; i > 0 && stop->gain[i - 1] < gain; i--) {
        stop->gain[i] = stop->gain[i - 1];
        stop->device[i] = stop->device[i - 1];
    }
    stop->gain[i] = gain;
    stop->device[i] = device;
}

/* What the devices of the j-th block that is heard, at sample i, earn beyond potentials and prices. */
static inline Eight gains_at(const Samples *all, const Potentials *by, int64_t i, int64_t j)
{
    const Sample *at = all->sample + i;
    const int32_t b = all->block[j];
    Eight gain = taken(all->reward[j]) - by->price[b];
    for (int c = 0; c < TRIANGLE; c++)
        gain -= at->share[c] * taken(stored_at(by, by->phi, at->vertex[c])[b]);
    return gain;
}

/* The best stop at a sample; returns what it earns beyond potentials and prices. */
static double find_stop(Samples *all, const Potentials *by, int64_t i)
{
    Stop *stop = &all->stop;
    double total = 0.0;
    stop->count = 0;
    for (int64_t j = all->first[i]; j < all->first[i + 1]; j++) {
        const Eight gain = gains_at(all, by, i, j);
        if (!any_above(gain, least_gain(stop))) continue; /* as most often */
        for (int lane = 0; lane < EIGHT; lane++)
            if (gain[lane] > least_gain(stop))
                serve_at(stop, all->block[j] * EIGHT + lane, gain[lane]);
    }
    for (int64_t n = 0; n < stop->count; n++) total += stop->gain[n];
    return total;
}

#endif
