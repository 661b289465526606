/* Planning, compiled once for every kind of processor, as LEVEL names it. */

#include "exported.h"
#include "following.h"
#include "search.h"
#include "space.h"
#include "variation.h"

static double explore(
    const Devices *devices, const Limits *limits, int64_t starts, int64_t tries, Point *way,
    int64_t *assigned)
{
    Arena arena = {0};
    Exploration all;
    Plan plan = {way, assigned, 0.0};
    lay_out_exploration(&all, &arena, devices->count, limits, starts);
    if (!provide(&arena)) return NAN;
    lay_out_exploration(&all, &arena, devices->count, limits, starts);
    find_plan(devices, limits, starts, tries, &plan, &all);
    release(&arena);
    return plan.value;
}

static int64_t search_places(
    const Devices *devices, const Limits *limits, const Target *target, int64_t max_nodes, int64_t max_open,
    double *value, Point *way, int64_t *assigned, double *bound, int64_t *ended)
{
    Arena arena = {0};
    Space all = {0};
    Plan plan = {way, assigned, *value};
    lay_out_space(&all, &arena, devices, limits, max_open);
    if (!provide(&arena)) return -1;
    lay_out_space(&all, &arena, devices, limits, max_open);
    all.programme.best = new_zones(&all.programme.sizes, 0);
    if (all.programme.best) search_space(devices, limits, target, max_nodes, &plan, &all);
    const int64_t nodes = all.programme.best ? all.proof.nodes : -1;
    *bound = all.proof.bound;
    *ended = all.proof.ended;
    *value = plan.value;
    free(all.programme.best);
    release(&arena);
    return nodes;
}

static double polish_near(
    int64_t aircraft, const Devices *devices, const Limits *limits, Point *way, int64_t *assigned)
{
    Problem problem[MOST_AIRCRAFT];
    Arena arena = {0};
    Team team = {.problem = problem};
    Plan plan = {way, assigned, 0.0};
    for (int64_t a = 0; a < aircraft; a++)
        problem[a] = (Problem){.devices = devices[a], .limits = limits[a]};
    lay_out_team(&team, &arena, aircraft, devices, limits);
    if (!provide(&arena)) return NAN;
    lay_out_team(&team, &arena, aircraft, devices, limits);
    if (aircraft == 1) {
        polish(way, limits->steps, limits, devices, 0.0, FINE, &plan, &team.polish);
    } else {
        memcpy(team.present.way, way, (size_t)(aircraft * limits->steps) * sizeof(Point));
        polish_team(&team, &plan);
    }
    release(&arena);
    return plan.value;
}

static int64_t search_orders(
    int64_t aircraft, const Devices *devices, const Limits *limits, const Relaxation *relaxation,
    const int64_t *alike, const Target *target, int64_t max_nodes, int64_t max_open, double *value,
    Point *way, int64_t *assigned, double *bound, int64_t *ended)
{
    Problem problem[MOST_AIRCRAFT];
    Arena arena = {0};
    Plan plan = {way, assigned, *value};
    Search *all = calloc(1, sizeof *all);
    if (!all) return -1;
    for (int64_t a = 0; a < aircraft; a++) problem[a] = (Problem){devices[a], limits[a], relaxation[a]};
    all->team.problem = problem;
    all->alike = alike;
    for (int pass = 0; pass < 2; pass++) {
        lay_out_team(&all->team, &arena, aircraft, devices, limits);
        all->now = claim(&arena, 1, size_of_crew(aircraft));
        all->path = claim(&arena, aircraft, sizeof(Path));
        all->children = claim(&arena, aircraft, sizeof(Children));
        all->queue = (Queue){claim(&arena, max_open, sizeof(double *)), 0, max_open};
        if (pass == 0 && !provide(&arena)) {
            free(all);
            return -1;
        }
    }
    const Proof proof = prove(all, target, max_nodes, &plan);
    *bound = proof.bound;
    *ended = proof.ended;
    *value = plan.value;
    release(&arena);
    free(all);
    return proof.nodes;
}

static int assign(
    int64_t devices, int64_t steps, int64_t per_step, const double *worth, int64_t *assigned)
{
    Arena arena = {0};
    Places places = lay_out_places(&arena, devices, steps, per_step);
    double *best = claim(&arena, devices, sizeof(double));
    if (!provide(&arena)) return -1;
    places = lay_out_places(&arena, devices, steps, per_step);
    best = claim(&arena, devices, sizeof(double));
    assign_steps(devices, steps, worth, best, assigned, &places);
    release(&arena);
    return 0;
}

