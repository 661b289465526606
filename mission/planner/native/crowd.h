/* Potentials of more devices than are searched, on three or four meshes: what `descent.h` does, for
   eight devices at a time.

   Eight neighbours make a block, which has values in the tiles (cells of the first mesh) around them
   only. All blocks of a vertex lie side by side, so that only triangles need be visited in which h
   is near mu: on the finer meshes, these are few. The maxima are made smooth by (1 + x / 16)^16 in
   place of e^x, which is 0 from -16 on. */
#ifndef CROWD_H
#define CROWD_H

#include "descent.h"

enum {
    EIGHT = 8,
    CROWD_MESHES = 4, /* at most, and */
    FEWEST_MESHES = 3,
    MOST_CROWD_VALUES = 5000000, /* of all devices on the last mesh: fewer meshes do */
    CROWD_AXES = 16,
    GROUP = 8,    /* of them, worked out together */
    REFRESH = 4,  /* turns from one that visits all triangles to the next */
    SOFT = 16,
    TRIANGLE = 3, /* its vertices */
};
static const double PI = 3.141592653589793;
static const double CROWD_SPACINGS = 1.5; /* mean distances of devices, around a block's devices */
static const double VISITED = 1.25;       /* margin on h, of what takes part in the maximum */
static const double LOW_HEAT_IN_CROWD = 0.02; /* of the least psi */
static const double CROWD_VALUE_TURNS = 3e8;  /* values by turns, at most */
static const double MANY_HEARD = 30.0; /* devices at a place: more take smaller steps each */
static const double CROWD_BEGINS[CROWD_MESHES] = {0.0, 0.25, 0.6, 0.9}; /* of meshes, in turns */
static const Course CROWD = {0.03, 4e-4, {1.0, 0.5, 0.2, 0.1}, 0.002, 0};

/* Numbers of eight devices. They are summed in the same order on every machine. */
typedef double Eight __attribute__((vector_size(8 * EIGHT)));
typedef int64_t EightBits __attribute__((vector_size(8 * EIGHT)));

static inline Eight eight(double a) { return a - (Eight){0.0}; }

static inline double sum_of_eight(Eight a)
{
    double sum = 0.0;
    for (int i = 0; i < EIGHT; i++) sum += a[i];
    return sum;
}

static inline Eight absolute(Eight a)
{
    return (Eight)((EightBits)a & (INT64_MAX - (EightBits){0}));
}

static inline Eight with_signs(double size, Eight of)
{
    return (Eight)((EightBits)eight(size) | ((EightBits)of & (INT64_MIN - (EightBits){0})));
}

/* a where it is above 0 and at most b; else the nearer of these. */
static inline Eight between_zero_and(Eight a, Eight b)
{
    a = (Eight)((EightBits)(a > 0.0) & (EightBits)a);
    const EightBits over = (EightBits)(a > b);
    return (Eight)((over & (EightBits)b) | (~over & (EightBits)a));
}

static inline Eight soft_eight(Eight x)
{
    Eight y = 1.0 + x * (1.0 / SOFT);
    y = (Eight)((EightBits)(y > 0.0) & (EightBits)y);
    y *= y;
    y *= y;
    y *= y;
    return y * y;
}

static inline double soft(double x)
{
    double y = most(0.0, 1.0 + x * (1.0 / SOFT));
    y *= y;
    y *= y;
    y *= y;
    return y * y;
}

/* Blocks with values at a place. */
typedef struct {
    int64_t count;
    const int32_t *block;
} Blocks;

typedef struct {
    Cells cells;
    Limits limits;
    Mesh mesh;
    int meshes, level;    /* how many; the present one, from 0 on */
    int64_t blocks;       /* of all devices; the last is filled up */
    int64_t tiles_across; /* twice the tiles a row and 1: tiles, and what lies between them */
    int64_t *first_block; /* (places between and in tiles + 1,) */
    int32_t *block;
    int32_t *every; /* (blocks,) */
    Eight *phi, *mean, *square, *gradient;         /* (vertices, blocks) */
    double *chi, *chi_mean, *chi_square, *chi_gradient; /* (vertices,) */
    double *psi, *low;                             /* (vertices,) as in a descent */
    Eight *highest;                                /* (blocks,) what devices are worth */
    double nu, nu_mean, nu_square, least_nu, unit;
    double *slopes, *lean; /* (cells, SHAPES, CROWD_AXES) */
    double *steep;         /* (cells,) the largest h */
    int64_t *visited, visits; /* (cells,) those that may take part in the maximum */
    Directions coarse, fine;
    Sample *sample;
    int64_t *first_sample; /* (K + 1,) */
    double *value;         /* of a device's samples */
} Crowd;

