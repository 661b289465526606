/* Plans along ways through waypoints, and what changes at random make of them: those are kept that make
   the present plan worth more, or less by a tolerance that falls to nothing (threshold accepting, Dueck
   and Scheuer 1990). */
#ifndef VARIATION_H
#define VARIATION_H

#include "exploration.h"
#include "flown.h"

static const double WIDEST_M = 256.0; /* twice what a waypoint is moved by at most */
enum { NARROWER = 8 };                /* halvings of that */
static const double BRISK = 5.0;    /* m/s2 of a way there and back that takes some time */
static const double TABLED = 1e-4; /* of a value: what it may be more, exactly */

/* Points that the route through a round's waypoints has at most. */
static int64_t room_of(const Round *round)
{
    return round->steps * (round->space ? round->space->vertices + 2 : 1);
}

enum { WAYS = 512, SHORT_WAY = 6 }; /* ways that are remembered, of so many points at most */

/* A way among areas, of `count` points after its first, 0 where there is none. */
typedef struct {
    int64_t count;
    Point from, to, at[SHORT_WAY];
} Way;

/* Ways that were found, and memory for others. */
typedef struct {
    Way *known;    /* (WAYS,) */
    double *spare; /* (2 V,) */
} Ways;

/* The desk of a round, with memory for ways among its areas. */
static void lay_out_planning(Desk *desk, Ways *ways, Arena *arena, const Round *round)
{
    lay_out_desk(desk, arena, round, room_of(round));
    ways->known = claim(arena, round->space ? WAYS : 0, sizeof(Way));
    ways->spare = claim(arena, round->space ? 2 * round->space->vertices : 0, sizeof(double));
}

/* See `way_towards`: most changes of a way leave most of its legs as they were. */
static int64_t known_way(const Airspace *space, Point from, Point to, Point *points, Ways *ways)
{
    Way *way = ways->known + (mixed(mixed(0, from), to) >> 32) % WAYS;
    if (!way->count || !is_same(way->from, from) || !is_same(way->to, to)) {
        const int64_t count = way_towards(space, from, to, points, ways->spare);
        if (count > SHORT_WAY) return count;
        *way = (Way){.count = count, .from = from, .to = to};
        memcpy(way->at, points, (size_t)count * sizeof(Point));
    }
    memcpy(points, way->at, (size_t)way->count * sizeof(Point));
    return way->count;
}

/* Make the plan along the way through waypoints, as `fit_path` does. */
static int fit_way(
    const Round *round, const Point *waypoint, CandidatePlan *plan, double metres, double above,
    int limited, Desk *desk, Ways *ways)
{
    plan->route[plan->at[0] = 0] = waypoint[0];
    plan->points = 1;
    for (int64_t n = 1; n < round->steps; n++) {
        Point *next = plan->route + plan->points;
        if (round->space)
            plan->points += known_way(round->space, next[-1], waypoint[n], next, ways);
        else
            plan->route[plan->points++] = waypoint[n];
        plan->at[n] = plan->points - 1;
    }
    return fit_path(round, plan, metres, above, limited, desk);
}

/* A whole number under a limit. */
static int64_t draw_under(int64_t limit, uint64_t *state)
{
    return (int64_t)(next_random(state) * (double)limit);
}

/* Move a waypoint (of N, the first stays) or all that are at its place, put one near a device, elsewhere in
   the order, or to the one before it, or reverse a stretch. If devices get ready, also put one beside the
   way for about as long as device k needs: steps begin at `begins` (N,), and nothing else waits for it. */
