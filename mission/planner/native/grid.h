/* Success on a grid of places. */
#ifndef GRID_H
#define GRID_H

#include "planner.h"

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

#endif
