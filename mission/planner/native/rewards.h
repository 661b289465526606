/* What devices earn at a distance, or at a place of a grid of success, and what an assignment of them
   to steps earns. */
#ifndef REWARDS_H
#define REWARDS_H

#include <math.h>
#include <string.h>

#include "planner.h"

static inline int64_t fewer(int64_t a, int64_t b) { return b < a ? b : a; }

static inline double between(Point a, Point b) { return sqrt(square_between(a, b)); }

typedef struct {
    double f, slope, bend;
} Reward;

/* f, f' and f'' at r >= 0 metres, expanded about the nearest row of the table. */
static inline Reward reward(double r, const Devices *devices)
{
    int64_t i = (int64_t)(r + 0.5);
    if (i >= devices->rows) return (Reward){0.0, 0.0, 0.0};
    const double *row = devices->table + 3 * i;
    double d = r - (double)i;
    return (Reward){row[0] + (row[1] + 0.5 * row[2] * d) * d, row[1] + row[2] * d, row[2]};
}

static inline double cost_of(const Devices *devices, int64_t k)
{
    return devices->price ? devices->price[k] : 0.0;
}

/* Success at a place, and how it grows a metre to the east and to the north. */
typedef struct {
    double f;
    Point slope;
} Spot;

static inline double within(double low, double value, double high)
{
    return value < low ? low : value > high ? high : value;
}

/* Numbers of columns and rows, with fractions. */
static inline Point on_grid(const Grid *grid, Point at)
{
    return (Point){
        within(0.0, (at.x - grid->first.x) / grid->cell, (double)(grid->columns - 1)),
        within(0.0, (at.y - grid->first.y) / grid->cell, (double)(grid->rows - 1))};
}

static inline Spot spot_at(const Grid *grid, int64_t k, Point at)
{
    const Point on = on_grid(grid, at);
    int64_t i = (int64_t)on.x, j = (int64_t)on.y;
    if (i > grid->columns - 2) i = grid->columns - 2;
    if (j > grid->rows - 2) j = grid->rows - 2;
    const double *south = grid->success + (k * grid->rows + j) * grid->columns + i;
    const double *north = south + grid->columns, u = on.x - (double)i, v = on.y - (double)j;
    const double low = south[0] + u * (south[1] - south[0]);
    const double high = north[0] + u * (north[1] - north[0]);
    const double east = (1.0 - v) * (south[1] - south[0]) + v * (north[1] - north[0]);
    return (Spot){low + v * (high - low), {east / grid->cell, (high - low) / grid->cell}};
}

/* What device k brings when it is served from a place, */
static inline double brings(const Devices *devices, int64_t k, Point from)
{
    if (devices->grid) return devices->delta[k] * spot_at(devices->grid, k, from).f;
    return devices->delta[k] * reward(between(from, devices->at[k]), devices).f;
}

/* and what is left of it once its price is paid. */
static inline double worth(const Devices *devices, int64_t k, Point from)
{
    return brings(devices, k, from) - cost_of(devices, k);
}

/* Metres that a stop takes beyond its leg, of that length at least; 0 where there may be none. */
static double stop_of(Stopping stop, double leg)
{
    if (!(leg > 0.0)) return 0.0;
    return stop.least + (leg < stop.brake ? 2.0 * sqrt(leg * stop.brake) - leg : stop.brake);
}

/* What the devices that are assigned to a step (-1: to none) earn in all. */
static double earned(const Point *way, const int64_t *assigned, const Devices *devices)
{
    double total = 0.0;
    for (int64_t k = 0; k < devices->count; k++)
        if (assigned[k] >= 0) total += worth(devices, k, way[assigned[k]]);
    return total;
}

#endif
