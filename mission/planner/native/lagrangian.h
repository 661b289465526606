/* The Lagrangian of visiting orders: a bound for any multipliers, and its derivatives.

   Stops v_1..v_m follow the start v_0 (the origin here) in a fixed order; stop k serves a device
   at u_k from a distance within [lo_k, hi_k]. For any y_1..y_m with |y_k| <= c_k mu, and
   y_{m+1} = 0,

       mu L + sum_k [ delta_k H_k(|w_k| / delta_k) - w_k . u_k ],      w_k = y_k - y_{k+1}

   bounds what any such path of length L can earn. (c_k = 1; a leg known to have length zero may
   cost anything, so its y_k is left nearly free.) It is convex in (y, mu). The barrier
   -eps log(c^2 mu^2 - |y|^2) a leg keeps every iterate inside the cones, hence every value a bound,
   and its minimiser is within 2 m eps of the least one. The slopes r_k = H_k' give back the path.

   Orders of the same number of stops are worked out side by side, each in a lane of its own: what comes
   out of a lane does not depend on the others. */
#ifndef LAGRANGIAN_H
#define LAGRANGIAN_H

#include "ascent.h"
#include "elementary.h"
#include "node.h"
#include "wide.h"

static const double FREE = 40.0; /* c of a leg known to have length zero */
static const double FLAT = 0.05; /* least curvature of H, as a share of the mean one */

typedef struct {
    Devices devices;
    Limits limits;
    Relaxation relaxation;
} Problem;

typedef struct {
    Wide x, y;
} WidePoint;

typedef struct {
    Wide xx, xy, yy;
} WideSym;

/* H of a distance interval in each lane. */
typedef struct {
    const double *coefficients[LENGTH];
    Wide rate; /* 1 / spacing */
    Wide end;  /* s from which on H is straight, */
    Wide outer; /* and its slope there */
} Intervals;

/* A stop, and the leg before it. */
typedef struct {
    WidePoint at; /* u */
    Wide delta, rate; /* 1 / delta */
    Wide cone;        /* c^2 */
    Wide floor;       /* least curvature of H */
    Intervals interval;
    WidePoint y, trial; /* multipliers, and those to look at */
    WidePoint gradient; /* at the trial, by y */
    WidePoint cross;    /* d2 / dy dmu */
    WideSym block;      /* diagonal block of the Hessian; once eliminated, its inverse */
    WideSym device;     /* Hessian of delta H */
    WidePoint a, b;     /* solutions of the block system: in the end, the Newton step is in a */
    WidePoint step;     /* that is tried */
} Link;

typedef struct {
    int64_t size; /* stops */
    Link link[MOST_DEVICES];
    Wide mu, trial_mu;
    Wide length; /* that legs may have, each counted as often as its cone is wide */
    Wide promise[MOST_DEVICES], hover[MOST_DEVICES]; /* of devices off the order; of timed ones */
    double soft; /* edges of what is rounded, in units of y */
    Wide weight;         /* eps */
    Wide bound, barrier; /* at the trial, without and with the barrier */
    Wide slope, bend;    /* d/dmu, d2/dmu2 */
    Wide mu_step, decrement; /* of the Newton step, of which y's part is in the links; squared */
} Lanes;

/* H, H', H'' */
typedef struct {
    Wide h, slope, bend;
} Conjugates;

