/* Potentials that bound a plan well, found by gradient steps (Adam; Kingma and Ba 2015) on the
   bound with its maxima made smooth, smoother at first, on one mesh after the other. Any potentials
   give a bound, whatever the steps. */
#ifndef DESCENT_H
#define DESCENT_H

#include "elementary.h"
#include "lists.h"
#include "slopes.h"

enum {
    MESHES = 5,            /* at most */
    MOST_VALUES = 8000000, /* of all devices on the last mesh: fewer meshes do */
    FULL_TURN = 8,         /* turns from one that visits all triangles and samples to the next */
    TOLD = 2,              /* the mesh on which ends are told apart */
};
static const double SHARE[MESHES] = {0.25, 0.45, 0.2, 0.06, 0.04}; /* of each mesh in turns */
static const double SLOWER[MESHES] = {1.0, 0.5, 0.2, 0.1, 0.06};   /* its steps */
static const double RATE = 0.03, LAST_RATE = 2.5e-4; /* steps, as shares of the best reward */
/* How smooth maxima are: of mu, as a share of it, and of a stop, as a share of what the bound has for
   one. */
static const double HEAT = 0.1, LAST_HEAT = 0.002;
static const double STOP_HEAT = 0.02, LAST_STOP_HEAT = 0.0005;
static const double MEAN_KEPT = 0.95, SQUARE_KEPT = 0.95;
static const double MOST_WORK = 5e8;   /* of all turns on a mesh, in values of potentials */
static const double SPACINGS = 0.5;    /* of devices: how far beyond earshot potentials change */
static const double MANY_HEARD = 30.0; /* devices at a place: more take smaller steps each */
static const double TOO_FAR = 1.005;   /* times the known bound: too much after two meshes */
static const double LESS = 1.5;        /* times the gap that is enough: not worth the fifth mesh */
/* A gap at which halves, too, are good enough; up to twice as much may be worth halving. */
static const double TOO_LOOSE = 0.05, WORTH_HALVING = 0.055;
static const double PI = 3.141592653589793;

typedef struct {
    Slopes at;
    Stored *mean, *square;            /* (vertices, blocks) of slopes */
    double *chi_mean, *chi_square;    /* (vertices,) */
    Eight *price_mean, *price_square; /* (blocks,) */
    Eight *highest;                   /* (blocks,) what devices are worth */
    int meshes;
    int64_t turns; /* taken */
    double radius; /* around devices, in which potentials change on fine meshes */
    double slower; /* steps of each device, the more are heard at a place */
} Descent;

/* As many meshes as there is memory for. */
static int meshes_for(const Devices *devices, const Limits *limits, int meshes)
{
    const Mesh first = mesh_of(devices, limits->length);
    while (meshes > 1 &&
           finest_mesh(&first, meshes).vertices * blocks_of(devices) * EIGHT > MOST_VALUES)
        meshes--;
    return meshes;
}

static Descent lay_out_descent(
    Arena *arena, const Devices *devices, const Limits *limits, int meshes, const Samples *counted)
{
    const Mesh first = mesh_of(devices, limits->length);
    const int64_t v = finest_mesh(&first, meshes).vertices, blocks = blocks_of(devices);
    return (Descent){
        .at = lay_out_slopes(arena, devices, limits, meshes, counted),
        .mean = claim(arena, v * blocks, sizeof(Stored)),
        .square = claim(arena, v * blocks, sizeof(Stored)),
        .chi_mean = claim(arena, v, sizeof(double)),
        .chi_square = claim(arena, v, sizeof(double)),
        .price_mean = claim(arena, blocks, sizeof(Eight)),
        .price_square = claim(arena, blocks, sizeof(Eight)),
        .highest = claim(arena, blocks, sizeof(Eight)),
        .meshes = meshes,
    };
}

/* One step down a slope; `past` makes up for the means' beginning at zero. */
typedef struct {
    double rate, mean_past, square_past;
} Pace;

