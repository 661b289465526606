/* Where a plan stops and for how long, what the flight through its stops takes, and where it passes. */
#ifndef STOPS_H
#define STOPS_H

#include "matching.h"

static const double SAME_PLACE_M = 0.5; /* nearer waypoints are flown as one; no flight tells them apart */
static const double ASTRAY_M = 0.15; /* from where it holds to where it believes to be: a hover there
                                        begins with that */
static const double MOST_LOST = 0.01;  /* of a plan's value, with every corner cut as far as allowed */
enum { ROWS = 1024 };
enum { RUNS = 512, SHORT_RUN = 12 }; /* flights that are remembered, of so many points at most */

typedef struct {
    Point p;
    double hold, arrived; /* seconds of hover there, and when it is reached */
    double left;          /* when what follows a hover there begins */
    int64_t steps;        /* that are served there */
} Stop;

typedef struct {
    int64_t step, device;
    double gain, taken; /* what it earns, share of the limits */
} Turn;

/* A flight from one hover to the next, of `count` points, 0 where there is none. */
typedef struct {
    int64_t count;
    int weighed; /* whether its joules were wanted */
    double radius, seconds, joules;
    Point at[SHORT_RUN];
    double passed[SHORT_RUN];
} Run;

/* Memory for a plan of N steps over P points. */
typedef struct {
    int64_t stops, *stop; /* (P,) of each point */
    Stop *at;             /* (P,) */
    double counted[COUNTED]; /* of the flight whose share was asked for */
    double *offset, *begins; /* (N,) when each step begins: after the arrival at its stop, in the round */
    int64_t cuts, *turn;  /* radii that the route's corners are cut by so far; (P,) corner of each point */
    Point *corner, *cut;  /* (P,) of the route, (radii, P) where they are passed */
    int64_t *heard;       /* (radii, K) at which step each device was last, 1 for the first, 0 for none, */
    double *hears;        /* (radii, K) and its success there as it is passed */
    PathProfile run; /* (P + 1,) */
    double *passed; /* (P + 1,) */
    Run *runs;      /* (RUNS,) of those that were foreseen */
    double *chances, *worth; /* (N, K) of success, (K, N) */
    double *exact; /* (N, K) of success, not from the rows, where steps were last */
    Point *exactly; /* (N,) there */
    double *row;             /* (ROWS,) of success at 0, 1, 2, ... m */
    int64_t rows;            /* that are filled in: those that may be relied on */
    double *best;            /* (K,) */
    int64_t *assigned, *chosen, *order, *spare; /* (K,) */
    Turn *turns;             /* (K,) */
    unsigned char *other, *kept; /* (N, K) schedules */
    CandidatePlan whole;     /* a path that is cut */
    Places places;
} Desk;

static void lay_out_desk(Desk *desk, Arena *arena, const Round *round, int64_t points)
{
    const int64_t k = round->devices, n = round->steps, run = points + 1;
    desk->stop = claim(arena, points, sizeof(int64_t));
    desk->at = claim(arena, points, sizeof(Stop));
    desk->offset = claim(arena, n, sizeof(double));
    desk->begins = claim(arena, n, sizeof(double));
    desk->turn = claim(arena, points, sizeof(int64_t));
    desk->corner = claim(arena, points, sizeof(Point));
    desk->cut = claim(arena, round->radii * points, sizeof(Point));
    desk->heard = claim(arena, round->radii * k, sizeof(int64_t));
    desk->hears = claim(arena, round->radii * k, sizeof(double));
    desk->run.points = claim(arena, run, 3 * sizeof(double));
    desk->run.speeds = claim(arena, run, sizeof(double));
    desk->run.acceptance = claim(arena, run, sizeof(double));
    desk->run.at = claim(arena, run, sizeof(Vertex));
    desk->run.pieces = claim(arena, 4 * run, sizeof(Piece));
    desk->passed = claim(arena, run, sizeof(double));
    desk->runs = claim(arena, RUNS, sizeof(Run));
    desk->chances = claim(arena, n * k, sizeof(double));
    desk->worth = claim(arena, n * k, sizeof(double));
    desk->exact = claim(arena, n * k, sizeof(double));
    desk->exactly = claim(arena, n, sizeof(Point));
    for (int64_t i = 0; i < n && desk->exactly; i++) desk->exactly[i].x = NAN;
    desk->row = claim(arena, ROWS, sizeof(double));
    desk->rows = 0;
    desk->best = claim(arena, k, sizeof(double));
    desk->assigned = claim(arena, k, sizeof(int64_t));
    desk->chosen = claim(arena, k, sizeof(int64_t));
    desk->order = claim(arena, k, sizeof(int64_t));
    desk->spare = claim(arena, k, sizeof(int64_t));
    desk->turns = claim(arena, k, sizeof(Turn));
    desk->other = claim(arena, n * k, 1);
    desk->kept = claim(arena, n * k, 1);
    desk->whole.route = claim(arena, points, sizeof(Point));
    desk->whole.at = claim(arena, n, sizeof(int64_t));
    desk->places = lay_out_places(arena, k, n, round->per_step);
}

