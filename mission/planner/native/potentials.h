/* A bound from potentials, for any number of devices and steps.

   Let phi_k >= 0 and psi be functions of the place, phi_k(v_0) = psi(v_0) = 0. On a path that serves
   device k at x_k, phi_k(x_k) is what phi_k gains until then, hence

       sum_k phi_k(x_k) + psi(end) <= integral of h over the path,
       h = most over directions t of sum_k (grad phi_k . t)+ + grad psi . t,

   at most mu L where h <= mu everywhere. As k earns delta f = [delta f - phi_k] + phi_k at x_k,

       mu L - least psi + nu N K_bar + sum_k most over x of (delta_k f(|x - u_k|) - phi_k(x) - nu)+

   bounds any plan, nu >= 0 being a price of a place. This is the dual of the flow relaxation of a
   path: what is served somewhere must have been passed, and each metre only serves one direction.

   The functions are linear on the triangles of a mesh, so that h is known exactly but for the
   polygon that stands for the circle of directions. psi is kept as chi = psi + sum_k phi_k / 2, since

       h(t) = sum_k |grad phi_k . t| / 2 + grad chi . t. */
#ifndef POTENTIALS_H
#define POTENTIALS_H

#include "cells.h"
#include "elementary.h"

enum {
    ACROSS_CELLS = 16, /* on the longer side of the first mesh */
    AXES = 8,          /* lines on which directions lie while the bound is lowered */
    MORE_AXES = 16,    /* the same on the last of three meshes */
    FINE_AXES = 32,    /* and when it is worked out */
    SPLITS = 3,        /* of a cell's side, where f bends */
    SHAPES = 2,        /* of triangles: below and above the diagonal of a cell */
};
static const double BENT = 0.01; /* share of the best f that it bends by within a cell */
enum { DEEP = 8 }; /* halvings of a cell where a peak is looked for */
static const double CLOSE = 5e-4; /* share of the best f to which peaks are known */
static const double FAINT = 0.02; /* share of the best f that is not sampled */

/* Square cells, each of two triangles along its diagonal to the north-east. */
typedef struct {
    int64_t across, up, vertices;
    int64_t start; /* the vertex at the start; below 0 where that is elsewhere */
    double side;   /* metres */
    Point low;     /* vertex 0 */
} Mesh;

/* The part of a mesh on which the potential of a device is not 0: a mesh itself. */
typedef struct {
    Mesh mesh;
    int64_t corner; /* the whole mesh's vertex at its vertex 0 */
    int64_t values; /* where its values begin among those of all devices */
} Window;

/* A place in a triangle, and what a device earns there. */
typedef struct {
    int32_t vertex[3];
    double share[3];
    double reward;
} Sample;

/* Directions: unit vectors times what makes their polygon hold the circle. */
typedef struct {
    int count;
    Point towards[FINE_AXES];
} Directions;

static const double COSINES[FINE_AXES / 2 + 1] = {
    1.0, 0.99518472667219693, 0.98078528040323043, 0.95694033573220882, 0.92387953251128674,
    0.88192126434835505, 0.83146961230254524, 0.77301045336273699, 0.70710678118654757,
    0.63439328416364549, 0.55557023301960229, 0.47139673682599781, 0.38268343236508984,
    0.29028467725446233, 0.19509032201612833, 0.098017140329560604, 0.0};

static double cosine(int step) /* of step pi / FINE_AXES */
{
    step = step < 0 ? -step : step;
    return step <= FINE_AXES / 2 ? COSINES[step] : -COSINES[FINE_AXES - step];
}

static Directions directions(int count)
{
    static const double HALF_STEP[] = { /* cosines */
        0.98078528040323043, 0.99518472667219689, 0.99879545620517241};
    const double out = 1.0 / HALF_STEP[(count >= MORE_AXES) + (count >= FINE_AXES)];
    Directions all = {count, {{0.0, 0.0}}};
    for (int i = 0; i < count; i++) {
        const int step = i * (FINE_AXES / count);
        all.towards[i] = (Point){out * cosine(step), out * cosine(step - FINE_AXES / 2)};
    }
    return all;
}

typedef struct {
    Mesh mesh;
    Window *window; /* (K,) */
    double *phi;    /* by window */
    double *chi;    /* (vertices,) */
    double nu;
} Potentials;