static inline double step_down(double slope, double *mean, double *square, Pace pace, double unit)
{
    *mean = MEAN_KEPT * *mean + (1.0 - MEAN_KEPT) * slope;
    *square = SQUARE_KEPT * *square + (1.0 - SQUARE_KEPT) * slope * slope;
    return unit * pace.rate * (*mean / pace.mean_past) / (sqrt(*square / pace.square_past) + 1e-8);
}

static inline Eight steps_down(Eight slope, Eight *mean, Eight *square, Pace pace, double unit)
{
    *mean = MEAN_KEPT * *mean + (1.0 - MEAN_KEPT) * slope;
    *square = SQUARE_KEPT * *square + (1.0 - SQUARE_KEPT) * slope * slope;
    return unit * pace.rate / pace.mean_past * *mean /
           (root_of_eight(*square * (1.0 / pace.square_past)) + 1e-8);
}

/* One step of the potentials of devices at a vertex, whose slopes are 0 again then. */
static void step_phi(Descent *all, int64_t v, Pace pace)
{
    Slopes *at = &all->at;
    const Blocks near = blocks_near(&at->near_vertex, v);
    Eight sum = {0};
    for (int64_t j = 0; j < near.count; j++) {
        const int64_t i = v * at->now.blocks + near.block[j];
        Eight mean = taken(all->mean[i]), square = taken(all->square[i]);
        const Eight step =
            steps_down(taken(at->slope[i]), &mean, &square, pace, at->now.highest);
        const Eight phi =
            between_zero_and(taken(at->now.phi[i]) - step, all->highest[near.block[j]]);
        all->mean[i] = stored(mean);
        all->square[i] = stored(square);
        at->now.phi[i] = stored(phi);
        at->slope[i] = (Stored){0};
        sum += phi;
    }
    at->half_sum[v] = at->fixed_sum[v] + 0.5 * sum_of_eight(sum);
}

/* One step of all potentials and prices. */
static void step_all(Descent *all, Pace pace)
{
    Potentials *now = &all->at.now;
    for (int64_t v = 0; v < now->mesh.vertices; v++) {
        if (v == now->mesh.start) continue;
        step_phi(all, v, pace);
        now->chi[v] -= step_down(
            all->at.chi_slope[v], all->chi_mean + v, all->chi_square + v, pace, now->highest);
    }
    for (int64_t b = 0; b < now->blocks; b++) {
        const Eight step = steps_down(
            all->at.price_slope[b], all->price_mean + b, all->price_square + b, pace, now->highest);
        now->price[b] =
            now->floor + between_zero_and(now->price[b] - now->floor - step, all->highest[b]);
    }
}

/* Open the present mesh, on which no step was taken. */
static void open_descent(Descent *all)
{
    const size_t vertices = (size_t)all->at.now.mesh.vertices, blocks = (size_t)all->at.now.blocks;
    memset(all->mean, 0, vertices * blocks * sizeof(Stored));
    memset(all->square, 0, vertices * blocks * sizeof(Stored));
    memset(all->chi_mean, 0, vertices * sizeof(double));
    memset(all->chi_square, 0, vertices * sizeof(double));
    memset(all->price_mean, 0, blocks * sizeof(Eight));
    memset(all->price_square, 0, blocks * sizeof(Eight));
    open_mesh(&all->at, all->radius);
}

/* Begin on the first mesh: a part of what devices earn beyond the start and the price of a place;
   and prices: what they earn beyond these. */
