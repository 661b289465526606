/* The nodes of a search that are open: a heap, the largest bound first. */
#ifndef QUEUE_H
#define QUEUE_H

#include <stdlib.h>

#include "rewards.h"

typedef struct {
    double **open; /* (most,) nodes, each of which begins with its bound */
    int64_t count, most;
} Queue;

/* Leave a node open, which is freed then once it is closed. Where there is no room, or it is NULL, it
   is closed at once, and `closed` becomes its bound if that is larger. */
static void leave_open(Queue *queue, void *node, double bound, double *closed)
{
    if (!node || queue->count == queue->most) {
        *closed = most(*closed, bound);
        free(node);
        return;
    }
    int64_t i = queue->count++;
    for (; i > 0 && *queue->open[(i - 1) / 2] < bound; i = (i - 1) / 2)
        queue->open[i] = queue->open[(i - 1) / 2];
    queue->open[i] = node;
}

/* The open node with the largest bound. */
static void *dequeue(Queue *queue)
{
    double *first = queue->open[0], *last = queue->open[--queue->count];
    int64_t i = 0;
    for (int64_t child; (child = 2 * i + 1) < queue->count; i = child) {
        if (child + 1 < queue->count && *queue->open[child + 1] > *queue->open[child]) child++;
        if (*last >= *queue->open[child]) break;
        queue->open[i] = queue->open[child];
    }
    queue->open[i] = last;
    return first;
}

static void close_all(Queue *queue)
{
    while (queue->count > 0) free(queue->open[--queue->count]);
}

#endif
