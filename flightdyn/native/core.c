/* The functions of one level. */

#include "control.h"
#include "error_state.h"
#include "guidance.h"
#include "landing.h"
#include "exported.h"
#include "strapdown.h"

static void pass_points(PathProfile *path, const Steering *steering, double *passed)
{
    foresee_path(path, steering, NULL, passed, NULL);
}

static void power(
    const Air *air, int64_t count, const double *speed, const double *accel, double *watts)
{
    for (int64_t i = 0; i < count; i++) watts[i] = power_at(speed[i], accel[i], air);
}

const Flight NAMED(flight) = {
    .integrate = integrate, .carry = carry, .transition = transition, .innovate = innovate,
    .reference = reference, .guide = guide, .land = land, .passed = passed, .cruise = cruise,
    .compute_trajectory = compute_trajectory, .pass_points = pass_points, .power = power,
    .read_gauges = read_gauges, .sample = sample, .drive = drive_tick};
