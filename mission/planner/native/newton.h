/* Newton steps on the barrier of the Lagrangian, in every lane.

   The system is block-tridiagonal with one dense row for mu, so that a step costs some tens of
   operations a stop. */
#ifndef NEWTON_H
#define NEWTON_H

#include "lagrangian.h"

static const double TO_BOUNDARY = 0.8; /* share of the way to a cone that a step may go */

/* The Newton step. The off-diagonal block between k and k + 1 is minus the Hessian of device k. */
static void step_newton(Lanes *all)
{
    const int64_t m = all->size;
    for (int64_t k = 0; k < m; k++) {
        Link *link = all->link + k;
        link->a = (WidePoint){-link->gradient.x, -link->gradient.y};
        link->b = link->cross;
        if (k > 0) {
            /* Eliminate with block k - 1 (already inverted in place) and off-diagonal -o. */
            const Link *last = link - 1;
            const WideSym o = last->device, i = last->block;
            const Wide mxx = o.xx * i.xx + o.xy * i.xy, mxy = o.xx * i.xy + o.xy * i.yy;
            const Wide myx = o.xy * i.xx + o.yy * i.xy, myy = o.xy * i.xy + o.yy * i.yy;
            link->block.xx -= mxx * o.xx + mxy * o.xy;
            link->block.xy -= mxx * o.xy + mxy * o.yy;
            link->block.yy -= myx * o.xy + myy * o.yy;
            link->a.x += mxx * last->a.x + mxy * last->a.y;
            link->a.y += myx * last->a.x + myy * last->a.y;
            link->b.x += mxx * last->b.x + mxy * last->b.y;
            link->b.y += myx * last->b.x + myy * last->b.y;
        }
        const WideSym block = link->block;
        const Wide inverse = 1.0 / (block.xx * block.yy - block.xy * block.xy);
        link->block = (WideSym){block.yy * inverse, -block.xy * inverse, block.xx * inverse};
    }
    for (int64_t k = m - 1; k >= 0; k--) {
        Link *link = all->link + k;
        if (k + 1 < m) {
            const WidePoint p = wide_times(link->device, link[1].a);
            const WidePoint q = wide_times(link->device, link[1].b);
            link->a = (WidePoint){link->a.x + p.x, link->a.y + p.y};
            link->b = (WidePoint){link->b.x + q.x, link->b.y + q.y};
        }
        link->a = wide_times(link->block, link->a);
        link->b = wide_times(link->block, link->b);
    }
    Wide top = -all->slope, bottom = all->bend;
    for (int64_t k = 0; k < m; k++) {
        const Link *link = all->link + k;
        top -= link->cross.x * link->a.x + link->cross.y * link->a.y;
        bottom -= link->cross.x * link->b.x + link->cross.y * link->b.y;
    }
    all->mu_step = top / bottom;
    all->decrement = -all->slope * (top / bottom);
    for (int64_t k = 0; k < m; k++) {
        Link *link = all->link + k;
        link->a.x -= all->mu_step * link->b.x;
        link->a.y -= all->mu_step * link->b.y;
        all->decrement -= link->gradient.x * link->a.x + link->gradient.y * link->a.y;
    }
}

/* The share of the step, at most 1, that stays well inside all cones. */
static Wide step_limit(const Lanes *all)
{
    const Wide dmu = all->mu_step;
    Wide limit = all_of(1.0);
    for (int64_t k = 0; k < all->size; k++) {
        const Link *link = all->link + k;
        const Wide c2 = link->cone;
        const WidePoint p = link->y, d = link->a;
        /* c^2 (mu + alpha dmu)^2 - |y + alpha step|^2 = t + 2 b alpha + a alpha^2 */
        const Wide t = c2 * all->mu * all->mu - p.x * p.x - p.y * p.y;
        const Wide b = c2 * all->mu * dmu - p.x * d.x - p.y * d.y;
        const Wide a = c2 * dmu * dmu - d.x * d.x - d.y * d.y;
        const Wide root = b * b - a * t, denominator = -b + wide_root(root);
        const Mask meets = (Mask)(root >= 0.0) & (Mask)(denominator > 0.0);
        limit = choose(meets, wide_least(limit, TO_BOUNDARY * t / denominator), limit);
    }
    return choose((Mask)(dmu < 0.0), wide_least(limit, -TO_BOUNDARY * all->mu / dmu), limit);
}

#endif
