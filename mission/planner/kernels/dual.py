"""Minimising the Lagrangian of one visiting order: Newton steps on its barrier.

The system is block-tridiagonal with one dense row for mu, so that a step costs some tens of
operations a stop.
"""

import math

from mission.planner.kernels.compiled import Indices, Matrix, Vector, compiled
from mission.planner.kernels.instance import Devices, Relaxation
from mission.planner.kernels.lagrangian import Work, evaluate

MAX_NEWTON = 60
EPS_START = 30.0  # the barrier starts that much heavier, since starts are not centred
EPS_FACTOR = 0.15  # and gets lighter by this each time the decrement is under
CENTRED = 0.5  # this many barrier weights a leg
TO_BOUNDARY = 0.8  # share of the way to the boundary of a cone that a step may go
MAX_HALVINGS = 20


@compiled
def newton_step(m: int, work: Work, slope: float, bend: float) -> tuple[float, float]:
    """Solve for the Newton step into `work.a`; returns (dmu, Newton decrement squared).

    The off-diagonal block between k and k + 1 is minus the Hessian of device k.
    """
    for k in range(m):
        work.a[k, 0], work.a[k, 1] = -work.gradient[k, 0], -work.gradient[k, 1]
        work.b[k, 0], work.b[k, 1] = work.cross[k, 0], work.cross[k, 1]
        if k > 0:
            # Eliminate with block k - 1 (already inverted in place) and off-diagonal -A.
            axx, axy, ayy = work.device[k - 1, 0], work.device[k - 1, 1], work.device[k - 1, 2]
            ixx, ixy, iyy = work.block[k - 1, 0], work.block[k - 1, 1], work.block[k - 1, 2]
            mxx, mxy = axx * ixx + axy * ixy, axx * ixy + axy * iyy
            myx, myy = axy * ixx + ayy * ixy, axy * ixy + ayy * iyy
            work.block[k, 0] -= mxx * axx + mxy * axy
            work.block[k, 1] -= mxx * axy + mxy * ayy
            work.block[k, 2] -= myx * axy + myy * ayy
            px, py = work.a[k - 1, 0], work.a[k - 1, 1]
            qx, qy = work.b[k - 1, 0], work.b[k - 1, 1]
            work.a[k, 0] += mxx * px + mxy * py
            work.a[k, 1] += myx * px + myy * py
            work.b[k, 0] += mxx * qx + mxy * qy
            work.b[k, 1] += myx * qx + myy * qy
        bxx, bxy, byy = work.block[k, 0], work.block[k, 1], work.block[k, 2]
        det = bxx * byy - bxy * bxy
        work.block[k, 0], work.block[k, 1], work.block[k, 2] = byy / det, -bxy / det, bxx / det
    for k in range(m - 1, -1, -1):
        ax, ay = work.a[k, 0], work.a[k, 1]
        bx, by = work.b[k, 0], work.b[k, 1]
        if k + 1 < m:
            axx, axy, ayy = work.device[k, 0], work.device[k, 1], work.device[k, 2]
            ax += axx * work.a[k + 1, 0] + axy * work.a[k + 1, 1]
            ay += axy * work.a[k + 1, 0] + ayy * work.a[k + 1, 1]
            bx += axx * work.b[k + 1, 0] + axy * work.b[k + 1, 1]
            by += axy * work.b[k + 1, 0] + ayy * work.b[k + 1, 1]
        ixx, ixy, iyy = work.block[k, 0], work.block[k, 1], work.block[k, 2]
        work.a[k, 0], work.a[k, 1] = ixx * ax + ixy * ay, ixy * ax + iyy * ay
        work.b[k, 0], work.b[k, 1] = ixx * bx + ixy * by, ixy * bx + iyy * by
    top = -slope
    bottom = bend
    for k in range(m):
        top -= work.cross[k, 0] * work.a[k, 0] + work.cross[k, 1] * work.a[k, 1]
        bottom -= work.cross[k, 0] * work.b[k, 0] + work.cross[k, 1] * work.b[k, 1]
    dmu = top / bottom
    decrement = -slope * dmu
    for k in range(m):
        work.a[k, 0] -= dmu * work.b[k, 0]
        work.a[k, 1] -= dmu * work.b[k, 1]
        decrement -= work.gradient[k, 0] * work.a[k, 0] + work.gradient[k, 1] * work.a[k, 1]
    return dmu, decrement


