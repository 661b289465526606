/* The search of orders over the chains of several aircraft at once.

   Each aircraft has a chain of its own, with its own dual. So a node of the search is a chain for each, its bound the sum of
   their duals and of what the devices off all chains promise, and a child of it changes one chain only.
   Every chain is a node of `search.h` in coordinates of its aircraft; a device that another one has counts
   as placed. */
#ifndef JOINT_H
#define JOINT_H

#include "search.h"
#include "team.h"

/* A node. The bound comes first (`queue.h`); every chain has it, too. */
typedef struct {
    double bound;
    Node chain[];
} Crew;

/* Memory for a search. */
typedef struct {
    Team team;
    Search all; /* what one aircraft needs, too */
    Crew *now;
    Path *path; /* (A,) */
    const int64_t *alike;
} Joint;

static size_t size_of_crew(int64_t aircraft) { return sizeof(Crew) + (size_t)aircraft * sizeof(Node); }

static double others_dual(const Crew *crew, int64_t own, int64_t aircraft)
{
    double total = 0.0;
    for (int64_t a = 0; a < aircraft; a++)
        if (a != own) total += crew->chain[a].dual;
    return total;
}

static int64_t placed_in(const Crew *crew, int64_t aircraft)
{
    int64_t count = 0;
    for (int64_t a = 0; a < aircraft; a++) count += crew->chain[a].size;
    return count;
}

/* Bound of what the devices off all chains can earn, less the prices of the others. */
static double rest_of_all(const Crew *crew, const Team *team)
{
    const Problem *problem = team->problem;
    const int64_t aircraft = team->aircraft;
    const int64_t places = aircraft * problem->limits.steps * problem->limits.per_step;
    double rest = promised_within(places - placed_in(crew, aircraft), crew->chain, problem);
    for (int64_t a = 0; a < aircraft; a++) rest -= paid_for(crew->chain + a, &problem->devices);
    return rest;
}

/* What bounds of a chain are measured against, if all others stay. */
static Goal goal_of(const Goal *goal, int64_t own, const Joint *joint)
{
    Goal one = *goal;
    one.rest += others_dual(joint->now, own, joint->team.aircraft);
    return one;
}

static Solver *solver_of(Joint *joint, int64_t own)
{
    joint->all.children->solver.problem = joint->team.problem + own;
    return &joint->all.children->solver;
}

/* Let the first path have the least excess of devices off all chains: that by the aircraft which brings
   most. Returns by how much all of them together count too much of what those bring. */
static double merge_excess(Joint *joint)
{
    const Team *team = &joint->team;
    const Node *first = joint->now->chain;
    double twice = 0.0;
    for (int64_t k = 0; k < team->problem->devices.count; k++) {
        if (first->level[k] == PLACED) continue;
        const double promise = promise_of(first, k, &team->problem->relaxation);
        double excess = INFINITY;
        for (int64_t a = 0; a < team->aircraft; a++) {
            twice += promise - joint->path[a].excess[k];
            excess = least(excess, joint->path[a].excess[k]);
        }
        twice -= promise - excess;
        joint->path->excess[k] = excess;
    }
    return twice;
}

static double recover_all(Joint *joint)
{
    double real = 0.0;
    for (int64_t a = 0; a < joint->team.aircraft; a++)
        real += recover(joint->now->chain + a, joint->team.problem + a, joint->path + a);
    return real - merge_excess(joint);
}

/* Put the relaxed paths to use; 1 if the plan is better than before. */
static int improve_all(Joint *joint, Plan *plan)
{
    Team *team = &joint->team;
    const int64_t steps = team->problem->limits.steps;
    if (recover_all(joint) <= plan->value) return 0;
    for (int64_t a = 0; a < team->aircraft; a++) {
        Point *draft = team->polish.draft, *way = team->present.way + a * steps;
        int64_t count = joint->now->chain[a].size + 1;
        memcpy(draft, joint->path[a].points, (size_t)count * sizeof(Point));
        for (; count > steps; count--) merge_nearest(draft, count);
        for (int64_t n = 0; n < steps; n++) way[n] = draft[fewer(n, count - 1)];
        shrink(way, steps, team->problem[a].limits.length);
    }
    polish_team(team, &team->made);
    if (team->made.value <= plan->value) return 0;
    copy_plan(&team->made, plan, team->problem->devices.count, team->aircraft * steps);
    return 1;
}

