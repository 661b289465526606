/* A plan as it is flown: who is served at its stops and when, and how much of it fits into a round's
   limits. */
#ifndef FLOWN_H
#define FLOWN_H

#include "stops.h"

static const double ROUNDING_M = 1e-9; /* a path that is over its budget by less is not */
static const double FILLED = 1.05;     /* of a limit: a device that seems to take no more is tried */
static const double FULL = 0.999;      /* of a limit, to which a path is cut */
static const double LEAST_RATE = 0.3;  /* of the whole path's share a metre: less at its end is a corner's
                                          doing */
static const double WITHIN = 1e-9; /* of a value: what sums of it differ by at most */
enum { CUTS = 6 };  /* of a path that is too long */
enum { ANEW = 3 }; /* a schedule whose hovers let more devices get ready is made anew at most so often */

/* Assign devices to steps so that the most of `worth` (K, N) is earned, and none where it is nothing. */
static void assign_steps(
    int64_t devices, int64_t steps, const double *worth, double *best, int64_t *assigned,
    const Places *places)
{
    int fits = 1;
    memset(places->load, 0, (size_t)steps * sizeof(int64_t));
    for (int64_t k = 0; k < devices; k++) {
        best[k] = 0.0;
        assigned[k] = -1;
        for (int64_t n = 0; n < steps; n++)
            if (worth[k * steps + n] > best[k]) best[k] = worth[k * steps + (assigned[k] = n)];
        if (assigned[k] >= 0 && ++places->load[assigned[k]] > places->places) fits = 0;
    }
    if (fits) return; /* each is at its best step */
    for (int64_t k = 0; k < devices; k++) {
        memcpy(places->worth + k * wides(steps), worth + k * steps, (size_t)steps * sizeof(double));
        places->known[k] = 1;
    }
    solve_assignment(NULL, NULL, devices, best, assigned, places);
}

/* The best schedule from where the steps are, of devices that may be heard at all and, if `timed`, are
   ready as steps begin. While one without hope sends, others may get ready: there it may have its turn. */
static void assign_ready(const Round *round, int timed, unsigned char *schedule, Desk *desk)
{
    const int64_t devices = round->devices, steps = round->steps;
    const double hope = round->ready && round->upload ? 0.0 : HOPE_PERCENT / 100.0;
    for (int64_t n = 0; n < steps; n++)
        for (int64_t k = 0; k < devices; k++) {
            const double chance = desk->chances[n * devices + k];
            const int never = chance < hope || (timed && desk->begins[n] < round->ready[k]);
            desk->worth[k * steps + n] = never ? 0.0 : most(0.0, gain_of(round, k, chance));
        }
    memset(schedule, 0, (size_t)(steps * devices));
    assign_steps(devices, steps, desk->worth, desk->best, desk->assigned, &desk->places);
    for (int64_t k = 0; k < devices; k++) {
        const int64_t n = desk->assigned[k];
        if (n >= 0) schedule[n * devices + k] = desk->worth[k * steps + n] > 0.0;
    }
}

/* Leave out devices whose step begins before they are ready, and work out what the plan is worth. Who
   is left out sends nothing, so that those after it may have their turn too early as well. */
static void leave_late(const Round *round, CandidatePlan *plan, Desk *desk)
{
    for (int late = round->ready != NULL; late;) {
        late = 0;
        time_steps(round, plan, desk);
        for (int64_t n = 0; n < round->steps; n++)
            for (int64_t k = 0; k < round->devices; k++) {
                unsigned char *turn = plan->schedule + n * round->devices + k;
                if (!*turn || !(desk->begins[n] < round->ready[k])) continue;
                *turn = 0;
                late = 1;
            }
    }
    plan->value = 0.0;
    for (int64_t n = 0, i = 0; n < round->steps; n++)
        for (int64_t k = 0; k < round->devices; k++, i++)
            if (plan->schedule[i]) plan->value += gain_of(round, k, desk->chances[i]);
}

