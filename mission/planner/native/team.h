/* The best plan of several aircraft near given paths.

   Once it is known who is served by whom, the aircraft have nothing to do with each other: each climbs by
   itself, then all devices are assigned anew. */
#ifndef TEAM_H
#define TEAM_H

#include "flown.h"

/* Memory for plans of several aircraft. */
typedef struct {
    const Problem *problem; /* (A,) */
    int64_t aircraft;
    double *worth, *best, *others; /* (K, A N), (K,), (K,) */
    double *mu;                    /* (A,) */
    Places places;                 /* for K devices and A N steps */
    Plan present, made;
    Polish polish; /* of one of them */
} Team;

static void lay_out_team(
    Team *team, Arena *arena, int64_t aircraft, const Devices *devices, const Limits *limits)
{
    const int64_t k = devices->count, places = aircraft * limits->steps;
    team->aircraft = aircraft;
    team->worth = claim(arena, k * places, sizeof(double));
    team->best = claim(arena, k, sizeof(double));
    team->others = claim(arena, k, sizeof(double));
    team->mu = claim(arena, aircraft, sizeof(double));
    team->places = lay_out_places(arena, k, places, limits->per_step);
    team->present = lay_out_plan(arena, k, places);
    team->made = lay_out_plan(arena, k, places);
    team->polish = lay_out_polish(arena, k, limits, k + 1);
}

/* Assign every device to a step of one of the aircraft so that the most is earned. */
static void match_all(Plan *plan, const Team *team)
{
    const int64_t devices = team->problem->devices.count, steps = team->problem->limits.steps;
    const int64_t places = team->aircraft * steps;
    for (int64_t k = 0; k < devices; k++)
        for (int64_t p = 0; p < places; p++)
            team->worth[k * places + p] = worth(&team->problem[p / steps].devices, k, plan->way[p]);
    assign_steps(devices, places, team->worth, team->best, plan->assigned, &team->places);
    plan->value = 0.0;
    for (int64_t k = 0; k < devices; k++) {
        const int64_t p = plan->assigned[k];
        if (p >= 0 && team->worth[k * places + p] > 0.0)
            plan->value += team->worth[k * places + p];
        else
            plan->assigned[k] = -1;
    }
}

/* What each device brings to the others than aircraft `own`, or its price if that is more. */
static void rate_others(const Plan *plan, int64_t own, const Team *team)
{
    const int64_t steps = team->problem->limits.steps;
    for (int64_t k = 0; k < team->problem->devices.count; k++) {
        const int64_t p = plan->assigned[k];
        team->others[k] = cost_of(&team->problem->devices, k);
        if (p >= 0 && p / steps != own)
            team->others[k] = most(
                team->others[k], brings(&team->problem[p / steps].devices, k, plan->way[p]));
    }
}

/* The part of one aircraft, as a plan of its own. */
static Plan *own_part(const Plan *plan, int64_t own, Team *team)
{
    const int64_t steps = team->problem->limits.steps;
    Plan *part = &team->polish.present;
    memcpy(part->way, plan->way + own * steps, (size_t)steps * sizeof(Point));
    for (int64_t k = 0; k < team->problem->devices.count; k++) {
        const int64_t p = plan->assigned[k];
        part->assigned[k] = p >= 0 && p / steps == own ? p % steps : -1;
    }
    return part;
}

/* Climb with the chain of one aircraft; returns what it earns. */
static double climb_alone(Plan *plan, int64_t own, Team *team)
{
    const Problem *problem = team->problem + own;
    const int64_t steps = problem->limits.steps;
    Plan *part = own_part(plan, own, team);
    climb(part, &problem->devices, &problem->limits, team->mu + own, &team->polish);
    memcpy(plan->way + own * steps, part->way, (size_t)steps * sizeof(Point));
    return part->value;
}

/* Put its idle steps to use for those whom nobody serves well. */
static void use_idle(Plan *plan, int64_t own, Team *team)
{
    const Problem *problem = team->problem + own;
    const int64_t steps = problem->limits.steps;
    const Plan *part = own_part(plan, own, team);
    Devices devices = problem->devices;
    rate_others(plan, own, team);
    devices.price = team->others;
    use_idle_steps(&team->polish, &problem->limits, &devices);
    memcpy(plan->way + own * steps, part->way, (size_t)steps * sizeof(Point));
}

/* The best plan near the paths of `present`, which keep to their lengths, into `plan`: as `polish`. */
static void polish_team(Team *team, Plan *plan)
{
    Plan *present = &team->present;
    const int64_t devices = team->problem->devices.count;
    const int64_t places = team->aircraft * team->problem->limits.steps;
    double best = -1.0;
    memset(team->mu, 0, (size_t)team->aircraft * sizeof(double));
    for (int turn = 0; turn < MAX_ROUNDS; turn++) {
        match_all(present, team);
        if (present->value > best) copy_plan(present, plan, devices, places);
        if (present->value <= best * (1.0 + FINE)) {
            best = most(best, present->value);
            break;
        }
        best = present->value;
        double climbed = 0.0;
        for (int64_t a = 0; a < team->aircraft; a++) climbed += climb_alone(present, a, team);
        present->value = climbed;
        if (climbed > best) {
            best = climbed;
            copy_plan(present, plan, devices, places);
        }
        for (int64_t a = 0; a < team->aircraft; a++) use_idle(present, a, team);
    }
    plan->value = best;
}

#endif
