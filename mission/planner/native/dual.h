/* Minimising the Lagrangian of visiting orders.

   Orders wait for a lane. What is in a lane goes its own way, one look at a trial at a time, until it
   is done and the next order takes its place. */
#ifndef DUAL_H
#define DUAL_H

#include "newton.h"

enum { MAX_NEWTON = 60, MAX_HALVINGS = 20 };
static const double NEAR_M = 40.0; /* of a leg between stops that are merged loosely */
static const double EPS_START = 30.0;  /* the barrier starts heavier: starts are not centred */
static const double EPS_FACTOR = 0.15; /* it gets lighter by this once the decrement is under */
static const double CENTRED = 0.5;     /* this many barrier weights a leg */
static const double INSIDE = 0.995;    /* of the way to the boundary of a cone */
static const double SOFT = 0.02;       /* of what is promised a metre */

/* How far duals are minimised. */
typedef struct {
    double eps;   /* barrier weight */
    double loose; /* stop once what is left to gain is under this share of the excess over `enough` */
} Aim;

/* A node to minimise the dual of: its y and mu are moved to the minimiser. */
typedef struct {
    Node *node;
    double enough;       /* a bound at or under this closes it: its path is of no interest then */
    int64_t pointed;     /* the position of a stop just inserted; or -1 */
    Point before, after; /* y before and after it, to begin with if that is better */
    double mu;           /* to begin again with, where steps end badly; or 0 */
    double bound, price; /* the least found, and the price of a metre there */
    int centred, done;   /* whether the steps ended well, and at all */
} Order;

/* What a lane looks at: the y and mu of its node, the same with y pointed at the stop just inserted, the
   start of its steps, where it is with a lighter barrier, or the end of a step. */
enum Phase { IDLE, STRAIGHT, POINTED, START, LIGHTER, TRIAL };

/* Whether a lane needs a Newton step, and whether the decrement may call for a lighter barrier instead. */
enum Need { NO_STEP, STEP, STEP_OR_LIGHTER };

typedef struct {
    Order *order;
    enum Phase phase;
    enum Need need;
    int64_t steps, halvings;
    double bound, barrier; /* the least found since the start; where it is */
    double price;          /* mu where the least was found */
    double straight;       /* the barrier where y is not pointed */
    double alpha, decrement; /* share of the step; its decrement squared */
} Lane;

typedef struct {
    const Problem *problem;
    Aim aim;
    Order *next, *end; /* orders that wait */
    Lanes all;
    Lane lane[LENGTH];
    Wide tried_mu_step; /* of the steps that are tried; those of y are in the links */
} Solver;

/* Let a lane be at a y. */
static void put_y(Solver *solver, int i, int64_t k, Point y)
{
    solver->all.link[k].y.x[i] = y.x;
    solver->all.link[k].y.y[i] = y.y;
}

/* Let a lane be at the y and mu of a node. Where devices have prices, y begins well inside the cones: what
   lies at their very boundary, as a parent may have left it, would take too many steps to come away. */
static void be_at(Solver *solver, int i, const Node *node)
{
    const int priced = solver->problem->devices.price != NULL;
    for (int64_t k = 0; k < node->size; k++) {
        const Point y = node->y[k];
        const double most_y = INSIDE * node->mu * sqrt(solver->all.link[k].cone[i]);
        const double size = priced ? between(y, (Point){0.0, 0.0}) : 0.0;
        const double share = size > most_y ? most_y / size : 1.0;
        put_y(solver, i, k, (Point){share * y.x, share * y.y});
    }
    solver->all.mu[i] = node->mu;
}

static void begin_steps(Solver *solver, int i)
{
    Lane *lane = &solver->lane[i];
    lane->phase = START;
    lane->steps = 0;
    solver->all.weight[i] = solver->aim.eps * EPS_START;
}

static double promise_of(const Node *node, int64_t k, const Relaxation *relaxation)
{
    return relaxation->promise[k * relaxation->radii + node->level[k]];
}

/* What a leg and the stop at its end take at least: `slope` times its metres, and `fixed` more. */
typedef struct {
    double slope, fixed;
} Taken;

