/* Branch and bound: the best plan, and a bound that no plan exceeds.

   A node fixes the visiting order of some devices, an interval of distance for each, which
   neighbours share a stop, and how near the other devices can be served at most. Its bound is the
   dual of the order plus what the others promise. It is split where its relaxed path falls short
   of the promise most: a device is inserted at every gap or declared out of reach of a radius, a
   distance interval is cut in two, or, where the path has too many stops, two neighbours are merged
   or kept apart. Of a few candidates the one with the least work left below it is taken. */
#ifndef SEARCH_H
#define SEARCH_H

#include "branching.h"
#include "queue.h"

static const double BARRIER_SHARE = 2.5e-4; /* of the best value: the barrier in a bound, a leg */
static const double TINY = 1e-4; /* of the best value: an excess not worth branching on */
/* After so many nodes, divided by the devices, and whenever there have been twice as many, a search looks
   at its progress. Those that end do so within this many times the nodes that it foretells. */
enum { FIRST_LOOK = 40000 };
static const double OVERRUN = 1.5;
static const double STRICTER = 1.0, EASED = 0.7; /* what later legs count more, and less again */
enum { TURNS_WEIGHED = 2, LAST_TURNS = 30 }; /* times, in every node and in those that are not divided */

/* Memory for a search. */
typedef struct {
    Queue queue;
    Node node;
    Path path;
    Children *children;
    Family families[2]; /* the way to split the node, and a rival */
    Polish polish;
    Plan made;
} Search;

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

/* The families of ways to split a node, as they are compared. */
typedef struct {
    Family *best, *next; /* the one with the least work below it, NULL at first; memory for another */
    double closed;       /* the largest bound among the parts that were closed on the way */
} Contest;

static int is_closed(const Contest *contest) { return contest->best && contest->best->count == 0; }

/* The next family takes part. */
static void compare(Contest *contest, Search *all)
{
    Family *next = contest->next;
    contest->closed = most(contest->closed, next->closed);
    if (contest->best && next->score >= contest->best->score) return;
    contest->next = next == &all->families[0] ? &all->families[1] : &all->families[0];
    contest->best = next;
}

/* Compare the insertions of up to so many devices, those with the largest excess first. While a lane
   would wait for what is left of one, the orders of the next are lined up. */
static void compare_insertions(
    Contest *contest, int64_t count, Search *all, const Problem *problem, const Goal *goal,
    double floor)
{
    Node *node = &all->node;
    Solver *solver = &all->children->solver;
    Probe probes[MANY_PROBES];
    int64_t made = 0, done = 0;
    uint64_t tried = 0;
    open_solver(solver, (Aim){goal->eps, LOOSE}, node->size + 1, all->children->order);
    while (!is_closed(contest)) {
        const int64_t k = made < count ? pick_device(node, &all->path, problem, floor, tried) : -1;
        if (k >= 0) {
            tried |= (uint64_t)1 << k;
            probes[made++] = probe(node, k, &all->path, problem, goal, all->children);
        }
        while (done < made && !is_closed(contest) &&
               work_on(solver, probes[done].first, probes[done].last, k >= 0)) {
            by_insertion(node, &probes[done++], problem, goal, contest->next, all->children);
            compare(contest, all);
        }
        if (k < 0) return;
    }
}

