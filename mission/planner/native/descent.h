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
static const double PI = 3.141592653589793;

typedef struct {
    Slopes at;
    Stored *mean, *square;            /* (vertices, blocks) of slopes */
    double *chi_mean, *chi_square;    /* (vertices,) */
    Eight *price_mean, *price_square; /* (blocks,) */
    Eight *highest;                   /* (blocks,) what devices are worth */
    int meshes;
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

/* Potentials to begin with: a part of what devices earn beyond the start and the price of a place;
   and prices: what they earn beyond these. */
static void begin_potentials(Descent *all, double place_price, double value)
{
    Potentials *now = &all->at.now;
    const Devices *devices = &now->cells.devices;
    double steepest = 0.0;
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

/* Go on with the same potentials on the next mesh. */
static void next_mesh(Descent *all, int mesh)
{
    Potentials *now = &all->at.now;
    refine_potentials(now);
    const int64_t v = now->mesh.vertices;
    memset(all->mean, 0, (size_t)(v * now->blocks) * sizeof(Stored));
    memset(all->square, 0, (size_t)(v * now->blocks) * sizeof(Stored));
    memset(all->chi_mean, 0, (size_t)v * sizeof(double));
    memset(all->chi_square, 0, (size_t)v * sizeof(double));
    memset(all->price_mean, 0, (size_t)now->blocks * sizeof(Eight));
    memset(all->price_square, 0, (size_t)now->blocks * sizeof(Eight));
    if (mesh == 2) all->at.ways = directions(MORE_GROUPS);
    open_mesh(&all->at, all->radius);
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

/* The scales of a problem, and the first mesh with what potentials begin with. */
static void begin_descent(Descent *all, double place_price, double left_out, double value)
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
    open_mesh(&all->at, all->radius);
    begin_potentials(all, place_price, value);
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

/* Lower the bound, of which `bound` is what is known, by so many turns or to that gap; returns the
   turns. */
static int64_t descend(
    Descent *all, int64_t turns, double place_price, double left_out, double value, double gap,
    double *bound)
{
    const double hopeless = TOO_FAR * *bound;
    double shares = 0.0, done = 0.0;
    int64_t taken = 0;
    begin_descent(all, place_price, left_out, value);
    for (int mesh = 0; mesh < all->meshes; mesh++) shares += SHARE[mesh];
    for (int mesh = 0; mesh < all->meshes; mesh++) {
        if (mesh > 0) next_mesh(all, mesh);
        const double share = SHARE[mesh] / shares, wanted = share * (double)turns;
        const int64_t here = (int64_t)ceil(least(wanted, MOST_WORK / work_of_turn(&all->at)));
        descend_on_mesh(all, mesh, here, done, done + share);
        done += share;
        taken += here;
        const double reached = bound_by_potentials(&all->at.now, work_out_stops(&all->at, 1, 0.0));
        *bound = least(*bound, reached);
        const double left = mesh + 2 == MESHES ? LESS * gap : gap;
        if (*bound * (1.0 - left) <= value || (mesh > 0 && reached > hopeless)) break;
    }
    return taken;
}

#endif
