/* Squares of the plane, and what a stop somewhere in one of them can earn at most.

   For a device at u and a square of centre c, let r be the whole number of metres nearest to
   |c - u|, and n the direction from u to c. As |v - u| >= n.(v - u) and f falls,

       f(|v - u|) <= f(r) + f'(r) (n.(v - u) - r) + rise,

   where the rise is the most by which f exceeds its tangent at r within the square: of second order
   in its size. The best K_bar of such lines, each less a price, add up to a convex function, which
   is largest at a corner. Where the square is large, the constant of its nearest point is lower. */
#ifndef CELLS_H
#define CELLS_H

#include "arena.h"
#include "rewards.h"

enum { SIZES = 12 };                   /* of squares that have tangents */
static const double LARGEST_HALF = 32.0; /* metres: half the side of the first of them */

/* One number for each corner: west or east (odd numbers), south or north (from 2 on). */
typedef double Corners __attribute__((vector_size(32)));
typedef int64_t CornerMask __attribute__((vector_size(32)));
static const Corners EAST = {-1.0, 1.0, -1.0, 1.0}, NORTH = {-1.0, -1.0, 1.0, 1.0};

typedef struct {
    double x, y, half; /* centre, half the side, metres */
    int64_t children;  /* number of the first of four in a row; 0 if it has none yet */
    int64_t rated;     /* turn in which `best` was worked out */
    Corners best;      /* what a stop at each corner can earn at most, less prices */
} Cell;

typedef struct {
    Devices devices;
    int64_t per_step;
    Cell *cell;   /* (most,) */
    Corners *reward; /* (most, K) bound of what a device brings at the corners */
    int64_t count, most;
    int64_t turn;
    double *upper; /* (rows,) bound of f from there on */
    double *rise;  /* (SIZES, rows) */
    Corners *top;  /* (K_bar,) */
} Cells;

static Cells lay_out_cells(Arena *arena, const Devices *devices, const Limits *limits, int64_t most)
{
    return (Cells){
        .devices = *devices,
        .per_step = fewer(limits->per_step, devices->count),
        .cell = claim(arena, most, sizeof(Cell)),
        .reward = claim(arena, most * devices->count, sizeof(Corners)),
        .most = most,
        .upper = claim(arena, devices->rows, sizeof(double)),
        .rise = claim(arena, SIZES * devices->rows, sizeof(double)),
        .top = claim(arena, fewer(limits->per_step, devices->count), sizeof(Corners)),
    };
}

/* What f may exceed the line between its samples by, twice for safety. */
static double between_samples(const double *row) { return 0.25 * fabs(row[2]); }

static double falling(const double *row) { return least(row[1], 0.0); }

/* Bounds of f from each row on, and its rises over its tangents there. */
static void fill_rises(const Cells *cells)
{
    const double *table = cells->devices.table;
    const int64_t rows = cells->devices.rows;
    double above = 0.0;
    for (int64_t i = rows - 1; i >= 0; i--) {
        above = most(above, table[3 * i] + between_samples(table + 3 * i));
        cells->upper[i] = above;
    }
    for (int64_t i = 0; i < rows; i++) {
        const double f = table[3 * i], slope = falling(table + 3 * i);
        double rise = 0.0;
        int64_t reach = -1;
        for (int size = SIZES - 1; size >= 0; size--) {
            const double half = LARGEST_HALF / (double)(1 << size);
            const int64_t wanted = (int64_t)(1.4142136 * half + 0.5) + 1;
            while (reach < wanted) {
                reach++;
                for (int side = -1; side <= 1; side += 2) {
                    const int64_t j = i + side * reach;
                    if (j < 0 || j >= rows) continue;
                    const double *row = table + 3 * j;
                    rise = most(
                        rise, row[0] + between_samples(row) - f - slope * (double)(j - i));
                }
            }
            cells->rise[size * rows + i] = rise;
        }
    }
}

/* Bound of f at all distances of at least r. */
static double upper_from(const Cells *cells, double r)
{
    const int64_t last = cells->devices.rows - 1, i = (int64_t)most(r, 0.0);
    if (i >= last) return cells->upper[last];
    const double t = most(r, 0.0) - (double)i;
    return cells->upper[i] + t * (cells->upper[i + 1] - cells->upper[i]);
}

/* The smallest size of squares with tangents that is not under this one. */
static int size_of(double half)
{
    int size = 0;
    while (size < SIZES - 1 && half <= LARGEST_HALF / (double)(2 << size)) size++;
    return size;
}

