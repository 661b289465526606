/* Branch and bound on the orders of visits: the best plan of one aircraft or several, and a bound that no
   plan exceeds.

   Each aircraft has a chain of its own, with its own dual. A chain fixes the visiting order of some
   devices, an interval of distance for each, which neighbours share a stop, and how near the other devices
   can be served at most; a device that another chain has counts as placed. The bound of a node is the sum
   of the duals of all chains plus what the devices off them promise. It is split where the relaxed paths
   fall short of the promise most: a device is inserted at every gap of every chain or declared out of reach
   of a radius, a distance interval is cut in two, or, where a path has too many stops, two neighbours are
   merged or kept apart. Of a few candidates the one with the least work left below it is taken. A child
   changes one chain only.

   Where hovers count there is one aircraft, whose dual has what the others promise, too. */
#ifndef SEARCH_H
#define SEARCH_H

#include "branching.h"
#include "queue.h"
#include "team.h"

static const double BARRIER_SHARE = 2.5e-4; /* of the best value: the barrier in a bound, a leg */
static const double TINY = 1e-4; /* of the best value: an excess not worth branching on */
enum { TURNS_WEIGHED = 2, LAST_TURNS = 30 }; /* times, in every node and in those that are not divided */

/* Memory for a search. */
typedef struct {
    Team team;
    const int64_t *alike; /* (A,) the first aircraft that each is equal to */
    Queue queue;
    Crew *now;
    Path *path;         /* (A,) */
    Children *children; /* (A,) */
    Family families[2]; /* the way to split the node, and a rival */
} Search;

/* Bound of what the devices off all chains can earn, less the prices of the others. */
static double rest_of_all(const Crew *crew, const Team *team)
{
    const Problem *problem = team->problem;
    if (problem->devices.hover) return 0.0;
    const int64_t aircraft = team->aircraft;
    const int64_t places = aircraft * problem->limits.steps * problem->limits.per_step;
    double rest = promised_within(places - placed_in(crew, aircraft), crew->chain, problem);
    for (int64_t a = 0; a < aircraft; a++) rest -= paid_for(crew->chain + a, &problem->devices);
    return rest;
}

/* What bounds of a chain are measured against, if all others stay. */
static Goal goal_of(const Goal *goal, int64_t own, const Search *all)
{
    Goal one = *goal;
    one.rest += others_dual(all->now, own, all->team.aircraft);
    return one;
}

/* Let the first path have the least excess of devices off all chains: that by the aircraft which brings
   most. Returns by how much all of them together count too much of what those bring. */
static double merge_excess(Search *all)
{
    const Team *team = &all->team;
    const Node *first = all->now->chain;
    double twice = 0.0;
    for (int64_t k = 0; k < team->problem->devices.count; k++) {
        if (first->level[k] == PLACED) continue;
        const double promise = promise_of(first, k, &team->problem->relaxation);
        double excess = INFINITY;
        for (int64_t a = 0; a < team->aircraft; a++) {
            twice += promise - all->path[a].excess[k];
            excess = least(excess, all->path[a].excess[k]);
        }
        twice -= promise - excess;
        all->path->excess[k] = excess;
    }
    return twice;
}

static double recover_all(Search *all)
{
    double real = 0.0;
    for (int64_t a = 0; a < all->team.aircraft; a++)
        real += recover(all->now->chain + a, all->team.problem + a, all->path + a);
    return real - merge_excess(all);
}

/* Minimise the duals of all chains to the end. */
static void tighten_all(Search *all, const Goal *goal)
{
    Crew *now = all->now;
    for (int64_t a = 0; a < all->team.aircraft; a++) {
        const Goal one = goal_of(goal, a, all);
        if (now->chain[a].size) tighten(now->chain + a, &one, &all->children[a].solver);
        now->bound = least(now->bound, now->chain[a].bound);
    }
    for (int64_t a = 0; a < all->team.aircraft; a++) now->chain[a].bound = now->bound;
}

/* Weigh the turns so often, while the node is open; its relaxed path is what it has come to. */
static void keep_to_turns(Search *all, const Goal *goal, int times)
{
    for (int turn = 0; turn < times && all->now->bound > goal->enough; turn++) {
        recover_all(all);
        weigh_turns(all->now->chain, all->path, all->team.problem);
        tighten_all(all, goal);
    }
    recover_all(all);
}

