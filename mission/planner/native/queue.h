/* The nodes of a search that are open: a heap, the largest bound first. */
#ifndef QUEUE_H
#define QUEUE_H

#include <stdlib.h>

#include "rewards.h"

/* After so many nodes, divided by the devices, and whenever there have been twice as many, a search looks
   at its progress. Those that end do so within this many times the nodes that it foretells. */
enum { FIRST_LOOK = 40000 };
static const double OVERRUN = 1.5;

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

/* A bound at or under this is met by a plan of that value. */
static double enough_for(const Target *target, double value)
{
    return most(value / (1.0 - target->gap), value + target->slack);
}

typedef struct {
    double bound; /* that no plan exceeds */
    int64_t nodes; /* looked into */
    enum Ended ended;
} Proof;

/* How a search gets on. */
typedef struct {
    int64_t look; /* the number of nodes after which to look again */
    double gap;   /* what was left at the last look */
} Progress;

/* Whether a search would not end within `most_nodes`, if each time that its nodes double took as much
   off the gap as the last. */
static int is_hopeless(Progress *progress, int64_t nodes, double gap, double goal, int64_t most_nodes)
{
    if (nodes != progress->look) return 0;
    const double taken_off = progress->gap - gap;
    double needed = (double)nodes, doublings = (gap - goal) / taken_off;
    progress->look *= 2;
    progress->gap = gap;
    for (; doublings > 1.0 && needed <= OVERRUN * (double)most_nodes; doublings--) needed *= 2.0;
    return !(taken_off > 0.0) || needed * (1.0 + doublings) > OVERRUN * (double)most_nodes;
}

#endif