@compiled
def step_limit(m: int, factor: Vector, y: Matrix, mu: float, dmu: float, step: Matrix) -> float:
    """The step length, at most 1, that stays well inside all cones."""
    limit = 1.0
    for k in range(m):
        c2 = factor[k] * factor[k]
        # c^2 (mu + alpha dmu)^2 - |y + alpha step|^2 = t + 2 b alpha + a alpha^2
        t = c2 * mu * mu - y[k, 0] * y[k, 0] - y[k, 1] * y[k, 1]
        b = c2 * mu * dmu - y[k, 0] * step[k, 0] - y[k, 1] * step[k, 1]
        a = c2 * dmu * dmu - step[k, 0] * step[k, 0] - step[k, 1] * step[k, 1]
        root = b * b - a * t
        if root >= 0.0:
            denominator = -b + math.sqrt(root)
            if denominator > 0.0:
                limit = min(limit, TO_BOUNDARY * t / denominator)
    if dmu < 0.0:
        limit = min(limit, -TO_BOUNDARY * mu / dmu)
    return limit


@compiled
def minimise(
    m: int,
    order: Indices,
    interval: Indices,
    factor: Vector,
    devices: Devices,
    relaxation: Relaxation,
    length: float,
    eps: float,
    enough: float,
    loose: float,
    y: Matrix,
    mu: Vector,
    work: Work,
) -> tuple[float, int, bool]:
    """(the least bound found, Newton steps, whether they ended well) from inside the cones.

    `y` (m, 2) and `mu` (1,) are moved to the minimiser. Stops early once the bound is at or
    under `enough`: the node is pruned then, and its path is of no interest. Stops as well once
    what is left to gain is under the share `loose` of the excess over `enough`.
    """
    weight = eps * EPS_START
    bound, barrier, slope, bend = evaluate(
        m, order, interval, factor, devices, relaxation, length, weight, y, mu[0], work
    )
    least = bound
    steps, centred = 0, False
    while steps < MAX_NEWTON and least > enough:
        steps += 1
        dmu, decrement = newton_step(m, work, slope, bend)
        if not decrement > CENTRED * weight * m:
            if weight <= eps or 2.0 * m * weight < loose * (least - enough):
                centred = True
                break
            weight = max(weight * EPS_FACTOR, eps)
            bound, barrier, slope, bend = evaluate(
                m, order, interval, factor, devices, relaxation, length, weight, y, mu[0], work
            )
            dmu, decrement = newton_step(m, work, slope, bend)
        alpha = step_limit(m, factor, y, mu[0], dmu, work.a)
        moved = False
        for _ in range(MAX_HALVINGS):
            for k in range(m):
                work.y[k, 0] = y[k, 0] + alpha * work.a[k, 0]
                work.y[k, 1] = y[k, 1] + alpha * work.a[k, 1]
            trial = mu[0] + alpha * dmu
            bound, value, slope, bend = evaluate(
                m, order, interval, factor, devices, relaxation, length, weight, work.y, trial, work
            )
            if value <= barrier - 1e-4 * alpha * decrement:
                moved = True
                break
            alpha *= 0.5
        if not moved:
            break
        for k in range(m):
            y[k, 0], y[k, 1] = work.y[k, 0], work.y[k, 1]
        mu[0] = trial
        barrier = value
        least = min(least, bound)
    return least, steps, centred or least <= enough