/* Whether an aircraft without a stop has an equal one before it: that one begins. */
static int waits_for_equal(const Joint *joint, int64_t own)
{
    if (joint->now->chain[own].size) return 0;
    for (int64_t a = 0; a < own; a++)
        if (joint->alike[a] == joint->alike[own] && !joint->now->chain[a].size) return 1;
    return 0;
}

/* Compare the insertions of up to so many devices into all chains, those with the largest excess first. */
static void compare_crews(
    Contest *contest, int64_t count, Joint *joint, const Goal *goal, double floor)
{
    const Problem *problem = joint->team.problem;
    const int64_t aircraft = joint->team.aircraft;
    Node *chain = joint->now->chain;
    Children *children = joint->all.children;
    Probe probes[MANY_PROBES][MOST_AIRCRAFT];
    int64_t device[MANY_PROBES], made = 0;
    uint64_t tried = 0;
    for (; made < count; made++) {
        device[made] = pick_device(chain, joint->path, problem, floor, tried);
        if (device[made] < 0) break;
        tried |= (uint64_t)1 << device[made];
    }
    Order *first = children->order;
    for (int64_t a = 0; a < aircraft; a++) {
        const Goal one = goal_of(goal, a, joint);
        Solver *solver = solver_of(joint, a);
        open_solver(solver, (Aim){goal->eps, LOOSE}, chain[a].size + 1, first);
        for (int64_t i = 0; i < made; i++) {
            probes[i][a].first = probes[i][a].last = NULL;
            if (!waits_for_equal(joint, a))
                probes[i][a] = probe(chain + a, device[i], joint->path + a, problem + a, &one, children);
        }
        work_on(solver, first, solver->end, 0);
        first = solver->end;
    }
    for (int64_t i = 0; i < made && !is_closed(contest); i++) {
        const int64_t k = device[i], radius = problem->relaxation.ladder[chain->level[k]];
        Family *family = contest->next;
        begin(family, INSERTION, k, radius);
        for (family->chain = 0; family->chain < aircraft; family->chain++) {
            const Goal one = goal_of(goal, family->chain, joint);
            offer_gaps(chain + family->chain, probes[i] + family->chain, &problem->relaxation, &one, family);
        }
        family->chain = 0;
        const int8_t level = chain->level[k];
        chain->level[k] = (int8_t)radius; /* for all */
        const double rest = rest_of_all(joint->now, &joint->team) + others_dual(joint->now, 0, aircraft);
        chain->level[k] = level;
        offer(family, OUT_OF_REACH, rest, chain, chain, goal);
        compare(contest, &joint->all);
    }
}

/* The stop of any chain that `pick_stop` finds with the largest excess; -1 where there is none. */
static int64_t pick_stop_of_all(const Joint *joint, double floor, int64_t *own)
{
    int64_t best = -1;
    for (int64_t a = 0; a < joint->team.aircraft; a++) {
        const Node *node = joint->now->chain + a;
        const int64_t at = pick_stop(node, joint->path + a, &joint->team.problem->relaxation, floor);
        if (at < 0) continue;
        best = at;
        *own = a;
        floor = joint->path[a].excess[node->order[at]];
    }
    return best;
}

/* Minimise the duals of all chains to the end. */
static void tighten_all(Joint *joint, const Goal *goal)
{
    Crew *now = joint->now;
    for (int64_t a = 0; a < joint->team.aircraft; a++) {
        const Goal one = goal_of(goal, a, joint);
        if (now->chain[a].size) tighten(now->chain + a, &one, solver_of(joint, a));
        now->bound = least(now->bound, now->chain[a].bound);
    }
    for (int64_t a = 0; a < joint->team.aircraft; a++) now->chain[a].bound = now->bound;
}