/* Bounds of what device k brings at the corners of a square of that size, linear in between. */
static inline Corners reward_at_corners(
    const Cells *cells, int64_t k, Point middle, double half, int size)
{
    const Point u = cells->devices.at[k];
    const double r = between(middle, u), delta = cells->devices.delta[k];
    const double nearest = delta * upper_from(cells, r - 1.4142136 * half);
    const int64_t rows = cells->devices.rows, i = (int64_t)(r + 0.5);
    if (half > LARGEST_HALF || i >= rows) return nearest - (Corners){0.0};
    const double *row = cells->devices.table + 3 * i;
    const double slope = falling(row);
    const double here = row[0] + slope * (r - (double)i) + cells->rise[size * rows + i];
    const double step = r > 1e-9 ? delta * slope * half / r : 0.0;
    const double east = step * (middle.x - u.x), north = step * (middle.y - u.y);
    if (delta * here + fabs(east) + fabs(north) < nearest)
        return delta * here + east * EAST + north * NORTH;
    return nearest - (Corners){0.0};
}

/* A new square; its number. There must be room. */
static int64_t add_cell(Cells *cells, double x, double y, double half)
{
    const int64_t devices = cells->devices.count, number = cells->count++;
    const int size = size_of(half);
    Corners *reward = cells->reward + devices * number;
    for (int64_t k = 0; k < devices; k++)
        reward[k] = reward_at_corners(cells, k, (Point){x, y}, half, size);
    cells->cell[number] = (Cell){.x = x, .y = y, .half = half, .rated = -1};
    return number;
}

/* The first of the four quarters of a square; -1 if there is no room for them. */
static int64_t quarters(Cells *cells, int64_t number)
{
    const Cell whole = cells->cell[number];
    if (whole.children) return whole.children;
    if (cells->count + 4 > cells->most) return -1;
    const double half = 0.5 * whole.half;
    for (int i = 0; i < 4; i++) {
        const int64_t child = add_cell(
            cells, whole.x + (i & 1 ? half : -half), whole.y + (i & 2 ? half : -half), half);
        if (i == 0) cells->cell[number].children = child;
    }
    return cells->cell[number].children;
}

/* Least (side -1) or largest (1) distance of a square from the start. */
static double from_start(Point middle, double half, double side)
{
    const double x = most(0.0, fabs(middle.x) + side * half);
    const double y = most(0.0, fabs(middle.y) + side * half);
    return sqrt(x * x + y * y);
}

static Point corner_of(const Cell *cell, int corner)
{
    return (Point){cell->x + cell->half * EAST[corner], cell->y + cell->half * NORTH[corner]};
}

/* Put numbers among the largest seen for each corner, which `top` holds from the largest down. */
static inline void keep_largest(Corners *top, int64_t places, Corners value)
{
    const CornerMask any = (CornerMask)(value > top[places - 1]);
    if (!(any[0] | any[1] | any[2] | any[3])) return; /* as most often */
    for (int64_t i = 0; i < places; i++) {
        const CornerMask more = (CornerMask)(value > top[i]);
        const Corners larger = (Corners)((more & (CornerMask)value) | (~more & (CornerMask)top[i]));
        value = (Corners)((~more & (CornerMask)value) | (more & (CornerMask)top[i]));
        top[i] = larger;
    }
}

static Corners sum_of_largest(const Cells *cells)
{
    Corners total = {0.0};
    for (int64_t i = 0; i < cells->per_step; i++) total += cells->top[i];
    return total;
}

/* What a stop at the corners of a square can earn at most, less prices. */
static Corners rated(Cells *cells, int64_t number, const double *price)
{
    Cell *cell = cells->cell + number;
    if (cell->rated != cells->turn) {
        const Corners *reward = cells->reward + cells->devices.count * number;
        cell->rated = cells->turn;
        memset(cells->top, 0, (size_t)cells->per_step * sizeof(Corners));
        for (int64_t k = 0; k < cells->devices.count; k++)
            keep_largest(cells->top, cells->per_step, reward[k] - price[k]);
        cell->best = sum_of_largest(cells);
    }
    return cell->best;
}

/* The same for one place, from what it earns with each device. */
static double rated_place(Cells *cells, const double *earned, const double *price)
{
    memset(cells->top, 0, (size_t)cells->per_step * sizeof(Corners));
    for (int64_t k = 0; k < cells->devices.count; k++)
        keep_largest(cells->top, cells->per_step, (earned[k] - price[k]) - (Corners){0.0});
    return sum_of_largest(cells)[0];
}

#endif