/* Of the stop at a position. What it takes is concave in its leg, so that between the leg's shortest
   and longest length it lies above the chord. */
static Taken taken(const Node *node, int64_t k, Stopping stop, const Problem *problem)
{
    const Relaxation *relaxation = &problem->relaxation;
    const Point *at = problem->devices.at, here = at[node->order[k]];
    if (!is_loose(&problem->limits)) return (Taken){1.0, 0.0};
    if (node->edge[k] == MERGED) return (Taken){1.0 + stop_of(stop, NEAR_M) / NEAR_M, 0.0};
    double apart = between(here, k == 0 ? (Point){0.0, 0.0} : at[node->order[k - 1]]);
    double around = outer_of(relaxation, node->interval[k]);
    if (k > 0) around += outer_of(relaxation, node->interval[k - 1]);
    const double shortest = most(apart - around, node->edge[k] == BARRED ? NEAR_M : 0.0);
    const double longest = least(apart + around, problem->limits.length);
    const double lowest = stop_of(stop, shortest);
    if (!(longest > shortest)) return (Taken){1.0, lowest};
    const double rise = (stop_of(stop, longest) - lowest) / (longest - shortest);
    return (Taken){1.0 + rise, lowest - rise * shortest};
}

/* Fill in how long the legs of a lane may be, what each metre counts, and who is off the order.

   What comes after a device's turn is limited by when it is ready: with a multiplier w mu, all later
   legs count w more of the time that they take. */
static void fill_timed(Solver *solver, int i, const Node *node)
{
    const Problem *problem = solver->problem;
    const Devices *devices = &problem->devices;
    Lanes *all = &solver->all;
    const Limits *limits = &problem->limits;
    double whole = limits->length, behind = 0.0, count = 0.0;
    for (int64_t k = 0; k < devices->count; k++) {
        const int placed = node->level[k] == PLACED;
        all->promise[k][i] = placed ? -1e9 : promise_of(node, k, &problem->relaxation);
        all->hover[k][i] = placed ? 0.0 : devices->hover[k];
    }
    for (int64_t k = 0; k < node->size; k++) {
        Link *link = all->link + k;
        const double slope = taken(node, k, limits->stop, problem).slope +
                             count * taken(node, k, limits->turn, problem).slope;
        link->cone[i] *= slope * slope;
        count += node->wait[k];
    }
    for (int64_t k = node->size - 1; k >= 0; k--) {
        const int64_t device = node->order[k];
        whole -= devices->hover[device] + taken(node, k, limits->stop, problem).fixed;
        behind += devices->sends[device];
        if (node->wait[k] > 0.0) whole += node->wait[k] * (devices->after[device] - behind);
        behind += taken(node, k, limits->turn, problem).fixed;
    }
    all->length[i] = whole;
}

/* Fill a lane with the stops of a node. */
static void fill_lane(Solver *solver, int i, const Node *node)
{
    const Problem *problem = solver->problem;
    const Relaxation *relaxation = &problem->relaxation;
    solver->all.length[i] = problem->limits.length;
    for (int64_t k = 0; k < node->size; k++) {
        Link *link = solver->all.link + k;
        const int64_t device = node->order[k], row = node->interval[k];
        const double c = node->edge[k] == MERGED && !is_loose(&problem->limits) ? FREE : 1.0;
        link->at.x[i] = problem->devices.at[device].x;
        link->at.y[i] = problem->devices.at[device].y;
        link->delta[i] = problem->devices.delta[device];
        link->rate[i] = 1.0 / problem->devices.delta[device];
        link->cone[i] = c * c;
        put_interval(&link->interval, i, row, relaxation);
        link->floor[i] = FLAT * link->interval.outer[i] / link->interval.end[i];
    }
    if (problem->devices.hover) fill_timed(solver, i, node);
    be_at(solver, i, node);
}

