/* The Lagrangian of one visiting order: a bound for any multipliers, and its derivatives.

   Stops v_1..v_m follow the start v_0 (the origin here) in a fixed order; stop k serves a device
   at u_k from a distance within [lo_k, hi_k]. For any y_1..y_m with |y_k| <= c_k mu, and
   y_{m+1} = 0,

       mu L + sum_k [ delta_k H_k(|w_k| / delta_k) - w_k . u_k ],      w_k = y_k - y_{k+1}

   bounds what any such path of length L can earn. (c_k = 1; a leg known to have length zero may
   cost anything, so its y_k is left nearly free.) It is convex in (y, mu). The barrier
   -eps log(c^2 mu^2 - |y|^2) a leg keeps every iterate inside the cones, hence every value a bound,
   and its minimiser is within 2 m eps of the least one. The slopes r_k = H_k' give back the path. */
#ifndef LAGRANGIAN_H
#define LAGRANGIAN_H

#include "ascent.h"
#include "elementary.h"
#include "tree.h"

static const double FREE = 40.0; /* c of a leg known to have length zero */
static const double FLAT = 0.05; /* least curvature of H, as a share of the mean one */

typedef struct {
    Devices devices;
    Limits limits;
    Relaxation relaxation;
} Problem;

/* Memory of one Newton method. */
typedef struct {
    Point y[MOST_DEVICES]; /* trial point */
    Point gradient[MOST_DEVICES];
    Point cross[MOST_DEVICES];            /* d2 / dy dmu */
    Sym block[MOST_DEVICES];              /* diagonal blocks */
    Sym device[MOST_DEVICES];             /* Hessians of delta H */
    Point a[MOST_DEVICES], b[MOST_DEVICES]; /* solutions of the block system */
    double factor[MOST_DEVICES];          /* c */
} Work;

typedef struct {
    double h, slope, bend;
} Conjugate;

/* (H, H', H'') of a distance interval at s >= 0. */
static inline Conjugate spline(double s, int64_t row, const Relaxation *relaxation)
{
    const double *c = relaxation->coefficients + row * relaxation->splines;
    const double spacing = relaxation->spacing[row], x = s / spacing;
    const int64_t last = relaxation->splines - 3;
    if (x >= (double)last) {
        const double h = (c[last] + 4.0 * c[last + 1] + c[last + 2]) / 6.0;
        const double outer = relaxation->outer_m[row];
        return (Conjugate){h + outer * (s - (double)last * spacing), outer, 0.0};
    }
    const int64_t i = (int64_t)x;
    const double t = x - (double)i, q = 1.0 - t;
    const double c0 = c[i], c1 = c[i + 1], c2 = c[i + 2], c3 = c[i + 3];
    double h = c0 * q * q * q + c1 * (3.0 * t * t * t - 6.0 * t * t + 4.0);
    h += c2 * (-3.0 * t * t * t + 3.0 * t * t + 3.0 * t + 1.0) + c3 * t * t * t;
    double slope =
        -c0 * q * q + c1 * (3.0 * t * t - 4.0 * t) + c2 * (-3.0 * t * t + 2.0 * t + 1.0);
    slope += c3 * t * t;
    const double bend = c0 * q + c1 * (3.0 * t - 2.0) + c2 * (1.0 - 3.0 * t) + c3 * t;
    return (Conjugate){h / 6.0, 0.5 * slope / spacing, bend / (spacing * spacing)};
}

typedef struct {
    double bound, barrier; /* without and with the barrier */
    double slope, bend;    /* d/dmu, d2/dmu2 */
} Value;

/* The barrier and its derivatives; outside the cones it is infinite, and nothing else is done. */
static Value barrier_at(int64_t m, double length, double eps, const Point *y, double mu, Work *work)
{
    double product = 1.0, slope = length, bend = 0.0;
    int64_t power = 0;
    for (int64_t k = 0; k < m; k++) {
        const double c2 = work->factor[k] * work->factor[k];
        const double t = c2 * mu * mu - y[k].x * y[k].x - y[k].y * y[k].y;
        if (t <= 0.0 || mu <= 0.0) return (Value){INFINITY, INFINITY, 0.0, 0.0};
        product *= split(t, &power); /* the sum of logarithms is that of the product */
        const double e = eps / t, f = 4.0 * e / t;
        work->gradient[k] = (Point){2.0 * e * y[k].x, 2.0 * e * y[k].y};
        work->block[k] = (Sym){
            2.0 * e + f * y[k].x * y[k].x, f * y[k].x * y[k].y, 2.0 * e + f * y[k].y * y[k].y};
        work->cross[k] = (Point){-f * c2 * mu * y[k].x, -f * c2 * mu * y[k].y};
        slope -= 2.0 * e * c2 * mu;
        bend += -2.0 * e * c2 + f * c2 * c2 * mu * mu;
    }
    return (Value){mu * length, -eps * log_of(product, power), slope, bend};
}

/* The value at (y, mu); gradient and blocks go into `work`. */
static Value evaluate(
    const Node *node, const Problem *problem, double eps, const Point *y, double mu, Work *work)
{
    const Devices *devices = &problem->devices;
    const Relaxation *relaxation = &problem->relaxation;
    const int64_t m = node->size;
    Value value = barrier_at(m, problem->limits.length, eps, y, mu, work);
    if (value.bound == INFINITY) return value;
    for (int64_t k = 0; k < m; k++) {
        const Point w = k + 1 < m ? less(y[k], y[k + 1]) : y[k];
        const Point u = devices->at[node->order[k]];
        const int64_t row = node->interval[k];
        const double delta = devices->delta[node->order[k]];
        const double z = sqrt(w.x * w.x + w.y * w.y), s = z / delta;
        const Conjugate at = spline(s, row, relaxation);
        value.bound += delta * at.h - w.x * u.x - w.y * u.y;
        /* Where H is straight it has no curvature and Newton steps would be unlimited. */
        const double floor = FLAT * relaxation->outer_m[row] /
                             (relaxation->spacing[row] * (double)(relaxation->splines - 3));
        double nx = 1.0, ny = 0.0, across = at.bend;
        if (s > 1e-12) {
            nx = w.x / z;
            ny = w.y / z;
            across = at.slope / s;
        }
        const Sym bend = along(most(at.bend, floor) / delta, most(across, floor) / delta, nx, ny);
        const Point slope = {at.slope * nx - u.x, at.slope * ny - u.y};
        work->device[k] = bend;
        work->gradient[k].x += slope.x;
        work->gradient[k].y += slope.y;
        add_to(&work->block[k], bend);
        if (k + 1 < m) {
            work->gradient[k + 1] = less(work->gradient[k + 1], slope);
            add_to(&work->block[k + 1], bend);
        }
    }
    value.barrier += value.bound;
    return value;
}

#endif