/* Seconds of hovers that a flight leaves which takes so much without them. */
static double left_to_hover(const Flying *flying, const double *way)
{
    const Air *air = &flying->air;
    const double hover_w = power_at(size3(air->wind[0], air->wind[1], 0.0), 0.0, air);
    const double hover[COUNTED] = {[SECONDS] = 1.0, [JOULES] = hover_w, [HOVERED] = 1.0};
    double left_s = INFINITY;
    for (const Limit *limit = flying->limit; limit < flying->limit + flying->limits; limit++) {
        const double rate = taken_of(limit, hover);
        if (rate > 0.0) left_s = least(left_s, (limit->most - taken_of(limit, way)) / rate);
    }
    return left_s;
}

/* Of device k's success at the step where that is largest: the nearest one, but on a grid. */
static double best_chance(const Round *round, const CandidatePlan *plan, int64_t k, const Desk *desk)
{
    double square = INFINITY, best = 0.0;
    for (int64_t n = 0; n < round->steps; n++) {
        const Point here = plan->route[plan->at[n]];
        if (round->grid)
            best = most(best, spot_at(round->grid, k, here).f);
        else
            square = least(square, square_between(here, round->at[k]));
    }
    return round->grid ? best : chance_by(round, sqrt(square), desk);
}

/* What devices of so much worth (K,) earn at most with hovers of so many seconds in all. */
static double worth_in(const Round *round, double room, Desk *desk)
{
    for (int64_t k = 0; k < round->devices; k++)
        desk->best[k] = desk->worth[k] / most(round->upload[k], 1e-9);
    const int64_t *order = descending(desk->best, round->devices, desk->order, desk->spare);
    double total = 0.0;
    for (int64_t i = 0; i < round->devices && room > 0.0; i++) {
        const int64_t k = order[i];
        total += desk->worth[k] * least(1.0, room / most(round->upload[k], 1e-9));
        room -= round->upload[k];
    }
    return total * (1.0 + WITHIN);
}

/* What a path of so many metres is worth at most: each device from the nearest step, the hovers for them
   within what the flight leaves. */
static double promised(const Round *round, const CandidatePlan *plan, double length, Desk *desk)
{
    double total = 0.0;
    for (int64_t k = 0; k < round->devices; k++) {
        desk->worth[k] = most(0.0, gain_of(round, k, best_chance(round, plan, k, desk)));
        total += desk->worth[k];
    }
    if (!round->upload || !round->flying) return total * (1.0 + WITHIN);
    const Flying *flying = round->flying;
    const Air *air = &flying->air;
    const double wind = size3(air->wind[0], air->wind[1], 0.0);
    double per_metre = INFINITY;
    for (int64_t v = 1; v < air->rows; v++)
        per_metre = least(per_metre, power_at((double)v, 0.0, air) / ((double)(v + 1) + wind));
    const double way[COUNTED] = {length / flying->speed * flying->pace, length * per_metre, length};
    const double room = left_to_hover(flying, way);
    return room > 0.0 ? worth_in(round, room, desk) : total * (1.0 + WITHIN); /* it will be cut */
}

/* The best schedule along a path; where devices have to get ready, one that waits for nobody but by
   hovers: while those of the plan send, others get ready. */
static void schedule_steps(const Round *round, CandidatePlan *plan, Desk *desk)
{
    const size_t size = (size_t)(round->steps * round->devices);
    set_chances(round, plan, desk);
    if (!round->ready) {
        assign_ready(round, 0, plan->schedule, desk);
        leave_late(round, plan, desk);
        return;
    }
    memset(plan->schedule, 0, size);
    plan->value = 0.0;
    for (int turn = 0; turn < (round->upload ? ANEW : 1); turn++) {
        CandidatePlan other = *plan;
        other.schedule = desk->other;
        if (!turn) time_steps(round, plan, desk); /* `leave_late` has timed what is better */
        assign_ready(round, 1, other.schedule, desk);
        if (turn && !memcmp(other.schedule, plan->schedule, size)) break; /* it is what it was */
        leave_late(round, &other, desk);
        if (!(other.value > plan->value)) break;
        memcpy(plan->schedule, other.schedule, size);
        plan->value = other.value;
    }
}

/* Make the plan serve the first `count` of those that are chosen, and work out the share of the limits
   that it takes then; `kept` becomes like it if it fits. */