/* Where a triangle of a shape has its vertices, from the south-west of a cell on: its sides are from
   the first to the second, and from that to the third. */
static inline void corners_of(const Mesh *mesh, int64_t cell, int shape, int64_t *corner)
{
    corner[0] = cell;
    corner[1] = shape == 0 ? cell + 1 : cell + mesh->across;
    corner[2] = cell + mesh->across + 1;
}

static Mesh crowd_mesh(const Devices *devices, const Limits *limits, int meshes)
{
    const Mesh first = mesh_of(devices, limits->length);
    return finest_mesh(&first, meshes);
}

static int64_t blocks_of(const Devices *devices) { return (devices->count + EIGHT - 1) / EIGHT; }

/* As many meshes as there is memory for; 0 where these are too few. */
static int crowd_meshes(const Devices *devices, const Limits *limits)
{
    int meshes = CROWD_MESHES;
    while (meshes >= FEWEST_MESHES && crowd_mesh(devices, limits, meshes).vertices *
                                              blocks_of(devices) * EIGHT > MOST_CROWD_VALUES)
        meshes--;
    return meshes < FEWEST_MESHES ? 0 : meshes;
}

static int64_t places_of(const Mesh *first)
{
    return (2 * first->across - 1) * (2 * first->up - 1);
}

static Crowd lay_out_crowd(
    Arena *arena, const Devices *devices, const Limits *limits, int meshes, int64_t samples)
{
    const Mesh first = mesh_of(devices, limits->length), last = finest_mesh(&first, meshes);
    const int64_t v = last.vertices, cells = cells_of(&last), blocks = blocks_of(devices);
    const int64_t slopes = cells * SHAPES * CROWD_AXES;
    return (Crowd){
        .cells = lay_out_cells(arena, devices, limits, 0),
        .limits = *limits,
        .mesh = first,
        .meshes = meshes,
        .blocks = blocks,
        .tiles_across = 2 * first.across - 1,
        .first_block = claim(arena, places_of(&first) + 1, sizeof(int64_t)),
        .block = claim(arena, places_of(&first) * blocks, sizeof(int32_t)),
        .every = claim(arena, blocks, sizeof(int32_t)),
        .phi = claim(arena, v * blocks, sizeof(Eight)),
        .mean = claim(arena, v * blocks, sizeof(Eight)),
        .square = claim(arena, v * blocks, sizeof(Eight)),
        .gradient = claim(arena, v * blocks, sizeof(Eight)),
        .chi = claim(arena, v, sizeof(double)),
        .chi_mean = claim(arena, v, sizeof(double)),
        .chi_square = claim(arena, v, sizeof(double)),
        .chi_gradient = claim(arena, v, sizeof(double)),
        .psi = claim(arena, v, sizeof(double)),
        .low = claim(arena, v, sizeof(double)),
        .highest = claim(arena, blocks, sizeof(Eight)),
        .slopes = claim(arena, slopes, sizeof(double)),
        .lean = claim(arena, slopes, sizeof(double)),
        .steep = claim(arena, cells, sizeof(double)),
        .visited = claim(arena, cells, sizeof(int64_t)),
        .coarse = directions(AXES),
        .fine = directions(FINE_AXES),
        .sample = claim(arena, samples, sizeof(Sample)),
        .first_sample = claim(arena, devices->count + 1, sizeof(int64_t)),
        .value = claim(arena, most_samples(&last), sizeof(double)),
    };
}

