/* Who is served at which step, for fixed positions. */
#ifndef MATCHING_H
#define MATCHING_H

#include "arena.h"
#include "rewards.h"
#include "wide.h"

/* Who is served at which step where steps are too few for all: the optimal assignment.

   Shortest augmenting paths with prices (Jonker and Volgenant 1987) between steps of `per_step`
   places each and a place outside for everybody. Devices come one after the other, the best first:
   one whose best step has room takes it. Otherwise the cheapest chain of displacements is searched,
   which ends at a step with room or at a device better left out. Most chains are two or three steps
   long, so that few of the worths are ever worked out. */

/* Memory for the assignment of K devices to N steps of P places. Rows of N are filled up with
   steps that are not open. */
typedef struct {
    int64_t steps, places;
    Wide *worth;            /* (K, N) */
    unsigned char *known;   /* (K,) whose worths are worked out */
    int64_t *order, *spare; /* (K,) */
    double *price;          /* (N,) */
    int64_t *load;          /* (N,) */
    int64_t *held;          /* (N, P) the devices at each step */
    double *reached; /* (N,) least loss of freeing a place by ending the chain at a step */
    int64_t *taker;  /* (N,) the device that moves there then */
    int64_t *open;   /* (N,) -1 until that is settled, then 0 */
    int64_t *asked;  /* (P,) the devices of the step that was settled last */
    double *loss;    /* (P,) what the chain has lost once each of them is taken from there */
} Places;

static Places lay_out_places(Arena *arena, int64_t devices, int64_t steps, int64_t per_step)
{
    int64_t places = fewer(per_step, devices);
    return (Places){
        .steps = steps,
        .places = places,
        .worth = claim(arena, devices * wides(steps), sizeof(Wide)),
        .known = claim(arena, devices, 1),
        .order = claim(arena, devices, sizeof(int64_t)),
        .spare = claim(arena, devices, sizeof(int64_t)),
        .price = claim(arena, wides(steps), sizeof(Wide)),
        .load = claim(arena, steps, sizeof(int64_t)),
        .held = claim(arena, steps * places, sizeof(int64_t)),
        .reached = claim(arena, wides(steps), sizeof(Wide)),
        .taker = claim(arena, wides(steps), sizeof(Mask)),
        .open = claim(arena, wides(steps), sizeof(Mask)),
        .asked = claim(arena, places, sizeof(int64_t)),
        .loss = claim(arena, places, sizeof(double)),
    };
}

/* Indices of the values from the largest to the least, equal ones in order: a merge sort from the
   bottom up, in the memory of `order` and `merged`, one of which is returned. */
static int64_t *descending(const double *values, int64_t count, int64_t *order, int64_t *merged)
{
    for (int64_t k = 0; k < count; k++) order[k] = k;
    for (int64_t width = 1; width < count; width *= 2) {
        for (int64_t first = 0; first < count; first += 2 * width) {
            int64_t middle = fewer(first + width, count), last = fewer(first + 2 * width, count);
            int64_t i = first, j = middle;
            for (int64_t k = first; k < last; k++)
                if (j == last || (i < middle && values[order[i]] >= values[order[j]]))
                    merged[k] = order[i++];
                else
                    merged[k] = order[j++];
        }
        int64_t *other = order;
        order = merged;
        merged = other;
    }
    return order;
}

/* Let the devices that are asked to go try every open step; the one at which the chain may end with
   the least loss under `most`, or -1. */
static int64_t next_step(const Places *places, int64_t asked, double most, double *loss)
{
    const int64_t end = wides(places->steps);
    const Wide *price = (const Wide *)places->price;
    const Mask *open = (const Mask *)places->open;
    Wide *reached = (Wide *)places->reached;
    Mask *taker = (Mask *)places->taker;
    Least least = begin_least(most);
    for (int64_t n = 0; n < end; n++) {
        Wide value = reached[n];
        Mask by = taker[n];
        for (int64_t m = 0; m < asked; m++) {
            const int64_t k = places->asked[m];
            const Wide moved = places->loss[m] - places->worth[k * end + n] + price[n];
            const Mask better = (Mask)(moved < value) & open[n];
            value = choose(better, moved, value);
            by = (better & k) | (~better & by);
        }
        reached[n] = value;
        taker[n] = by;
        offer_wide(&least, value, open[n]);
    }
    return end_least(&least, loss);
}