static double serve_chosen(
    const Round *round, CandidatePlan *plan, int64_t count, CandidatePlan *kept, Desk *desk)
{
    const size_t size = (size_t)(round->steps * round->devices);
    memset(plan->schedule, 0, size);
    for (int64_t i = 0; i < count; i++) {
        const Turn *turn = desk->turns + desk->chosen[i];
        plan->schedule[turn->step * round->devices + turn->device] = 1;
    }
    leave_late(round, plan, desk);
    if (!round->ready) hover_at_stops(round, plan, desk);
    const double share = share_of(round->flying, radius_of(round, plan, desk), desk);
    if (share > 1.0) return share;
    memcpy(kept->schedule, plan->schedule, size);
    kept->value = plan->value;
    return share;
}

/* Whether a turn is among the first `count` that are chosen. */
static int is_chosen(int64_t turn, int64_t count, const Desk *desk)
{
    for (int64_t i = 0; i < count; i++)
        if (desk->chosen[i] == turn) return 1;
    return 0;
}

/* What may be earned at most by the first `count` turns that are chosen and, in so much room, by those of
   `others` that are not, the most for what they take first. */
static double worth_within(int64_t count, const int64_t *others, int64_t left, double room, const Desk *desk)
{
    double worth = 0.0;
    for (int64_t i = 0; i < count; i++) worth += desk->turns[desk->chosen[i]].gain;
    for (int64_t i = 0; i < left && room > 0.0; i++) {
        const Turn *turn = desk->turns + others[i];
        if (is_chosen(others[i], count, desk)) continue;
        worth += turn->taken > room ? turn->gain * room / turn->taken : turn->gain;
        room -= turn->taken;
    }
    return worth * (1.0 + WITHIN);
}

/* Let nobody be served, for whom a flight hovers; returns the share of the limits that it takes then. */
static double serve_nobody(const Round *round, CandidatePlan *plan, Desk *desk)
{
    memset(plan->schedule, 0, (size_t)(round->steps * round->devices));
    plan->value = 0.0;
    hover_at_stops(round, plan, desk);
    return share_of(round->flying, radius_of(round, plan, desk), desk);
}

/* Leave out the devices whose sending takes a plan beyond the limits, least worth a second first; it
   may still not fit, if the path does not, which takes the share `alone` of the limits, and is worth nothing
   where it seems that it would be worth no more than `above`. Its chances are worked out, and its stops
   gathered. Returns the share that it takes. */
static double serve_fewer(
    const Round *round, CandidatePlan *plan, double alone, double above, Desk *desk)
{
    hover_at_stops(round, plan, desk);
    const double whole = share_of(round->flying, radius_of(round, plan, desk), desk);
    if (whole <= 1.0 || !round->upload) return whole;
    if (alone > 1.0) {
        serve_nobody(round, plan, desk);
        return alone;
    }
    int64_t served = 0, count = 0, failed = -1;
    double seconds = 0.0;
    for (int64_t n = 0, i = 0; n < round->steps; n++)
        for (int64_t k = 0; k < round->devices; k++, i++)
            if (plan->schedule[i] && served < round->devices) {
                desk->turns[served++] = (Turn){n, k, gain_of(round, k, desk->chances[i]), 0.0};
                seconds += round->upload[k];
            }
    CandidatePlan kept = {.schedule = desk->kept};
    const size_t size = (size_t)(round->steps * round->devices);
    double taken = alone, share = alone;
    memset(kept.schedule, 0, size);
    /* What one of them takes, about: its stop's braking goes with the seconds of its hover. */
    for (int64_t i = 0; i < served; i++) {
        Turn *turn = desk->turns + i;
        turn->taken = (whole - alone) * round->upload[turn->device] / most(seconds, 1e-9);
        desk->best[i] = turn->gain / most(turn->taken, 1e-9);
    }
    const int64_t *order = descending(desk->best, served, desk->order, desk->spare);
    if (!(worth_within(0, order, served, FILLED - taken, desk) > above)) {
        plan->value = 0.0;
        return taken;
    }
    for (int64_t i = 0; i < served; i++)
        if (taken + desk->turns[order[i]].taken <= 1.0) {
            taken += desk->turns[order[i]].taken;
            desk->chosen[count++] = order[i];
        }
    for (; count; taken -= desk->turns[failed].taken) {
        const double all = serve_chosen(round, plan, count, &kept, desk);
        if (all <= 1.0) {
            share = all;
            break;
        }
        failed = desk->chosen[--count];
    }
    for (int64_t i = 0; i < served; i++) {
        const double more = desk->turns[order[i]].taken;
        if (order[i] == failed || taken + more > FILLED || is_chosen(order[i], count, desk)) continue;
        if (!(worth_within(count, order + i, served - i, FILLED - taken, desk) > above)) break;
        desk->chosen[count] = order[i];
        const double all = serve_chosen(round, plan, count + 1, &kept, desk);
        if (all > 1.0) continue;
        share = all;
        taken += more;
        count++;
    }
    memcpy(plan->schedule, kept.schedule, size);
    plan->value = kept.value;
    hover_at_stops(round, plan, desk);
    return share;
}