static void begin_potentials(Descent *all, double place_price, double value)
{
    Potentials *now = &all->at.now;
    const Devices *devices = &now->cells.devices;
    double steepest = 0.0;
    now->mesh = mesh_of(devices, now->limits.length);
    memset(now->phi, 0, (size_t)(now->mesh.vertices * now->blocks) * sizeof(Stored));
    memset(now->chi, 0, (size_t)now->mesh.vertices * sizeof(double));
    all->at.ways = directions(GROUPS);
    open_descent(all);
    for (int64_t v = 0; v < now->mesh.vertices; v++)
        for (int64_t k = 0; v != now->mesh.start && k < devices->count; k++) {
            const double here = worth(devices, k, vertex_at(&now->mesh, v));
            const double start = most(place_price, worth(devices, k, (Point){0.0, 0.0}));
            stored_at(now, now->phi, v)[k / EIGHT][k % EIGHT] = (float)most(0.0, here - start);
        }
    for (int64_t i = 0; i < count_triangles(&all->at); i++)
        if (is_cell(&now->mesh, triangle_at(i, all->at.ways.groups).cell))
            steepest = most(steepest, work_out_triangle(&all->at, i));
    const double have = steepest * now->limits.length / now->mesh.side;
    const double share = least(1.0, value / most(have, 1e-300));
    for (int64_t i = 0; i < now->mesh.vertices * now->blocks; i++) now->phi[i] *= (float)share;
    for (int64_t b = 0; b < now->blocks; b++) now->price[b] = eight(now->floor);
    for (int64_t v = 0; v < now->mesh.vertices; v++)
        for (int64_t k = 0; k < devices->count; k++) {
            double *mine = (double *)now->price + k;
            const double here = worth(devices, k, vertex_at(&now->mesh, v)) - place_price;
            const double phi = stored_at(now, now->phi, v)[k / EIGHT][k % EIGHT];
            *mine = most(*mine, now->floor + here - phi);
        }
}

/* Go on with the same potentials on the next mesh. */
static void next_mesh(Descent *all, int mesh)
{
    refine_potentials(&all->at.now);
    if (mesh == 2) all->at.ways = directions(MORE_GROUPS);
    open_descent(all);
}

/* first * (last / first)^done */
static double between_rates(double first, double last, double done)
{
    return first * exp_of_negative(done * log_of(last / first, 0));
}

/* What a turn on the present mesh visits, in values of potentials. */
static double work_of_turn(const Slopes *all)
{
    return (double)(EIGHT * (all->samples.heard + all->near_vertex.first[all->now.mesh.vertices]));
}

/* The scales of a problem. */
static void set_up_descent(Descent *all, double left_out)
{
    Potentials *now = &all->at.now;
    const Devices *devices = &now->cells.devices;
    const double side = now->mesh.side, reach = reach_of(devices), count = (double)devices->count;
    const double area = side * side * (double)((now->mesh.across - 1) * (now->mesh.up - 1));
    set_up_potentials(now, left_out);
    all->radius = reach + SPACINGS * sqrt(area / count);
    all->slower = 1.0 + count * reach * reach * PI / (area * MANY_HEARD);
    for (int64_t k = 0; k < devices->count; k++)
        all->highest[k / EIGHT][k % EIGHT] = devices->delta[k] * now->cells.upper[0];
}

/* So many turns on the present mesh, `from` where to `until` where in the whole course. */
static void descend_on_mesh(Descent *all, int mesh, int64_t turns, double from, double until)
{
    double mean_left = 1.0, square_left = 1.0;
    for (int64_t turn = 0; turn < turns; turn++) {
        const double done = from + (until - from) * (double)turn / (double)turns;
        const double rate = between_rates(RATE, LAST_RATE, done) * SLOWER[mesh] / all->slower;
        mean_left *= MEAN_KEPT;
        square_left *= SQUARE_KEPT;
        find_slopes(
            &all->at, turn % FULL_TURN == 0, between_rates(HEAT, LAST_HEAT, done),
            between_rates(STOP_HEAT, LAST_STOP_HEAT, done));
        step_all(all, (Pace){rate, 1.0 - mean_left, 1.0 - square_left});
    }
}

/* Two parts of a box, and how far apart the ends of a path lie in them: the variance between. */
typedef struct {
    Box part[2];
    double apart;
} Halves;