static const Wide *worths_of(
    int64_t k, const Point *way, const Devices *devices, const Places *places)
{
    Wide *worths = places->worth + k * wides(places->steps);
    if (!places->known[k]) {
        places->known[k] = 1;
        for (int64_t n = 0; n < places->steps; n++) worths[n / LENGTH][n % LENGTH] = worth(devices, k, way[n]);
    }
    return worths;
}

/* The place of a device among those of its step. */
static int64_t slot_of(const Places *places, int64_t step, int64_t device)
{
    int64_t slot = 0;
    while (places->held[step * places->places + slot] != device) slot++;
    return slot;
}

typedef struct {
    int64_t end;  /* the step with room, or -1: a device is left out */
    int64_t out;  /* that device */
    double total; /* what is lost */
} Displacement;

/* The cheapest chain that begins with a device that wants in. */
static Displacement displace(
    int64_t device, const Point *way, const Devices *devices, const Places *places)
{
    Displacement chain = {-1, device, INFINITY};
    for (int64_t n = 0; n < places->steps; n++) {
        places->reached[n] = INFINITY;
        places->open[n] = -1;
    }
    /* What the chain has lost when the devices in question are taken from where they are. */
    double lost = 0.0;
    int64_t here = -1, size = 1;
    places->asked[0] = device;
    for (;;) {
        for (int64_t m = 0; m < size; m++) {
            int64_t k = places->asked[m];
            const Wide *worths = worths_of(k, way, devices, places);
            double profit = 0.0;
            if (here >= 0)
                profit = worths[here / LENGTH][here % LENGTH] - places->price[here];
            else
                for (int64_t n = 0; n < places->steps; n++)
                    profit = most(profit, worths[n / LENGTH][n % LENGTH] - places->price[n]);
            double loss = lost + profit;
            if (loss < chain.total) {
                chain.out = k;
                chain.total = loss;
            }
            places->loss[m] = loss;
        }
        here = next_step(places, size, chain.total, &lost);
        if (here < 0) return chain;
        if (places->load[here] < places->places) {
            chain.end = here;
            chain.total = places->reached[here];
            return chain;
        }
        places->open[here] = 0;
        size = places->places;
        memcpy(places->asked, places->held + here * size, (size_t)size * sizeof(int64_t));
    }
}

/* Write the step of every device into `assigned` (K,), -1 where it is not served. `best` (K,) is
   what each earns at its best step, or less than nothing to leave it out. Worths that are not known
   are worked out from `way` and `devices`. */
static void solve_assignment(
    const Point *way, const Devices *devices, int64_t count, const double *best, int64_t *assigned,
    const Places *places)
{
    for (int64_t k = 0; k < count; k++) assigned[k] = -1;
    for (int64_t n = 0; n < places->steps; n++) {
        places->price[n] = 0.0;
        places->load[n] = 0;
    }
    const int64_t *order = descending(best, count, places->order, places->spare);
    double cheapest = 0.0;
    for (int64_t i = 0; i < count; i++) {
        int64_t device = order[i];
        /* No place is worth its price for this device, nor for any after it. */
        if (best[device] <= cheapest) break;
        Displacement chain = displace(device, way, devices, places);
        cheapest = INFINITY;
        for (int64_t n = 0; n < places->steps; n++) {
            if (!places->open[n]) places->price[n] += chain.total - places->reached[n];
            cheapest = least(cheapest, places->price[n]);
        }
        int64_t end = chain.end, slot;
        if (end < 0) {
            if (chain.out == device) continue;
            end = assigned[chain.out];
            slot = slot_of(places, end, chain.out);
            assigned[chain.out] = -1;
        } else {
            slot = places->load[end]++;
        }
        /* Back along the chain: each device moves on into the place of the one after it. */
        for (int64_t k = places->taker[end];; k = places->taker[end]) {
            int64_t before = assigned[k];
            places->held[end * places->places + slot] = k;
            assigned[k] = end;
            if (k == device) break;
            slot = slot_of(places, before, k);
            end = before;
        }
    }
}

/* Memory for the assignment of K devices to N steps. */
typedef struct {
    int64_t *load; /* (N,) */
    double *best;  /* (K,) what each earns at its nearest step */
    double *x, *y; /* (N,) of the path, filled up with a point out of reach */
    Places places;
} Matching;