/* The best plan of several aircraft near their relaxed paths, into `plan`. */
static void polish_paths(Search *all, Plan *plan)
{
    Team *team = &all->team;
    const int64_t steps = team->problem->limits.steps;
    for (int64_t a = 0; a < team->aircraft; a++) {
        Point *draft = team->polish.draft, *way = team->present.way + a * steps;
        int64_t count = all->now->chain[a].size + 1;
        memcpy(draft, all->path[a].points, (size_t)count * sizeof(Point));
        for (; count > steps; count--) merge_nearest(draft, count);
        for (int64_t n = 0; n < steps; n++) way[n] = draft[fewer(n, count - 1)];
        shrink(way, steps, team->problem[a].limits.length);
    }
    polish_team(team, plan);
}

/* Put the relaxed paths to use; 1 if the plan is better than before. Where hovers count they only show what
   to branch on. */
static int improve(Search *all, const Goal *goal, Plan *plan)
{
    Team *team = &all->team;
    const Problem *problem = team->problem;
    if (problem->devices.hover) {
        keep_to_turns(all, goal, TURNS_WEIGHED);
        return 0;
    }
    if (recover_all(all) <= plan->value) return 0;
    if (team->aircraft > 1)
        polish_paths(all, &team->made);
    else
        polish(
            all->path->points, all->now->chain->size + 1, &problem->limits, &problem->devices, 0.0, FINE,
            &team->made, &team->polish);
    if (team->made.value <= plan->value) return 0;
    copy_plan(&team->made, plan, problem->devices.count, team->aircraft * problem->limits.steps);
    return 1;
}

/* Whether an aircraft without a stop has an equal one before it: that one begins. */
static int waits_for_equal(const Search *all, int64_t own)
{
    if (all->now->chain[own].size) return 0;
    for (int64_t a = 0; a < own; a++)
        if (all->alike[a] == all->alike[own] && !all->now->chain[a].size) return 1;
    return 0;
}

/* Line up the insertions of a device into all chains. */
static void probe_all(Probe *probes, int64_t device, const Goal *goal, Search *all)
{
    for (int64_t a = 0; a < all->team.aircraft; a++) {
        const Goal one = goal_of(goal, a, all);
        probes[a].first = probes[a].last = NULL;
        if (!waits_for_equal(all, a))
            probes[a] = probe(
                all->now->chain + a, device, all->path + a, all->team.problem + a, &one,
                all->children + a);
    }
}

/* Whether they are solved, as `work_on` says. */
static int work_on_all(const Probe *probes, int may_be_more, Search *all)
{
    for (int64_t a = 0; a < all->team.aircraft; a++)
        if (!work_on(&all->children[a].solver, probes[a].first, probes[a].last, may_be_more)) return 0;
    return 1;
}

/* Serve a device at each gap of each chain, or not from within the radius at all. */
static void by_insertion(const Probe *probes, const Goal *goal, Family *family, Search *all)
{
    const int64_t aircraft = all->team.aircraft, k = probes->device;
    const Problem *problem = all->team.problem;
    const Relaxation *relaxation = &problem->relaxation;
    Node *chain = all->now->chain;
    begin(family, INSERTION, k, probes->radius);
    for (family->chain = 0; family->chain < aircraft; family->chain++)
        offer_gaps(chain + family->chain, probes + family->chain, relaxation, goal, family);
    family->chain = 0;
    const double less = relaxation->promise[k * relaxation->radii + probes->radius];
    const Node before = *chain;
    double rest = probes->others + cost_of(&problem->devices, k) + less;
    if (problem->devices.hover) {
        const double hover = problem->devices.hover[k], soft = all->children->solver.all.soft;
        chain->dual += left_over_at(less, hover, chain->price, soft) -
                       left_over_at(promise_of(chain, k, relaxation), hover, chain->price, soft);
        rest = 0.0;
    } else if (
        aircraft > 1 || problem->devices.count > problem->limits.steps * problem->limits.per_step) {
        chain->level[k] = (int8_t)probes->radius; /* another device may take its place */
        rest = rest_of_all(all->now, &all->team) + others_dual(all->now, 0, aircraft);
    }
    offer(family, OUT_OF_REACH, rest, chain, chain, goal);
    chain->dual = before.dual;
    chain->level[k] = before.level[k];
}

