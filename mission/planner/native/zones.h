/* Zones of a plan's stops, and a bound of what any path with its stops in them can earn.

   A zone is a set of squares, one set for each stop after the start. For any prices p_k >= 0 of
   serving a device and mu >= 0 of a metre, Lagrangian relaxation of "each device once" and "L
   metres" gives the bound

       mu L + sum_k p_k + g(v_0) + max over v_1.. of sum_n [ g(v_n) - mu |v_n - v_{n-1}| ],

   where g is the best total of K_bar rewards less prices. Where serving has a cost of its own, prices
   begin with that, and only what they are above it is added. The maximum over chains of squares is
   found by dynamic programming, so that squares of one stop add to those of another, where boxes
   around all stops at once would multiply. For any e_n with |e_n| <= 1, mu e_n.(v_n - v_{n-1}) may
   be added to each leg and taken from its ends. That changes nothing between points; between
   squares it takes away what is of first order in their size where e_n is the leg's direction. */
#ifndef ZONES_H
#define ZONES_H

#include "cells.h"
#include "wide.h"

/* Length that is a fifth too long counts like a device that is served twice too often. */
static const double LENGTH_WEIGHT = 5.0;
static const double SHORTEN = 0.6; /* of the step, after this many bounds that are no better */
enum { PATIENCE = 2 };

/* How many stops after the start a search plans, for how many devices, within what length. */
typedef struct {
    int64_t devices, stops;
    double length;
} Sizes;

/* A node of the search, in one piece of memory. The bound comes first (`queue.h`). */
typedef struct {
    double bound, mu;
    double share; /* of a full step on prices, at first: less where that has not helped its parent */
    int64_t *first; /* (stops + 1,) where the squares of each stop begin */
    double *price;  /* (K,) */
    Point *lean;    /* (stops,) e */
    int32_t *square; /* (first[stops],) numbers of cells */
} Zones;

/* NULL where memory is short. */
static Zones *new_zones(const Sizes *sizes, int64_t squares)
{
    const size_t stops = (size_t)sizes->stops, devices = (size_t)sizes->devices;
    Zones *zones = calloc(
        1, sizeof(Zones) + (stops + 1) * sizeof(int64_t) + devices * sizeof(double) +
               stops * sizeof(Point) + (size_t)squares * sizeof(int32_t));
    if (!zones) return NULL;
    zones->first = (int64_t *)(zones + 1);
    zones->price = (double *)(zones->first + stops + 1);
    zones->lean = (Point *)(zones->price + devices);
    zones->square = (int32_t *)(zones->lean + stops);
    return zones;
}

/* Bound and multipliers from one node to another. */
static void inherit(const Sizes *sizes, const Zones *from, Zones *to)
{
    to->bound = from->bound;
    to->mu = from->mu;
    to->share = from->share;
    memcpy(to->price, from->price, (size_t)sizes->devices * sizeof(double));
    memcpy(to->lean, from->lean, (size_t)sizes->stops * sizeof(Point));
}

/* Where the best chains of several turns lie: sums of a coordinate and its square. */
typedef struct {
    Point sum, squares;
} Spread;

/* Memory of the dynamic programme; numbers by square of the zones. */
typedef struct {
    Sizes sizes;
    Cells cells;
    int64_t most;                  /* squares that there is room for */
    double *x, *y, *half;          /* (most,) */
    double *stop, *ahead, *behind; /* (most,) bounds of a stop there, of all up to there, and of
                                      what follows */
    double *trial;                 /* (most,) */
    int64_t *chain;                /* (stops,) squares of the best chain */
    double *at_start;              /* (K,) what devices earn at the start */
    double *worths;                /* (K,) */
    double *served;                /* (K,) how often the best chain serves a device */
    Spread *spread;                /* (stops,) */
    Zones *best;                   /* bound and multipliers of the best turn so far */
} Programme;

