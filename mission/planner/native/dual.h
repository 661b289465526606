/* Minimising the Lagrangian of one visiting order: Newton steps on its barrier.

   The system is block-tridiagonal with one dense row for mu, so that a step costs some tens of
   operations a stop. */
#ifndef DUAL_H
#define DUAL_H

#include "lagrangian.h"

enum { MAX_NEWTON = 60, MAX_HALVINGS = 20 };
static const double EPS_START = 30.0;  /* the barrier starts heavier: starts are not centred */
static const double EPS_FACTOR = 0.15; /* it gets lighter by this once the decrement is under */
static const double CENTRED = 0.5;     /* this many barrier weights a leg */
static const double TO_BOUNDARY = 0.8; /* share of the way to a cone that a step may go */

typedef struct {
    double mu;        /* step of the multiplier; those of y are in `work.a` */
    double decrement; /* squared */
} Step;

/* The Newton step. The off-diagonal block between k and k + 1 is minus the Hessian of device k. */
static Step newton_step(int64_t m, Work *work, double slope, double bend)
{
    Point *a = work->a, *b = work->b;
    for (int64_t k = 0; k < m; k++) {
        a[k] = (Point){-work->gradient[k].x, -work->gradient[k].y};
        b[k] = work->cross[k];
        if (k > 0) {
            /* Eliminate with block k - 1 (already inverted in place) and off-diagonal -o. */
            const Sym o = work->device[k - 1], i = work->block[k - 1];
            const double mxx = o.xx * i.xx + o.xy * i.xy, mxy = o.xx * i.xy + o.xy * i.yy;
            const double myx = o.xy * i.xx + o.yy * i.xy, myy = o.xy * i.xy + o.yy * i.yy;
            work->block[k].xx -= mxx * o.xx + mxy * o.xy;
            work->block[k].xy -= mxx * o.xy + mxy * o.yy;
            work->block[k].yy -= myx * o.xy + myy * o.yy;
            a[k].x += mxx * a[k - 1].x + mxy * a[k - 1].y;
            a[k].y += myx * a[k - 1].x + myy * a[k - 1].y;
            b[k].x += mxx * b[k - 1].x + mxy * b[k - 1].y;
            b[k].y += myx * b[k - 1].x + myy * b[k - 1].y;
        }
        work->block[k] = inverse_of(work->block[k]);
    }
    for (int64_t k = m - 1; k >= 0; k--) {
        if (k + 1 < m) {
            const Point p = times(work->device[k], a[k + 1]), q = times(work->device[k], b[k + 1]);
            a[k] = (Point){a[k].x + p.x, a[k].y + p.y};
            b[k] = (Point){b[k].x + q.x, b[k].y + q.y};
        }
        a[k] = times(work->block[k], a[k]);
        b[k] = times(work->block[k], b[k]);
    }
    double top = -slope, bottom = bend;
    for (int64_t k = 0; k < m; k++) {
        top -= work->cross[k].x * a[k].x + work->cross[k].y * a[k].y;
        bottom -= work->cross[k].x * b[k].x + work->cross[k].y * b[k].y;
    }
    Step step = {top / bottom, -slope * (top / bottom)};
    for (int64_t k = 0; k < m; k++) {
        a[k].x -= step.mu * b[k].x;
        a[k].y -= step.mu * b[k].y;
        step.decrement -= work->gradient[k].x * a[k].x + work->gradient[k].y * a[k].y;
    }
    return step;
}

/* The share of the step, at most 1, that stays well inside all cones. */
static double step_limit(int64_t m, const Point *y, double mu, double dmu, const Work *work)
{
    double limit = 1.0;
    for (int64_t k = 0; k < m; k++) {
        const double c2 = work->factor[k] * work->factor[k];
        const Point p = y[k], d = work->a[k];
        /* c^2 (mu + alpha dmu)^2 - |y + alpha step|^2 = t + 2 b alpha + a alpha^2 */
        const double t = c2 * mu * mu - p.x * p.x - p.y * p.y;
        const double b = c2 * mu * dmu - p.x * d.x - p.y * d.y;
        const double a = c2 * dmu * dmu - d.x * d.x - d.y * d.y;
        const double root = b * b - a * t;
        if (root >= 0.0) {
            const double denominator = -b + sqrt(root);
            if (denominator > 0.0) limit = least(limit, TO_BOUNDARY * t / denominator);
        }
    }
    return dmu < 0.0 ? least(limit, -TO_BOUNDARY * mu / dmu) : limit;
}

/* What a bound is wanted for. */
typedef struct {
    double eps;    /* barrier weight */
    double enough; /* a bound at or under this closes the node: its path is of no interest then */
    double loose;  /* stop once what is left to gain is under this share of the excess over it */
} Aim;

typedef struct {
    double bound; /* the least found */
    int64_t steps;
    int centred; /* whether the steps ended well */
} Minimum;

/* Minimise from inside the cones; the node's y and mu are moved to the minimiser. */
static Minimum minimise(Node *node, const Problem *problem, Aim aim, Work *work)
{
    const int64_t m = node->size;
    double weight = aim.eps * EPS_START;
    Value now = evaluate(node, problem, weight, node->y, node->mu, work);
    Minimum found = {now.bound, 0, 0};
    double barrier = now.barrier;
    while (found.steps < MAX_NEWTON && found.bound > aim.enough) {
        found.steps++;
        Step step = newton_step(m, work, now.slope, now.bend);
        if (!(step.decrement > CENTRED * weight * (double)m)) {
            if (weight <= aim.eps ||
                2.0 * (double)m * weight < aim.loose * (found.bound - aim.enough)) {
                found.centred = 1;
                break;
            }
            weight = most(weight * EPS_FACTOR, aim.eps);
            now = evaluate(node, problem, weight, node->y, node->mu, work);
            barrier = now.barrier;
            step = newton_step(m, work, now.slope, now.bend);
        }
        double alpha = step_limit(m, node->y, node->mu, step.mu, work), mu = node->mu;
        int moved = 0;
        for (int i = 0; i < MAX_HALVINGS && !moved; i++) {
            for (int64_t k = 0; k < m; k++)
                work->y[k] = (Point){
                    node->y[k].x + alpha * work->a[k].x, node->y[k].y + alpha * work->a[k].y};
            mu = node->mu + alpha * step.mu;
            now = evaluate(node, problem, weight, work->y, mu, work);
            moved = now.barrier <= barrier - 1e-4 * alpha * step.decrement;
            if (!moved) alpha *= 0.5;
        }
        if (!moved) break;
        memcpy(node->y, work->y, (size_t)m * sizeof(Point));
        node->mu = mu;
        barrier = now.barrier;
        found.bound = least(found.bound, now.bound);
    }
    found.centred = found.centred || found.bound <= aim.enough;
    return found;
}

#endif
