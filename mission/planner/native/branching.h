/* Ways to split a node, each with the bounds of its children, and what they are worth. */
#ifndef BRANCHING_H
#define BRANCHING_H

#include "path.h"

/* Bounds of nodes: the dual of the order plus what the other devices promise. Where hovers count, what
   they promise is in the dual, as it depends on the price of a metre. */

/* A child's dual is minimised until what is left to gain is under this share of its excess over
   the threshold: it will stay open anyway. */
static const double LOOSE = 0.25;

/* What bounds of a node's children are measured against. */
typedef struct {
    double rest;   /* bound of what is beside the order: of devices off it, less prices of those in it */
    double eps;    /* barrier weight */
    double enough; /* a bound at or under this closes a node */
    double mu;     /* a multiplier of the right size */
} Goal;

static double paid_for(const Node *node, const Devices *devices)
{
    double paid = 0.0;
    for (int64_t i = 0; i < node->size; i++) paid += cost_of(devices, node->order[i]);
    return paid;
}

/* Bound of what the devices off the order can earn within so many places. */
static double promised_within(int64_t room, const Node *node, const Problem *problem)
{
    double promises[MOST_DEVICES], total = 0.0;
    int64_t count = 0;
    for (int64_t k = 0; k < problem->devices.count; k++)
        if (node->level[k] != PLACED) {
            promises[count] = promise_of(node, k, &problem->relaxation);
            total += promises[count++];
        }
    if (count <= room) return total;
    if (room <= 0) return 0.0;
    int64_t order[MOST_DEVICES], spare[MOST_DEVICES];
    const int64_t *best = descending(promises, count, order, spare);
    total = 0.0;
    for (int64_t i = 0; i < room; i++) total += promises[best[i]];
    return total;
}

/* An order to solve, down to where with `others` it closes the node. */
static Order order_of(Node *node, const Goal *goal, double others)
{
    return (Order){
        .node = node, .enough = goal->enough - others, .pointed = -1, .mu = goal->mu};
}

/* Let a node have the lower one of two duals, its own and one found for it. */
static void take_dual(Node *node, double dual, double price)
{
    if (!(dual < node->dual)) return;
    node->dual = dual;
    node->price = price;
}