/* Find a way to split the search's node; its best is NULL if the node is a leaf. */
static Contest branch(Search *all, const Problem *problem, const Goal *goal, double floor)
{
    Node *node = &all->node;
    Path *path = &all->path;
    const Relaxation *relaxation = &problem->relaxation;
    Contest contest = {NULL, &all->families[0], 0.0};
    int64_t at = pick_stop(node, path, relaxation, floor);
    if (at < 0 && pick_device(node, path, problem, floor, 0) < 0) {
        tighten(node, goal, &all->children->solver);
        recover(node, problem, path);
        at_stops(node, problem, path);
        at = pick_stop(node, path, relaxation, floor);
    }
    if (at >= 0) {
        const int64_t radius = cut_radius(node, at, path, relaxation);
        by_split(node, at, radius, problem, goal, contest.next, all->children);
        compare(&contest, all);
    }
    const int64_t probes = node->size < SHORT_ORDER ? MANY_PROBES : PROBES;
    compare_insertions(&contest, probes, all, problem, goal, floor);
    const int loose = is_loose(&problem->limits);
    if ((loose || stops_now(node) >= problem->limits.steps) && !is_closed(&contest)) {
        const int64_t edge =
            loose ? pick_stopping(node, path, problem) : pick_edge(node, path);
        if (edge >= 0) {
            by_merge(node, edge, problem, goal, contest.next, all->children);
            compare(&contest, all);
        }
    }
    /* Nobody promises too much, but together they may need more places than there are. */
    if (!contest.best) compare_insertions(&contest, 1, all, problem, goal, -INFINITY);
    return contest;
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

/* Weigh the turns so often, while the node is open; its relaxed path is what it has come to. */
static void keep_to_turns(Search *all, const Problem *problem, const Goal *goal, int times)
{
    for (int turn = 0; turn < times && all->node.bound > goal->enough; turn++) {
        recover(&all->node, problem, &all->path);
        weigh_turns(&all->node, &all->path, problem);
        if (all->node.size > 0) tighten(&all->node, goal, &all->children->solver);
    }
    recover(&all->node, problem, &all->path);
}

/* Put the node's relaxed path to use; 1 if the plan is better than before. Where hovers count it only
   shows what to branch on. */
static int improve(Search *all, const Problem *problem, const Goal *goal, Plan *plan)
{
    if (problem->devices.hover) {
        keep_to_turns(all, problem, goal, TURNS_WEIGHED);
        return 0;
    }
    if (recover(&all->node, problem, &all->path) <= plan->value) return 0;
    polish(
        all->path.points, all->node.size + 1, &problem->limits, &problem->devices, 0.0, FINE,
        &all->made, &all->polish);
    if (all->made.value <= plan->value) return 0;
    copy_plan(&all->made, plan, problem->devices.count, problem->limits.steps);
    return 1;
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

/* NULL where memory is short. */
static Node *copy_of(const Node *node)
{
    Node *copy = malloc(sizeof *copy);
    if (copy) *copy = *node;
    return copy;
}

/* Improve on a plan until none can be better by more than the target says, the nodes run out, or
   there is no hope of it. Nodes for which there is no room are closed with their bound. */
static Proof prove(
    const Problem *problem, const Target *target, int64_t max_nodes, Plan *plan, Search *all)
{
    Queue *queue = &all->queue;
    Node *node = &all->node;
    Proof proof = {plan->value, 0, DONE}; /* the largest bound among all that was closed */
    Progress progress = {FIRST_LOOK / problem->devices.count, INFINITY};
    for (int64_t k = 0; k < problem->devices.count; k++) node->mask[k] = 1;
    node->bound = rest_of(node, problem);
    if (problem->devices.hover) {
        for (int64_t k = 0; k < problem->devices.count; k++)
            node->dual += left_over_at(
                promise_of(node, k, &problem->relaxation), problem->devices.hover[k], 0.0,
                all->children->solver.all.soft);
        node->bound = node->dual;
    }
    node->mu = node->bound / problem->limits.length;
    leave_open(queue, copy_of(node), node->bound, &proof.bound);
    while (queue->count > 0) {
        double enough = enough_for(target, plan->value);
        const double scale = most(plan->value, target->scale);
        const double largest_bound = *queue->open[0], left = 1.0 - plan->value / largest_bound;
        if (largest_bound > enough) {
            if (proof.nodes >= max_nodes) proof.ended = OUT_OF_NODES;
            else if (is_hopeless(&progress, proof.nodes, left, 1.0 - plan->value / enough, max_nodes))
                proof.ended = TOO_SLOW;
        }
        if (largest_bound <= enough || proof.ended != DONE) {
            proof.bound = most(proof.bound, largest_bound);
            break;
        }
        Node *first = dequeue(queue);
        *node = *first;
        free(first);
        proof.nodes++;
        const double eps =
            BARRIER_SHARE * scale / (double)(node->size + 1 > 3 ? node->size + 1 : 3);
        Goal goal = {rest_of(node, problem), eps, enough, scale / problem->limits.length};
        if (improve(all, problem, &goal, plan)) goal.enough = enough = enough_for(target, plan->value);
        if (node->bound <= enough) {
            proof.bound = most(proof.bound, node->bound);
            continue;
        }
        const Contest contest = branch(all, problem, &goal, TINY * most(plan->value, target->scale));
        if (!contest.best) {
            if (problem->devices.hover) keep_to_turns(all, problem, &goal, LAST_TURNS);
            proof.bound = most(proof.bound, node->bound);
            continue;
        }
        proof.bound = most(proof.bound, contest.closed);
        for (int64_t c = 0; c < contest.best->count; c++) {
            const Node child = make_child(node, contest.best, c, problem);
            leave_open(queue, copy_of(&child), child.bound, &proof.bound);
        }
    }
    close_all(queue);
    return proof;
}

#endif
