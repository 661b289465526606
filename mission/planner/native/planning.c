/* Planning, compiled once for every kind of processor, as LEVEL names it. */

#include "crowd.h"
#include "exploration.h"
#include "levelled.h"
#include "space.h"

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

static int64_t search_orders(
    const Devices *devices, const Limits *limits, const Relaxation *relaxation, double gap,
    int64_t max_nodes, int64_t max_open, double *value, Point *way, int64_t *assigned,
    double *bound)
{
    const Problem problem = {*devices, *limits, *relaxation};
    Arena arena = {0};
    Plan plan = {way, assigned, *value};
    Search *all = calloc(1, sizeof *all);
    if (!all) return -1;
    for (int pass = 0; pass < 2; pass++) {
        all->polish = lay_out_polish(&arena, devices->count, limits, devices->count + 1);
        all->made = lay_out_plan(&arena, devices->count, limits->steps);
        if (pass == 0 && !provide(&arena)) {
            free(all);
            return -1;
        }
    }
    all->tree.most = max_open;
    const Proof proof = prove(&problem, gap, max_nodes, &plan, all);
    *bound = proof.bound;
    *value = plan.value;
    close_tree(&all->tree);
    release(&arena);
    free(all);
    return proof.nodes;
}

static int64_t search_places(
    const Devices *devices, const Limits *limits, double gap, int64_t max_nodes, int64_t max_open,
    double *value, Point *way, int64_t *assigned, double *bound)
{
    Arena arena = {0};
    Space all = {0};
    Plan plan = {way, assigned, *value};
    lay_out_space(&all, &arena, devices, limits, max_open);
    if (!provide(&arena)) return -1;
    lay_out_space(&all, &arena, devices, limits, max_open);
    all.programme.best = new_zones(&all.programme.sizes, 0);
    if (all.programme.best) search_space(devices, limits, gap, max_nodes, &plan, &all);
    const int64_t nodes = all.programme.best ? all.proof.nodes : -1;
    *bound = all.proof.bound;
    *value = plan.value;
    free(all.programme.best);
    release(&arena);
    return nodes;
}

/* The devices that take part in a bound from potentials, in memory of their own. */
typedef struct {
    Arena arena;
    Point *at;
    double *delta;
    Devices devices;
    double price, left_out; /* of a place; what others are worth at most */
} Dear;

/* 0 where memory is short. */
static int provide_dear(const Devices *devices, const Limits *limits, const Plan *plan, Dear *dear)
{
    *dear = (Dear){.price = price_of_place(devices, limits, plan)};
    for (int pass = 0; pass < 2; pass++) {
        dear->at = claim(&dear->arena, devices->count, sizeof(Point));
        dear->delta = claim(&dear->arena, devices->count, sizeof(double));
        if (pass == 0 && !provide(&dear->arena)) return 0;
    }
    dear->devices = dear_devices(devices, dear->price, dear->at, dear->delta, &dear->left_out);
    return 1;
}

static int64_t lower_potentials(
    const Devices *devices, const Limits *limits, int64_t meshes, int64_t turns, double value,
    Point *way, int64_t *assigned, double enough, double *bound)
{
    const Plan plan = {way, assigned, value};
    Arena arena = {0};
    Dear dear;
    Descent *all = malloc(sizeof *all);
    int64_t taken = -1;
    if (all && provide_dear(devices, limits, &plan, &dear)) {
        const int64_t samples = count_samples(&dear.devices, limits, (int)meshes);
        *all = lay_out_descent(&arena, &dear.devices, limits, (int)meshes, samples);
        if (provide(&arena)) {
            *all = lay_out_descent(&arena, &dear.devices, limits, (int)meshes, samples);
            all->least_nu = dear.left_out;
            turns = fewer(turns, most_turns(all));
            taken = descend(all, turns, dear.price, value, enough, bound);
            release(&arena);
        }
        release(&dear.arena);
    }
    free(all);
    return taken;
}

