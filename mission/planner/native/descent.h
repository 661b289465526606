/* Potentials that bound a plan well, found by gradient steps (Adam; Kingma and Ba 2015) on the bound
   with its maxima made smooth, smoother at first. Any potentials give a bound, whatever the steps. */
#ifndef DESCENT_H
#define DESCENT_H

#include "ascent.h"
#include "lists.h"
#include "potentials.h"

/* How a descent goes, on up to two meshes and on three. */
typedef struct {
    double rate, last_rate; /* steps, as shares of the best reward */
    double slower[4];       /* on each mesh */
    double last_heat;       /* smoothness of mu at the end, as a share of mu L */
    int shared;             /* whether steps are those of all devices together, or of each */
} Course;

static const Course SHORT = {6.0, 0.045, {1.0, 0.5}, 0.005, 1};
static const Course LONG = {0.015, 1e-4, {1.0, 0.5, 0.2}, 0.002, 0};
static const double FEW_DEVICES = 50.0; /* fewer do not each take larger steps */
static const double HEAT = 0.1; /* the smoothness at first */
static const double PEAK_HEAT = 0.003, LOW_HEAT = 0.1; /* of peaks and of the least psi */
static const double MEAN_KEPT = 0.95, SQUARE_KEPT = 0.95;
static const double DEAR = 0.9; /* of the price of a place: whose devices take part */
enum { MOST_MESHES = 3 };
enum { DEVICE_TURNS = 120000 }; /* devices by turns, at most, on two meshes */
static const double SPACINGS = 3.0;    /* mean distances of devices, around a potential */
enum { COLD = 30 }; /* what lies this many heats below a maximum has no part in it */

/* Means of a slope and of its square, by which steps are scaled. */
typedef struct {
    double *mean, *square;
} Moments;

/* Memory of a descent. */
typedef struct {
    Cells cells;
    Limits limits;
    Potentials now;
    Moments of_phi, of_chi, of_nu;
    Directions coarse, fine;
    int meshes;            /* one after the other */
    int64_t values;        /* of all potentials on the last mesh */
    double *slopes, *lean; /* (SHAPES, FINE_AXES, cells) */
    double *half_sum;     /* (vertices,) of phi over all devices */
    double *low;          /* (vertices,) share of the smooth minimum of psi */
    double *gradient;     /* (vertices,) */
    double *east, *north;   /* (SHAPES, cells) rises of a function along sides of triangles */
    double *by_east, *by_north; /* (cells,) slopes by them */
    Sample *sample;
    int64_t *first;       /* (K + 1,) the samples of each device */
    double *value;        /* of a device's samples */
    double unit;          /* the best reward */
    double least_nu;      /* below it, devices that are left out would count */
} Descent;

static int64_t most_samples(const Mesh *mesh) { return mesh->vertices * SPLITS * SPLITS; }

/* The last of so many meshes. */
static Mesh finest_mesh(const Mesh *first, int meshes)
{
    Mesh mesh = *first;
    for (int i = 1; i < meshes; i++) mesh = finer_mesh(&mesh);
    return mesh;
}

/* How far from its device a potential may be above 0. With three meshes, as far as it is heard and
   some mean distances of the devices further: beyond that chi can tell what a way is worth. */
static double radius_of(const Devices *devices, const Mesh *mesh, int meshes)
{
    if (meshes < MOST_MESHES) return INFINITY;
    const double area = mesh->side * mesh->side * (double)(mesh->across - 1) * (double)(mesh->up - 1);
    return reach_of(devices) + SPACINGS * sqrt(area / (double)devices->count);
}

/* How many values the potentials have on the last mesh. */
static int64_t count_values(const Devices *devices, const Mesh *first, int meshes)
{
    const double radius = radius_of(devices, first, meshes);
    int64_t count = 0;
    for (int64_t k = 0; k < devices->count; k++) {
        const Window window = window_of(first, devices->at[k], radius);
        count += finest_mesh(&window.mesh, meshes).vertices;
    }
    return count;
}

