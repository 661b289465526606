/* Bounds of nodes: the dual of the order plus what the other devices promise. */
#ifndef BOUNDS_H
#define BOUNDS_H

#include "dual.h"
#include "path.h"

/* A child's dual is minimised until what is left to gain is under this share of its excess over
   the threshold: it will stay open anyway. */
static const double LOOSE = 0.25;

/* What bounds of a node's children are measured against. */
typedef struct {
    double rest;   /* bound of what the devices off the order bring */
    double eps;    /* barrier weight */
    double enough; /* a bound at or under this closes a node */
    double mu;     /* a multiplier of the right size */
} Goal;

/* Bound of what the devices off the order can bring, within the places that are left. */
static double rest_of(const Node *node, const Problem *problem)
{
    const int64_t room = problem->limits.steps * problem->limits.per_step - node->size;
    double promises[MOST_DEVICES], total = 0.0;
    int64_t count = 0;
    for (int64_t k = 0; k < problem->devices.count; k++)
        if (node->level[k] != PLACED) {
            promises[count] = promise_of(node, k, &problem->relaxation);
            total += promises[count++];
        }
    if (count <= room) return total;
    if (room <= 0) return 0.0;
    nth_largest(promises, count, room);
    total = 0.0;
    for (int64_t i = 0; i < room; i++) total += promises[i];
    return total;
}

static void set_factors(const Node *node, Work *work)
{
    for (int64_t i = 0; i < node->size; i++) work->factor[i] = node->edge[i] == MERGED ? FREE : 1.0;
}

/* Minimise the dual of a node in place, down to where with `others` it closes the node. */
static double solve(
    Node *node, const Problem *problem, const Goal *goal, double others, double loose, Work *work)
{
    const Aim aim = {goal->eps, goal->enough - others, loose};
    set_factors(node, work);
    Minimum found = minimise(node, problem, aim, work);
    if (found.centred) return found.bound;
    /* Too near the boundary of the cones: start again from their middle. */
    memset(node->y, 0, (size_t)node->size * sizeof(Point));
    node->mu = goal->mu;
    return least(found.bound, minimise(node, problem, aim, work).bound);
}

/* Minimise the dual of a node to the end, and lower its bound. */
static void tighten(Node *node, const Problem *problem, const Goal *goal, Work *work)
{
    node->dual = least(node->dual, solve(node, problem, goal, goal->rest, 0.0, work));
    node->bound = least(node->bound, node->dual + goal->rest);
}

/* The dual of a leg that points there, well inside its cone. */
static Point towards(Point from, Point to, double mu)
{
    const double x = to.x - from.x, y = to.y - from.y;
    const double scale = 0.9 * mu / (sqrt(x * x + y * y) + 1e-9);
    return (Point){scale * x, scale * y};
}

/* Start values of the edges at a device just inserted: straight on, or towards the device
   and back, whichever is nearer to the minimum. */
static void point_at(
    Node *node, int64_t gap, const Path *path, const Problem *problem, double eps, Work *work)
{
    const Point u = problem->devices.at[node->order[gap]];
    const int inner = gap + 1 < node->size;
    const Point straight = inner ? node->y[gap + 1] : (Point){0.0, 0.0};
    set_factors(node, work);
    node->y[gap] = straight;
    const double plain = evaluate(node, problem, eps, node->y, node->mu, work).barrier;
    node->y[gap] = towards(path->points[gap], u, node->mu);
    if (inner) node->y[gap + 1] = towards(u, path->points[gap + 1], node->mu);
    if (evaluate(node, problem, eps, node->y, node->mu, work).barrier < plain) return;
    node->y[gap] = straight;
    if (inner) node->y[gap + 1] = straight;
}

#endif