/* Sort devices by strips, so that eight in a row are neighbours. */
static void sort_by_place(int64_t count, Point *at, double *delta)
{
    Point low = at[0], high = at[0];
    for (int64_t k = 1; k < count; k++) {
        low.x = least(low.x, at[k].x);
        high.x = most(high.x, at[k].x);
    }
    const double strips = floor(sqrt((double)count / EIGHT)) + 1.0;
    const double width = most(high.x - low.x, 1e-9) / strips;
    for (int64_t i = 1; i < count; i++) {
        const Point point = at[i];
        const double strip = floor((point.x - low.x) / width), worth = delta[i];
        int64_t j = i;
        for (; j > 0; j--) {
            const double other = floor((at[j - 1].x - low.x) / width);
            if (other < strip || (other == strip && at[j - 1].y <= point.y)) break;
            at[j] = at[j - 1];
            delta[j] = delta[j - 1];
        }
        at[j] = point;
        delta[j] = worth;
    }
}

/* Whether a block has values within a tile. */
static int is_near(const Crowd *all, int64_t block, int64_t column, int64_t row, double radius)
{
    const Devices *devices = &all->cells.devices;
    const double half = 0.5 * all->mesh.side;
    const Point middle = {
        all->mesh.low.x + half * (double)(2 * column + 1),
        all->mesh.low.y + half * (double)(2 * row + 1)};
    for (int64_t k = block * EIGHT; k < fewer((block + 1) * EIGHT, devices->count); k++) {
        const Point u = devices->at[k];
        if (fabs(u.x - middle.x) < radius + half && fabs(u.y - middle.y) < radius + half) return 1;
    }
    return 0;
}

/* List the blocks of every tile; what lies between tiles has the blocks of all of them. */
static void list_blocks(Crowd *all, double radius)
{
    const int64_t across = all->mesh.across - 1, up = all->mesh.up - 1;
    int64_t count = 0, place = 0;
    for (int64_t j = 0; j < 2 * up + 1; j++)
        for (int64_t i = 0; i < 2 * across + 1; i++) {
            all->first_block[place++] = count;
            const int64_t west = i > 0 ? (i - 1) / 2 : 0, east = fewer(i / 2, across - 1);
            const int64_t south = j > 0 ? (j - 1) / 2 : 0, north = fewer(j / 2, up - 1);
            for (int64_t b = 0; b < all->blocks; b++)
                if (is_near(all, b, west, south, radius) && is_near(all, b, east, south, radius) &&
                    is_near(all, b, west, north, radius) && is_near(all, b, east, north, radius))
                    all->block[count++] = (int32_t)b;
        }
    all->first_block[place] = count;
    for (int64_t b = 0; b < all->blocks; b++) all->every[b] = (int32_t)b;
}

static inline Blocks blocks_at(const Crowd *all, int64_t x, int64_t y)
{
    const int64_t place = y * all->tiles_across + x, first = all->first_block[place];
    return (Blocks){all->first_block[place + 1] - first, all->block + first};
}

static inline Blocks blocks_in_cell(const Crowd *all, int64_t cell)
{
    const int64_t across = all->mesh.across;
    return blocks_at(
        all, 2 * (cell % across >> all->level) + 1, 2 * (cell / across >> all->level) + 1);
}

static inline Blocks blocks_at_vertex(const Crowd *all, int64_t v)
{
    const int64_t x = v % all->mesh.across, y = v / all->mesh.across;
    const int64_t within = ((int64_t)1 << all->level) - 1;
    return blocks_at(
        all, 2 * (x >> all->level) + ((x & within) != 0), 2 * (y >> all->level) + ((y & within) != 0));
}

static inline Eight *eights_at(const Crowd *all, Eight *of, int64_t vertex)
{
    return of + vertex * all->blocks;
}

/* Rises of the potentials of a block along the two sides of a triangle. */
typedef struct {
    Eight first, second;
} Rises;

static inline Rises rises_over(const Crowd *all, const int64_t *corner, int32_t block)
{
    const Eight middle = eights_at(all, all->phi, corner[1])[block];
    return (Rises){
        middle - eights_at(all, all->phi, corner[0])[block],
        eights_at(all, all->phi, corner[2])[block] - middle};
}