static Descent lay_out_descent(
    Arena *arena, const Devices *devices, const Limits *limits, int meshes, int64_t samples)
{
    const Mesh first = mesh_of(devices, limits->length), mesh = finest_mesh(&first, meshes);
    const int64_t v = mesh.vertices, all = count_values(devices, &first, meshes);
    const int64_t cells = cells_of(&mesh), slopes = SHAPES * FINE_AXES * cells;
    return (Descent){
        .cells = lay_out_cells(arena, devices, limits, 0),
        .limits = *limits,
        .meshes = meshes,
        .values = all,
        .now = {
            first, claim(arena, devices->count, sizeof(Window)), claim(arena, all, sizeof(double)),
            claim(arena, v, sizeof(double)), 0.0},
        .of_phi = {claim(arena, all, sizeof(double)), claim(arena, all, sizeof(double))},
        .of_chi = {claim(arena, v, sizeof(double)), claim(arena, v, sizeof(double))},
        .of_nu = {claim(arena, 1, sizeof(double)), claim(arena, 1, sizeof(double))},
        .coarse = directions(AXES),
        .fine = directions(FINE_AXES),
        .slopes = claim(arena, slopes, sizeof(double)),
        .lean = claim(arena, slopes, sizeof(double)),
        .half_sum = claim(arena, v, sizeof(double)),
        .low = claim(arena, v, sizeof(double)),
        .gradient = claim(arena, v, sizeof(double)),
        .east = claim(arena, SHAPES * cells, sizeof(double)),
        .north = claim(arena, SHAPES * cells, sizeof(double)),
        .by_east = claim(arena, cells, sizeof(double)),
        .by_north = claim(arena, cells, sizeof(double)),
        .sample = claim(arena, samples, sizeof(Sample)),
        .first = claim(arena, devices->count + 1, sizeof(int64_t)),
        .value = claim(arena, most_samples(&mesh), sizeof(double)),
    };
}

/* List the places where device k is looked at: vertices, and more where f bends within a cell.
   Returns how many; they are written where there is memory for them. */
static int64_t list_samples(
    const Devices *devices, const Mesh *mesh, double length, int64_t k, Sample *into)
{
    int64_t count = 0;
    const double best = devices->table[0], faint = FAINT * best;
    for (int64_t v = 0; v < mesh->vertices; v++) {
        const Point corner = vertex_at(mesh, v);
        const int inner = is_cell(mesh, v);
        const Point middle = {corner.x + 0.5 * mesh->side, corner.y + 0.5 * mesh->side};
        const double r = between(middle, devices->at[k]);
        const Reward at = reward(r, devices);
        const double bend = most(-at.bend, -at.slope / most(r, 1.0));
        const int splits =
            inner && bend * mesh->side * mesh->side > 8.0 * BENT * best ? SPLITS : 1;
        for (int i = 0; i < splits * splits; i++) {
            const double east = (double)(i % splits) / splits;
            const double north = (double)(i / splits) / splits;
            const Point place = {corner.x + mesh->side * east, corner.y + mesh->side * north};
            const double f = reward(between(place, devices->at[k]), devices).f;
            if (f < faint || from_start(place, 0.0, 1.0) > length) continue;
            if (into) {
                const int32_t alone = (int32_t)v; /* at the edge of the mesh */
                into[count] = inner ? sample_at(mesh, v, east, north)
                                    : (Sample){{alone, alone, alone}, {1.0, 0.0, 0.0}, 0.0};
                into[count].reward = devices->delta[k] * f;
            }
            count++;
        }
    }
    return count;
}

/* The samples of any of the meshes that there has to be room for. */
static int64_t count_samples(const Devices *devices, const Limits *limits, int meshes)
{
    const Mesh first = mesh_of(devices, limits->length);
    const double radius = radius_of(devices, &first, meshes);
    int64_t most_count = 0;
    for (int i = 1; i <= meshes; i++) {
        int64_t count = 0;
        for (int64_t k = 0; k < devices->count; k++) {
            const Window window = window_of(&first, devices->at[k], radius);
            const Mesh mesh = finest_mesh(&window.mesh, i);
            count += list_samples(devices, &mesh, limits->length, k, NULL);
        }
        if (count > most_count) most_count = count;
    }
    return most_count;
}