/* The part of the plane that a path need not leave: the box of start and devices, within reach. */
static Mesh mesh_of(const Devices *devices, double length)
{
    Point low = {0.0, 0.0}, high = {0.0, 0.0};
    for (int64_t k = 0; k < devices->count; k++) {
        const Point u = devices->at[k];
        low = (Point){least(low.x, u.x), least(low.y, u.y)};
        high = (Point){most(high.x, u.x), most(high.y, u.y)};
    }
    low = (Point){most(low.x, -length), most(low.y, -length)};
    high = (Point){least(high.x, length), least(high.y, length)};
    const double side = most(most(high.x - low.x, high.y - low.y), 1.0) / ACROSS_CELLS;
    const int64_t west = (int64_t)ceil(-low.x / side), east = (int64_t)ceil(high.x / side);
    const int64_t south = (int64_t)ceil(-low.y / side), north = (int64_t)ceil(high.y / side);
    Mesh mesh = {.across = west + east + 1, .up = south + north + 1, .side = side};
    if (mesh.across < 2) mesh.across = 2;
    if (mesh.up < 2) mesh.up = 2;
    mesh.vertices = mesh.across * mesh.up;
    mesh.start = south * mesh.across + west;
    mesh.low = (Point){-side * (double)west, -side * (double)south};
    return mesh;
}

/* Cells by the vertex at their south-west. Those at the eastern edge, which are none, are passed
   over as if the next row followed there, so that loops are long: their numbers mean nothing. */
static int64_t cells_of(const Mesh *mesh) { return mesh->vertices - mesh->across - 1; }

/* The vertex of a mesh of quarters that lies at vertex i. */
static int64_t finer_vertex(const Mesh *mesh, const Mesh *fine, int64_t i)
{
    return 2 * (i / mesh->across * fine->across + i % mesh->across);
}

/* The mesh with every cell in quarters: what is linear on triangles of the one is on the other's. */
static Mesh finer_mesh(const Mesh *mesh)
{
    Mesh fine = *mesh;
    fine.across = 2 * mesh->across - 1;
    fine.up = 2 * mesh->up - 1;
    fine.vertices = fine.across * fine.up;
    fine.start = finer_vertex(mesh, &fine, mesh->start);
    fine.side = 0.5 * mesh->side;
    return fine;
}

/* The cells within `radius` of a place, in x or y: at least one. */
static Window window_of(const Mesh *mesh, Point place, double radius)
{
    const int64_t columns = mesh->across - 1, rows = mesh->up - 1;
    const double x = (place.x - mesh->low.x) / mesh->side, y = (place.y - mesh->low.y) / mesh->side;
    const double half = radius / mesh->side;
    Mesh part = *mesh;
    const int64_t west = fewer((int64_t)most(0.0, floor(x - half)), columns - 1);
    const int64_t south = fewer((int64_t)most(0.0, floor(y - half)), rows - 1);
    const int64_t east = (int64_t)least((double)columns, ceil(most(x + half, (double)west + 1.0)));
    const int64_t north = (int64_t)least((double)rows, ceil(most(y + half, (double)south + 1.0)));
    part.across = east - west + 1;
    part.up = north - south + 1;
    part.vertices = part.across * part.up;
    part.low.x += mesh->side * (double)west;
    part.low.y += mesh->side * (double)south;
    const int64_t column = mesh->start % mesh->across - west, row = mesh->start / mesh->across - south;
    const int inside = column >= 0 && column < part.across && row >= 0 && row < part.up;
    part.start = inside ? row * part.across + column : -1;
    return (Window){part, south * mesh->across + west, 0};
}

/* Stretches of the whole mesh that a window consists of: rows, or one for all of them. */
typedef struct {
    int64_t count, length, step, whole_step; /* from one to the next, in the window and the mesh */
} Stretches;

/* Those of its vertices, or without the last row and column, of its cells. */
static Stretches stretches_of(const Window *window, const Mesh *whole, int cells)
{
    const Mesh *mesh = &window->mesh;
    if (mesh->across == whole->across)
        return (Stretches){1, cells ? cells_of(mesh) : mesh->vertices, 0, 0};
    return (Stretches){mesh->up - cells, mesh->across - cells, mesh->across, whole->across};
}

/* The same function on the finer mesh. */
static void refine_function(const Mesh *mesh, const double *value, double *fine)
{
    const int64_t across = 2 * mesh->across - 1, up = 2 * mesh->up - 1;
    for (int64_t j = 0; j < up; j++)
        for (int64_t i = 0; i < across; i++) {
            const double *at = value + j / 2 * mesh->across + i / 2;
            const double other = at[(j & 1) * mesh->across + (i & 1)];
            *fine++ = 0.5 * (*at + other);
        }
}

static Point vertex_at(const Mesh *mesh, int64_t i)
{
    return (Point){
        mesh->low.x + mesh->side * (double)(i % mesh->across),
        mesh->low.y + mesh->side * (double)(i / mesh->across)};
}

static int is_cell(const Mesh *mesh, int64_t i)
{
    return i % mesh->across + 1 < mesh->across && i + mesh->across < mesh->vertices;
}

/* How much a function rises along the two sides of each cell's triangle of a shape. */
static void rise_along(
    const Mesh *mesh, const double *value, int shape, double *restrict east, double *restrict north)
{
    const int64_t cells = cells_of(mesh);
    const double *base = shape == 0 ? value : value + mesh->across;
    const double *foot = shape == 0 ? value + 1 : value;
    for (int64_t c = 0; c < cells; c++) {
        east[c] = base[c + 1] - base[c];
        north[c] = foot[c + mesh->across] - foot[c];
    }
}