static Programme lay_out_programme(
    Arena *arena, const Devices *devices, const Limits *limits, int64_t most, int64_t cells)
{
    const Sizes sizes = {devices->count, limits->steps - 1, limits->length};
    return (Programme){
        .sizes = sizes,
        .cells = lay_out_cells(arena, devices, limits, cells),
        .most = most,
        .x = claim(arena, most, sizeof(double)),
        .y = claim(arena, most, sizeof(double)),
        .half = claim(arena, most, sizeof(double)),
        .stop = claim(arena, most, sizeof(double)),
        .ahead = claim(arena, most, sizeof(double)),
        .behind = claim(arena, most, sizeof(double)),
        .trial = claim(arena, most, sizeof(double)),
        .chain = claim(arena, sizes.stops, sizeof(int64_t)),
        .at_start = claim(arena, sizes.devices, sizeof(double)),
        .worths = claim(arena, sizes.devices, sizeof(double)),
        .served = claim(arena, sizes.devices, sizeof(double)),
        .spread = claim(arena, sizes.stops, sizeof(Spread)),
    };
}

static void load_squares(const Zones *zones, const Programme *all)
{
    for (int64_t j = 0; j < zones->first[all->sizes.stops]; j++) {
        const Cell *cell = all->cells.cell + zones->square[j];
        all->x[j] = cell->x;
        all->y[j] = cell->y;
        all->half[j] = cell->half;
    }
}

static Point centre(const Programme *all, int64_t square)
{
    return (Point){all->x[square], all->y[square]};
}

static double largest(const double *values, int64_t count)
{
    Wide all = all_of(-INFINITY);
    int64_t i = 0;
    for (Wide next; i + LENGTH <= count; i += LENGTH) {
        memcpy(&next, values + i, sizeof next);
        all = choose((Mask)(next > all), next, all);
    }
    double found = -INFINITY;
    for (int lane = 0; lane < LENGTH; lane++) found = most(found, all[lane]);
    for (; i < count; i++) found = most(found, values[i]);
    return found;
}

/* A leg between squares: which way it leans, and whether it comes from the squares or goes there. */
typedef struct {
    Point lean;
    double mu, sign;
} Leg;

/* `base` plus the bound of the leg between each of the squares first..last-1 and another one, into
   `trial`; returns the largest. */
static double best_leg(
    const Programme *all, const double *base, int64_t first, int64_t last, Point end, double half,
    Leg leg)
{
    const double *x = all->x, *y = all->y, *halves = all->half;
    const double ex = leg.lean.x * leg.mu, ey = leg.lean.y * leg.mu;
    double *trial = all->trial;
    for (int64_t j = first; j < last; j++) {
        const double dx = leg.sign * (end.x - x[j]), dy = leg.sign * (end.y - y[j]);
        const double length = sqrt(dx * dx + dy * dy), scale = leg.mu / (length + 1e-300);
        /* The tangent at the centres of a concave function of the difference. */
        const double bound = ex * dx + ey * dy - leg.mu * length +
                             (half + halves[j]) * (fabs(ex - scale * dx) + fabs(ey - scale * dy));
        trial[j] = base[j] + (bound < 0.0 ? bound : 0.0);
    }
    return largest(trial + first, last - first);
}

static Leg leg_to(const Zones *zones, int64_t stop) { return (Leg){zones->lean[stop], zones->mu, 1.0}; }

static Leg leg_back(const Zones *zones, int64_t stop)
{
    return (Leg){zones->lean[stop], zones->mu, -1.0};
}

/* The corner where a stop earns most at most, less what its legs lean on it. */
static int best_corner(
    const Zones *zones, const Programme *all, int64_t stop, const Cell *cell, double *value)
{
    Point lean = zones->lean[stop];
    if (stop + 1 < all->sizes.stops) lean = less(lean, zones->lean[stop + 1]);
    int best = 0;
    *value = -INFINITY;
    for (int i = 0; i < 4; i++) {
        const Point at = corner_of(cell, i);
        const double here = cell->best[i] - zones->mu * (lean.x * at.x + lean.y * at.y);
        if (here > *value) {
            *value = here;
            best = i;
        }
    }
    return best;
}

