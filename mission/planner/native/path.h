/* What a node's relaxation looks like: its path, and where it promises more than it can keep. */
#ifndef PATH_H
#define PATH_H

#include "lagrangian.h"

/* The relaxed path of a node. */
typedef struct {
    Point points[MOST_DEVICES + 1]; /* the start, then the stops in order */
    double radius[MOST_DEVICES]; /* by device: distance it is served from, if in the order */
    double excess[MOST_DEVICES]; /* by device: what the bound promises beyond what the path brings */
} Path;

/* What a device that may be left out earns from a distance. */
static double earned_at(double r, int64_t k, const Devices *devices)
{
    return most(0.0, devices->delta[k] * reward(r, devices).f - cost_of(devices, k));
}

/* Fill `path` from the node's dual; returns what it would earn with a stop everywhere. Whoever is in the
   order pays its price; the others are served if they are worth it. */
static double recover(const Node *node, const Problem *problem, Path *path)
{
    const Devices *devices = &problem->devices;
    const int64_t m = node->size;
    double real = 0.0;
    path->points[0] = (Point){0.0, 0.0};
    for (int64_t i = 0; i < m; i++) {
        const int64_t k = node->order[i];
        const Point w = i + 1 < m ? less(node->y[i], node->y[i + 1]) : node->y[i];
        const double delta = devices->delta[k], z = sqrt(w.x * w.x + w.y * w.y), s = z / delta;
        const Conjugate at = conjugate_at(s, node->interval[i], &problem->relaxation);
        const double shift = z > 0.0 ? at.slope / z : 0.0;
        path->points[i + 1] =
            (Point){devices->at[k].x - shift * w.x, devices->at[k].y - shift * w.y};
        path->radius[k] = at.slope;
        const double brought = delta * reward(at.slope, devices).f;
        path->excess[k] = delta * (at.h - s * at.slope) - brought;
        real += brought - cost_of(devices, k);
    }
    for (int64_t k = 0; k < devices->count; k++)
        if (node->level[k] != PLACED) {
            const double away = distance_to(devices->at[k], path->points, m + 1);
            const double earns = earned_at(away, k, devices);
            path->excess[k] = promise_of(node, k, &problem->relaxation) - earns;
            real += earns;
        }
    return real;
}

/* Count for devices off the order only what the stops bring, not the legs between them. */
static void at_stops(const Node *node, const Problem *problem, Path *path)
{
    const Devices *devices = &problem->devices;
    for (int64_t k = 0; k < devices->count; k++)
        if (node->level[k] != PLACED) {
            double square = INFINITY;
            for (int64_t i = 0; i <= node->size; i++)
                square = least(square, square_between(path->points[i], devices->at[k]));
            path->excess[k] =
                promise_of(node, k, &problem->relaxation) - earned_at(sqrt(square), k, devices);
        }
}

#endif