/* Of each lane's distance interval at s >= 0; `splines` is the number of coefficients. */
static inline Conjugates conjugates(Wide s, const Intervals *of, int64_t splines)
{
    const Wide x = s * of->rate;
    const Mask near = (Mask)(x < (double)(splines - 3));
    Wide c[4], t;
    for (int i = 0; i < LENGTH; i++) {
        const int64_t part = near[i] ? (int64_t)x[i] : splines - 4;
        const double *from = of->coefficients[i] + part;
        for (int j = 0; j < 4; j++) c[j][i] = from[j];
        t[i] = x[i] - (double)part;
    }
    const Wide q = 1.0 - t;
    Wide h = c[0] * q * q * q + c[1] * (3.0 * t * t * t - 6.0 * t * t + 4.0);
    h += c[2] * (-3.0 * t * t * t + 3.0 * t * t + 3.0 * t + 1.0) + c[3] * t * t * t;
    Wide slope = -c[0] * q * q + c[1] * (3.0 * t * t - 4.0 * t) + c[2] * (-3.0 * t * t + 2.0 * t + 1.0);
    slope += c[3] * t * t;
    const Wide bend = c[0] * q + c[1] * (3.0 * t - 2.0) + c[2] * (1.0 - 3.0 * t) + c[3] * t;
    const Wide straight = (c[1] + 4.0 * c[2] + c[3]) * (1.0 / 6.0) + of->outer * (s - of->end);
    return (Conjugates){
        choose(near, h * (1.0 / 6.0), straight),
        choose(near, 0.5 * slope * of->rate, of->outer),
        choose(near, bend * (of->rate * of->rate), all_of(0.0)),
    };
}

/* The outer radius of a distance interval. */
static inline double outer_of(const Relaxation *relaxation, int64_t row)
{
    return relaxation->radius_m[relaxation->ends[2 * row + 1]];
}

/* Let a lane have a distance interval. */
static inline void put_interval(Intervals *of, int i, int64_t row, const Relaxation *relaxation)
{
    of->coefficients[i] = relaxation->coefficients + row * relaxation->splines;
    of->rate[i] = 1.0 / relaxation->spacing[row];
    of->end[i] = (double)(relaxation->splines - 3) * relaxation->spacing[row];
    of->outer[i] = outer_of(relaxation, row);
}

typedef struct {
    double h, slope;
} Conjugate;

/* (H, H') of a distance interval at s >= 0. */
static inline Conjugate conjugate_at(double s, int64_t row, const Relaxation *relaxation)
{
    Intervals interval;
    for (int i = 0; i < LENGTH; i++) put_interval(&interval, i, row, relaxation);
    const Conjugates at = conjugates(all_of(s), &interval, relaxation->splines);
    return (Conjugate){at.h[0], at.slope[0]};
}

static inline Wide wide_root(Wide a)
{
    for (int i = 0; i < LENGTH; i++) a[i] = sqrt(a[i]);
    return a;
}

static inline Wide wide_most(Wide a, Wide b) { return choose((Mask)(b > a), b, a); }

static inline Wide wide_least(Wide a, Wide b) { return choose((Mask)(b < a), b, a); }

static inline WidePoint wide_less(WidePoint a, WidePoint b)
{
    return (WidePoint){a.x - b.x, a.y - b.y};
}

static inline WidePoint wide_times(WideSym a, WidePoint p)
{
    return (WidePoint){a.xx * p.x + a.xy * p.y, a.xy * p.x + a.yy * p.y};
}

static inline void wide_add_to(WideSym *sum, WideSym part)
{
    sum->xx += part.xx;
    sum->xy += part.xy;
    sum->yy += part.yy;
}

/* Positive normal numbers as mantissas, in [1, 2), and powers of two, which are added to. */
static inline Wide wide_split(Wide x, Mask *power)
{
    *power += ((Mask)x >> 52) - 1023;
    return (Wide)(((Mask)x & 0x000fffffffffffff) | 0x3ff0000000000000);
}

/* What devices off the order bring at most where metres have a price: a rounded max(0, promise -
   price hover), and its first and second derivative by price. */
static inline Conjugates left_over(Wide promise, Wide hover, Wide price, double soft)
{
    const Wide x = promise - price * hover, width = hover * soft + 1e-12;
    const Wide root = wide_root(x * x + width * width), share = width / root;
    return (Conjugates){
        0.5 * (x + root), -0.5 * hover * (1.0 + x / root), 0.5 * hover * hover * share * share / root};
}