static void fill_samples(Descent *all)
{
    for (int64_t k = 0; k < all->cells.devices.count; k++)
        all->first[k + 1] = all->first[k] + list_samples(
            &all->cells.devices, &all->now.window[k].mesh, all->limits.length, k,
            all->sample + all->first[k]);
}

/* Set where each potential lives on the first mesh. */
static void open_windows(Descent *all, double radius)
{
    const Devices *devices = &all->cells.devices;
    int64_t values = 0;
    for (int64_t k = 0; k < devices->count; k++) {
        Window *window = all->now.window + k;
        *window = window_of(&all->now.mesh, devices->at[k], radius);
        window->values = values;
        values += finest_mesh(&window->mesh, all->meshes).vertices;
    }
}

static double *phi_of(const Descent *all, int64_t k)
{
    return all->now.phi + all->now.window[k].values;
}

/* Take the potential of device k from the whole mesh. */
static void gather(Descent *all, int64_t k, const double *whole)
{
    const Window *window = all->now.window + k;
    const Stretches rows = stretches_of(window, &all->now.mesh, 0);
    for (int64_t j = 0; j < rows.count; j++)
        memcpy(phi_of(all, k) + j * rows.step, whole + window->corner + j * rows.whole_step,
               (size_t)rows.length * sizeof(double));
}

/* The potential of device k on the whole mesh, into `gradient`. */
static const double *spread(Descent *all, int64_t k)
{
    const Window *window = all->now.window + k;
    const Stretches rows = stretches_of(window, &all->now.mesh, 0);
    memset(all->gradient, 0, (size_t)all->now.mesh.vertices * sizeof(double));
    for (int64_t j = 0; j < rows.count; j++)
        memcpy(all->gradient + window->corner + j * rows.whole_step, phi_of(all, k) + j * rows.step,
               (size_t)rows.length * sizeof(double));
    return all->gradient;
}

/* psi, from chi and the sum over phi. */
static inline double psi_at(const Descent *all, int64_t i)
{
    return all->now.chi[i] - all->half_sum[i];
}

/* The rises of a function along the sides of all triangles of a mesh. */
static void rise_of(Descent *all, const Mesh *mesh, const double *value)
{
    const int64_t cells = cells_of(mesh);
    for (int shape = 0; shape < SHAPES; shape++)
        rise_along(mesh, value, shape, all->east + shape * cells, all->north + shape * cells);
}

/* Work out h of all triangles in both senses of each axis, and half of the sum over phi. Returns
   the largest times the length. */
static double work_out(Descent *all, const Directions *ways)
{
    const Mesh *mesh = &all->now.mesh;
    const int64_t v = mesh->vertices, cells = cells_of(mesh), block = ways->count * cells;
    memset(all->slopes, 0, (size_t)(SHAPES * block) * sizeof(double));
    memset(all->half_sum, 0, (size_t)v * sizeof(double));
    for (int64_t k = 0; k < all->cells.devices.count; k++) {
        const Window *window = all->now.window + k;
        const Stretches inner = stretches_of(window, mesh, 1), rows = stretches_of(window, mesh, 0);
        const int64_t own = cells_of(&window->mesh);
        rise_of(all, &window->mesh, phi_of(all, k));
        for (int shape = 0; shape < SHAPES; shape++)
            add_slopes(
                inner, cells, all->east + shape * own, all->north + shape * own, ways,
                all->slopes + shape * block + window->corner);
        for (int64_t j = 0; j < rows.count; j++) {
            const double *phi = phi_of(all, k) + j * rows.step;
            double *sum = all->half_sum + window->corner + j * rows.whole_step;
            for (int64_t i = 0; i < rows.length; i++) sum[i] += 0.5 * phi[i];
        }
    }
    rise_of(all, mesh, all->now.chi);
    for (int shape = 0; shape < SHAPES; shape++)
        set_lean(
            cells, all->east + shape * cells, all->north + shape * cells, ways,
            all->lean + shape * block);
    double steepest = 0.0;
    for (int64_t i = 0; i < SHAPES * block; i++) {
        const int64_t cell = i % cells;
        if (!is_cell(mesh, cell)) all->slopes[i] = all->lean[i] = 0.0;
        steepest = most(steepest, all->slopes[i] + fabs(all->lean[i]));
    }
    return steepest * all->limits.length / mesh->side;
}

