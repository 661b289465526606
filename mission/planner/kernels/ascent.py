"""From a rough path to a local optimum: Newton ascent on the chain of waypoints.

For a fixed assignment the reward is sum_k delta_k f(|v_n(k) - u_k|), smooth but not concave, and
the path may be L long. One step solves the chain's block-tridiagonal system with the clipped
Hessian of the reward, the curvature of the length weighed by its multiplier, and damping; the
path is then shrunk about the start onto L, and kept if it earns more.
"""

import math
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.chain import (
    Spare,
    chain_length,
    fill_spare,
    make_spare,
    merge_nearest,
    shrink,
)
from mission.planner.kernels.compiled import ZERO, Flags, Indices, Matrix, compiled
from mission.planner.kernels.instance import Devices, Limits
from mission.planner.kernels.matching import Matching, copy_plan, make_matching, match
from mission.planner.kernels.rewards import earned, reward

SMOOTHING_M = 0.5  # a leg of length e counts as sqrt(e^2 + smoothing^2)
MAX_ROUNDS = 12
MAX_STEPS = 12
RISE = 1e-6  # relative rise that is worth another step
FINE = 1e-5  # and another turn of assignment and ascent


class Polish(NamedTuple):
    """Memory for polishing."""

    draft: Matrix  # (N or more, 2)
    path: Matrix  # (N, 2)
    who: Indices  # (K,)
    used: Flags  # (N,) steps that serve somebody
    trial: Matrix  # (N, 2)
    c: Matrix  # (N, 10) see `_model`
    s: Matrix  # (N, 7) see `_solve`
    spare: Spare
    matching: Matching


def make_polish(devices: int, limits: Limits, points: int) -> Polish:
    """Memory for a problem of that size and paths of up to that many points."""
    steps = limits.steps
    return Polish(
        np.zeros((max(points, steps), 2)),
        np.zeros((steps, 2)),
        np.zeros(devices, dtype=np.int64),
        np.zeros(steps, dtype=np.bool_),
        np.zeros((steps, 2)),
        np.zeros((steps, 10)),
        np.zeros((steps, 7)),
        make_spare(devices, steps),
        make_matching(devices, steps, limits.per_step),
    )


@compiled
def _model(way: Matrix, assigned: Indices, devices: Devices, mu: float, c: Matrix) -> float:
    """Per waypoint into `c`: gradient (0:2), length gradient (2:4), diagonal block (4:7),
    off-diagonal block to the next waypoint (7:10). Returns the mean curvature of the reward."""
    steps = way.shape[0]
    for n in range(steps):
        for i in range(10):
            c[n, i] = 0.0
    trace = 0.0
    for k in range(assigned.shape[0]):
        n = assigned[k]
        if n < 1:
            continue
        dx, dy = way[n, 0] - devices.u[k, 0], way[n, 1] - devices.u[k, 1]
        r = math.sqrt(dx * dx + dy * dy)
        _, f1, f2 = reward(r, devices.rows)
        delta = devices.delta[k]
        radial = max(0.0, -delta * f2)
        if r > 1e-6:
            nx, ny = dx / r, dy / r
            around = max(0.0, -delta * f1 / r)
        else:
            nx, ny = 1.0, 0.0
            around = radial
        c[n, 0] += delta * f1 * nx
        c[n, 1] += delta * f1 * ny
        c[n, 4] += around + (radial - around) * nx * nx
        c[n, 5] += (radial - around) * nx * ny
        c[n, 6] += around + (radial - around) * ny * ny
        trace += radial + around
    for n in range(1, steps):
        ex, ey = way[n, 0] - way[n - 1, 0], way[n, 1] - way[n - 1, 1]
        q = math.sqrt(ex * ex + ey * ey + SMOOTHING_M * SMOOTHING_M)
        gx, gy = ex / q, ey / q
        hxx, hxy, hyy = mu * (1.0 - gx * gx) / q, -mu * gx * gy / q, mu * (1.0 - gy * gy) / q
        c[n, 2] += gx
        c[n, 3] += gy
        c[n, 4] += hxx
        c[n, 5] += hxy
        c[n, 6] += hyy
        if n > 1:
            c[n - 1, 2] -= gx
            c[n - 1, 3] -= gy
            c[n - 1, 4] += hxx
            c[n - 1, 5] += hxy
            c[n - 1, 6] += hyy
            c[n - 1, 7], c[n - 1, 8], c[n - 1, 9] = -hxx, -hxy, -hyy
    return float(trace / (2.0 * max(steps - 1, 1)))


