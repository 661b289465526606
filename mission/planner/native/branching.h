/* Ways to split a node, each with the bounds of its children, and what they are worth. */
#ifndef BRANCHING_H
#define BRANCHING_H

#include "bounds.h"

enum Kind { INSERTION, SPLIT, MERGE };
enum { OUT_OF_REACH = -1 }; /* in place of a gap */
static const double CHILD_COST = 0.02;

/* A child that is left open. */
typedef struct {
    int64_t detail; /* gap or OUT_OF_REACH, interval row, or state of an edge */
    double bound, dual, mu;
    Point y[MOST_DEVICES];
} Child;

/* One way to split a node, with those of its children that are left open. */
typedef struct {
    double score;  /* less is better */
    double closed; /* largest bound among the children closed */
    enum Kind kind;
    int64_t what, radius; /* device or position; of an insertion, index of the radius */
    int64_t count;
    Child child[MOST_DEVICES + 2];
} Family;

static void begin(Family *family, enum Kind kind, int64_t what, int64_t radius)
{
    family->score = family->closed = 0.0;
    family->kind = kind;
    family->what = what;
    family->radius = radius;
    family->count = 0;
}

/* Take a child into the family unless its bound closes it. The score stands for the work below:
   the children's excess over the threshold as a share of the parent's, to the fourth power. */
static int offer(
    Family *family, int64_t detail, double dual, double others, const Node *parent,
    const Node *node, const Goal *goal)
{
    const double bound = least(parent->bound, dual + others);
    if (bound <= goal->enough) {
        family->closed = most(family->closed, bound);
        return 0;
    }
    Child *child = &family->child[family->count++];
    child->detail = detail;
    child->bound = bound;
    child->dual = dual;
    child->mu = node->mu;
    memcpy(child->y, node->y, (size_t)node->size * sizeof(Point));
    const double share = (bound - goal->enough) / (parent->bound - goal->enough);
    family->score += CHILD_COST + share * share * (share * share);
    return 1;
}

/* The interval between two radii. */
static int64_t row_of(const Relaxation *relaxation, int64_t inner, int64_t outer)
{
    return relaxation->row[inner * relaxation->radii + outer];
}

/* Serve a device from within the next rung's radius, at each gap of the order, or not.

   On the last rung, gaps without a child are closed in the node's mask, for all descendants. */
static void by_insertion(
    Node *node, int64_t device, const Path *path, const Problem *problem, const Goal *goal,
    Family *family, Work *work)
{
    const Relaxation *relaxation = &problem->relaxation;
    const int64_t level = node->level[device], radius = relaxation->ladder[level];
    const double promise = promise_of(node, device, relaxation), others = goal->rest - promise;
    begin(family, INSERTION, device, radius);
    for (int64_t gap = 0; gap <= node->size; gap++) {
        const uint64_t bit = (uint64_t)1 << gap;
        if (!(node->mask[device] & bit)) continue;
        Node child = *node;
        insert(&child, problem->devices.count, device, gap, row_of(relaxation, level, radius));
        if (!settle(&child, &problem->limits)) continue;
        point_at(&child, gap, path, problem, goal->eps, work);
        double dual = solve(&child, problem, goal, others, LOOSE, work);
        dual = least(dual, node->dual + promise);
        const int stays = offer(family, gap, dual, others, node, &child, goal);
        if (!stays && radius == relaxation->radii - 1) node->mask[device] &= ~bit;
    }
    double rest = others + relaxation->promise[device * relaxation->radii + radius];
    if (problem->devices.count > problem->limits.steps * problem->limits.per_step) {
        Node away = *node; /* another device may take its place */
        away.level[device] = (int8_t)radius;
        rest = rest_of(&away, problem);
    }
    offer(family, OUT_OF_REACH, node->dual, rest, node, node, goal);
}

/* Split the distance interval of the stop at a position. */
static void by_split(
    const Node *node, int64_t at, int64_t radius, const Problem *problem, const Goal *goal,
    Family *family, Work *work)
{
    const Relaxation *relaxation = &problem->relaxation;
    const int64_t *ends = relaxation->ends + 2 * node->interval[at];
    begin(family, SPLIT, at, radius);
    for (int side = 0; side < 2; side++) {
        const int64_t row = side == 0 ? row_of(relaxation, ends[0], radius)
                                      : row_of(relaxation, radius, ends[1]);
        Node child = *node;
        child.interval[at] = (int16_t)row;
        const double dual =
            least(node->dual, solve(&child, problem, goal, goal->rest, LOOSE, work));
        offer(family, row, dual, goal->rest, node, &child, goal);
    }
}

/* Make the stop at a position one with the stop before it, or keep them apart for good. */
static void by_merge(
    const Node *node, int64_t at, const Problem *problem, const Goal *goal, Family *family,
    Work *work)
{
    begin(family, MERGE, at, 0);
    for (int8_t edge = MERGED; edge <= BARRED; edge++) {
        Node child = *node;
        child.edge[at] = edge;
        if (!settle(&child, &problem->limits)) continue;
        double dual = node->dual;
        if (stops_now(&child) < stops_now(node))
            dual = least(dual, solve(&child, problem, goal, goal->rest, LOOSE, work));
        offer(family, edge, dual, goal->rest, node, &child, goal);
    }
}

/* The node of child `c`. */
static Node make_child(
    const Node *node, const Family *family, int64_t c, const Problem *problem)
{
    const Child *from = &family->child[c];
    const int64_t what = family->what;
    Node child = *node;
    if (family->kind == SPLIT)
        child.interval[what] = (int16_t)from->detail;
    else if (family->kind == MERGE)
        child.edge[what] = (int8_t)from->detail;
    else if (from->detail == OUT_OF_REACH)
        child.level[what] = (int8_t)family->radius;
    else
        insert(
            &child, problem->devices.count, what, from->detail,
            row_of(&problem->relaxation, node->level[what], family->radius));
    if (family->kind != SPLIT) settle(&child, &problem->limits);
    child.bound = from->bound;
    child.dual = from->dual;
    child.mu = from->mu;
    memcpy(child.y, from->y, (size_t)child.size * sizeof(Point));
    return child;
}

#endif