/* The bound of the present potentials; where they are no numbers, there is none. */
static double bound_by_potentials(Descent *all)
{
    const Mesh *mesh = &all->now.mesh;
    const int64_t v = mesh->vertices;
    double bound = work_out(all, &all->fine), lowest = 0.0, zero = 0.0;
    for (int64_t i = 0; i < v; i++) lowest = least(lowest, psi_at(all, i));
    for (int64_t i = 0; i < v; i++) zero += 0.0 * all->now.chi[i]; /* comparing would pass a NaN */
    bound += all->now.nu * (double)(all->limits.steps * all->limits.per_step) - lowest;
    for (int64_t k = 0; k < all->cells.devices.count; k++) {
        const double *phi = spread(all, k);
        for (int64_t i = 0; i < v; i++) zero += 0.0 * phi[i];
        bound += most_beyond(&all->cells, mesh, all->limits.length, k, phi, all->now.nu);
    }
    return isfinite(bound + zero) ? bound : INFINITY;
}

/* One step down a slope; `past` makes up for the means' beginning at zero. */
typedef struct {
    double rate, mean_past, square_past;
} Pace;

static inline double step_down(double slope, double *mean, double *square, Pace pace, double unit)
{
    *mean = MEAN_KEPT * *mean + (1.0 - MEAN_KEPT) * slope;
    *square = SQUARE_KEPT * *square + (1.0 - SQUARE_KEPT) * slope * slope;
    return unit * pace.rate * (*mean / pace.mean_past) / (sqrt(*square / pace.square_past) + 1e-8);
}

static void step_all(
    int64_t count, const double *slope, double *x, Moments of, Pace pace, double unit)
{
    double *restrict mean = of.mean, *restrict square = of.square, *restrict at = x;
    for (int64_t i = 0; i < count; i++)
        at[i] -= step_down(slope[i], mean + i, square + i, pace, unit);
}

/* Turn h into the slopes of its smooth maximum times the length: `slopes` by |grad phi . t|, `lean`
   by grad chi . t. */
static void soften(Descent *all, double steepest, double heat)
{
    const Mesh *mesh = &all->now.mesh;
    const int64_t count = SHAPES * all->coarse.count * cells_of(mesh);
    const double length = all->limits.length / mesh->side, scale = 1.0 / (heat * steepest);
    double total = 0.0;
    for (int64_t i = 0; i < count; i++) {
        const double with = ((all->slopes[i] + all->lean[i]) * length - steepest) * scale;
        const double against = ((all->slopes[i] - all->lean[i]) * length - steepest) * scale;
        const double a = with < -COLD ? 0.0 : exp_of_negative(with);
        const double b = against < -COLD ? 0.0 : exp_of_negative(against);
        total += a + b;
        all->slopes[i] = a + b;
        all->lean[i] = a - b;
    }
    for (int64_t i = 0; i < count; i++) {
        all->slopes[i] *= length / total;
        all->lean[i] *= length / total;
    }
}

/* Add slopes by the rises along the sides of triangles to those by the function itself. */
static void add_sides(Descent *all, const Mesh *mesh, int shape)
{
    const int64_t cells = cells_of(mesh), up = mesh->across;
    double *restrict base = all->gradient + (shape == 0 ? 0 : up);
    double *restrict foot = all->gradient + (shape == 0 ? 1 : 0);
    const double *restrict x = all->by_east, *restrict y = all->by_north;
    for (int64_t c = 0; c < cells; c++) base[c] -= x[c];
    for (int64_t c = 0; c < cells; c++) base[c + 1] += x[c];
    for (int64_t c = 0; c < cells; c++) foot[c] -= y[c];
    for (int64_t c = 0; c < cells; c++) foot[c + up] += y[c];
}