/* Add half of |grad phi . t| of all triangles of a window, by the side of a cell, to `slopes` (axes,
   cells), from the rises of phi. */
static void add_slopes(
    Stretches rows, int64_t cells, const double *east, const double *north, const Directions *all,
    double *slopes)
{
    for (int i = 0; i < all->count; i++) {
        const double x = 0.5 * all->towards[i].x, y = 0.5 * all->towards[i].y;
        for (int64_t j = 0; j < rows.count; j++) {
            double *restrict sum = slopes + i * cells + j * rows.whole_step;
            const double *restrict e = east + j * rows.step, *restrict n = north + j * rows.step;
            for (int64_t c = 0; c < rows.length; c++) sum[c] += fabs(x * e[c] + y * n[c]);
        }
    }
}

/* grad chi . t of all triangles, by the side of a cell. */
static void set_lean(
    int64_t cells, const double *restrict east, const double *restrict north,
    const Directions *all, double *lean)
{
    for (int i = 0; i < all->count; i++) {
        const double x = all->towards[i].x, y = all->towards[i].y;
        double *restrict row = lean + i * cells;
        for (int64_t c = 0; c < cells; c++) row[c] = x * east[c] + y * north[c];
    }
}

/* A place in a cell, from its south-west corner (0, 0) to the north-east (1, 1). */
static Sample sample_at(const Mesh *mesh, int64_t corner, double east, double north)
{
    const int32_t v = (int32_t)corner, across = (int32_t)mesh->across;
    if (east >= north)
        return (Sample){{v, v + 1, v + across + 1}, {1.0 - east, east - north, north}, 0.0};
    return (Sample){{v, v + across, v + across + 1}, {1.0 - north, north - east, east}, 0.0};
}

static inline double value_at(const double *phi, const Sample *at)
{
    return at->share[0] * phi[at->vertex[0]] + at->share[1] * phi[at->vertex[1]] +
           at->share[2] * phi[at->vertex[2]];
}

/* A part of a cell, by what of the cell's side lies before it, and its own side. */
typedef struct {
    int64_t corner; /* vertex south-west of the cell */
    double east, north, side;
} Part;

/* What is known of the most of delta f - phi: reached somewhere, and exceeded nowhere. */
typedef struct {
    const double *phi;
    int64_t device;
    double reached, bound, close;
} Peak;

/* Look for more in a part of a cell. */
static void look_into(
    const Cells *cells, const Mesh *mesh, double length, Part part, int depth, Peak *peak)
{
    const Point corner = vertex_at(mesh, part.corner);
    const double half = 0.5 * part.side * mesh->side;
    const Point middle = {
        corner.x + mesh->side * part.east + half, corner.y + mesh->side * part.north + half};
    if (from_start(middle, half, -1.0) > length) return;
    const Corners reward = reward_at_corners(
        cells, peak->device, middle, half, size_of(half));
    double bound = -INFINITY;
    for (int i = 0; i < 4; i++) {
        const Sample at = sample_at(
            mesh, part.corner, part.east + part.side * (i & 1), part.north + part.side * (i >> 1));
        bound = most(bound, reward[i] - value_at(peak->phi, &at));
    }
    if (bound <= peak->reached + peak->close || depth == 0) {
        peak->bound = most(peak->bound, bound);
        return;
    }
    const double step = 0.5 * part.side;
    const Sample at = sample_at(mesh, part.corner, part.east + step, part.north + step);
    const double here = worth(&cells->devices, peak->device, middle) - value_at(peak->phi, &at);
    if (from_start(middle, 0.0, 1.0) <= length) peak->reached = most(peak->reached, here);
    for (int i = 0; i < 4; i++)
        look_into(
            cells, mesh, length,
            (Part){part.corner, part.east + step * (i & 1), part.north + step * (i >> 1), step},
            depth - 1, peak);
}

/* Bound of the most that device k earns beyond phi and `price`, anywhere; 0 where there is none. */
static double most_beyond(
    const Cells *cells, const Mesh *mesh, double length, int64_t k, const double *phi, double price)
{
    Peak peak = {phi, k, price, price, CLOSE * cells->devices.delta[k] * cells->upper[0]};
    for (int64_t i = 0; i < mesh->vertices; i++)
        peak.reached =
            most(peak.reached, worth(&cells->devices, k, vertex_at(mesh, i)) - phi[i]);
    for (int64_t i = 0; i < cells_of(mesh); i++)
        if (is_cell(mesh, i))
            look_into(cells, mesh, length, (Part){i, 0.0, 0.0, 1.0}, DEEP, &peak);
    return peak.bound - price;
}

#endif