/* 0 where memory is short. */
static int open_desk(Desk *desk, Arena *arena, const Round *round, int64_t points)
{
    *arena = (Arena){0};
    lay_out_desk(desk, arena, round, points);
    if (!provide(arena)) return 0;
    lay_out_desk(desk, arena, round, points);
    return 1;
}

/* Merge consecutive points of the route nearer than `SAME_PLACE_M` to the first of them. */
static void gather_stops(const Round *round, const CandidatePlan *plan, Desk *desk)
{
    desk->stops = desk->cuts = 0;
    memset(desk->heard, 0, (size_t)(round->radii * round->devices) * sizeof(int64_t));
    for (int64_t p = 0; p < plan->points; p++) {
        if (!desk->stops || between(plan->route[p], desk->at[desk->stops - 1].p) > SAME_PLACE_M)
            desk->at[desk->stops++] = (Stop){.p = plan->route[p]};
        desk->stop[p] = desk->stops - 1;
    }
    for (int64_t n = 0; n < round->steps; n++) desk->at[desk->stop[plan->at[n]]].steps++;
}

/* How long the stops that are gathered hover. What is held at every stop but the first, or at the only one,
   is shared by its steps; each lasts until its devices have sent, one after another, and a stop until all
   of its steps have. */
static void hover_at_stops(const Round *round, const CandidatePlan *plan, Desk *desk)
{
    for (int64_t s = 0; s < desk->stops; s++) desk->at[s].hold = 0.0;
    double free = 0.0, hover = 0.0;
    for (int64_t n = 0, rank = 0; n < round->steps; n++, rank++) {
        const int64_t s = desk->stop[plan->at[n]];
        if (n == 0 || s != desk->stop[plan->at[n - 1]]) {
            hover = desk->stops == 1 || s > 0 ? round->hold : 0.0;
            free = 0.0;
            rank = 0;
        }
        desk->offset[n] = most(hover * (double)rank / (double)desk->at[s].steps, free);
        free = desk->offset[n];
        for (int64_t k = 0; round->upload && k < round->devices; k++)
            if (plan->schedule[n * round->devices + k]) free += round->upload[k];
        desk->at[s].hold = most(hover, free);
    }
    desk->at[0].hold = most(desk->at[0].hold, plan->wait);
}

static int is_same(Point a, Point b) { return a.x == b.x && a.y == b.y; }

/* A key of all points that go into it, in turn. */
static uint64_t mixed(uint64_t key, Point p)
{
    key = (key ^ bits_of(p.x)) * 0x9E3779B97F4A7C15u;
    return (key ^ key >> 29 ^ bits_of(p.y)) * 0xBF58476D1CE4E5B9u;
}

