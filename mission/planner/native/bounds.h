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

/* An order to solve, down to where with `others` it closes the node. */
static Order order_of(Node *node, const Goal *goal, double others)
{
    return (Order){
        .node = node, .enough = goal->enough - others, .pointed = -1, .mu = goal->mu};
}

/* Minimise the dual of a node to the end, and lower its bound. */
static void tighten(Node *node, const Goal *goal, Solver *solver)
{
    Order order = order_of(node, goal, goal->rest);
    minimise(&order, 1, (Aim){goal->eps, 0.0}, solver);
    node->dual = least(node->dual, order.bound);
    node->bound = least(node->bound, node->dual + goal->rest);
}

/* The dual of a leg that points there, well inside its cone. */
static Point towards(Point from, Point to, double mu)
{
    const double x = to.x - from.x, y = to.y - from.y;
    const double scale = 0.9 * mu / (sqrt(x * x + y * y) + 1e-9);
    return (Point){scale * x, scale * y};
}

/* An order with a device just inserted: its edges go straight on, or towards the device and back,
   whichever is nearer to the minimum. */
static Order order_with(
    Node *node, int64_t at, const Path *path, const Problem *problem, const Goal *goal,
    double others)
{
    const Point u = problem->devices.at[node->order[at]];
    const int inner = at + 1 < node->size;
    Order order = order_of(node, goal, others);
    node->y[at] = inner ? node->y[at + 1] : (Point){0.0, 0.0};
    order.pointed = at;
    order.before = towards(path->points[at], u, node->mu);
    if (inner) order.after = towards(u, path->points[at + 1], node->mu);
    return order;
}

#endif