static double match_devices(
    const Devices *devices, const Limits *limits, Point *way, int64_t *assigned)
{
    Arena arena = {0};
    Plan plan = {way, assigned, 0.0};
    Matching memory = lay_out_matching(&arena, devices->count, limits);
    if (!provide(&arena)) return NAN;
    memory = lay_out_matching(&arena, devices->count, limits);
    match(&plan, limits, devices, &memory);
    release(&arena);
    return plan.value;
}

static int fit(
    const Round *round, const Point *waypoint, CandidatePlan *plan, double metres, double above,
    int limited)
{
    Arena arena = {0};
    Desk desk;
    Ways ways;
    lay_out_planning(&desk, &ways, &arena, round);
    if (!provide(&arena)) return -1;
    lay_out_planning(&desk, &ways, &arena, round);
    const int fits = fit_way(round, waypoint, plan, metres, above, limited, &desk, &ways);
    release(&arena);
    return fits;
}

static int leave_out(const Round *round, CandidatePlan *plan)
{
    Arena arena;
    Desk desk;
    if (!open_desk(&desk, &arena, round, plan->points)) return -1;
    set_chances(round, plan, &desk);
    gather_stops(round, plan, &desk);
    const size_t size = (size_t)(round->steps * round->devices);
    const double value = plan->value;
    memcpy(desk.other, plan->schedule, size);
    const double alone = serve_nobody(round, plan, &desk);
    memcpy(plan->schedule, desk.other, size);
    plan->value = value;
    serve_fewer(round, plan, alone, -INFINITY, &desk);
    release(&arena);
    return 0;
}

static int judge(const Round *round, const CandidatePlan *given, Evaluation *evaluation)
{
    CandidatePlan whole = *given, *plan = &whole;
    const size_t size = (size_t)round->steps * sizeof(double);
    Arena arena;
    Desk desk;
    if (!open_desk(&desk, &arena, round, plan->points)) return -1;
    if (round->radii && plan->value != plan->value) { /* nobody has told what it is worth */
        set_chances(round, plan, &desk);
        plan->value = 0.0;
        for (int64_t n = 0, i = 0; n < round->steps; n++)
            for (int64_t k = 0; k < round->devices; k++, i++)
                if (plan->schedule[i]) plan->value += gain_of(round, k, desk.chances[i]);
    }
    gather_stops(round, plan, &desk);
    if (round->radii) evaluation->radius = radius_of(round, plan, &desk);
    hover_at_stops(round, plan, &desk);
    memcpy(evaluation->offset, desk.offset, size);
    for (int64_t p = 0; p < plan->points; p++) {
        evaluation->stop[p] = desk.stop[p];
        evaluation->hold[p] = desk.at[p].hold;
    }
    if (round->flying) {
        time_steps(round, plan, &desk);
        memcpy(evaluation->begins, desk.begins, size);
        evaluation->share = share_of(round->flying, evaluation->radius, &desk);
    }
    release(&arena);
    return 0;
}

/* A desk with a flight's stops; 0 where memory is short. */
static int open_way(Desk *desk, Arena *arena, int64_t count, const Point *stops, const double *hold)
{
    const Round round = {.steps = 1, .per_step = 1};
    if (!open_desk(desk, arena, &round, count)) return 0;
    desk->stops = count;
    for (int64_t i = 0; i < count; i++) desk->at[i] = (Stop){.p = stops[i], .hold = hold[i]};
    return 1;
}

static int foresee(
    const Flying *flying, int64_t count, const Point *stops, const double *hold, double radius,
    double *arrived, double *counted)
{
    Arena arena;
    Desk desk;
    if (!open_way(&desk, &arena, count, stops, hold)) return -1;
    count_flight(flying, radius, 1, counted, &desk);
    for (int64_t i = 0; i < count; i++) arrived[i] = desk.at[i].arrived;
    release(&arena);
    return 0;
}

static int follow(
    const Flying *flying, int64_t stops, const Point *stop, const double *hold, double radius,
    double step, int64_t count, Point *at)
{
    Arena arena;
    Desk desk;
    if (!open_way(&desk, &arena, stops, stop, hold)) return -1;
    fly_stops(flying, radius, NULL, &desk);
    follow_stops(flying, radius, step, count, at, &desk);
    release(&arena);
    return 0;
}

const Planner NAMED(planner) = {
    .explore = explore, .search_orders = search_orders, .search_places = search_places,
    .polish = polish_near, .assign = assign, .fit = fit, .vary = vary, .leave_out = leave_out, .judge = judge,
    .foresee = foresee, .follow = follow, .match = match_devices};