/* Where a run is remembered. */
static Run *run_at(const Stop *stop, int64_t count, double radius, Desk *desk)
{
    uint64_t key = bits_of(radius);
    for (int64_t i = 0; i < count; i++) key = mixed(key, stop[i].p);
    return desk->runs + (key >> 32) % RUNS;
}

static int is_run(const Run *run, const Stop *stop, int64_t count, double radius, int weighed)
{
    if (run->count != count || run->radius != radius || run->weighed < weighed) return 0;
    for (int64_t i = 0; i < count; i++)
        if (!is_same(run->at[i], stop[i].p)) return 0;
    return 1;
}

/* The path through stops of a run; of one stop, from where it holds to where it believes to be. */
static PathProfile *path_through(
    const Flying *flying, double radius, const Stop *stop, int64_t count, Desk *desk)
{
    PathProfile *path = &desk->run;
    path->count = count > 1 ? count : 2;
    for (int64_t i = 0; i < path->count; i++) {
        path->points[i][0] = i < count ? stop[i].p.x : stop[0].p.x + ASTRAY_M;
        path->points[i][1] = i < count ? stop[i].p.y : stop[0].p.y;
        path->speeds[i] = flying->speed;
        path->acceptance[i] = radius;
    }
    return path;
}

/* The seconds, and the joules if they are wanted, of guided flight through stops from rest to rest, and
   when each is passed: most changes of a way leave most of such runs as they were. */
static double fly_run(
    const Flying *flying, double radius, const Stop *stop, int64_t count, double *joules, Desk *desk)
{
    if (count < 3) radius = 0.0; /* there is no corner */
    Run *run = count > SHORT_RUN ? NULL : run_at(stop, count, radius, desk);
    if (run && is_run(run, stop, count, radius, joules != NULL)) {
        memcpy(desk->passed, run->passed, (size_t)count * sizeof(double));
        if (joules) *joules = run->joules;
        return run->seconds;
    }
    PathProfile *path = path_through(flying, radius, stop, count, desk);
    const double seconds = foresee_path(
        path, &flying->steering, joules ? &flying->air : NULL, desk->passed, joules);
    if (!run) return seconds;
    *run = (Run){.count = count, .weighed = joules != NULL, .radius = radius, .seconds = seconds,
                 .joules = joules ? *joules : 0.0};
    for (int64_t i = 0; i < count; i++) run->at[i] = stop[i].p;
    memcpy(run->passed, desk->passed, (size_t)count * sizeof(double));
    return seconds;
}

/* What the flight through the stops takes, from one hover to the next: when each is reached, and
   joules where they are wanted; returns its seconds. Where nobody hovers, nobody stops. */
static double fly_stops(const Flying *flying, double radius, double *joules, Desk *desk)
{
    const Air *air = &flying->air;
    const double hover_w = power_at(size3(air->wind[0], air->wind[1], 0.0), 0.0, air);
    const int64_t final = desk->stops - 1;
    double now = 0.0, energy = 0.0;
    desk->at[0].arrived = 0.0;
    for (int64_t first = 0, last = 0; last <= final; last++) {
        const double hover = desk->at[last].hold;
        if (!(hover > 0.0 || (last == final && final > 0))) continue;
        const Stop *run = desk->at + first;
        const int64_t count = last - first + 1;
        double moving = 0.0, moved = 0.0;
        if (flying->guided) {
            moving = fly_run(flying, radius, run, count, joules ? &moved : NULL, desk);
            /* A hover where it begins takes the aircraft to where it believes to be. */
            const double rests = last == final || !last ? flying->settling : flying->stopping;
            moving += rests;
            /* What takes longer than the guidance's own is spent hovering. */
            moved += hover_w * (rests + most(0.0, moving * (flying->pace - 1.0)));
            moving *= flying->pace;
            for (int64_t i = 1; i < count; i++) desk->passed[i] *= flying->pace;
        } else {
            for (int64_t i = 1; i < count; i++) {
                moving += between(run[i - 1].p, run[i].p) / flying->speed;
                desk->passed[i] = moving;
            }
            moved = power_at(flying->speed, 0.0, air) * moving;
        }
        for (int64_t i = 1; i < count; i++) desk->at[first + i].arrived = now + desk->passed[i];
        now += moving + hover;
        desk->at[last].left = now;
        energy += moved + hover_w * hover;
        first = last;
    }
    if (joules) *joules = energy;
    return now;
}