/* The bound without its chain. */
static double beside(const Zones *zones, Programme *all)
{
    double total = zones->mu * all->sizes.length;
    for (int64_t k = 0; k < all->sizes.devices; k++)
        total += zones->price[k] - cost_of(&all->cells.devices, k);
    return total + rated_place(&all->cells, all->at_start, zones->price);
}

/* Find the best chain backwards from the last stop. */
static void trace(const Zones *zones, Programme *all)
{
    const int64_t *first = zones->first;
    for (int64_t n = all->sizes.stops - 1; n >= 0; n--) {
        const double *value = all->ahead;
        if (n + 1 < all->sizes.stops) {
            const int64_t next = all->chain[n + 1];
            best_leg(
                all, all->ahead, first[n], first[n + 1], centre(all, next), all->half[next],
                leg_to(zones, n + 1));
            value = all->trial;
        }
        all->chain[n] = first[n];
        for (int64_t j = first[n]; j < first[n + 1]; j++)
            if (value[j] > value[all->chain[n]]) all->chain[n] = j;
    }
}

/* The bound of the zones with their multipliers; its best chain goes into `chain`. */
static double bound_of(const Zones *zones, Programme *all)
{
    const int64_t stops = all->sizes.stops, *first = zones->first;
    all->cells.turn++;
    for (int64_t n = 0; n < stops; n++)
        for (int64_t j = first[n]; j < first[n + 1]; j++) {
            rated(&all->cells, zones->square[j], zones->price);
            best_corner(zones, all, n, all->cells.cell + zones->square[j], &all->stop[j]);
        }
    memset(all->behind, 0, (size_t)first[1] * sizeof(double));
    best_leg(all, all->behind, 0, first[1], (Point){0.0, 0.0}, 0.0, leg_back(zones, 0));
    for (int64_t j = 0; j < first[1]; j++) all->ahead[j] = all->trial[j] + all->stop[j];
    for (int64_t n = 1; n < stops; n++)
        for (int64_t j = first[n]; j < first[n + 1]; j++)
            all->ahead[j] = all->stop[j] + best_leg(all, all->ahead, first[n - 1], first[n],
                                                    centre(all, j), all->half[j], leg_to(zones, n));
    trace(zones, all);
    return beside(zones, all) + all->ahead[all->chain[stops - 1]];
}

/* What follows each square at most, after `bound_of`. */
static void look_back(const Zones *zones, Programme *all)
{
    const int64_t last = all->sizes.stops - 1, *first = zones->first;
    memset(all->behind + first[last], 0, (size_t)(first[last + 1] - first[last]) * sizeof(double));
    for (int64_t n = last - 1; n >= 0; n--) {
        for (int64_t j = first[n + 1]; j < first[n + 2]; j++) all->stop[j] += all->behind[j];
        for (int64_t j = first[n]; j < first[n + 1]; j++)
            all->behind[j] = best_leg(all, all->stop, first[n + 1], first[n + 2], centre(all, j),
                                      all->half[j], leg_back(zones, n + 1));
    }
}

/* Count those that the best K_bar places serve with a gain; `worths` is used up. */
static void count_served(Programme *all)
{
    for (int64_t i = 0; i < all->cells.per_step; i++) {
        int64_t best = 0;
        for (int64_t k = 1; k < all->sizes.devices; k++)
            if (all->worths[k] > all->worths[best]) best = k;
        if (all->worths[best] <= 0.0) return;
        all->worths[best] = 0.0;
        all->served[best] += 1.0;
    }
}