/* Slopes of the smooth mu L by a device's potential. */
static void slope_of_phi(Descent *all, const Window *window, const double *phi)
{
    const int64_t cells = cells_of(&all->now.mesh), own = cells_of(&window->mesh);
    const Stretches rows = stretches_of(window, &all->now.mesh, 1);
    rise_of(all, &window->mesh, phi);
    for (int shape = 0; shape < SHAPES; shape++) {
        memset(all->by_east, 0, (size_t)own * sizeof(double));
        memset(all->by_north, 0, (size_t)own * sizeof(double));
        for (int i = 0; i < all->coarse.count; i++) {
            const Point way = all->coarse.towards[i];
            const double x = 0.5 * way.x, y = 0.5 * way.y;
            const int64_t block = (shape * all->coarse.count + i) * cells + window->corner;
            for (int64_t j = 0; j < rows.count; j++) {
                const int64_t first = j * rows.step;
                const double *restrict east = all->east + shape * own + first;
                const double *restrict north = all->north + shape * own + first;
                const double *restrict weight = all->slopes + block + j * rows.whole_step;
                double *restrict by_east = all->by_east + first;
                double *restrict by_north = all->by_north + first;
                for (int64_t c = 0; c < rows.length; c++) {
                    const double share = copysign(weight[c], x * east[c] + y * north[c]);
                    by_east[c] += share * x;
                    by_north[c] += share * y;
                }
            }
        }
        add_sides(all, &window->mesh, shape);
    }
}

/* The same by chi. */
static void slope_of_chi(Descent *all)
{
    const int64_t cells = cells_of(&all->now.mesh);
    for (int shape = 0; shape < SHAPES; shape++) {
        memset(all->by_east, 0, (size_t)cells * sizeof(double));
        memset(all->by_north, 0, (size_t)cells * sizeof(double));
        for (int i = 0; i < all->coarse.count; i++) {
            const double *weight = all->lean + (shape * all->coarse.count + i) * cells;
            for (int64_t c = 0; c < cells; c++) {
                all->by_east[c] += weight[c] * all->coarse.towards[i].x;
                all->by_north[c] += weight[c] * all->coarse.towards[i].y;
            }
        }
        add_sides(all, &all->now.mesh, shape);
    }
}

/* Slopes of the smooth peak of a device by its potential; returns the share that is served. */
static double slope_of_peak(Descent *all, int64_t k, const double *phi)
{
    const Sample *sample = all->sample + all->first[k];
    const int64_t count = all->first[k + 1] - all->first[k];
    const double heat = 1.0 / (PEAK_HEAT * all->unit);
    double highest = all->now.nu, total;
    for (int64_t i = 0; i < count; i++) {
        all->value[i] = sample[i].reward - value_at(phi, sample + i);
        highest = most(highest, all->value[i]);
    }
    total = exp_of_negative((all->now.nu - highest) * heat);
    const double unserved = total;
    for (int64_t i = 0; i < count; i++) {
        const double x = (all->value[i] - highest) * heat;
        all->value[i] = x < -COLD ? 0.0 : exp_of_negative(x);
        total += all->value[i];
    }
    for (int64_t i = 0; i < count; i++) {
        const double share = all->value[i] / total;
        if (share > 0.0)
            for (int c = 0; c < 3; c++)
                all->gradient[sample[i].vertex[c]] -= share * sample[i].share[c];
    }
    return 1.0 - unserved / total;
}

/* Shares in the smooth minimum of psi. */
static void find_low(Descent *all)
{
    const int64_t v = all->now.mesh.vertices;
    const double heat = 1.0 / (LOW_HEAT * all->unit);
    double lowest = 0.0, total = 0.0;
    for (int64_t i = 0; i < v; i++) lowest = least(lowest, psi_at(all, i));
    for (int64_t i = 0; i < v; i++) {
        all->low[i] = exp_of_negative((lowest - psi_at(all, i)) * heat);
        total += all->low[i];
    }
    for (int64_t i = 0; i < v; i++) all->low[i] /= total;
}

/* Keep a potential from 0 to what its device is worth, and 0 along those sides of its window that
   are not the mesh's: it ends there. */
static void keep_within(const Window *window, const Mesh *whole, double highest, double *phi)
{
    const Mesh *mesh = &window->mesh;
    for (int64_t i = 0; i < mesh->vertices; i++) phi[i] = least(most(phi[i], 0.0), highest);
    const int64_t west = window->corner % whole->across, south = window->corner / whole->across;
    for (int64_t i = 0; i < mesh->up; i++) {
        if (west > 0) phi[i * mesh->across] = 0.0;
        if (west + mesh->across < whole->across) phi[(i + 1) * mesh->across - 1] = 0.0;
    }
    for (int64_t i = 0; i < mesh->across; i++) {
        if (south > 0) phi[i] = 0.0;
        if (south + mesh->up < whole->up) phi[mesh->vertices - 1 - i] = 0.0;
    }
}

