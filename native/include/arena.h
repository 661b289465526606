/* Memory that is laid out twice: without memory to count, then to give it away piece by piece, each
   on a cache line (vectors across two lines cost twice). All of it is zeros. */
#ifndef ARENA_H
#define ARENA_H

#include <stdint.h>
#include <stdlib.h>

/* Address sanitizer sees what is beyond a piece, too. */
#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/asan_interface.h>
enum { FENCE = 4096 }; /* bytes: wider than any structure, so that the one before an array is seen */
#else
#define ASAN_POISON_MEMORY_REGION(at, size)
enum { FENCE = 0 };
#endif

typedef struct {
    char *memory, *at;
    size_t used;
} Arena;

static void *claim(Arena *arena, int64_t count, size_t size)
{
    const size_t start = arena->used, end = start + (size_t)count * size;
    arena->used = (end + FENCE + 63) / 64 * 64;
    if (!arena->at) return NULL;
    ASAN_POISON_MEMORY_REGION(arena->at + end, arena->used - end);
    return arena->at + start;
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