static Matching lay_out_matching(Arena *arena, int64_t devices, const Limits *limits)
{
    return (Matching){
        .load = claim(arena, limits->steps, sizeof(int64_t)),
        .best = claim(arena, devices, sizeof(double)),
        .x = claim(arena, wides(limits->steps), sizeof(Wide)),
        .y = claim(arena, wides(limits->steps), sizeof(Wide)),
        .places = lay_out_places(arena, devices, limits->steps, limits->per_step),
    };
}

/* A path, who is served from its points (-1: not at all), and what that earns. */
typedef struct {
    Point *way;        /* (N,) */
    int64_t *assigned; /* (K,) */
    double value;
} Plan;

static Plan lay_out_plan(Arena *arena, int64_t devices, int64_t steps)
{
    return (Plan){
        .way = claim(arena, steps, sizeof(Point)),
        .assigned = claim(arena, devices, sizeof(int64_t)),
    };
}

static void copy_plan(const Plan *from, Plan *to, int64_t devices, int64_t steps)
{
    memcpy(to->way, from->way, (size_t)steps * sizeof(Point));
    memcpy(to->assigned, from->assigned, (size_t)devices * sizeof(int64_t));
    to->value = from->value;
}

/* The step nearest to a point, the first of equals, and the square of its distance. */
static inline int64_t nearest_step(const Matching *memory, int64_t steps, Point p, double *square)
{
    const Wide *x = (const Wide *)memory->x, *y = (const Wide *)memory->y;
    const Mask all = (Mask){0} - 1;
    Least least = begin_least(INFINITY);
    for (int64_t n = 0, end = wides(steps); n < end; n++) {
        const Wide dx = x[n] - p.x, dy = y[n] - p.y;
        offer_wide(&least, dx * dx + dy * dy, all);
    }
    return end_least(&least, square);
}

/* Coincident steps share the load: a later one only if the earlier ones are full. */
static int64_t with_room(
    const Matching *memory, const Limits *limits, Point p, int64_t nearest, double square)
{
    for (int64_t n = nearest + 1; n < limits->steps; n++) {
        if (memory->load[nearest] < limits->per_step) return nearest;
        const double dx = memory->x[n] - p.x, dy = memory->y[n] - p.y;
        if (dx * dx + dy * dy == square) nearest = n;
    }
    return nearest;
}

/* The step at which a device has most success. */
static int64_t best_step(const Point *way, int64_t steps, int64_t k, const Grid *grid, double *f)
{
    int64_t best = 0;
    *f = -1.0;
    for (int64_t n = 0; n < steps; n++) {
        const double here = spot_at(grid, k, way[n]).f;
        if (!(here > *f)) continue;
        *f = here;
        best = n;
    }
    return best;
}

/* Assign every device to a step of the plan's path so that the most is earned.

   Every device goes to its nearest or best step; where that overfills one, the assignment problem is
   solved. */
static void match(Plan *plan, const Limits *limits, const Devices *devices, const Matching *memory)
{
    int64_t *load = memory->load, *assigned = plan->assigned;
    double *best = memory->best, total = 0.0;
    int fits = 1;
    for (int64_t n = 0; n < LENGTH * wides(limits->steps); n++) {
        memory->x[n] = n < limits->steps ? plan->way[n].x : INFINITY;
        memory->y[n] = n < limits->steps ? plan->way[n].y : INFINITY;
    }
    for (int64_t n = 0; n < limits->steps; n++) load[n] = 0;
    for (int64_t k = 0; k < devices->count; k++) {
        double near, f;
        int64_t nearest;
        if (devices->grid) {
            nearest = best_step(plan->way, limits->steps, k, devices->grid, &f);
        } else {
            nearest = nearest_step(memory, limits->steps, devices->at[k], &near);
            if (load[nearest] >= limits->per_step)
                nearest = with_room(memory, limits, devices->at[k], nearest, near);
            f = reward(sqrt(near), devices).f;
        }
        best[k] = devices->delta[k] * f - cost_of(devices, k);
        if (best[k] <= 0.0) {
            assigned[k] = -1;
            best[k] = 0.0;
            continue;
        }
        assigned[k] = nearest;
        load[nearest] += 1;
        total += best[k];
        if (load[nearest] > limits->per_step) fits = 0;
    }
    if (!fits) {
        memset(memory->places.known, 0, (size_t)devices->count);
        solve_assignment(plan->way, devices, devices->count, best, assigned, &memory->places);
        total = earned(plan->way, assigned, devices);
    }
    plan->value = total;
}

#endif