/* Find a way to split the search's node, as `branch` does. */
static Contest branch_crew(Joint *joint, const Goal *goal, double floor)
{
    Search *all = &joint->all;
    const Team *team = &joint->team;
    Node *chain = joint->now->chain;
    Contest contest = {NULL, &all->families[0], 0.0};
    int64_t own = 0, at = pick_stop_of_all(joint, floor, &own);
    if (at < 0 && pick_device(chain, joint->path, team->problem, floor, 0) < 0) {
        tighten_all(joint, goal);
        recover_all(joint);
        for (int64_t a = 0; a < team->aircraft; a++)
            at_stops(chain + a, team->problem + a, joint->path + a);
        merge_excess(joint);
        at = pick_stop_of_all(joint, floor, &own);
    }
    if (at >= 0) {
        const Problem *problem = team->problem + own;
        const Goal one = goal_of(goal, own, joint);
        const int64_t radius = cut_radius(chain + own, at, joint->path + own, &problem->relaxation);
        solver_of(joint, own);
        contest.next->chain = own;
        by_split(chain + own, at, radius, problem, &one, contest.next, all->children);
        compare(&contest, all);
    }
    const int64_t placed = placed_in(joint->now, team->aircraft);
    compare_crews(&contest, placed < SHORT_ORDER ? MANY_PROBES : PROBES, joint, goal, floor);
    for (int64_t a = 0; a < team->aircraft && !is_closed(&contest); a++) {
        if (stops_now(chain + a) < team->problem->limits.steps) continue;
        const int64_t edge = pick_edge(chain + a, joint->path + a);
        if (edge < 0) continue;
        const Goal one = goal_of(goal, a, joint);
        solver_of(joint, a);
        contest.next->chain = a;
        by_merge(chain + a, edge, team->problem + a, &one, contest.next, all->children);
        compare(&contest, all);
    }
    if (!contest.best) compare_crews(&contest, 1, joint, goal, -INFINITY);
    return contest;
}

/* Child `c` of the node; NULL where memory is short. */
static Crew *crew_of(const Family *family, int64_t c, const Joint *joint)
{
    const Child *from = family->child + c;
    const int64_t aircraft = joint->team.aircraft, k = family->what;
    Crew *crew = malloc(size_of_crew(aircraft));
    if (!crew) return NULL;
    memcpy(crew, joint->now, size_of_crew(aircraft));
    crew->chain[from->chain] =
        make_child(joint->now->chain + from->chain, family, c, joint->team.problem + from->chain);
    crew->bound = from->bound;
    for (int64_t a = 0; a < aircraft; a++) {
        crew->chain[a].bound = from->bound;
        if (family->kind == INSERTION) crew->chain[a].level[k] = crew->chain[from->chain].level[k];
    }
    return crew;
}

/* As `prove` of `search.h`. */
static Proof prove_all(Joint *joint, const Target *target, int64_t max_nodes, Plan *plan)
{
    const Team *team = &joint->team;
    const int64_t aircraft = team->aircraft, devices = team->problem->devices.count;
    Queue *queue = &joint->all.queue;
    Crew *now = joint->now;
    Proof proof = {plan->value, 0, DONE};
    Progress progress = {FIRST_LOOK / devices, INFINITY};
    for (int64_t a = 0; a < aircraft; a++)
        for (int64_t k = 0; k < devices; k++) now->chain[a].mask[k] = 1;
    now->bound = rest_of_all(now, team);
    for (int64_t a = 0; a < aircraft; a++) {
        now->chain[a].bound = now->bound;
        now->chain[a].mu = now->bound / team->problem[a].limits.length;
    }
    Crew *root = malloc(size_of_crew(aircraft));
    if (root) memcpy(root, now, size_of_crew(aircraft));
    leave_open(queue, root, now->bound, &proof.bound);
    while (queue->count > 0) {
        double enough = enough_for(target, plan->value);
        const double scale = most(plan->value, target->scale), largest_bound = *queue->open[0];
        const double left = 1.0 - plan->value / largest_bound, asked = 1.0 - plan->value / enough;
        if (largest_bound > enough) {
            if (proof.nodes >= max_nodes) proof.ended = OUT_OF_NODES;
            else if (is_hopeless(&progress, proof.nodes, left, asked, max_nodes)) proof.ended = TOO_SLOW;
        }
        if (largest_bound <= enough || proof.ended != DONE) {
            proof.bound = most(proof.bound, largest_bound);
            break;
        }
        Crew *first = dequeue(queue);
        memcpy(now, first, size_of_crew(aircraft));
        free(first);
        proof.nodes++;
        const int64_t legs = placed_in(now, aircraft) + 1;
        const double eps = BARRIER_SHARE * scale / (double)(legs > 3 ? legs : 3);
        Goal goal = {rest_of_all(now, team), eps, enough, scale / team->problem->limits.length};
        if (improve_all(joint, plan)) goal.enough = enough = enough_for(target, plan->value);
        if (now->bound <= enough) {
            proof.bound = most(proof.bound, now->bound);
            continue;
        }
        const Contest contest = branch_crew(joint, &goal, TINY * scale);
        if (!contest.best) {
            proof.bound = most(proof.bound, now->bound);
            continue;
        }
        proof.bound = most(proof.bound, contest.closed);
        for (int64_t c = 0; c < contest.best->count; c++)
            leave_open(queue, crew_of(contest.best, c, joint), contest.best->child[c].bound, &proof.bound);
    }
    close_all(queue);
    return proof;
}

#endif
