"""Paths made of stops above devices: the best insertions, and stretches taken out again."""

import math
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.compiled import Indices, Matrix, Vector, compiled
from mission.planner.kernels.instance import Devices, Limits
from mission.planner.kernels.rewards import reward


class Lists(NamedTuple):
    """Neighbour lists: a stop above device k serves `neighbour[begin[k]:begin[k + 1]]` well."""

    begin: Indices  # (K + 1,)
    neighbour: Indices  # (E,)
    share: Vector  # (E,) f at their distance


class Draft(NamedTuple):
    """A path under construction."""

    points: Matrix  # (N, 2) the start first
    have: Vector  # (K,) what each device earns so far
    worth: Vector  # (K,) what a stop above the device would add
    metres: Vector  # (K,) shortest detour to it
    ease: Vector  # (K,) metres^-power
    leg: Indices  # (K,) where that detour leaves the path
    top: Vector  # (K_bar,) scratch


@compiled
def _worth(k: int, devices: Devices, lists: Lists, draft: Draft) -> float:
    """The best total gain of K_bar devices served from above device k."""
    top = draft.top
    top[:] = 0.0
    for e in range(lists.begin[k], lists.begin[k + 1]):
        j = lists.neighbour[e]
        gain = devices.delta[j] * lists.share[e] - draft.have[j]
        if gain > top[0]:
            i = 0
            while i + 1 < top.shape[0] and top[i + 1] < gain:
                top[i] = top[i + 1]
                i += 1
            top[i] = gain
    return float(top.sum())


@compiled
def serve(k: int, devices: Devices, lists: Lists, draft: Draft) -> None:
    """Serve the K_bar devices that gain most from above device k, and bring worths up to date."""
    _worth(k, devices, lists, draft)
    least = draft.top[0]
    places = draft.top.shape[0]
    for e in range(lists.begin[k], lists.begin[k + 1]):
        j = lists.neighbour[e]
        gain = devices.delta[j] * lists.share[e] - draft.have[j]
        if gain > 0.0 and gain >= least and places > 0:
            places -= 1
            draft.have[j] += gain
            for g in range(lists.begin[j], lists.begin[j + 1]):
                draft.worth[lists.neighbour[g]] = -1.0  # to be worked out again
    for e in range(lists.begin[k], lists.begin[k + 1]):
        for g in range(lists.begin[lists.neighbour[e]], lists.begin[lists.neighbour[e] + 1]):
            j = lists.neighbour[g]
            if draft.worth[j] < 0.0:
                draft.worth[j] = _worth(j, devices, lists, draft)


@compiled
def _detour(ux: float, uy: float, leg: int, points: Matrix, count: int) -> float:
    """Metres that a stop at u adds after point `leg`; at the end the way there only."""
    ax, ay = points[leg, 0], points[leg, 1]
    out = math.sqrt((ux - ax) ** 2 + (uy - ay) ** 2)
    if leg + 1 == count:
        return out
    bx, by = points[leg + 1, 0], points[leg + 1, 1]
    back = math.sqrt((ux - bx) ** 2 + (uy - by) ** 2)
    return out + back - math.sqrt((ax - bx) ** 2 + (ay - by) ** 2)


@compiled
def _find_leg(
    k: int, first: int, last: int, power: float, devices: Devices, count: int, draft: Draft
) -> None:
    """Take the shortest detour to device k over the legs first..last-1, if shorter."""
    shorter = False
    for leg in range(first, last):
        metres = _detour(devices.u[k, 0], devices.u[k, 1], leg, draft.points, count)
        if metres < draft.metres[k]:
            draft.metres[k], draft.leg[k] = metres, leg
            shorter = True
    if shorter and power > 0.0:
        draft.ease[k] = max(draft.metres[k], 1.0) ** -power


@compiled
def extend(
    devices: Devices, limits: Limits, lists: Lists, count: int, length: float, power: float,
    draft: Draft,
) -> int:  # fmt: skip
    """Insert stops above devices while the length allows; returns the number of points.

    `draft.points` and `draft.have` are given; each insertion has the most worth per added
    metre^power.
    """
    total = devices.u.shape[0]
    points = draft.points
    used = 0.0
    for n in range(1, count):
        used += math.sqrt(
            (points[n, 0] - points[n - 1, 0]) ** 2 + (points[n, 1] - points[n - 1, 1]) ** 2
        )
    for k in range(total):
        draft.worth[k] = _worth(k, devices, lists, draft)
        draft.metres[k], draft.ease[k] = math.inf, 1.0
        _find_leg(k, 0, count, power, devices, count, draft)
    while count < limits.steps:
        best, rating = -1, 0.0
        for k in range(total):
            if draft.worth[k] > 1e-9 * devices.delta[k] and used + draft.metres[k] <= length:
                value = draft.worth[k] * draft.ease[k]
                if value > rating:
                    best, rating = k, value
        if best < 0:
            break
        at = draft.leg[best] + 1
        used += draft.metres[best]
        for n in range(count, at, -1):
            points[n, 0], points[n, 1] = points[n - 1, 0], points[n - 1, 1]
        points[at, 0], points[at, 1] = devices.u[best, 0], devices.u[best, 1]
        count += 1
        serve(best, devices, lists, draft)
        for k in range(total):
            if draft.leg[k] == at - 1:
                draft.metres[k] = math.inf
                _find_leg(k, 0, count, power, devices, count, draft)
                continue
            if draft.leg[k] >= at:
                draft.leg[k] += 1
            _find_leg(k, at - 1, at + 1, power, devices, count, draft)
    return count


@compiled
def make_draft(devices: int, limits: Limits) -> Draft:
    """Room for a path of that problem, with nothing in it but the start."""
    return Draft(
        np.zeros((limits.steps, 2)),
        np.zeros(devices),
        np.zeros(devices),
        np.zeros(devices),
        np.zeros(devices),
        np.zeros(devices, dtype=np.int64),
        np.zeros(min(limits.per_step, devices)),
    )


@compiled
def cut_out(
    way: Matrix, assigned: Indices, devices: Devices, first: int, last: int, draft: Draft
) -> int:
    """Copy `way` without the points first..last-1, and what its devices earn; the point count."""
    count = 0
    for n in range(way.shape[0]):
        repeated = n > 0 and way[n, 0] == way[n - 1, 0] and way[n, 1] == way[n - 1, 1]
        if not first <= n < last and not repeated:
            draft.points[count, 0], draft.points[count, 1] = way[n, 0], way[n, 1]
            count += 1
    for k in range(assigned.shape[0]):
        n = assigned[k]
        draft.have[k] = 0.0
        if n >= 0 and not first <= n < last:
            dx, dy = way[n, 0] - devices.u[k, 0], way[n, 1] - devices.u[k, 1]
            f = reward(math.sqrt(dx * dx + dy * dy), devices.rows)[0]
            draft.have[k] = devices.delta[k] * f
    return count
