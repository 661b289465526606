/* Eight neighbours make a block. Where there are many, its potentials change around them only;
   further away they stay as they were on a coarser mesh. */
#ifndef BLOCKS_H
#define BLOCKS_H

#include "arena.h"
#include "mesh.h"

/* Some blocks, in order. */
typedef struct {
    int64_t count;
    const int32_t *block;
} Blocks;

/* Those near each vertex, or near each cell: what is near a vertex is near its cells. */
typedef struct {
    int64_t *first; /* (vertices + 1,) */
    int32_t *block;
} Nearby;

static int64_t blocks_of(const Devices *devices) { return (devices->count + EIGHT - 1) / EIGHT; }

static Nearby lay_out_nearby(Arena *arena, int64_t vertices, int64_t blocks)
{
    return (Nearby){
        .first = claim(arena, vertices + 1, sizeof(int64_t)),
        .block = claim(arena, vertices * blocks, sizeof(int32_t)),
    };
}

static inline Blocks blocks_near(const Nearby *near, int64_t i)
{
    return (Blocks){near->first[i + 1] - near->first[i], near->block + near->first[i]};
}

/* Whether one of a block's devices is within `radius` of a square, in x and y. */
static int is_near(const Devices *devices, int64_t block, Point middle, double half, double radius)
{
    for (int64_t k = block * EIGHT; k < fewer((block + 1) * EIGHT, devices->count); k++) {
        const Point u = devices->at[k];
        if (fabs(u.x - middle.x) < radius + half && fabs(u.y - middle.y) < radius + half) return 1;
    }
    return 0;
}

/* List the blocks within `radius` of squares of that size, north-east of the vertices. */
static void list_blocks(
    const Nearby *near, const Devices *devices, const Mesh *mesh, double side, double radius)
{
    int64_t count = 0;
    for (int64_t v = 0; v < mesh->vertices; v++) {
        const Point low = vertex_at(mesh, v);
        const Point middle = {low.x + 0.5 * side, low.y + 0.5 * side};
        near->first[v] = count;
        for (int64_t b = 0; b < blocks_of(devices); b++)
            if (is_near(devices, b, middle, 0.5 * side, radius)) near->block[count++] = (int32_t)b;
    }
    near->first[mesh->vertices] = count;
}

#endif
