/* Memory that is laid out twice: without memory to count, then to give it away piece by piece, each
   on a cache line (vectors across two lines cost twice). All of it is zeros. */
#ifndef ARENA_H
#define ARENA_H

#include <stdint.h>
#include <stdlib.h>

typedef struct {
    char *memory, *at;
    size_t used;
} Arena;

static void *claim(Arena *arena, int64_t count, size_t size)
{
    size_t start = arena->used;
    arena->used += ((size_t)count * size + 63) / 64 * 64;
    return arena->at ? arena->at + start : NULL;
}

/* After the first pass; 0 where memory is short. */
static int provide(Arena *arena)
{
    arena->memory = calloc(arena->used + 63, 1);
    if (!arena->memory) return 0;
    arena->at = arena->memory + (64 - (uintptr_t)arena->memory % 64) % 64;
    arena->used = 0;
    return 1;
}

static void release(Arena *arena) { free(arena->memory); }

#endif
