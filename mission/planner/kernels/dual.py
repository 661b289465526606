"""The dual bound of one visiting order, by a barrier method on a block-tridiagonal system.

Stops v_1..v_m follow the start v_0 (the origin here) in a fixed order; stop k serves a device
at u_k from a distance within [lo_k, hi_k]. For any y_1..y_m with |y_k| <= c_k mu, and y_{m+1} = 0,

    mu L + sum_k [ delta_k H_k(|w_k| / delta_k) - w_k . u_k ],      w_k = y_k - y_{k+1}

bounds what any such path of length L can earn. (c_k = 1; a leg known to have length zero may
cost anything, so its y_k is left nearly free.) It is convex in (y, mu). The barrier
-eps log(c^2 mu^2 - |y|^2) a leg keeps every iterate inside the cones, hence every value a bound,
and its minimiser is within 2 m eps of the least one. The slopes r_k = H_k' give back the path.
"""

import math
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.compiled import Indices, Matrix, Vector, compiled
from mission.planner.kernels.instance import Devices, Relaxation

FREE = 40.0  # c of a leg known to have length zero
MAX_NEWTON = 60
EPS_START = 30.0  # the barrier starts that much heavier, since starts are not centred
EPS_FACTOR = 0.15  # and gets lighter by this each time the decrement is under
CENTRED = 0.5  # this many barrier weights a leg
FLAT = 0.05  # least curvature of H, as a share of the mean one
TO_BOUNDARY = 0.8  # share of the way to the boundary of a cone that a step may go
MAX_HALVINGS = 20


class Work(NamedTuple):
    """Scratch for one Newton method, at least m rows each."""

    y: Matrix  # trial point
    w: Matrix  # y_k - y_{k+1}
    gradient: Matrix
    block: Matrix  # diagonal 2x2 blocks: xx, xy, yy
    device: Matrix  # Hessians of delta H: xx, xy, yy
    cross: Matrix  # d2 / dy dmu
    a: Matrix  # solutions of the block system
    b: Matrix


@compiled
def make_work(rows: int) -> Work:
    """Scratch for chains of up to that many stops."""
    return Work(
        np.zeros((rows, 2)),
        np.zeros((rows, 2)),
        np.zeros((rows, 2)),
        np.zeros((rows, 3)),
        np.zeros((rows, 3)),
        np.zeros((rows, 2)),
        np.zeros((rows, 2)),
        np.zeros((rows, 2)),
    )


@compiled
def spline(s: float, c: Vector, spacing: float, hi: float) -> tuple[float, float, float]:
    """(H, H', H'') at s >= 0."""
    x = s / spacing
    last = c.shape[0] - 3
    if x >= last:
        h = (c[last] + 4.0 * c[last + 1] + c[last + 2]) / 6.0
        return h + hi * (s - last * spacing), hi, 0.0
    i = int(x)
    t = x - i
    q = 1.0 - t
    c0, c1, c2, c3 = c[i], c[i + 1], c[i + 2], c[i + 3]
    h = c0 * q * q * q + c1 * (3.0 * t * t * t - 6.0 * t * t + 4.0)
    h += c2 * (-3.0 * t * t * t + 3.0 * t * t + 3.0 * t + 1.0) + c3 * t * t * t
    h1 = -c0 * q * q + c1 * (3.0 * t * t - 4.0 * t) + c2 * (-3.0 * t * t + 2.0 * t + 1.0)
    h1 += c3 * t * t
    h2 = c0 * q + c1 * (3.0 * t - 2.0) + c2 * (1.0 - 3.0 * t) + c3 * t
    return h / 6.0, 0.5 * h1 / spacing, h2 / (spacing * spacing)


@compiled
def evaluate(
    m: int,
    order: Indices,
    interval: Indices,
    factor: Vector,
    devices: Devices,
    relaxation: Relaxation,
    length: float,
    eps: float,
    y: Matrix,
    mu: float,
    work: Work,
) -> tuple[float, float, float, float]:
    """(bound, bound with barrier, d/dmu, d2/dmu2) at (y, mu); gradient and blocks into `work`.

    The barrier is infinite outside the cones, where nothing else is computed.
    """
    barrier = 0.0
    slope = length
    bend = 0.0
    for k in range(m):
        c2 = factor[k] * factor[k]
        t = c2 * mu * mu - y[k, 0] * y[k, 0] - y[k, 1] * y[k, 1]
        if t <= 0.0 or mu <= 0.0:
            return math.inf, math.inf, 0.0, 0.0
        barrier -= eps * math.log(t)
        e = eps / t
        f = 4.0 * e / t
        work.gradient[k, 0] = 2.0 * e * y[k, 0]
        work.gradient[k, 1] = 2.0 * e * y[k, 1]
        work.block[k, 0] = 2.0 * e + f * y[k, 0] * y[k, 0]
        work.block[k, 1] = f * y[k, 0] * y[k, 1]
        work.block[k, 2] = 2.0 * e + f * y[k, 1] * y[k, 1]
        work.cross[k, 0] = -f * c2 * mu * y[k, 0]
        work.cross[k, 1] = -f * c2 * mu * y[k, 1]
        slope -= 2.0 * e * c2 * mu
        bend += -2.0 * e * c2 + f * c2 * c2 * mu * mu
    bound = mu * length
    for k in range(m):
        wx, wy = y[k, 0], y[k, 1]
        if k + 1 < m:
            wx -= y[k + 1, 0]
            wy -= y[k + 1, 1]
        work.w[k, 0], work.w[k, 1] = wx, wy
        device = order[k]
        row = interval[k]
        delta = devices.delta[device]
        z = math.sqrt(wx * wx + wy * wy)
        s = z / delta
        h, h1, h2 = spline(
            s, relaxation.coefficients[row], relaxation.spacing[row], relaxation.hi[row]
        )
        bound += delta * h - wx * devices.u[device, 0] - wy * devices.u[device, 1]
        # Where H is straight it has no curvature and Newton steps would be unlimited.
        floor = (
            FLAT
            * relaxation.hi[row]
            / (relaxation.spacing[row] * (relaxation.coefficients.shape[1] - 3))
        )
        nx, ny, bend_across = 1.0, 0.0, h2
        if s > 1e-12:
            nx, ny, bend_across = wx / z, wy / z, h1 / s
        radial, around = max(h2, floor) / delta, max(bend_across, floor) / delta
        gx = h1 * nx - devices.u[device, 0]
        gy = h1 * ny - devices.u[device, 1]
        axx = around + (radial - around) * nx * nx
        axy = (radial - around) * nx * ny
        ayy = around + (radial - around) * ny * ny
        work.device[k, 0], work.device[k, 1], work.device[k, 2] = axx, axy, ayy
        work.gradient[k, 0] += gx
        work.gradient[k, 1] += gy
        work.block[k, 0] += axx
        work.block[k, 1] += axy
        work.block[k, 2] += ayy
        if k + 1 < m:
            work.gradient[k + 1, 0] -= gx
            work.gradient[k + 1, 1] -= gy
            work.block[k + 1, 0] += axx
            work.block[k + 1, 1] += axy
            work.block[k + 1, 2] += ayy
    return bound, bound + barrier, slope, bend


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
