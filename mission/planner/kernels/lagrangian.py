"""The Lagrangian of one visiting order: a bound for any multipliers, and its derivatives.

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
FLAT = 0.05  # least curvature of H, as a share of the mean one


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