/* One step of a device's potential; returns the share that is served. */
static double step_phi(Descent *all, int64_t k, Pace pace)
{
    const Window *window = all->now.window + k;
    const Stretches rows = stretches_of(window, &all->now.mesh, 0);
    const Moments of = {all->of_phi.mean + window->values, all->of_phi.square + window->values};
    double *phi = phi_of(all, k);
    for (int64_t j = 0; j < rows.count; j++) {
        const double *low = all->low + window->corner + j * rows.whole_step;
        double *gradient = all->gradient + j * rows.step;
        for (int64_t i = 0; i < rows.length; i++) gradient[i] = 0.5 * low[i];
    }
    slope_of_phi(all, window, phi);
    const double served = slope_of_peak(all, k, phi);
    if (window->mesh.start >= 0) all->gradient[window->mesh.start] = 0.0;
    step_all(window->mesh.vertices, all->gradient, phi, of, pace, all->unit);
    keep_within(window, &all->now.mesh, all->cells.devices.delta[k] * all->cells.upper[0], phi);
    return served;
}

/* One step of all potentials. */
static void turn_down(Descent *all, double heat, Pace pace)
{
    const int64_t v = all->now.mesh.vertices;
    const double steepest = work_out(all, &all->coarse);
    double served = 0.0;
    soften(all, most(steepest, 1e-9 * all->unit), heat);
    find_low(all);
    for (int64_t i = 0; i < v; i++) all->gradient[i] = -all->low[i];
    slope_of_chi(all);
    all->gradient[all->now.mesh.start] = 0.0;
    step_all(v, all->gradient, all->now.chi, all->of_chi, pace, all->unit);
    for (int64_t k = 0; k < all->cells.devices.count; k++) served += step_phi(all, k, pace);
    const double scarce = (double)(all->limits.steps * all->limits.per_step) - served;
    all->now.nu -= step_down(scarce, all->of_nu.mean, all->of_nu.square, pace, all->unit);
    all->now.nu = most(all->now.nu, all->least_nu);
}

/* first * (last / first)^(turn / turns) */
static double between_rates(double first, double last, double done)
{
    return first * exp_of_negative(done * log_of(last / first, 0));
}

/* Potentials to begin with: a part of what devices earn beyond the start and the price. */
static void begin_potentials(Descent *all, double value)
{
    const Devices *devices = &all->cells.devices;
    for (int64_t k = 0; k < devices->count; k++) {
        const Window *window = all->now.window + k;
        const double least_worth = most(all->now.nu, worth(devices, k, (Point){0.0, 0.0}));
        double *phi = phi_of(all, k);
        for (int64_t i = 0; i < window->mesh.vertices; i++)
            phi[i] = most(0.0, worth(devices, k, vertex_at(&window->mesh, i)) - least_worth);
        if (window->mesh.start >= 0) phi[window->mesh.start] = 0.0;
        keep_within(window, &all->now.mesh, INFINITY, phi);
    }
    const double share = least(1.0, value / most(work_out(all, &all->coarse), 1e-300));
    for (int64_t k = 0; k < devices->count; k++)
        for (int64_t i = 0; i < all->now.window[k].mesh.vertices; i++) phi_of(all, k)[i] *= share;
}

/* What the last place is worth in a plan that uses all of them; 0 in others. */
static double price_of_place(const Devices *devices, const Limits *limits, const Plan *plan)
{
    double cheapest = INFINITY;
    int64_t used = 0;
    for (int64_t k = 0; k < devices->count; k++)
        if (plan->assigned[k] >= 0) {
            cheapest = least(cheapest, worth(devices, k, plan->way[plan->assigned[k]]));
            used++;
        }
    return used < limits->steps * limits->per_step ? 0.0 : cheapest;
}

/* The devices that can be worth a good part of the price of a place, into `at` and `delta`; the
   others earn at most `left_out` each. */