/* The parts of where paths end on both sides of a line of the first mesh: across x, or up y. */
static Halves halves_at(const Slopes *all, int up, int64_t line)
{
    const Mesh *mesh = &all->now.mesh;
    const Point at = vertex_at(mesh, up ? line * mesh->across : line);
    double share[2] = {0.0, 0.0}, mean[2] = {0.0, 0.0};
    for (int64_t v = 0; v < mesh->vertices; v++) {
        const int64_t i = up ? v / mesh->across : v % mesh->across;
        share[i > line] += all->low[v];
        mean[i > line] += all->low[v] * (double)(i - line);
    }
    Halves halves = {{all->now.ends, all->now.ends}, 0.0};
    if (!(share[0] > 0.0 && share[1] > 0.0)) return halves;
    const double distance = mean[1] / share[1] - mean[0] / share[0];
    halves.apart = share[0] * share[1] * distance * distance;
    if (up)
        halves.part[0].high.y = halves.part[1].low.y = at.y;
    else
        halves.part[0].high.x = halves.part[1].low.x = at.x;
    return halves;
}

/* The parts that tell apart best where a path, which may divide, ends; every so many lines of the
   present mesh is one of the first. */
static Halves best_halves(const Slopes *all, int64_t every)
{
    const Mesh *now = &all->now.mesh;
    Halves best = {0};
    for (int up = 0; up < 2; up++)
        for (int64_t line = every; line + 1 < (up ? now->up : now->across); line += every) {
            const Halves halves = halves_at(all, up, line);
            if (halves.apart > best.apart) best = halves;
        }
    return best;
}

/* What a bound is lowered for, and how far. */
typedef struct {
    int64_t turns;
    double place_price, value; /* of the plan: what its last place is worth, and all of it */
    double gap, hopeless;      /* that is enough; a bound that is not worth more turns */
} Purpose;

/* Lower the bound of plans that end in a box, of which `bound` is what is known, on all meshes; each
   begins with what the last has found. Ends where the bound is good enough or hopeless, or where it
   is better to go on with `halves` of the box, unless there is no room for them. */
static double descend(Descent *all, const Purpose *to, Box ends, double bound, Halves *halves)
{
    double shares = 0.0, done = 0.0;
    all->at.now.ends = ends;
    begin_potentials(all, to->place_price, to->value);
    for (int mesh = 0; mesh < all->meshes; mesh++) shares += SHARE[mesh];
    for (int mesh = 0; mesh < all->meshes; mesh++) {
        if (mesh > 0) next_mesh(all, mesh);
        const double share = SHARE[mesh] / shares, wanted = share * (double)to->turns;
        const int64_t turns = (int64_t)ceil(least(wanted, MOST_WORK / work_of_turn(&all->at)));
        descend_on_mesh(all, mesh, turns, done, done + share);
        done += share;
        all->turns += turns;
        const double reached = bound_by_potentials(&all->at.now, work_out_stops(&all->at, 1, 0.0));
        bound = least(bound, reached);
        const double gap = 1.0 - to->value / bound, last = least(LESS * to->gap, TOO_LOOSE);
        if (gap <= (mesh + 2 == MESHES ? most(to->gap, last) : to->gap)) break;
        if (mesh > 0 && reached > to->hopeless) break;
        if (mesh == TOLD && halves && gap > WORTH_HALVING && gap < 2.0 * WORTH_HALVING) {
            *halves = best_halves(&all->at, 1 << mesh);
            if (halves->apart > 0.0) break;
        }
    }
    return bound;
}

/* Lower a bound; each plan ends in one half or the other of the plane. */
static double descend_by_halves(Descent *all, Purpose to, double bound, int may_halve)
{
    Halves halves = {0};
    const double whole = descend(all, &to, PLANE, bound, may_halve ? &halves : NULL);
    if (!(halves.apart > 0.0)) return whole;
    double highest = 0.0;
    for (int i = 0; i < 2; i++) {
        to.gap = most(most(to.gap, TOO_LOOSE), 1.0 - to.value / most(highest, to.value));
        highest = most(highest, descend(all, &to, halves.part[i], whole, NULL));
    }
    return highest;
}

#endif