/* Minimise the dual of a node to the end, and lower its bound. */
static void tighten(Node *node, const Goal *goal, Solver *solver)
{
    Order order = order_of(node, goal, goal->rest);
    minimise(&order, 1, (Aim){goal->eps, 0.0}, solver);
    take_dual(node, order.bound, order.price);
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

enum Kind { INSERTION, SPLIT, MERGE };
enum { OUT_OF_REACH = -1 }; /* in place of a gap */
/* Devices compared before one is branched on. What an order of few devices is branched on decides how
   large the tree gets: there the comparison is worth more than it costs. */
enum { SHORT_ORDER = 6, MANY_PROBES = 12, PROBES = 2 };
static const double CHILD_COST = 0.1;

/* A device to insert, and the orders that this makes. */
typedef struct {
    int64_t device, radius; /* index of the next radius */
    double brings, others; /* what it promises and its price, and the rest without it */
    Order *first, *last;
} Probe;

/* Memory for the children of a chain while they are solved. */
typedef struct {
    Node node[MANY_PROBES * (MOST_DEVICES + 1)];
    Order order[MANY_PROBES * (MOST_DEVICES + 1)];
    Solver solver;
} Children;

/* A child that is left open. */
typedef struct {
    int64_t detail; /* gap or OUT_OF_REACH, interval row, or state of an edge */
    int64_t chain;  /* whose, where there are several */
    double bound, dual, mu, price;
    Point y[MOST_DEVICES];
} Child;

/* One way to split a node, with those of its children that are left open. */
typedef struct {
    double score;  /* less is better */
    double closed; /* largest bound among the children closed */
    enum Kind kind;
    int64_t what, radius; /* device or position; of an insertion, index of the radius */
    int64_t count, chain; /* that of the next child */
    Child child[MOST_DEVICES + MOST_AIRCRAFT + 1];
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
    Family *family, int64_t detail, double others, const Node *parent, const Node *node,
    const Goal *goal)
{
    const double bound = least(parent->bound, node->dual + others);
    if (bound <= goal->enough) {
        family->closed = most(family->closed, bound);
        return 0;
    }
    Child *child = &family->child[family->count++];
    child->detail = detail;
    child->chain = family->chain;
    child->bound = bound;
    child->dual = node->dual;
    child->mu = node->mu;
    child->price = node->price;
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

/* Whether a device is worth nothing, or not its price, from anywhere beyond a radius: no plan is the worse for
   leaving it out there. */
static int is_worthless(int64_t device, int64_t radius, const Relaxation *relaxation)
{
    return radius == relaxation->radii - 1 || relaxation->promise[device * relaxation->radii + radius] <= 0.0;
}

/* The radius that is decided about after this one: the next rung, or one before it that is the last of use. */
static int64_t next_radius(int64_t device, int64_t level, const Relaxation *relaxation)
{
    int64_t radius = relaxation->ladder[level];
    while (radius - 1 > level && is_worthless(device, radius - 1, relaxation)) radius--;
    return radius;
}

/* Line up the orders in which a device is served from within the next radius, at each gap. */
static Probe probe(
    const Node *node, int64_t device, const Path *path, const Problem *problem, const Goal *goal,
    Children *all)
{
    const Relaxation *relaxation = &problem->relaxation;
    const int64_t level = node->level[device], radius = next_radius(device, level, relaxation);
    const double brings = problem->devices.hover ? 0.0
                                                 : promise_of(node, device, relaxation) +
                                                       cost_of(&problem->devices, device);
    const double others = goal->rest - brings;
    Order *first = all->solver.end, *last = first;
    for (int64_t gap = 0; gap <= node->size; gap++) {
        if (!(node->mask[device] >> gap & 1)) continue;
        Node *child = &all->node[last - all->order];
        *child = *node;
        insert(child, problem->devices.count, device, gap, row_of(relaxation, level, radius));
        if (settle(child, &problem->limits))
            *last++ = order_with(child, gap, path, problem, goal, others);
    }
    all->solver.end = last;
    return (Probe){
        .device = device, .radius = radius, .brings = brings, .others = others,
        .first = first, .last = last,
    };
}

/* Serve a device at each gap of the order. At the last radius, gaps without a child are closed in the
   node's mask, for all descendants. */
static void offer_gaps(
    Node *node, const Probe *probe, const Relaxation *relaxation, const Goal *goal, Family *family)
{
    for (const Order *order = probe->first; order < probe->last; order++) {
        order->node->dual = node->dual + probe->brings;
        take_dual(order->node, order->bound, order->price);
        const int stays = offer(family, order->pointed, probe->others, node, order->node, goal);
        if (!stays && is_worthless(probe->device, probe->radius, relaxation))
            node->mask[probe->device] &= ~((uint64_t)1 << order->pointed);
    }
}

/* Split the distance interval of the stop at a position. */
static void by_split(
    const Node *node, int64_t at, int64_t radius, const Problem *problem, const Goal *goal,
    Family *family, Children *all)
{
    const Relaxation *relaxation = &problem->relaxation;
    const int64_t *ends = relaxation->ends + 2 * node->interval[at];
    begin(family, SPLIT, at, radius);
    for (int side = 0; side < 2; side++) {
        Node *child = &all->node[side];
        *child = *node;
        child->interval[at] = (int16_t)(side == 0 ? row_of(relaxation, ends[0], radius)
                                                  : row_of(relaxation, radius, ends[1]));
        all->order[side] = order_of(child, goal, goal->rest);
    }
    minimise(all->order, 2, (Aim){goal->eps, LOOSE}, &all->solver);
    for (int side = 0; side < 2; side++) {
        Node *child = &all->node[side];
        take_dual(child, all->order[side].bound, all->order[side].price);
        offer(family, child->interval[at], goal->rest, node, child, goal);
    }
}

/* Make the stop at a position one with the stop before it, or keep them apart for good. */
static void by_merge(
    const Node *node, int64_t at, const Problem *problem, const Goal *goal, Family *family,
    Children *all)
{
    begin(family, MERGE, at, 0);
    for (int8_t edge = MERGED; edge <= BARRED; edge++) {
        Node *child = &all->node[0];
        *child = *node;
        child->edge[at] = edge;
        if (!settle(child, &problem->limits)) continue;
        if (is_loose(&problem->limits) || stops_now(child) < stops_now(node)) {
            all->order[0] = order_of(child, goal, goal->rest);
            minimise(all->order, 1, (Aim){goal->eps, LOOSE}, &all->solver);
            take_dual(child, all->order[0].bound, all->order[0].price);
        }
        offer(family, edge, goal->rest, node, child, goal);
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
    child.price = from->price;
    memcpy(child.y, from->y, (size_t)child.size * sizeof(Point));
    return child;
}

/* The families of ways to split a node, as they are compared. */
typedef struct {
    Family *best, *next; /* the one with the least work below it, NULL at first; memory for another */
    double closed;       /* the largest bound among the parts that were closed on the way */
} Contest;

static int is_closed(const Contest *contest) { return contest->best && contest->best->count == 0; }

/* The next family takes part. */
static void compare(Contest *contest, Family families[2])
{
    Family *next = contest->next;
    contest->closed = most(contest->closed, next->closed);
    if (contest->best && next->score >= contest->best->score) return;
    contest->next = next == families ? families + 1 : families;
    contest->best = next;
}

#endif