/* The first metres of a path: where everywhere may be flown it is shrunk about its start, among areas
   its end is cut off, where the waypoints that are left all are. Returns the metres. */
static double cut_path(const Round *round, const CandidatePlan *whole, double metres, CandidatePlan *plan)
{
    double along = 0.0;
    plan->points = whole->points;
    memcpy(plan->at, whole->at, (size_t)round->steps * sizeof(int64_t));
    memcpy(plan->route, whole->route, (size_t)whole->points * sizeof(Point));
    for (int64_t p = 1; p < whole->points; p++) along += between(whole->route[p - 1], whole->route[p]);
    if (!round->space && along > metres) {
        const Point start = whole->route[0];
        /* One part in 1e12 keeps rounding from putting the path over the budget again. */
        const double scale = metres / along * (1.0 - 1e-12);
        for (int64_t p = 0; p < whole->points; p++) {
            plan->route[p].x = start.x + (whole->route[p].x - start.x) * scale;
            plan->route[p].y = start.y + (whole->route[p].y - start.y) * scale;
        }
        return metres;
    }
    along = 0.0;
    for (int64_t p = 1, n = 1; p < whole->points; p++) {
        const Point a = whole->route[p - 1], b = whole->route[p];
        const double leg = between(a, b);
        if (along + leg > metres + ROUNDING_M) {
            const double share = most(0.0, metres - along) / leg;
            plan->points = p;
            for (; n < round->steps; n++) {
                plan->at[n] = plan->points;
                plan->route[plan->points++] = between_at(a, b, share);
            }
            return metres;
        }
        along += leg;
        if (n < round->steps && whole->at[n] == p) n++;
    }
    return along;
}

/* Make the plan along a path as far as it fits; 0 where it is worth no more than `above`, or where a
   few cuts do not find how far it may go. */
static int fit_path(
    const Round *round, CandidatePlan *plan, double metres, double above, int limited, Desk *desk)
{
    CandidatePlan *whole = &desk->whole;
    double before = 0.0, longer = -1.0; /* share, and metres, of the path before */
    whole->points = plan->points;
    memcpy(whole->at, plan->at, (size_t)round->steps * sizeof(int64_t));
    memcpy(whole->route, plan->route, (size_t)plan->points * sizeof(Point));
    for (int cut = 0; cut < CUTS; cut++) {
        const double length = cut_path(round, whole, metres, plan);
        double alone = 0.0;
        if (!(promised(round, plan, length, desk) > above)) return 0;
        if (limited || round->ready) gather_stops(round, plan, desk);
        if (limited && round->upload) {
            alone = serve_nobody(round, plan, desk);
            double room = left_to_hover(round->flying, desk->counted);
            for (int64_t s = 0; s < desk->stops; s++) room += desk->at[s].hold; /* in which others send */
            if (alone <= 1.0 && !(worth_in(round, room, desk) > above)) return 0;
        }
        schedule_steps(round, plan, desk);
        if (!(plan->value > above)) return 0;
        if (!limited) return 1;
        const double taken = serve_fewer(round, plan, alone, above, desk);
        if (taken <= 1.0) return plan->value > above;
        /* By the last two cuts: what the rest of the path takes, corners included. */
        double rate = taken / most(length, 1e-9);
        if (longer > length) rate = most((before - taken) / (longer - length), rate * LEAST_RATE);
        longer = length;
        before = taken;
        metres = most(0.0, length - (taken - FULL) / rate);
    }
    return 0;
}

#endif
