/* Where a flight through stops is at each instant, as it is foreseen. */
#ifndef FOLLOWING_H
#define FOLLOWING_H

#include "stops.h"

/* Where a run through stops is so many seconds after it has begun. */
static Point place_of_run(const Flying *flying, const Stop *run, int64_t count, double s, const Desk *desk)
{
    if (count == 1) return run->p;
    if (!flying->guided) {
        for (int64_t i = 1; i < count; i++) {
            const double leg = between(run[i - 1].p, run[i].p) / flying->speed;
            if (s < leg) return between_at(run[i - 1].p, run[i].p, s / leg);
            s -= leg;
        }
        return run[count - 1].p;
    }
    const double half = most(flying->steering.smoothing_s / 2.0, 1e-3);
    const Trajectory path = {.pieces = desk->run.pieces, .count = desk->run.piece_count};
    const double t = least(s / flying->pace, desk->passed[count - 1]) - flying->steering.smoothing_s / 2.0;
    double p[3], v[3], before[3], after[3];
    unsmoothed(&path, t - half, before, p, v);
    unsmoothed(&path, t + half, after, p, v);
    return (Point){(after[0] - before[0]) / (2.0 * half), (after[1] - before[1]) / (2.0 * half)};
}

/* Where the flight is every `step` seconds; where it ends it stays. */
static void follow_stops(
    const Flying *flying, double radius, double step, int64_t count, Point *at, Desk *desk)
{
    static const double STILL[3] = {0.0, 0.0, 0.0};
    const int64_t final = desk->stops - 1;
    double begun = 0.0; /* when the run begins */
    int64_t n = 0;
    for (int64_t first = 0, last = 0; last <= final; last++) {
        if (!(desk->at[last].hold > 0.0 || (last == final && final > 0))) continue;
        const Stop *run = desk->at + first;
        const int64_t stops = last - first + 1;
        if (flying->guided && stops > 1) {
            PathProfile *path = path_through(flying, radius, run, stops, desk);
            foresee_path(path, &flying->steering, NULL, desk->passed, NULL);
            compute_trajectory(path, &flying->steering, STILL, 0);
        }
        for (; n < count && (double)n * step < desk->at[last].left; n++)
            at[n] = place_of_run(flying, run, stops, (double)n * step - begun, desk);
        begun = desk->at[last].left;
        first = last;
    }
    for (; n < count; n++) at[n] = desk->at[final].p;
}

#endif