/* Compare the insertions of up to so many devices, those with the largest excess first. While a lane
   would wait for what is left of one, the orders of the next are lined up. */
static void compare_insertions(
    Contest *contest, int64_t count, Search *all, const Goal *goal, double floor)
{
    Node *chain = all->now->chain;
    Probe probes[MANY_PROBES][MOST_AIRCRAFT];
    int64_t made = 0, done = 0;
    uint64_t tried = 0;
    for (int64_t a = 0; a < all->team.aircraft; a++) {
        Children *children = all->children + a;
        open_solver(
            &children->solver, (Aim){goal->eps, LOOSE}, chain[a].size + 1, children->order);
    }
    while (!is_closed(contest)) {
        const int64_t k =
            made < count ? pick_device(chain, all->path, all->team.problem, floor, tried) : -1;
        if (k >= 0) {
            tried |= (uint64_t)1 << k;
            probe_all(probes[made++], k, goal, all);
        }
        while (done < made && !is_closed(contest) && work_on_all(probes[done], k >= 0, all)) {
            by_insertion(probes[done++], goal, contest->next, all);
            compare(contest, all->families);
        }
        if (k < 0) return;
    }
}

/* The stop of any chain that `pick_stop` finds with the largest excess; -1 where there is none. */
static int64_t pick_stop_of_all(const Search *all, double floor, int64_t *own)
{
    int64_t best = -1;
    for (int64_t a = 0; a < all->team.aircraft; a++) {
        const Node *node = all->now->chain + a;
        const int64_t at = pick_stop(node, all->path + a, &all->team.problem->relaxation, floor);
        if (at < 0) continue;
        best = at;
        *own = a;
        floor = all->path[a].excess[node->order[at]];
    }
    return best;
}

/* Find a way to split the search's node; its best is NULL if the node is a leaf. */
static Contest branch(Search *all, const Goal *goal, double floor)
{
    const Team *team = &all->team;
    const Problem *problem = team->problem;
    Node *chain = all->now->chain;
    Path *path = all->path;
    Contest contest = {NULL, all->families, 0.0};
    int64_t own = 0, at = pick_stop_of_all(all, floor, &own);
    if (at < 0 && pick_device(chain, path, problem, floor, 0) < 0) {
        tighten_all(all, goal);
        recover_all(all);
        for (int64_t a = 0; a < team->aircraft; a++) at_stops(chain + a, problem + a, path + a);
        merge_excess(all);
        at = pick_stop_of_all(all, floor, &own);
    }
    if (at >= 0) {
        const Goal one = goal_of(goal, own, all);
        const int64_t radius = cut_radius(chain + own, at, path + own, &problem[own].relaxation);
        contest.next->chain = own;
        by_split(
            chain + own, at, radius, problem + own, &one, contest.next, all->children + own);
        compare(&contest, all->families);
    }
    const int64_t placed = placed_in(all->now, team->aircraft);
    compare_insertions(&contest, placed < SHORT_ORDER ? MANY_PROBES : PROBES, all, goal, floor);
    const int loose = is_loose(&problem->limits);
    for (int64_t a = 0; a < team->aircraft && !is_closed(&contest); a++) {
        if (!loose && stops_now(chain + a) < problem->limits.steps) continue;
        const int64_t edge = loose ? pick_stopping(chain + a, path + a, problem + a)
                                   : pick_edge(chain + a, path + a);
        if (edge < 0) continue;
        const Goal one = goal_of(goal, a, all);
        contest.next->chain = a;
        by_merge(chain + a, edge, problem + a, &one, contest.next, all->children + a);
        compare(&contest, all->families);
    }
    /* Nobody promises too much, but together they may need more places than there are. */
    if (!contest.best) compare_insertions(&contest, 1, all, goal, -INFINITY);
    return contest;
}