static void change_way(
    const Round *round, int64_t k, const double *begins, Point *way, uint64_t *state)
{
    const int64_t steps = round->steps;
    const Point device = round->at[k];
    const int64_t n = 1 + draw_under(steps - 1, state), m = 1 + draw_under(steps - 1, state);
    const int64_t kind = draw_under(round->ready ? 9 : 7, state);
    const double x = next_random(state), y = next_random(state), nearness = x * y;
    if (kind == 0 || kind == 6) {
        const double widest = WIDEST_M / (double)(1 << draw_under(NARROWER, state));
        const Point old = way[n];
        for (int64_t i = 1; i < steps; i++)
            if (i == n || (kind == 6 && between(way[i], old) == 0.0))
                way[i] = (Point){old.x + (x - 0.5) * widest, old.y + (y - 0.5) * widest};
    } else if (kind == 1) {
        way[n] = between_at(device, way[n], nearness);
    } else if (kind == 2) {
        for (int64_t i = fewer(n, m), j = n + m - i; i < j; i++, j--) {
            const Point other = way[i];
            way[i] = way[j];
            way[j] = other;
        }
    } else {
        Point put = kind == 3 ? way[n] : way[m - 1];
        if (kind == 4) put = between_at(device, put, nearness);
        if (kind > 6) { /* there and back, from rest to rest */
            const double east = x - 0.5, north = y - 0.5, more = next_random(state);
            const double quarter = most(0.0, round->ready[k] - begins[m]) * (1.0 + more * more) / 4.0;
            const double speed = round->flying->speed, slow = most(0.0, speed / BRISK - quarter);
            const double far = speed * (2.0 * quarter - speed / BRISK) + BRISK * slow * slow;
            const double scale = far / most(sqrt(east * east + north * north), 1e-9);
            put = (Point){put.x + scale * east, put.y + scale * north};
        }
        for (int64_t i = n; i < m; i++) way[i] = way[i + 1];
        for (int64_t i = n; i > m; i--) way[i] = way[i - 1];
        way[m] = put;
    }
}

/* See `planner.h`. */
static int vary(
    const Round *round, CandidatePlan *plan, double metres, int64_t changes, double tolerance, int64_t seed,
    int limited)
{
    const int64_t steps = round->steps;
    uint64_t state = 0x9E3779B97F4A7C15u ^ (uint64_t)seed;
    int64_t *worth, count = 0;
    double *begins, value = plan->value;
    Point *now, *way;
    CandidatePlan other = {.wait = plan->wait};
    Desk desk;
    Ways ways;
    Arena arena = {0};
    for (int pass = 0; pass < 2; pass++) {
        lay_out_planning(&desk, &ways, &arena, round);
        other.route = claim(&arena, room_of(round), sizeof(Point));
        other.at = claim(&arena, steps, sizeof(int64_t));
        other.schedule = claim(&arena, steps * round->devices, 1);
        now = claim(&arena, steps, sizeof(Point));
        way = claim(&arena, steps, sizeof(Point));
        begins = claim(&arena, steps, sizeof(double));
        worth = claim(&arena, round->devices, sizeof(int64_t));
        if (pass == 0 && !provide(&arena)) return -1;
    }
    for (int64_t i = 0; i < ROWS; i++) desk.row[i] = chance_by(round, (double)i, &desk);
    for (int64_t n = 0; n < steps; n++) now[n] = plan->route[plan->at[n]];
    if (round->ready) {
        gather_stops(round, plan, &desk);
        time_steps(round, plan, &desk);
    }
    memcpy(begins, desk.begins, (size_t)steps * sizeof(double));
    for (int64_t k = 0; k < round->devices; k++)
        if (round->importance[k] > 0.0) worth[count++] = k;
    for (int64_t i = 0; i < changes && count && steps > 1; i++) {
        const double left = 1.0 - (double)i / (double)changes;
        const double above = value * (1.0 - tolerance * left * next_random(&state));
        memcpy(way, now, (size_t)steps * sizeof(Point));
        change_way(round, worth[draw_under(count, &state)], begins, way, &state);
        desk.rows = ROWS;
        if (!fit_way(round, way, &other, metres, above, limited, &desk, &ways)) continue;
        desk.rows = 0;
        value = other.value;
        /* After the arrival at its stop, not in the round: with the longer detours that this makes, plans are
           better. */
        memcpy(begins, desk.offset, (size_t)steps * sizeof(double));
        for (int64_t n = 0; n < steps; n++) now[n] = other.route[other.at[n]];
        if (!(value > plan->value * (1.0 - TABLED)) ||
            !fit_way(round, way, &other, metres, plan->value, limited, &desk, &ways))
            continue;
        memcpy(plan->route, other.route, (size_t)other.points * sizeof(Point));
        memcpy(plan->at, other.at, (size_t)steps * sizeof(int64_t));
        memcpy(plan->schedule, other.schedule, (size_t)(steps * round->devices));
        plan->points = other.points;
        plan->value = other.value;
    }
    release(&arena);
    return 0;
}

#endif