/* The parts of a direction along the two sides of a triangle. */
static inline Point sides_of(Point way, int shape)
{
    return shape == 0 ? way : (Point){way.y, way.x};
}

/* h of a triangle along all axes, by the side of a cell: `slopes`, half the sums over devices, and
   `lean`, what chi adds one way and takes the other. Returns the largest. */
static double work_out_triangle(
    const Crowd *all, int64_t cell, int shape, Blocks near, const Directions *ways, double *slopes,
    double *lean)
{
    int64_t corner[TRIANGLE];
    double highest = 0.0;
    corners_of(&all->mesh, cell, shape, corner);
    const double first = all->chi[corner[1]] - all->chi[corner[0]];
    const double second = all->chi[corner[2]] - all->chi[corner[1]];
    for (int from = 0; from < ways->count; from += GROUP) {
        Eight sum[GROUP] = {0};
        Point way[GROUP];
        for (int i = 0; i < GROUP; i++) way[i] = sides_of(ways->towards[from + i], shape);
        for (int64_t b = 0; b < near.count; b++) {
            const Rises rises = rises_over(all, corner, near.block[b]);
            for (int i = 0; i < GROUP; i++)
                sum[i] += absolute(way[i].x * rises.first + way[i].y * rises.second);
        }
        for (int i = 0; i < GROUP; i++) {
            slopes[from + i] = 0.5 * sum_of_eight(sum[i]);
            lean[from + i] = way[i].x * first + way[i].y * second;
            highest = most(highest, slopes[from + i] + fabs(lean[from + i]));
        }
    }
    return highest;
}

/* The same of both triangles of a cell, into all slopes. */
static double work_out_cell(Crowd *all, int64_t cell)
{
    const Blocks near = blocks_in_cell(all, cell);
    double highest = 0.0;
    for (int shape = 0; shape < SHAPES; shape++) {
        const int64_t at = (cell * SHAPES + shape) * CROWD_AXES;
        highest = most(highest, work_out_triangle(
            all, cell, shape, near, &all->coarse, all->slopes + at, all->lean + at));
    }
    return highest;
}

static double half_sum_at(const Crowd *all, int64_t v, Blocks near)
{
    const Eight *phi = eights_at(all, all->phi, v);
    Eight sum = {0};
    for (int64_t b = 0; b < near.count; b++) sum += phi[near.block[b]];
    return 0.5 * sum_of_eight(sum);
}

/* Bound of the most that device k earns beyond its potential and the price, anywhere. */
static double most_beyond_in_crowd(const Crowd *all, int64_t k)
{
    const Devices *devices = &all->cells.devices;
    const int64_t wide = all->blocks * EIGHT;
    const double *phi = (const double *)all->phi + k;
    double local[4];
    Peak peak = {local, k, all->nu, all->nu, CLOSE * devices->delta[k] * all->cells.upper[0]};
    for (int64_t v = 0; v < all->mesh.vertices; v++)
        peak.reached =
            most(peak.reached, worth(devices, k, vertex_at(&all->mesh, v)) - phi[v * wide]);
    for (int64_t i = 0; i < cells_of(&all->mesh); i++) {
        if (!is_cell(&all->mesh, i)) continue;
        const Mesh alone = {2, 2, 4, -1, all->mesh.side, vertex_at(&all->mesh, i)};
        for (int c = 0; c < 4; c++) local[c] = phi[(i + c % 2 + c / 2 * all->mesh.across) * wide];
        look_into(
            &all->cells, &alone, all->limits.length, (Part){0, 0.0, 0.0, 1.0}, DEEP, &peak);
    }
    return peak.bound - all->nu;
}

/* The bound of the present potentials, wherever blocks have values; where they are no numbers, there
   is none. */
