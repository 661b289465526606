/* What a node's relaxation looks like: its path, and where it promises more than it can keep. */
#ifndef PATH_H
#define PATH_H

#include "dual.h"

static const double STRICTER = 1.0, EASED = 0.7; /* what later legs count more, and less again */

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

/* The device to be decided about with the largest excess above `floor`, not tried; or -1. */
static int64_t pick_device(
    const Node *node, const Path *path, const Problem *problem, double floor, uint64_t tried)
{
    const int64_t last = problem->relaxation.radii - 1;
    int64_t best = -1;
    for (int64_t k = 0; k < problem->devices.count; k++) {
        const int undecided = node->level[k] != PLACED && node->level[k] < last;
        if (undecided && !(tried >> k & 1) && path->excess[k] > floor) {
            floor = path->excess[k];
            best = k;
        }
    }
    return best;
}

/* The position with the largest excess above `floor` and an interval to cut; or -1. */
static int64_t pick_stop(
    const Node *node, const Path *path, const Relaxation *relaxation, double floor)
{
    int64_t best = -1;
    for (int64_t i = 0; i < node->size; i++) {
        const int64_t *ends = relaxation->ends + 2 * node->interval[i];
        const double excess = path->excess[node->order[i]];
        if (ends[1] - ends[0] > 1 && excess > floor) {
            floor = excess;
            best = i;
        }
    }
    return best;
}

/* The undecided edge of the leg whose stop takes most that is not counted yet; or -1. */
static int64_t pick_stopping(const Node *node, const Path *path, const Problem *problem)
{
    int64_t best = -1;
    double least_m = problem->limits.stop.least;
    for (int64_t i = 0; i < node->size; i++) {
        if (node->edge[i] != UNDECIDED) continue;
        const double leg = between(path->points[i + 1], path->points[i]);
        const Taken counted = taken(node, i, problem->limits.stop, problem);
        const double missing =
            stop_of(problem->limits.stop, leg) + (1.0 - counted.slope) * leg - counted.fixed;
        if (missing > least_m) {
            best = i;
            least_m = missing;
        }
    }
    return best;
}

/* The undecided edge with the longest leg; or -1. Merging it costs most, and where it is barred there
   is one stop fewer for the others. */
static int64_t pick_edge(const Node *node, const Path *path)
{
    int64_t best = -1;
    double longest = -1.0;
    for (int64_t i = 0; i < node->size; i++)
        if (node->edge[i] == UNDECIDED && !apart(node, i)) {
            const double square = square_between(path->points[i + 1], path->points[i]);
            if (square > longest) {
                best = i;
                longest = square;
            }
        }
    return best;
}

/* Where to cut the interval of the stop at a position: next to its relaxed distance. */
static int64_t cut_radius(
    const Node *node, int64_t at, const Path *path, const Relaxation *relaxation)
{
    const int64_t *ends = relaxation->ends + 2 * node->interval[at];
    const double *radius = relaxation->radius_m, have = path->radius[node->order[at]];
    int64_t best = ends[0] + 1;
    for (int64_t b = best + 1; b < ends[1]; b++)
        if (fabs(radius[b] - have) < fabs(radius[best] - have)) best = b;
    return best;
}

/* Let later legs count more where too much comes after a device's turn, or less where too little. */
static void weigh_turns(Node *node, const Path *path, const Problem *problem)
{
    const Devices *devices = &problem->devices;
    double behind = 0.0, worst = 0.0;
    int64_t at = -1;
    for (int64_t k = node->size - 1; k >= 0; k--) {
        behind += devices->sends[node->order[k]];
        const double over = behind - devices->after[node->order[k]];
        if (over > worst) {
            worst = over;
            at = k;
        }
        if (over < 0.0) node->wait[k] *= EASED;
        const Taken leg = taken(node, k, problem->limits.turn, problem);
        behind += leg.slope * between(path->points[k + 1], path->points[k]) + leg.fixed;
    }
    if (at >= 0) node->wait[at] += STRICTER;
}

#endif