@compiled
def _solve(steps: int, c: Matrix, damping: float, s: Matrix) -> None:
    """(blocks + damping) s = gradient and length gradient: columns 0:2 and 2:4 of `s`;
    4:7 hold the inverted pivots."""
    for n in range(1, steps):
        xx, xy, yy = c[n, 4] + damping, c[n, 5], c[n, 6] + damping
        for i in range(4):
            s[n, i] = c[n, i]
        if n > 1:
            oxx, oxy, oyy = c[n - 1, 7], c[n - 1, 8], c[n - 1, 9]
            ixx, ixy, iyy = s[n - 1, 4], s[n - 1, 5], s[n - 1, 6]
            mxx, mxy = oxx * ixx + oxy * ixy, oxx * ixy + oxy * iyy
            myx, myy = oxy * ixx + oyy * ixy, oxy * ixy + oyy * iyy
            xx -= mxx * oxx + mxy * oxy
            xy -= mxx * oxy + mxy * oyy
            yy -= myx * oxy + myy * oyy
            for i in range(0, 4, 2):
                px, py = s[n - 1, i], s[n - 1, i + 1]
                s[n, i] -= mxx * px + mxy * py
                s[n, i + 1] -= myx * px + myy * py
        det = xx * yy - xy * xy
        s[n, 4], s[n, 5], s[n, 6] = yy / det, -xy / det, xx / det
    for n in range(steps - 1, 0, -1):
        for i in range(0, 4, 2):
            px, py = s[n, i], s[n, i + 1]
            if n + 1 < steps:
                px -= c[n, 7] * s[n + 1, i] + c[n, 8] * s[n + 1, i + 1]
                py -= c[n, 8] * s[n + 1, i] + c[n, 9] * s[n + 1, i + 1]
            s[n, i], s[n, i + 1] = s[n, 4] * px + s[n, 5] * py, s[n, 5] * px + s[n, 6] * py


@compiled
def climb(
    way: Matrix, assigned: Indices, devices: Devices, length: float, mu: float, room: Polish
) -> tuple[float, float]:
    """Newton ascent of `way` (N, 2) for a fixed assignment; (what is earned, multiplier).

    `way` starts within the length, and stays so.
    """
    steps = way.shape[0]
    trial, c, s = room.trial, room.c, room.s
    trial[0, 0], trial[0, 1] = way[0, 0], way[0, 1]
    value = earned(way, assigned, devices)
    damping = 0.01
    for _ in range(MAX_STEPS):
        curvature = _model(way, assigned, devices, mu, c)
        slack = length - chain_length(way, steps)
        before = value
        moved = False
        for _ in range(6):
            _solve(steps, c, damping * curvature + 1e-12, s)
            along_reward, along_length = 0.0, 0.0
            for n in range(1, steps):
                along_reward += c[n, 2] * s[n, 0] + c[n, 3] * s[n, 1]
                along_length += c[n, 2] * s[n, 2] + c[n, 3] * s[n, 3]
            nu = 0.0
            if along_length > 0.0:
                nu = max(0.0, (along_reward - slack) / along_length)
            for n in range(1, steps):
                trial[n, 0] = way[n, 0] + s[n, 0] - nu * s[n, 2]
                trial[n, 1] = way[n, 1] + s[n, 1] - nu * s[n, 3]
            shrink(trial, steps, length)
            better = earned(trial, assigned, devices)
            if better > value:
                copy_plan(trial, assigned, way, assigned)
                value = better
                mu = nu
                damping = max(damping * 0.2, 1e-6)
                moved = True
                break
            damping = max(damping * 8.0, 1e-3)
        if not moved or value - before <= RISE * value:
            break
    return value, mu


@compiled
def polish(
    points: Matrix,
    count: int,
    limits: Limits,
    devices: Devices,
    hopeless: float,
    rise: float,
    way: Matrix,
    assigned: Indices,
    room: Polish,
) -> float:
    """The best plan near a path of `count` points (the first is the start); what it earns.

    Points too many are merged, spare ones put to use, then assignment and ascent alternate until
    a turn raises the value by less than the share `rise`; no further if an ascent ends under
    `hopeless`.
    Writes `way` (N, 2) and `assigned` (K,).
    """
    steps = limits.steps
    draft, path, who, used = room.draft, room.path, room.who, room.used
    for n in range(count):
        draft[n, 0], draft[n, 1] = points[n, 0], points[n, 1]
    while count > steps:
        merge_nearest(draft, count)
        count -= 1
    fill_spare(draft, count, steps, devices, room.spare)
    shrink(draft, steps, limits.length)
    for n in range(steps):
        path[n, 0], path[n, 1] = draft[n, 0], draft[n, 1]
    best, mu = -1.0, 0.0
    for _ in range(MAX_ROUNDS):
        value = match(path, limits.per_step, devices, who, room.matching)
        if value > best:
            copy_plan(path, who, way, assigned)
        if value <= best * (1.0 + rise):
            best = max(best, value)
            break
        best = value
        value, mu = climb(path, who, devices, limits.length, mu, room)
        if value > best:
            best = value
            copy_plan(path, who, way, assigned)
        if best < hopeless:
            break
        # Steps that serve nobody are taken out and put to better use.
        for n in range(steps):
            used[n] = n == 0
        for k in range(who.shape[0]):
            if who[k] >= 0:
                used[who[k]] = True
        kept = ZERO
        for n in range(steps):
            if used[n]:
                draft[kept, 0], draft[kept, 1] = path[n, 0], path[n, 1]
                kept += 1
        fill_spare(draft, kept, steps, devices, room.spare)
        copy_plan(draft, who, path, who)
    return best