static int64_t lower_in_crowd(
    const Devices *devices, const Limits *limits, int64_t turns, double value, Point *way,
    int64_t *assigned, double enough, double *bound)
{
    const Plan plan = {way, assigned, value};
    Arena arena = {0};
    Dear dear;
    Crowd all;
    int64_t taken = -1;
    if (!provide_dear(devices, limits, &plan, &dear)) return -1;
    sort_by_place(dear.devices.count, dear.at, dear.delta);
    const int meshes = crowd_meshes(&dear.devices, limits);
    const int64_t samples = count_crowd_samples(&dear.devices, limits, meshes);
    if (meshes > 0) all = lay_out_crowd(&arena, &dear.devices, limits, meshes, samples);
    if (meshes == 0) { /* nothing is proven */
        *bound = INFINITY;
        taken = 0;
    } else if (provide(&arena)) {
        all = lay_out_crowd(&arena, &dear.devices, limits, meshes, samples);
        all.least_nu = dear.left_out;
        taken = descend_in_crowd(&all, turns, dear.price, value, enough, bound);
        release(&arena);
    }
    release(&dear.arena);
    return taken;
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
    for (int64_t k = 0; k < devices; k++) {
        double *row = (double *)(places.worth + k * wides(steps));
        memcpy(row, worth + k * steps, (size_t)steps * sizeof(double));
        places.known[k] = 1;
        for (int64_t n = 0; n < steps; n++) best[k] = most(best[k], row[n]);
    }
    solve_assignment(NULL, NULL, devices, best, assigned, &places);
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

static double order_bound(
    const Devices *devices, const Limits *limits, const Relaxation *relaxation,
    const int64_t *interval, const int64_t *merged, double eps)
{
    const Problem problem = {*devices, *limits, *relaxation};
    const Aim aim = {eps, -INFINITY, 0.0};
    Node node = {.size = devices->count, .mu = 0.003};
    Work work;
    for (int64_t i = 0; i < node.size; i++) {
        node.order[i] = (int16_t)i;
        node.interval[i] = (int16_t)interval[i];
        node.edge[i] = merged[i] ? MERGED : UNDECIDED;
    }
    set_factors(&node, &work);
    const Minimum found = minimise(&node, &problem, aim, &work);
    return found.centred ? found.bound : -1.0;
}

static double square_bound(
    const Devices *devices, const Limits *limits, double x, double y, double half)
{
    Arena arena = {0};
    Cells cells = lay_out_cells(&arena, devices, limits, 1);
    double *price = claim(&arena, devices->count, sizeof(double)), bound = 0.0;
    if (!provide(&arena)) return NAN;
    cells = lay_out_cells(&arena, devices, limits, 1);
    price = claim(&arena, devices->count, sizeof(double));
    fill_rises(&cells);
    const Corners best = rated(&cells, add_cell(&cells, x, y, half), price);
    for (int i = 0; i < 4; i++) bound = most(bound, best[i]);
    release(&arena);
    return bound;
}

static double potential_bound(
    const Devices *devices, const Limits *limits, int64_t vertices, const double *phi,
    const double *chi, double nu, double radius)
{
    Arena arena = {0};
    Descent *all = malloc(sizeof *all);
    double bound = NAN;
    if (!all) return bound;
    *all = lay_out_descent(&arena, devices, limits, 1, 0);
    if (all->now.mesh.vertices != vertices) {
        bound = -1.0;
    } else if (provide(&arena)) {
        *all = lay_out_descent(&arena, devices, limits, 1, 0);
        open_windows(all, radius);
        for (int64_t k = 0; k < devices->count; k++) gather(all, k, phi + k * vertices);
        memcpy(all->now.chi, chi, (size_t)vertices * sizeof(double));
        all->now.nu = nu;
        fill_rises(&all->cells);
        bound = bound_by_potentials(all);
        release(&arena);
    }
    free(all);
    return bound;
}

static double crowd_bound(
    const Devices *devices, const Limits *limits, int64_t vertices, const double *phi,
    const double *chi, double nu)
{
    Arena arena = {0};
    Crowd all = lay_out_crowd(&arena, devices, limits, 1, 0);
    if (all.mesh.vertices != vertices) return -1.0;
    if (!provide(&arena)) return NAN;
    all = lay_out_crowd(&arena, devices, limits, 1, 0);
    list_blocks(&all, 0.0);
    for (int64_t v = 0; v < vertices; v++)
        for (int64_t k = 0; k < devices->count; k++)
            eights_at(&all, all.phi, v)[k / EIGHT][k % EIGHT] = phi[k * vertices + v];
    memcpy(all.chi, chi, (size_t)vertices * sizeof(double));
    all.nu = nu;
    fill_rises(&all.cells);
    const double bound = bound_by_crowd(&all);
    release(&arena);
    return bound;
}

static double conjugate(const Relaxation *relaxation, int64_t row, double s)
{
    return spline(s, row, relaxation).h;
}

const Planner NAMED(planner) = {
    explore, search_orders, search_places, lower_potentials, lower_in_crowd, assign, match_devices,
    order_bound, square_bound, potential_bound, crowd_bound, conjugate};