static double bound_by_crowd(const Crowd *all)
{
    const Blocks every = {all->blocks, all->every};
    double slopes[FINE_AXES], lean[FINE_AXES], steepest = 0.0, lowest = 0.0, zero = 0.0;
    for (int64_t i = 0; i < cells_of(&all->mesh); i++)
        for (int shape = 0; shape < SHAPES && is_cell(&all->mesh, i); shape++)
            steepest =
                most(steepest, work_out_triangle(all, i, shape, every, &all->fine, slopes, lean));
    for (int64_t v = 0; v < all->mesh.vertices; v++) {
        const double psi = all->chi[v] - half_sum_at(all, v, every);
        lowest = least(lowest, psi);
        zero += 0.0 * psi; /* comparing would pass a NaN */
    }
    double bound = steepest * all->limits.length / all->mesh.side - lowest +
                   all->nu * (double)(all->limits.steps * all->limits.per_step);
    for (int64_t k = 0; k < all->cells.devices.count; k++) bound += most_beyond_in_crowd(all, k);
    return isfinite(bound + zero) ? bound : INFINITY;
}

/* List where devices are looked at; returns how many places. They are written from `into` on. */
static int64_t sample_device(
    const Devices *devices, const Mesh *mesh, double length, int64_t k, Sample *into)
{
    const Window window = window_of(mesh, devices->at[k], (double)devices->rows);
    const int64_t count = list_samples(devices, &window.mesh, length, k, into);
    for (int64_t i = 0; into && i < count; i++)
        for (int c = 0; c < TRIANGLE; c++) {
            const int64_t v = into[i].vertex[c], across = window.mesh.across;
            into[i].vertex[c] = (int32_t)(window.corner + v / across * mesh->across + v % across);
        }
    return count;
}

/* The samples of any of the meshes that there has to be room for. */
static int64_t count_crowd_samples(const Devices *devices, const Limits *limits, int meshes)
{
    int64_t most_count = 0;
    for (int i = 1; i <= meshes; i++) {
        const Mesh mesh = crowd_mesh(devices, limits, i);
        int64_t count = 0;
        for (int64_t k = 0; k < devices->count; k++)
            count += sample_device(devices, &mesh, limits->length, k, NULL);
        if (count > most_count) most_count = count;
    }
    return most_count;
}

static void sample_crowd(Crowd *all)
{
    const Devices *devices = &all->cells.devices;
    for (int64_t k = 0; k < devices->count; k++)
        all->first_sample[k + 1] = all->first_sample[k] + sample_device(
            devices, &all->mesh, all->limits.length, k, all->sample + all->first_sample[k]);
}

/* Potentials to begin with: a part of what devices earn beyond the start and the price. */
static void begin_crowd(Crowd *all, double price, double value)
{
    const Devices *devices = &all->cells.devices;
    double steepest = 0.0;
    all->nu = most(price, all->least_nu);
    for (int64_t v = 0; v < all->mesh.vertices; v++) {
        const Blocks near = blocks_at_vertex(all, v);
        for (int64_t b = 0; v != all->mesh.start && b < near.count; b++) {
            const int64_t block = near.block[b], first = block * EIGHT;
            Eight *phi = eights_at(all, all->phi, v) + block;
            for (int64_t k = first; k < fewer(first + EIGHT, devices->count); k++)
                (*phi)[k - first] = most(
                    0.0, worth(devices, k, vertex_at(&all->mesh, v)) -
                             most(all->nu, worth(devices, k, (Point){0.0, 0.0})));
        }
    }
    for (int64_t i = 0; i < cells_of(&all->mesh); i++)
        if (is_cell(&all->mesh, i)) steepest = most(steepest, work_out_cell(all, i));
    const double have = steepest * all->limits.length / all->mesh.side;
    const double share = least(1.0, value / most(have, 1e-300));
    for (int64_t i = 0; i < all->mesh.vertices * all->blocks; i++) all->phi[i] *= share;
}

