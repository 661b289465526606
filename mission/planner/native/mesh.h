/* Meshes of triangles, each the same but twice as fine as the one before, and the directions in
   which functions that are linear on the triangles rise. */
#ifndef MESH_H
#define MESH_H

#include "eights.h"

enum {
    ACROSS_CELLS = 16, /* on the longer side of the first mesh */
    SHAPES = 2,        /* of triangles: below and above the diagonal of a cell */
    TRIANGLE = 3,      /* its vertices */
    GROUPS = 1,        /* of eight lines on which directions lie: on coarse meshes, */
    MORE_GROUPS = 2,   /* on finer ones, */
    FINE_GROUPS = 4,   /* and when a bound is worked out */
    FINE_AXES = FINE_GROUPS * EIGHT,
};

/* Square cells, each of two triangles along its diagonal to the north-east. */
typedef struct {
    int64_t across, up, vertices;
    int64_t start; /* the vertex at the start */
    double side;   /* metres */
    Point low;     /* vertex 0 */
} Mesh;

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

/* The mesh with every cell in quarters: what is linear on triangles of the one is on the other's. */
static Mesh finer_mesh(const Mesh *mesh)
{
    Mesh fine = *mesh;
    fine.across = 2 * mesh->across - 1;
    fine.up = 2 * mesh->up - 1;
    fine.vertices = fine.across * fine.up;
    fine.start = 2 * (mesh->start / mesh->across * fine.across + mesh->start % mesh->across);
    fine.side = 0.5 * mesh->side;
    return fine;
}

/* The last of so many meshes. */
static Mesh finest_mesh(const Mesh *first, int meshes)
{
    Mesh mesh = *first;
    for (int i = 1; i < meshes; i++) mesh = finer_mesh(&mesh);
    return mesh;
}

static Point vertex_at(const Mesh *mesh, int64_t i)
{
    return (Point){
        mesh->low.x + mesh->side * (double)(i % mesh->across),
        mesh->low.y + mesh->side * (double)(i / mesh->across)};
}

static const Box PLANE = {{-INFINITY, -INFINITY}, {INFINITY, INFINITY}};

static inline int is_in(const Box *box, Point p)
{
    return p.x >= box->low.x && p.x <= box->high.x && p.y >= box->low.y && p.y <= box->high.y;
}

/* Cells have the number of the vertex at their south-west: the last of a row and column have none. */
static inline int is_cell(const Mesh *mesh, int64_t i)
{
    return i % mesh->across + 1 < mesh->across && i + mesh->across < mesh->vertices;
}

/* A triangle, and eight axes of those in which h is known there. */
typedef struct {
    int64_t cell;
    int shape, group;
} Triangle;

static inline Triangle triangle_at(int64_t number, int groups)
{
    const int64_t triangle = number / groups;
    return (Triangle){triangle / SHAPES, (int)(triangle % SHAPES), (int)(number % groups)};
}

/* Where it has its vertices: its sides are from the first to the second, and from that to the
   third. */
static inline void corners_of(const Mesh *mesh, Triangle at, int64_t *corner)
{
    corner[0] = at.cell;
    corner[1] = at.shape == 0 ? at.cell + 1 : at.cell + mesh->across;
    corner[2] = at.cell + mesh->across + 1;
}

/* The two vertices half way between which vertex `fine` of the finer mesh lies. */
typedef struct {
    int64_t one, other;
} Parents;

static inline Parents parents_of(const Mesh *mesh, int64_t fine)
{
    const int64_t across = 2 * mesh->across - 1, x = fine % across, y = fine / across;
    const int64_t one = y / 2 * mesh->across + x / 2;
    return (Parents){one, one + (y & 1) * mesh->across + (x & 1)};
}

/* Unit vectors times what makes their polygon hold the circle. */
typedef struct {
    int groups;
    Eight x[FINE_GROUPS], y[FINE_GROUPS];
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

static Directions directions(int groups)
{
    static const double HALF_STEP[] = { /* cosines, of 1, 2 and 4 groups */
        0.98078528040323043, 0.99518472667219689, 0.99879545620517241};
    const double out = 1.0 / HALF_STEP[groups / 2];
    Directions all = {.groups = groups};
    for (int i = 0; i < groups * EIGHT; i++) {
        const int step = i * (FINE_GROUPS / groups);
        all.x[i / EIGHT][i % EIGHT] = out * cosine(step);
        all.y[i / EIGHT][i % EIGHT] = out * cosine(step - FINE_AXES / 2);
    }
    return all;
}

#endif