/* Give a lane the next order; one without keeps what it holds, and nobody looks at that. */
static void take_next(Solver *solver, int i)
{
    Lane *lane = &solver->lane[i];
    lane->phase = IDLE;
    lane->need = NO_STEP;
    if (solver->next == solver->end) return;
    lane->order = solver->next++;
    lane->order->bound = INFINITY;
    fill_lane(solver, i, lane->order->node);
    begin_steps(solver, i);
    if (lane->order->pointed < 0) return;
    lane->phase = STRAIGHT;
    solver->all.weight[i] = solver->aim.eps;
}

/* The steps have come to an end, well or not. */
static void end_steps(Solver *solver, int i, int centred)
{
    Lane *lane = &solver->lane[i];
    Order *order = lane->order;
    Node *node = order->node;
    lane->need = NO_STEP;
    if (lane->bound < order->bound) order->price = lane->price;
    order->bound = least(order->bound, lane->bound);
    order->centred = centred || lane->bound <= order->enough;
    if (order->centred || !(order->mu > 0.0)) {
        for (int64_t k = 0; k < node->size; k++)
            node->y[k] = (Point){solver->all.link[k].y.x[i], solver->all.link[k].y.y[i]};
        node->mu = solver->all.mu[i];
        order->done = 1;
        take_next(solver, i);
        return;
    }
    /* Too near the boundary of the cones: start again from their middle. */
    memset(node->y, 0, (size_t)node->size * sizeof(Point));
    node->mu = order->mu;
    order->mu = 0.0;
    be_at(solver, i, node);
    begin_steps(solver, i);
}

/* Take the next step, if there is to be one. */
static void go_on(Solver *solver, int i)
{
    Lane *lane = &solver->lane[i];
    lane->need = STEP_OR_LIGHTER;
    if (!(lane->steps++ < MAX_NEWTON && lane->bound > lane->order->enough)) end_steps(solver, i, 0);
}

/* Go by what a lane has looked at; 1 where it is now there. */
static int goes_there(Solver *solver, int i)
{
    Lane *lane = &solver->lane[i];
    const double barrier = solver->all.barrier[i];
    const Order *order = lane->order;
    const int64_t at = lane->phase == IDLE ? 0 : order->pointed;
    lane->need = NO_STEP;
    switch (lane->phase) {
    case IDLE:
        break;
    case STRAIGHT:
        lane->straight = barrier;
        lane->phase = POINTED;
        put_y(solver, i, at, order->before);
        if (at + 1 < order->node->size) put_y(solver, i, at + 1, order->after);
        break;
    case POINTED:
        if (!(barrier < lane->straight)) be_at(solver, i, order->node);
        begin_steps(solver, i);
        break;
    case START:
        lane->barrier = barrier;
        lane->bound = solver->all.bound[i];
        lane->price = solver->all.trial_mu[i];
        go_on(solver, i);
        break;
    case LIGHTER:
        lane->barrier = barrier;
        lane->need = STEP;
        break;
    case TRIAL:
        if (barrier <= lane->barrier - 1e-4 * lane->alpha * lane->decrement) return 1;
        lane->alpha *= 0.5;
        if (++lane->halvings == MAX_HALVINGS) end_steps(solver, i, 0);
    }
    return 0;
}

/* Go by what the Newton step says; 1 where it begins. */
static int begins_step(Solver *solver, int i, double limit)
{
    Lane *lane = &solver->lane[i];
    const double legs = (double)solver->all.size, weight = solver->all.weight[i];
    const double decrement = solver->all.decrement[i], excess = lane->bound - lane->order->enough;
    const Aim *aim = &solver->aim;
    if (lane->need == STEP || decrement > CENTRED * weight * legs) {
        lane->phase = TRIAL;
        lane->halvings = 0;
        lane->alpha = limit;
        lane->decrement = decrement;
        return 1;
    }
    if (weight <= aim->eps || 2.0 * legs * weight < aim->loose * excess) {
        end_steps(solver, i, 1);
    } else {
        solver->all.weight[i] = most(weight * EPS_FACTOR, aim->eps);
        lane->phase = LIGHTER;
    }
    return 0;
}

static int lane_waits(const Solver *solver)
{
    for (int i = 0; i < LENGTH; i++)
        if (solver->lane[i].phase == IDLE) return 1;
    return 0;
}

