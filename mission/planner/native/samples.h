/* Where devices are looked at while potentials are lowered: vertices, and more where f bends within
   a cell. */
#ifndef SAMPLES_H
#define SAMPLES_H

#include "potentials.h"

enum { SPLITS = 3 };              /* of a cell's side, where f bends */
static const double BENT = 0.01;  /* share of the best f that it bends by within a cell */
static const double FAINT = 0.02; /* share of the best f that is not sampled */

typedef struct {
    Sample *sample;
    int64_t *first, *active; /* (K + 1,), (K,): those of each device, the active ones first */
    double *value;           /* of a device's */
} Samples;

static int splits_at(const Devices *devices, const Mesh *mesh, Point corner, int64_t k)
{
    const double best = devices->table[0], side = mesh->side;
    const double r = between((Point){corner.x + 0.5 * side, corner.y + 0.5 * side}, devices->at[k]);
    const Reward at = reward(r, devices);
    const double bend = most(-at.bend, -at.slope / most(r, 1.0));
    return bend * side * side > 8.0 * BENT * best ? SPLITS : 1;
}

/* List the samples of device k; returns how many. They are written where there is memory for them. */
static int64_t list_samples(
    const Devices *devices, const Mesh *mesh, double length, int64_t k, Sample *into)
{
    int64_t count = 0;
    for (int64_t v = 0; v < mesh->vertices; v++) {
        const Point corner = vertex_at(mesh, v);
        const int inner = is_cell(mesh, v);
        const int splits = inner ? splits_at(devices, mesh, corner, k) : 1;
        for (int i = 0; i < splits * splits; i++) {
            const double east = (double)(i % splits) / splits;
            const double north = (double)(i / splits) / splits;
            const Point place = {corner.x + mesh->side * east, corner.y + mesh->side * north};
            const double f = reward(between(place, devices->at[k]), devices).f;
            if (f < FAINT * devices->table[0] || from_start(place, 0.0, 1.0) > length) continue;
            if (into) {
                const int32_t alone = (int32_t)v; /* at the edge of the mesh */
                into[count] = inner ? sample_at(mesh, v, east, north)
                                    : (Sample){{alone, alone, alone}, {1.0, 0.0, 0.0}, 0.0};
                into[count].reward = devices->delta[k] * f;
            }
            count++;
        }
    }
    return count;
}

/* The samples of all devices, on any of the meshes, that there has to be room for. */
static int64_t count_samples(const Devices *devices, const Limits *limits, int meshes)
{
    Mesh mesh = mesh_of(devices, limits->length);
    int64_t most_count = 0;
    for (int i = 0; i < meshes; i++) {
        int64_t count = 0;
        for (int64_t k = 0; k < devices->count; k++)
            count += list_samples(devices, &mesh, limits->length, k, NULL);
        if (count > most_count) most_count = count;
        mesh = finer_mesh(&mesh);
    }
    return most_count;
}

static Samples lay_out_samples(Arena *arena, int64_t devices, int64_t samples)
{
    return (Samples){
        .sample = claim(arena, samples, sizeof(Sample)),
        .first = claim(arena, devices + 1, sizeof(int64_t)),
        .active = claim(arena, devices, sizeof(int64_t)),
        .value = claim(arena, samples, sizeof(double)),
    };
}

static void fill_samples(const Samples *samples, const Potentials *of)
{
    const Devices *devices = &of->cells.devices;
    for (int64_t k = 0; k < devices->count; k++) {
        const int64_t first = samples->first[k];
        samples->active[k] = list_samples(
            devices, &of->mesh, of->limits.length, k, samples->sample + first);
        samples->first[k + 1] = first + samples->active[k];
    }
}

#endif