/* How much a limit counts of what is counted. */
static double taken_of(const Limit *limit, const double *counted)
{
    double taken = 0.0;
    for (int64_t i = 0; i < COUNTED; i++)
        if (limit->of[i] != 0.0) taken += limit->of[i] * counted[i];
    return taken;
}

/* Whether some limit counts one of what is counted, from the first to the last. */
static int is_limited(const Flying *flying, int64_t first, int64_t last)
{
    for (int64_t l = 0; l < flying->limits; l++)
        for (int64_t i = first; i <= last; i++)
            if (flying->limit[l].of[i] != 0.0) return 1;
    return 0;
}

/* Count what the flight through the stops takes: all of it, or seconds and what some limit weighs. */
static void count_flight(const Flying *flying, double radius, int all, double *counted, Desk *desk)
{
    for (int64_t i = 0; i < COUNTED; i++) counted[i] = 0.0;
    /* Energy takes most of the work to foresee. */
    double *joules = all || is_limited(flying, JOULES, JOULES) ? counted + JOULES : NULL;
    counted[SECONDS] = fly_stops(flying, radius, joules, desk);
    if (!all && !is_limited(flying, METRES, COUNTED - 1)) return;
    Point before = {0.0, 0.0};
    for (int64_t i = 0; i < desk->stops; i++) {
        const Point a = desk->at[i ? i - 1 : 0].p, b = desk->at[i].p, leg = {b.x - a.x, b.y - a.y};
        const double across = before.x * leg.y - before.y * leg.x;
        counted[METRES] += between(a, b);
        counted[HOVERED] += desk->at[i].hold;
        counted[TURNED] += fabs(arc_tangent2(across, before.x * leg.x + before.y * leg.y));
        before = leg;
    }
}

/* When each step begins at the earliest, in seconds into the round: as foreseen with the widest
   corners, less what a flight may be ahead of that. */
static void time_steps(const Round *round, const CandidatePlan *plan, Desk *desk)
{
    const Flying *flying = round->flying;
    hover_at_stops(round, plan, desk);
    fly_stops(flying, flying->widest, NULL, desk);
    for (int64_t n = 0; n < round->steps; n++) {
        const double at = desk->at[desk->stop[plan->at[n]]].arrived + desk->offset[n];
        desk->begins[n] = most(0.0, at * (1.0 - flying->ahead_share) - flying->ahead);
    }
}

/* Where the route's corners are passed by a path that cuts them by up to a radius.

   A corner is cut along its bisector. The arc is a parabola that takes up half of either leg at most,
   so that its depth is limited to a quarter of the shorter leg times sin(phi / 2). */
static void cut_corners(const CandidatePlan *plan, double radius, Point *cut, Desk *desk)
{
    int64_t count = 0;
    Point *corner = desk->corner;
    for (int64_t p = 0; p < plan->points; p++) {
        if (!p || between(plan->route[p - 1], plan->route[p]) > SAME_PLACE_M)
            corner[count++] = plan->route[p];
        desk->turn[p] = count - 1;
    }
    for (int64_t i = 0; i < count; i++) {
        cut[i] = corner[i];
        if (i == 0 || i == count - 1) continue;
        const double into = between(corner[i - 1], corner[i]), out = between(corner[i], corner[i + 1]);
        /* A path may come back in steps that are dropped: such a leg has no direction. */
        const double a = most(into, 1e-9), b = most(out, 1e-9);
        const double x = (corner[i + 1].x - corner[i].x) / b - (corner[i].x - corner[i - 1].x) / a;
        const double y = (corner[i + 1].y - corner[i].y) / b - (corner[i].y - corner[i - 1].y) / a;
        const double twice_sine = sqrt(x * x + y * y);
        if (!(twice_sine > 1e-9)) continue;
        const double depth = least(radius, least(into, out) * twice_sine / 8.0);
        cut[i].x += depth / twice_sine * x;
        cut[i].y += depth / twice_sine * y;
    }
}