/* Go on with the same potentials on the finer mesh. */
static void refine_crowd(Crowd *all)
{
    const Mesh coarse = all->mesh;
    const size_t size = (size_t)(coarse.vertices * all->blocks) * sizeof(Eight);
    memcpy(all->gradient, all->phi, size);
    memset(all->phi, 0, size);
    memcpy(all->chi_gradient, all->chi, (size_t)coarse.vertices * sizeof(double));
    refine_function(&coarse, all->chi_gradient, all->chi);
    all->mesh = finer_mesh(&coarse);
    all->level++;
    for (int64_t v = 0; v < all->mesh.vertices; v++) {
        const int64_t x = v % all->mesh.across, y = v / all->mesh.across;
        const int64_t one = y / 2 * coarse.across + x / 2;
        const int64_t other = one + (y & 1) * coarse.across + (x & 1);
        const Blocks near = blocks_at_vertex(all, v);
        for (int64_t b = 0; b < near.count; b++) {
            const int32_t block = near.block[b];
            eights_at(all, all->phi, v)[block] =
                0.5 * (eights_at(all, all->gradient, one)[block] +
                       eights_at(all, all->gradient, other)[block]);
            eights_at(all, all->mean, v)[block] = eights_at(all, all->square, v)[block] = eight(0.0);
        }
        all->chi_mean[v] = all->chi_square[v] = 0.0;
    }
    all->nu_mean = all->nu_square = 0.0;
    if (all->level == 2) all->coarse = directions(CROWD_AXES);
    sample_crowd(all);
}

/* Work out h where it may be near mu, or in all cells; returns mu. */
static double work_out_visited(Crowd *all, int everywhere, double heat)
{
    const int64_t cells = cells_of(&all->mesh);
    double steepest = 1e-9 * all->unit;
    if (everywhere) {
        all->visits = 0;
        for (int64_t i = 0; i < cells; i++)
            if (is_cell(&all->mesh, i)) all->visited[all->visits++] = i;
    }
    for (int64_t j = 0; j < all->visits; j++) {
        const int64_t i = all->visited[j];
        all->steep[i] = work_out_cell(all, i);
        steepest = most(steepest, all->steep[i]);
    }
    if (everywhere) {
        const double enough = steepest * (1.0 - VISITED * SOFT * heat);
        int64_t kept = 0;
        for (int64_t j = 0; j < all->visits; j++)
            if (all->steep[all->visited[j]] > enough) all->visited[kept++] = all->visited[j];
        all->visits = kept;
    }
    return steepest;
}

/* Turn h into the slopes of its smooth maximum: `slopes` by |grad phi . t|, `lean` by grad chi . t.
   Returns their sum. */
static double soften_visited(Crowd *all, double steepest, double heat)
{
    const double scale = 1.0 / (heat * steepest);
    Eight total = {0};
    for (int64_t j = 0; j < all->visits; j++) {
        const int64_t at = all->visited[j] * SHAPES * CROWD_AXES;
        for (int shape = 0; shape < SHAPES; shape++)
            for (int i = 0; i < all->coarse.count; i += EIGHT) {
                Eight *slopes = (Eight *)(all->slopes + at + shape * CROWD_AXES + i);
                Eight *lean = (Eight *)(all->lean + at + shape * CROWD_AXES + i);
                const Eight with = soft_eight((*slopes + *lean - steepest) * scale);
                const Eight against = soft_eight((*slopes - *lean - steepest) * scale);
                *slopes = with + against;
                *lean = with - against;
                total += *slopes;
            }
    }
    return sum_of_eight(total);
}

/* Add the slopes of the smooth mu L by the values at a triangle's vertices, `scale` times. */
static void add_slopes_of_triangle(Crowd *all, int64_t cell, int shape, double scale)
{
    const int64_t at = (cell * SHAPES + shape) * CROWD_AXES;
    const double *slopes = all->slopes + at, *lean = all->lean + at;
    const Blocks near = blocks_in_cell(all, cell);
    int64_t corner[TRIANGLE], count = 0;
    Point way[CROWD_AXES];
    double weight[CROWD_AXES], first = 0.0, second = 0.0;
    corners_of(&all->mesh, cell, shape, corner);
    for (int i = 0; i < all->coarse.count; i++)
        if (slopes[i] > 0.0) {
            way[count] = sides_of(all->coarse.towards[i], shape);
            first += scale * lean[i] * way[count].x;
            second += scale * lean[i] * way[count].y;
            weight[count++] = 0.5 * scale * slopes[i];
        }
    if (count == 0) return;
    all->chi_gradient[corner[0]] -= first;
    all->chi_gradient[corner[1]] += first - second;
    all->chi_gradient[corner[2]] += second;
    Eight *a = eights_at(all, all->gradient, corner[0]);
    Eight *b = eights_at(all, all->gradient, corner[1]);
    Eight *c = eights_at(all, all->gradient, corner[2]);
    for (int64_t j = 0; j < near.count; j++) {
        const int32_t block = near.block[j];
        const Rises rises = rises_over(all, corner, block);
        Eight by_first = {0}, by_second = {0};
        for (int64_t i = 0; i < count; i++) {
            const Eight share =
                with_signs(weight[i], way[i].x * rises.first + way[i].y * rises.second);
            by_first += share * way[i].x;
            by_second += share * way[i].y;
        }
        a[block] -= by_first;
        b[block] += by_first - by_second;
        c[block] += by_second;
    }
}

