/* Branch and bound: the best plan, and a bound that no plan exceeds.

   A node fixes the visiting order of some devices, an interval of distance for each, which
   neighbours share a stop, and how near the other devices can be served at most. Its bound is the
   dual of the order plus what the others promise. It is split where its relaxed path falls short
   of the promise most: a device is inserted at every gap or declared out of reach of a radius, a
   distance interval is cut in two, or, once the path keeps its promise but has too many stops, two
   neighbours are merged or kept apart. Of a few candidates the one with the least work left below
   it is taken. */
#ifndef SEARCH_H
#define SEARCH_H

#include "branching.h"

static const double BARRIER_SHARE = 2.5e-4; /* of the best value: the barrier in a bound, a leg */
static const double TINY = 1e-4; /* of the best value: an excess not worth branching on */
enum { PROBES = 3 };             /* devices compared before one is branched on */

/* Memory for a search. */
typedef struct {
    Tree tree;
    Node node;
    Path path;
    Work work;
    Family families[2]; /* the way to split the node, and a rival */
    Polish polish;
    Plan made;
} Search;

/* The device to be decided about with the largest excess above `least`, not tried; or -1. */
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

/* The undecided edge with the shortest leg; or -1. */
static int64_t pick_edge(const Node *node, const Path *path)
{
    int64_t best = -1;
    double shortest = INFINITY;
    for (int64_t i = 0; i < node->size; i++)
        if (node->edge[i] == UNDECIDED) {
            const double square = square_between(path->points[i + 1], path->points[i]);
            if (square < shortest) {
                best = i;
                shortest = square;
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

/* Find a way to split the search's node, or NULL if it is a leaf. `closed` gets the largest bound
   among the parts of it that were closed on the way. */
static const Family *branch(
    Search *all, const Problem *problem, const Goal *goal, double floor, double *closed)
{
    Node *node = &all->node;
    Path *path = &all->path;
    Family *family = &all->families[0], *rival = &all->families[1];
    const Relaxation *relaxation = &problem->relaxation;
    uint64_t tried = 0;
    int found = 0;
    int64_t at = pick_stop(node, path, relaxation, floor);
    if (at < 0 && pick_device(node, path, problem, floor, tried) < 0) {
        tighten(node, problem, goal, &all->work);
        recover(node, problem, path);
        at_stops(node, problem, path);
        at = pick_stop(node, path, relaxation, floor);
    }
    *closed = 0.0;
    if (at >= 0) {
        by_split(
            node, at, cut_radius(node, at, path, relaxation), problem, goal, family, &all->work);
        found = 1;
        *closed = family->closed;
    }
    for (int probe = 0; probe < PROBES; probe++) {
        const int64_t k = pick_device(node, path, problem, floor, tried);
        if (k < 0 || (found && family->count == 0)) break;
        tried |= (uint64_t)1 << k;
        by_insertion(node, k, path, problem, goal, rival, &all->work);
        *closed = most(*closed, rival->closed);
        if (!found || rival->score < family->score) {
            Family *better = rival;
            rival = family;
            family = better;
            found = 1;
        }
    }
    if (found) return family;
    if (stops_now(node) < problem->limits.steps) {
        /* Nobody promises too much, but together they may need more places than there are. */
        const int64_t k = pick_device(node, path, problem, -INFINITY, 0);
        if (k < 0) return NULL;
        by_insertion(node, k, path, problem, goal, family, &all->work);
        *closed = family->closed;
        return family;
    }
    by_merge(node, pick_edge(node, path), problem, goal, family, &all->work);
    *closed = family->closed;
    return family;
}

/* Put the node's relaxed path to use; 1 if the plan is better than before. */
static int improve(Search *all, const Problem *problem, Plan *plan)
{
    if (recover(&all->node, problem, &all->path) <= plan->value) return 0;
    polish(
        all->path.points, all->node.size + 1, &problem->limits, &problem->devices, 0.0, FINE,
        &all->made, &all->polish);
    if (all->made.value <= plan->value) return 0;
    copy_plan(&all->made, plan, problem->devices.count, problem->limits.steps);
    return 1;
}

typedef struct {
    double bound; /* that no plan exceeds */
    int64_t nodes; /* looked into */
} Proof;

/* Improve on a plan until none can be better by more than the relative gap, or the nodes run out.
   Nodes for which there is no room are closed with their bound. */
static Proof prove(const Problem *problem, double gap, int64_t max_nodes, Plan *plan, Search *all)
{
    Tree *tree = &all->tree;
    Node *node = &all->node;
    Proof proof = {plan->value, 0}; /* the largest bound among all that was closed */
    for (int64_t k = 0; k < problem->devices.count; k++) node->mask[k] = 1;
    node->bound = rest_of(node, problem);
    node->mu = node->bound / problem->limits.length;
    if (!push(tree, node)) proof.bound = node->bound;
    while (tree->open > 0) {
        double enough = plan->value / (1.0 - gap), cut_off;
        if (best_open(tree) <= enough || proof.nodes >= max_nodes) {
            proof.bound = most(proof.bound, best_open(tree));
            break;
        }
        pop(tree, node);
        proof.nodes++;
        if (improve(all, problem, plan)) enough = plan->value / (1.0 - gap);
        if (node->bound <= enough) {
            proof.bound = most(proof.bound, node->bound);
            continue;
        }
        const double eps =
            BARRIER_SHARE * plan->value / (double)(node->size + 1 > 3 ? node->size + 1 : 3);
        const Goal goal = {
            rest_of(node, problem), eps, enough, plan->value / problem->limits.length};
        const Family *family = branch(all, problem, &goal, TINY * plan->value, &cut_off);
        if (!family) {
            proof.bound = most(proof.bound, node->bound);
            continue;
        }
        proof.bound = most(proof.bound, cut_off);
        for (int64_t c = 0; c < family->count; c++) {
            const Node child = make_child(node, family, c, problem);
            if (!push(tree, &child)) proof.bound = most(proof.bound, child.bound);
        }
    }
    return proof;
}

#endif