/* Of success at a distance: exactly, or between the desk's rows. */
static double chance_by(const Round *round, double far, const Desk *desk)
{
    const int64_t i = far < ROWS ? (int64_t)far : ROWS;
    if (i + 1 >= desk->rows) return 1.0 - per_at(round->channel, far, round->altitude);
    return desk->row[i] + (desk->row[i + 1] - desk->row[i]) * (far - (double)i);
}

/* Of device k's success at a place. */
static double chance_at(const Round *round, int64_t k, Point place, const Desk *desk)
{
    if (round->grid) return spot_at(round->grid, k, place).f;
    return chance_by(round, between(place, round->at[k]), desk);
}

/* What serving a device is worth with that chance of success, its price paid. */
static double gain_of(const Round *round, int64_t k, double chance)
{
    return chance * round->importance[k] - (round->price ? round->price[k] : 0.0);
}

/* The widest acceptance radius of the round's that costs a plan 1 % of its value at most; where none
   does, the narrowest. Its stops are gathered. */
static double radius_of(const Round *round, const CandidatePlan *plan, Desk *desk)
{
    for (int64_t i = 0; i < round->radii; i++) {
        Point *cut = desk->cut + i * plan->points;
        double flown = 0.0;
        if (i == desk->cuts) cut_corners(plan, round->radius[desk->cuts++], cut, desk);
        for (int64_t n = 0; n < round->steps; n++)
            for (int64_t k = 0; k < round->devices; k++) {
                if (!plan->schedule[n * round->devices + k]) continue;
                const int64_t at = i * round->devices + k;
                if (desk->heard[at] != n + 1) {
                    desk->heard[at] = n + 1;
                    desk->hears[at] = chance_at(round, k, cut[desk->turn[plan->at[n]]], desk);
                }
                flown += gain_of(round, k, desk->hears[at]);
            }
        if (flown >= (1.0 - MOST_LOST) * plan->value) return round->radius[i];
    }
    return round->radius[round->radii - 1];
}

/* How much of the tightest limit the flight takes whose hovers are known; more than 1 does not fit. */
static double share_of(const Flying *flying, double radius, Desk *desk)
{
    double share = 0.0;
    count_flight(flying, radius, 0, desk->counted, desk);
    for (int64_t l = 0; l < flying->limits; l++)
        share = most(share, taken_of(flying->limit + l, desk->counted) / flying->limit[l].most);
    return share;
}

/* Of each device's success at a place, into `chance` (K,); most steps are where they were. */
static void set_exactly(const Round *round, Point place, double *chance, const Desk *desk)
{
    const int64_t devices = round->devices;
    for (int64_t n = 0; n < round->steps; n++)
        if (is_same(desk->exactly[n], place)) {
            memcpy(chance, desk->exact + n * devices, (size_t)devices * sizeof(double));
            return;
        }
    for (int64_t k = 0; k < devices; k++) chance[k] = chance_at(round, k, place, desk);
}

static void set_chances(const Round *round, const CandidatePlan *plan, Desk *desk)
{
    const int64_t devices = round->devices;
    for (int64_t n = 0; n < round->steps; n++) {
        const Point place = plan->route[plan->at[n]];
        double *chance = desk->chances + n * devices;
        if (!desk->rows) set_exactly(round, place, chance, desk);
        else
            for (int64_t k = 0; k < devices; k++) chance[k] = chance_at(round, k, place, desk);
    }
    if (desk->rows) return;
    memcpy(desk->exact, desk->chances, (size_t)(round->steps * devices) * sizeof(double));
    for (int64_t n = 0; n < round->steps; n++) desk->exactly[n] = plan->route[plan->at[n]];
}

#endif
