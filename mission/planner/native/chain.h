/* Polylines: length, nearest points, points merged and points added. */
#ifndef CHAIN_H
#define CHAIN_H

#include "arena.h"
#include "rewards.h"

/* Length of the polyline through `count` points. */
static double chain_length(const Point *way, int64_t count)
{
    double total = 0.0;
    for (int64_t n = 1; n < count; n++) total += between(way[n], way[n - 1]);
    return total;
}

/* Scale points about the origin so that their polyline fits `length`. */
static void shrink(Point *way, int64_t count, double length)
{
    double have = chain_length(way, count);
    if (have <= length) return;
    double scale = length / have;
    for (int64_t n = 1; n < count; n++) {
        way[n].x *= scale;
        way[n].y *= scale;
    }
}

/* Distance of a point from the polyline through `count` points. */
static double distance_to(Point p, const Point *way, int64_t count)
{
    double square = square_between(p, way[0]);
    for (int64_t n = 0; n + 1 < count; n++)
        square = least(square, square_between(p, foot_of(p, way[n], way[n + 1])));
    return sqrt(square);
}

/* Replace the closest pair of neighbours among `count` points by one (the start stays). */
static void merge_nearest(Point *way, int64_t count)
{
    int64_t pair = 1;
    double nearest = INFINITY;
    for (int64_t n = 1; n < count; n++) {
        double square = square_between(way[n], way[n - 1]);
        if (square < nearest) {
            pair = n;
            nearest = square;
        }
    }
    if (pair > 1) {
        way[pair - 1].x = 0.5 * (way[pair - 1].x + way[pair].x);
        way[pair - 1].y = 0.5 * (way[pair - 1].y + way[pair].y);
    }
    for (int64_t n = pair; n + 1 < count; n++) way[n] = way[n + 1];
}

/* Memory for putting spare points to use. */
typedef struct {
    double *have;     /* (K,) what each device brings at its nearest point, or its price if that is more */
    double *could;    /* (K,) and at the place of the path that is nearest */
    double *along;    /* (K,) that place: number of the point before it, and share of the leg */
    Point *point;     /* (K,) where it is */
    double *position; /* (N,) the points by the same measure */
    Point *points;    /* (N,) */
} Spare;

static Spare lay_out_spare(Arena *arena, int64_t devices, int64_t steps)
{
    return (Spare){
        .have = claim(arena, devices, sizeof(double)),
        .could = claim(arena, devices, sizeof(double)),
        .along = claim(arena, devices, sizeof(double)),
        .point = claim(arena, devices, sizeof(Point)),
        .position = claim(arena, steps, sizeof(double)),
        .points = claim(arena, steps, sizeof(Point)),
    };
}

/* What a device earns at the points there are, and could earn at the foot of its perpendiculars. */
static void rate_by_worth(
    int64_t k, const Point *way, int64_t count, const Devices *devices, const Spare *spare)
{
    spare->have[k] = cost_of(devices, k);
    spare->could[k] = 0.0;
    for (int64_t n = 0; n < count; n++) spare->have[k] = most(spare->have[k], brings(devices, k, way[n]));
    for (int64_t n = 0; n + 1 < count; n++) {
        const double share = share_before(devices->at[k], way[n], way[n + 1]);
        const Point there = between_at(way[n], way[n + 1], share);
        const double could = brings(devices, k, there);
        if (!(could > spare->could[k])) continue;
        spare->could[k] = could;
        spare->along[k] = (double)n + share;
        spare->point[k] = there;
    }
}

/* What each device earns at the points there are, and could earn at a point more. */
static void rate_spare(const Point *way, int64_t count, const Devices *devices, const Spare *spare)
{
    for (int64_t k = 0; k < devices->count; k++) {
        if (devices->grid) {
            rate_by_worth(k, way, count, devices, spare);
            continue;
        }
        double near = INFINITY, nearest = INFINITY;
        for (int64_t n = 0; n < count; n++) {
            near = least(near, square_between(devices->at[k], way[n]));
            if (n + 1 < count) {
                const double share = share_before(devices->at[k], way[n], way[n + 1]);
                const Point there = between_at(way[n], way[n + 1], share);
                double square = square_between(devices->at[k], there);
                if (square < nearest) {
                    nearest = square;
                    spare->along[k] = (double)n + share;
                    spare->point[k] = there;
                }
            }
        }
        spare->have[k] = most(devices->delta[k] * reward(sqrt(near), devices).f, cost_of(devices, k));
        spare->could[k] = spare->have[k];
        if (nearest < near)
            spare->could[k] = devices->delta[k] * reward(sqrt(nearest), devices).f;
    }
}

/* Put the spare points where the path passes devices that no point serves well yet.

   They lie on the path and leave its shape as it is. What cannot be used stays at the end. */
static void fill_spare(
    Point *way, int64_t count, int64_t steps, const Devices *devices, const Spare *spare)
{
    if (count >= steps) return;
    double *have = spare->have, *could = spare->could, *position = spare->position;
    Point *points = spare->points;
    rate_spare(way, count, devices, spare);
    for (int64_t n = 0; n < steps; n++) {
        position[n] = (double)(n < count ? n : steps); /* the last ones, until put to use */
        points[n] = way[fewer(n, count - 1)];
    }
    for (int64_t n = count; n < steps; n++) {
        int64_t best = -1;
        for (int64_t k = 0; k < devices->count; k++) {
            double gain = could[k] - have[k];
            if (gain > 1e-9 * devices->delta[k] && (best < 0 || gain > could[best] - have[best]))
                best = k;
        }
        if (best < 0) break;
        position[n] = spare->along[best];
        points[n] = spare->point[best];
        for (int64_t k = 0; k < devices->count; k++)
            have[k] = most(have[k], brings(devices, k, points[n]));
    }
    /* Insertion sort: all but the spare points are in order already. */
    for (int64_t n = 1; n < steps; n++) {
        double key = position[n];
        Point point = points[n];
        int64_t i = n;
        for (; i > 0 && position[i - 1] > key; i--) {
            position[i] = position[i - 1];
            points[i] = points[i - 1];
        }
        position[i] = key;
        points[i] = point;
    }
    memcpy(way, points, (size_t)steps * sizeof(Point));
}

#endif