static void set_trials(Solver *solver)
{
    Lanes *all = &solver->all;
    Mask trying;
    Wide alpha;
    for (int i = 0; i < LENGTH; i++) {
        trying[i] = -(solver->lane[i].phase == TRIAL);
        alpha[i] = solver->lane[i].alpha;
    }
    for (Link *link = all->link; link < all->link + all->size; link++) {
        link->trial.x = choose(trying, link->y.x + alpha * link->step.x, link->y.x);
        link->trial.y = choose(trying, link->y.y + alpha * link->step.y, link->y.y);
    }
    all->trial_mu = choose(trying, all->mu + alpha * solver->tried_mu_step, all->mu);
}

/* Go where trials were good; returns how many lanes need a Newton step. */
static int go(Solver *solver)
{
    Lanes *all = &solver->all;
    Mask there;
    int needing = 0;
    for (int i = 0; i < LENGTH; i++) there[i] = -goes_there(solver, i);
    for (Link *link = all->link; link < all->link + all->size; link++) {
        link->y.x = choose(there, link->trial.x, link->y.x);
        link->y.y = choose(there, link->trial.y, link->y.y);
    }
    all->mu = choose(there, all->trial_mu, all->mu);
    for (int i = 0; i < LENGTH; i++) {
        Lane *lane = &solver->lane[i];
        if (there[i]) {
            lane->barrier = all->barrier[i];
            if (all->bound[i] < lane->bound) lane->price = all->trial_mu[i];
            lane->bound = least(lane->bound, all->bound[i]);
            go_on(solver, i);
        }
        needing += lane->need != NO_STEP;
    }
    return needing;
}

/* Begin the Newton steps that are needed. */
static void begin_all_steps(Solver *solver)
{
    Lanes *all = &solver->all;
    Mask begun = {0};
    step_newton(all);
    const Wide limit = step_limit(all);
    for (int i = 0; i < LENGTH; i++)
        if (solver->lane[i].need != NO_STEP) begun[i] = -begins_step(solver, i, limit[i]);
    for (Link *link = all->link; link < all->link + all->size; link++) {
        link->step.x = choose(begun, link->a.x, link->step.x);
        link->step.y = choose(begun, link->a.y, link->step.y);
    }
    solver->tried_mu_step = choose(begun, all->mu_step, solver->tried_mu_step);
}

/* Let all lanes hold what may be looked at, though nobody needs it. */
static void set_up_solver(Solver *solver, const Problem *problem)
{
    solver->problem = problem;
    double promised = 0.0;
    for (int64_t k = 0; k < problem->devices.count; k++)
        promised += problem->relaxation.promise[k * problem->relaxation.radii];
    solver->all.soft = SOFT * promised / problem->limits.length;
    for (int64_t k = 0; k < MOST_DEVICES; k++)
        for (int i = 0; i < LENGTH; i++)
            put_interval(&solver->all.link[k].interval, i, 0, &problem->relaxation);
}

/* Begin with orders of so many stops, of which the first will be there. */
static void open_solver(Solver *solver, Aim aim, int64_t size, Order *first)
{
    solver->aim = aim;
    solver->next = solver->end = first;
    solver->all.size = size;
    for (int i = 0; i < LENGTH; i++) solver->lane[i].phase = IDLE;
}

/* Work on orders until those from `first` to `last` are done; or, if there may be more of them, until
   a lane waits for one, and then 0. */
static int work_on(Solver *solver, const Order *first, const Order *last, int may_be_more)
{
    for (;;) {
        for (int i = 0; i < LENGTH; i++)
            if (solver->lane[i].phase == IDLE) take_next(solver, i);
        while (first < last && first->done) first++;
        if (first == last) return 1;
        if (may_be_more && lane_waits(solver)) return 0;
        set_trials(solver);
        look(&solver->all, solver->problem);
        if (go(solver)) begin_all_steps(solver);
    }
}

/* Minimise the duals of nodes with the same number of stops. */
static void minimise(Order *order, int64_t count, Aim aim, Solver *solver)
{
    open_solver(solver, aim, order->node->size, order);
    solver->end = order + count;
    work_on(solver, order, order + count, 0);
}

#endif