/* Begin all slopes with those of the smooth minimum of psi. */
static void begin_slopes(Crowd *all)
{
    const int64_t v = all->mesh.vertices;
    const double heat = 1.0 / (LOW_HEAT_IN_CROWD * all->unit);
    double lowest = 0.0, total = 0.0;
    for (int64_t i = 0; i < v; i++) {
        all->psi[i] = all->chi[i] - half_sum_at(all, i, blocks_at_vertex(all, i));
        lowest = least(lowest, all->psi[i]);
    }
    for (int64_t i = 0; i < v; i++) {
        all->low[i] = soft((lowest - all->psi[i]) * heat);
        total += all->low[i];
    }
    for (int64_t i = 0; i < v; i++) {
        const Blocks near = blocks_at_vertex(all, i);
        const double share = all->low[i] / most(total, 1e-300);
        for (int64_t b = 0; b < near.count; b++)
            eights_at(all, all->gradient, i)[near.block[b]] = eight(0.5 * share);
        all->chi_gradient[i] = -share;
    }
}

/* Add the slopes of the smooth peak of a device; returns the share that is served. */
static double add_slopes_of_peak(Crowd *all, int64_t k)
{
    const Sample *sample = all->sample + all->first_sample[k];
    const int64_t count = all->first_sample[k + 1] - all->first_sample[k];
    const int64_t wide = all->blocks * EIGHT;
    const double *phi = (const double *)all->phi + k;
    double *gradient = (double *)all->gradient + k;
    const double heat = 1.0 / (PEAK_HEAT * all->unit);
    double highest = all->nu;
    for (int64_t i = 0; i < count; i++) {
        double value = sample[i].reward;
        for (int c = 0; c < TRIANGLE; c++)
            value -= sample[i].share[c] * phi[sample[i].vertex[c] * wide];
        all->value[i] = value;
        highest = most(highest, value);
    }
    const double unserved = soft((all->nu - highest) * heat);
    double total = unserved;
    for (int64_t i = 0; i < count; i++) {
        all->value[i] = soft((all->value[i] - highest) * heat);
        total += all->value[i];
    }
    for (int64_t i = 0; i < count; i++)
        if (all->value[i] > 0.0)
            for (int c = 0; c < TRIANGLE; c++)
                gradient[sample[i].vertex[c] * wide] -=
                    all->value[i] / total * sample[i].share[c];
    return 1.0 - unserved / total;
}

/* One step of all potentials down their slopes. */
static void step_crowd(Crowd *all, Pace pace)
{
    const double rate = all->unit * pace.rate / pace.mean_past;
    for (int64_t v = 0; v < all->mesh.vertices; v++) {
        if (v == all->mesh.start) continue;
        const Blocks near = blocks_at_vertex(all, v);
        for (int64_t j = 0; j < near.count; j++) {
            const int32_t b = near.block[j];
            const Eight slope = eights_at(all, all->gradient, v)[b];
            Eight *mean = eights_at(all, all->mean, v) + b;
            Eight *square = eights_at(all, all->square, v) + b;
            Eight *phi = eights_at(all, all->phi, v) + b, size;
            *mean = MEAN_KEPT * *mean + (1.0 - MEAN_KEPT) * slope;
            *square = SQUARE_KEPT * *square + (1.0 - SQUARE_KEPT) * slope * slope;
            for (int i = 0; i < EIGHT; i++) size[i] = sqrt((*square)[i] / pace.square_past);
            *phi = between_zero_and(*phi - rate * *mean / (size + 1e-8), all->highest[b]);
        }
        all->chi[v] -= step_down(
            all->chi_gradient[v], all->chi_mean + v, all->chi_square + v, pace, all->unit);
    }
}