static Devices dear_devices(
    const Devices *devices, double price, Point *at, double *delta, double *left_out)
{
    Devices dear = *devices;
    dear.count = 0;
    dear.at = at;
    dear.delta = delta;
    *left_out = 0.0;
    for (int64_t k = 0; k < devices->count; k++) {
        const double best = devices->delta[k] * devices->table[0];
        if (best < DEAR * price) {
            *left_out = most(*left_out, devices->delta[k]);
            continue;
        }
        at[dear.count] = devices->at[k];
        delta[dear.count++] = devices->delta[k];
    }
    return dear;
}

/* Go on with the same potentials on the finer mesh. */
static void refine(Descent *all)
{
    const Mesh mesh = all->now.mesh, fine = finer_mesh(&mesh);
    for (int64_t k = 0; k < all->cells.devices.count; k++) {
        Window *window = all->now.window + k;
        double *phi = phi_of(all, k);
        memcpy(all->gradient, phi, (size_t)window->mesh.vertices * sizeof(double));
        refine_function(&window->mesh, all->gradient, phi);
        window->mesh = finer_mesh(&window->mesh);
        window->corner = finer_vertex(&mesh, &fine, window->corner);
    }
    memcpy(all->gradient, all->now.chi, (size_t)mesh.vertices * sizeof(double));
    refine_function(&mesh, all->gradient, all->now.chi);
    all->now.mesh = fine;
    fill_samples(all);
}

static void forget(const Moments *of, int64_t count)
{
    memset(of->mean, 0, (size_t)count * sizeof(double));
    memset(of->square, 0, (size_t)count * sizeof(double));
}

/* What there is time for. */
static int64_t most_turns(const Descent *all)
{
    if (all->values == 0) return 0;
    return DEVICE_TURNS / all->cells.devices.count;
}

/* The turn from which on the mesh after so many is the one; after the last, that of the end. */
static int64_t turn_of_mesh(int64_t turns, int meshes, int after)
{
    if (after == meshes) return turns;
    return meshes == MOST_MESHES ? turns * (after == 1 ? 3 : 8) / 10 : turns * after / meshes;
}

/* Lower the bound by so many turns, the later ones on finer meshes, or until it is `enough`;
   returns the turns. */
static int64_t descend(
    Descent *all, int64_t turns, double price, double value, double enough, double *bound)
{
    const Devices *devices = &all->cells.devices;
    const Course *course = all->meshes == MOST_MESHES ? &LONG : &SHORT;
    const double among = course->shared ? FEW_DEVICES + (double)devices->count : 1.0;
    double mean_left = 1.0, square_left = 1.0;
    int mesh = 1;
    fill_rises(&all->cells);
    all->least_nu *= all->cells.upper[0];
    all->unit = 0.0;
    for (int64_t k = 0; k < devices->count; k++)
        all->unit = most(all->unit, devices->delta[k] * all->cells.upper[0]);
    open_windows(all, radius_of(devices, &all->now.mesh, all->meshes));
    fill_samples(all);
    all->now.nu = most(price, all->least_nu);
    begin_potentials(all, value);
    *bound = INFINITY;
    for (int64_t turn = 0; turn < turns; turn++) {
        const double done = (double)turn / (double)turns;
        if (turn == turn_of_mesh(turns, all->meshes, mesh)) {
            refine(all);
            if (++mesh == MOST_MESHES) all->coarse = directions(MORE_AXES);
            forget(&all->of_phi, all->values);
            forget(&all->of_chi, all->now.mesh.vertices);
            forget(&all->of_nu, 1);
            mean_left = square_left = 1.0;
        }
        mean_left *= MEAN_KEPT;
        square_left *= SQUARE_KEPT;
        const double rate =
            between_rates(course->rate, course->last_rate, done) * course->slower[mesh - 1];
        const Pace pace = {rate / among, 1.0 - mean_left, 1.0 - square_left};
        turn_down(all, between_rates(HEAT, course->last_heat, done), pace);
        if (turn + 1 == turns || turn + 1 == turn_of_mesh(turns, all->meshes, mesh)) {
            *bound = least(*bound, bound_by_potentials(all));
            if (*bound <= enough) return turn + 1;
        }
    }
    return turns;
}

#endif