/* How often the best chain serves each device; returns its length between centres. */
static double use_of(const Zones *zones, Programme *all)
{
    const int64_t devices = all->sizes.devices;
    double length = 0.0;
    Point last = {0.0, 0.0};
    for (int64_t k = 0; k < devices; k++) {
        all->served[k] = 0.0;
        all->worths[k] = all->at_start[k] - zones->price[k];
    }
    count_served(all);
    for (int64_t n = 0; n < all->sizes.stops; n++) {
        const int64_t j = all->chain[n], number = zones->square[j];
        double value;
        const int corner = best_corner(zones, all, n, all->cells.cell + number, &value);
        for (int64_t k = 0; k < devices; k++)
            all->worths[k] = all->cells.reward[devices * number + k][corner] - zones->price[k];
        count_served(all);
        length += between(centre(all, j), last);
        last = centre(all, j);
    }
    return length;
}

/* The Lagrangian of the centres of the best chain: no smaller squares bring the bound below. */
static double centre_value(const Zones *zones, Programme *all)
{
    double total = beside(zones, all);
    Point last = {0.0, 0.0};
    for (int64_t n = 0; n < all->sizes.stops; n++) {
        const Point here = centre(all, all->chain[n]);
        for (int64_t k = 0; k < all->sizes.devices; k++)
            all->worths[k] = brings(&all->cells.devices, k, here);
        total += rated_place(&all->cells, all->worths, zones->price);
        total -= zones->mu * between(here, last);
        last = here;
    }
    return total;
}

/* Add the best chain to the spread, and let legs lean halfway more towards its own. */
static void follow_chain(Zones *zones, const Programme *all)
{
    Point last = {0.0, 0.0};
    for (int64_t n = 0; n < all->sizes.stops; n++) {
        const Point here = centre(all, all->chain[n]), leg = less(here, last);
        const double length = between(here, last) + 1e-9;
        all->spread[n].sum.x += here.x;
        all->spread[n].sum.y += here.y;
        all->spread[n].squares.x += here.x * here.x;
        all->spread[n].squares.y += here.y * here.y;
        zones->lean[n].x = 0.5 * (zones->lean[n].x + leg.x / length);
        zones->lean[n].y = 0.5 * (zones->lean[n].y + leg.y / length);
        last = here;
    }
}

/* A subgradient step on prices and mu, from a bound towards a target (Polyak 1969). */
static void step_towards(Zones *zones, double bound, double target, double share, Programme *all)
{
    double over = LENGTH_WEIGHT * (use_of(zones, all) / all->sizes.length - 1.0), norm = 0.0;
    if (over < 0.0 && zones->mu <= 0.0) over = 0.0;
    norm += over * over;
    for (int64_t k = 0; k < all->sizes.devices; k++) {
        all->served[k] -= 1.0;
        if (all->served[k] < 0.0 && zones->price[k] <= cost_of(&all->cells.devices, k))
            all->served[k] = 0.0;
        norm += all->served[k] * all->served[k];
    }
    if (norm < 1e-12) return;
    const double step = share * (bound - target) / norm;
    zones->mu = most(0.0, zones->mu + step * over * LENGTH_WEIGHT / all->sizes.length);
    for (int64_t k = 0; k < all->sizes.devices; k++)
        zones->price[k] = most(
            cost_of(&all->cells.devices, k), zones->price[k] + step * all->served[k]);
}

/* Lower the bound of zones by their multipliers, in so many turns or until it is `enough`. */
static void lower_bound(Zones *zones, double target, double enough, int turns, Programme *all)
{
    const double inherited = zones->bound;
    double share = zones->share;
    int stale = 0;
    memset(all->spread, 0, (size_t)all->sizes.stops * sizeof(Spread));
    all->best->bound = INFINITY;
    for (int turn = 0; turn < turns && all->best->bound > enough; turn++) {
        if (turn > 0) step_towards(zones, zones->bound, target, share, all);
        if (turn > 0) follow_chain(zones, all);
        zones->bound = bound_of(zones, all);
        if (zones->bound < all->best->bound) {
            inherit(&all->sizes, zones, all->best);
            stale = 0;
        } else if (++stale == PATIENCE) {
            share *= SHORTEN;
            stale = 0;
        }
    }
    inherit(&all->sizes, all->best, zones);
    zones->share = all->best->bound < inherited ? 1.0 : share;
    zones->bound = least(zones->bound, inherited);
}

#endif