/* One turn: slopes, and a step of all potentials and of the price. */
static void turn_crowd(Crowd *all, int everywhere, double heat, Pace pace)
{
    const double steepest = work_out_visited(all, everywhere, heat);
    const double scale =
        all->limits.length / (all->mesh.side * soften_visited(all, steepest, heat));
    double served = 0.0;
    begin_slopes(all);
    for (int64_t j = 0; j < all->visits; j++)
        for (int shape = 0; shape < SHAPES; shape++)
            add_slopes_of_triangle(all, all->visited[j], shape, scale);
    for (int64_t k = 0; k < all->cells.devices.count; k++) served += add_slopes_of_peak(all, k);
    step_crowd(all, pace);
    const double scarce = (double)(all->limits.steps * all->limits.per_step) - served;
    all->nu -= step_down(scarce, &all->nu_mean, &all->nu_square, pace, all->unit);
    all->nu = most(all->nu, all->least_nu);
}

/* The turns that there is time for. */
static int64_t most_crowd_turns(const Crowd *all)
{
    double values = 0.0; /* in a turn, on average */
    for (int level = 0; level < all->meshes; level++) {
        const double ends = level + 1 < all->meshes ? CROWD_BEGINS[level + 1] : 1.0;
        values += (ends - CROWD_BEGINS[level]) * (double)((int64_t)1 << 2 * level);
    }
    double near = 0.0; /* on the first mesh */
    for (int64_t v = 0; v < all->mesh.vertices; v++)
        near += (double)(EIGHT * blocks_at_vertex(all, v).count);
    return near > 0.0 ? (int64_t)(CROWD_VALUE_TURNS / (values * near)) : 0;
}

/* Lower the bound by so many turns, the later ones on finer meshes, or until it is `enough`; returns
   the turns. */
static int64_t descend_in_crowd(
    Crowd *all, int64_t turns, double price, double value, double enough, double *bound)
{
    const Devices *devices = &all->cells.devices;
    const double side = all->mesh.side, reach = reach_of(devices), count = (double)devices->count;
    const double area = side * side * (double)((all->mesh.across - 1) * (all->mesh.up - 1));
    const double slower = 1.0 + count * reach * reach * PI / (area * MANY_HEARD);
    double mean_left = 1.0, square_left = 1.0;
    fill_rises(&all->cells);
    all->least_nu *= all->cells.upper[0];
    for (int64_t k = 0; k < devices->count; k++) {
        all->highest[k / EIGHT][k % EIGHT] = devices->delta[k] * all->cells.upper[0];
        all->unit = most(all->unit, devices->delta[k] * all->cells.upper[0]);
    }
    list_blocks(all, reach + CROWD_SPACINGS * sqrt(area / most(count, 1.0)));
    turns = fewer(turns, most_crowd_turns(all));
    sample_crowd(all);
    begin_crowd(all, price, value);
    *bound = INFINITY;
    int64_t begun = 0; /* the turn that the present mesh began with */
    for (int64_t turn = 0; turn < turns; turn++) {
        const double done = (double)turn / (double)turns, heat = between_rates(HEAT, CROWD.last_heat, done);
        if (all->level + 1 < all->meshes && done >= CROWD_BEGINS[all->level + 1]) {
            *bound = least(*bound, bound_by_crowd(all));
            if (*bound <= enough) return turn;
            refine_crowd(all);
            mean_left = square_left = 1.0;
            begun = turn;
        }
        mean_left *= MEAN_KEPT;
        square_left *= SQUARE_KEPT;
        const double rate = between_rates(CROWD.rate, CROWD.last_rate, done) * CROWD.slower[all->level];
        const Pace pace = {rate / slower, 1.0 - mean_left, 1.0 - square_left};
        turn_crowd(all, (turn - begun) % REFRESH == 0, heat, pace);
    }
    if (turns > 0) *bound = least(*bound, bound_by_crowd(all));
    return turns;
}

#endif