/* Child `c` of the node; NULL where memory is short. */
static Crew *crew_of(const Family *family, int64_t c, const Search *all)
{
    const Child *from = family->child + c;
    const int64_t aircraft = all->team.aircraft, k = family->what;
    Crew *crew = copy_of(all->now, size_of_crew(aircraft));
    if (!crew) return NULL;
    crew->chain[from->chain] =
        make_child(all->now->chain + from->chain, family, c, all->team.problem + from->chain);
    crew->bound = from->bound;
    for (int64_t a = 0; a < aircraft; a++) {
        crew->chain[a].bound = from->bound;
        if (family->kind == INSERTION) crew->chain[a].level[k] = crew->chain[from->chain].level[k];
    }
    return crew;
}

/* Let the search be at its root. */
static void begin_search(Search *all)
{
    const Problem *problem = all->team.problem;
    const int64_t aircraft = all->team.aircraft;
    Crew *now = all->now;
    for (int64_t a = 0; a < aircraft; a++) {
        set_up_solver(&all->children[a].solver, problem + a);
        for (int64_t k = 0; k < problem->devices.count; k++) now->chain[a].mask[k] = 1;
    }
    for (int64_t k = 0; k < problem->devices.count && problem->devices.hover; k++)
        now->chain->dual += left_over_at(
            promise_of(now->chain, k, &problem->relaxation), problem->devices.hover[k], 0.0,
            all->children->solver.all.soft);
    now->bound = rest_of_all(now, &all->team) + now->chain->dual;
    for (int64_t a = 0; a < aircraft; a++) {
        now->chain[a].bound = now->bound;
        now->chain[a].mu = now->bound / problem[a].limits.length;
    }
}

/* A bound at or under this closes a node. A search with a scale is for a term of a sum of bounds: what is
   under the bound of a part closed already does not matter to it. */
static double enough_now(const Target *target, const Plan *plan, const Proof *proof)
{
    const double enough = enough_for(target, plan->value);
    return target->scale > 0.0 ? most(enough, proof->bound) : enough;
}

/* Improve on a plan until none can be better by more than the target says, the nodes run out, or
   there is no hope of it. Nodes for which there is no room are closed with their bound. */
static Proof prove(Search *all, const Target *target, int64_t max_nodes, Plan *plan)
{
    const Team *team = &all->team;
    const Problem *problem = team->problem;
    const size_t size = size_of_crew(team->aircraft);
    Queue *queue = &all->queue;
    Crew *now = all->now;
    Proof proof = {plan->value, 0, DONE}; /* the largest bound among all that was closed */
    Progress progress = {FIRST_LOOK / problem->devices.count, INFINITY};
    begin_search(all);
    leave_open(queue, copy_of(now, size), now->bound, &proof.bound);
    while (queue->count > 0) {
        double enough = enough_now(target, plan, &proof);
        const double scale = most(plan->value, target->scale), largest_bound = *queue->open[0];
        const double left = 1.0 - plan->value / largest_bound, asked = 1.0 - plan->value / enough;
        if (largest_bound > enough) {
            if (proof.nodes >= max_nodes) proof.ended = OUT_OF_NODES;
            else if (!(target->scale > 0.0) && is_hopeless(&progress, proof.nodes, left, asked, max_nodes))
                proof.ended = TOO_SLOW;
        }
        if (largest_bound <= enough || proof.ended != DONE) {
            proof.bound = most(proof.bound, largest_bound);
            break;
        }
        Crew *first = dequeue(queue);
        memcpy(now, first, size);
        free(first);
        proof.nodes++;
        const int64_t legs = placed_in(now, team->aircraft) + 1;
        const double eps = BARRIER_SHARE * scale / (double)(legs > 3 ? legs : 3);
        Goal goal = {rest_of_all(now, team), eps, enough, scale / problem->limits.length};
        if (improve(all, &goal, plan)) goal.enough = enough = enough_now(target, plan, &proof);
        if (now->bound <= enough) {
            proof.bound = most(proof.bound, now->bound);
            continue;
        }
        const Contest contest = branch(all, &goal, TINY * most(plan->value, target->scale));
        if (!contest.best) {
            if (problem->devices.hover) keep_to_turns(all, &goal, LAST_TURNS);
            proof.bound = most(proof.bound, now->bound);
            continue;
        }
        proof.bound = most(proof.bound, contest.closed);
        for (int64_t c = 0; c < contest.best->count; c++)
            leave_open(queue, crew_of(contest.best, c, all), contest.best->child[c].bound, &proof.bound);
    }
    close_all(queue);
    return proof;
}

#endif