static inline double left_over_at(double promise, double hover, double price, double soft)
{
    return left_over(all_of(promise), all_of(hover), all_of(price), soft).h[0];
}

static void look_beside(Lanes *all, const Problem *problem)
{
    for (int64_t k = 0; k < problem->devices.count; k++) {
        const Conjugates at = left_over(all->promise[k], all->hover[k], all->trial_mu, all->soft);
        all->bound += at.h;
        all->slope += at.slope;
        all->bend += at.bend;
    }
}

/* The barrier and its derivatives; outside the cones it is infinite. */
static void look_at_barrier(Lanes *all)
{
    const Wide mu = all->trial_mu, eps = all->weight, length = all->length;
    Mask outside = (Mask)(mu <= 0.0), power = {0};
    Wide product = all_of(1.0);
    all->slope = length;
    all->bend = all_of(0.0);
    for (Link *link = all->link; link < all->link + all->size; link++) {
        const WidePoint y = link->trial;
        const Wide c2 = link->cone, t = c2 * mu * mu - y.x * y.x - y.y * y.y;
        outside |= (Mask)(t <= 0.0);
        product *= wide_split(t, &power); /* the sum of logarithms is that of the product */
        const Wide inverse = 1.0 / t, e = eps * inverse, f = 4.0 * e * inverse;
        link->gradient = (WidePoint){2.0 * e * y.x, 2.0 * e * y.y};
        link->block = (WideSym){
            2.0 * e + f * y.x * y.x, f * y.x * y.y, 2.0 * e + f * y.y * y.y};
        link->cross = (WidePoint){-f * c2 * mu * y.x, -f * c2 * mu * y.y};
        all->slope -= 2.0 * e * c2 * mu;
        all->bend += -2.0 * e * c2 + f * c2 * c2 * mu * mu;
    }
    Wide logarithm;
    for (int i = 0; i < LENGTH; i++) logarithm[i] = log_of(product[i], power[i]);
    all->bound = choose(outside, all_of(INFINITY), mu * length);
    all->barrier = -eps * logarithm;
}

/* Look at the trials: values, gradients and blocks. */
static void look(Lanes *all, const Problem *problem)
{
    look_at_barrier(all);
    if (problem->devices.hover) look_beside(all, problem);
    for (int64_t k = 0; k < all->size; k++) {
        Link *link = all->link + k, *next = k + 1 < all->size ? link + 1 : NULL;
        const WidePoint w = next ? wide_less(link->trial, next->trial) : link->trial, u = link->at;
        const Wide delta = link->delta, z = wide_root(w.x * w.x + w.y * w.y), s = z * link->rate;
        const Conjugates at = conjugates(s, &link->interval, problem->relaxation.splines);
        all->bound += delta * at.h - w.x * u.x - w.y * u.y;
        const Mask turned = (Mask)(s > 1e-12);
        const Wide inverse = 1.0 / z, none = all_of(0.0);
        const Wide nx = choose(turned, w.x * inverse, none + 1.0), ny = choose(turned, w.y * inverse, none);
        /* Where H is straight it has no curvature and Newton steps would be unlimited. */
        const Wide radial = wide_most(at.bend, link->floor) * link->rate;
        const Wide bend = choose(turned, at.slope * (delta * inverse), at.bend);
        const Wide around = wide_most(bend, link->floor) * link->rate;
        link->device = (WideSym){
            around + (radial - around) * nx * nx, (radial - around) * nx * ny,
            around + (radial - around) * ny * ny};
        const WidePoint slope = {at.slope * nx - u.x, at.slope * ny - u.y};
        link->gradient.x += slope.x;
        link->gradient.y += slope.y;
        wide_add_to(&link->block, link->device);
        if (!next) break;
        next->gradient = wide_less(next->gradient, slope);
        wide_add_to(&next->block, link->device);
    }
    all->barrier = choose((Mask)(all->bound < INFINITY), all->barrier + all->bound, all_of(INFINITY));
}

#endif
