"""Good plans for many devices: stretches of the path removed and put back better.

Each try takes a stretch of the best path out, fills the gap by insertions that look at the
nearest neighbours of a device only, polishes the result, and keeps it unless it earns less by
more than a tolerance that falls to nothing (threshold accepting, Dueck and Scheuer 1990).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.ascent import polish
from mission.planner.kernels.compiled import (
    SOURCES,
    Indices,
    Masks,
    Matrix,
    Vector,
    cached,
    compiled,
)
from mission.planner.kernels.instance import Devices, Limits
from mission.planner.kernels.matching import copy_plan, reward

TOLERANCE = 0.01  # of the value, at the first try
LONGEST_CUT = 12  # stops
HOPELESS = 0.95  # of the present value: below it after one ascent, a try is given up


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
    leg: Indices  # (K,) where that detour leaves the path
    top: Vector  # (K_bar,) scratch


@compiled
def next_random(state: Masks) -> float:
    """Uniform in [0, 1) from a 64-bit xorshift (Marsaglia 2003): the same on every machine."""
    x = state[0]
    x ^= x << np.uint64(13)
    x ^= x >> np.uint64(7)
    x ^= x << np.uint64(17)
    state[0] = x
    return float(x >> np.uint64(11)) / 9007199254740992.0


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
def _serve(k: int, devices: Devices, lists: Lists, draft: Draft) -> None:
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
def _find_leg(k: int, devices: Devices, count: int, draft: Draft) -> None:
    draft.metres[k] = math.inf
    for leg in range(count):
        metres = _detour(devices.u[k, 0], devices.u[k, 1], leg, draft.points, count)
        if metres < draft.metres[k]:
            draft.metres[k], draft.leg[k] = metres, leg


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
        _find_leg(k, devices, count, draft)
    while count < limits.steps:
        best, rating = -1, 0.0
        for k in range(total):
            if draft.worth[k] > 1e-9 * devices.delta[k] and used + draft.metres[k] <= length:
                value = draft.worth[k] / max(draft.metres[k], 1.0) ** power
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
        _serve(best, devices, lists, draft)
        for k in range(total):
            if draft.leg[k] == at - 1:
                _find_leg(k, devices, count, draft)
                continue
            if draft.leg[k] >= at:
                draft.leg[k] += 1
            for leg in range(at - 1, at + 1):
                metres = _detour(devices.u[k, 0], devices.u[k, 1], leg, points, count)
                if metres < draft.metres[k]:
                    draft.metres[k], draft.leg[k] = metres, leg
    return count


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


Explore = Callable[[Devices, Limits, Lists, int, Matrix, Indices], float]


def _make(sources: str) -> Explore:
    @cached
    def explore(
        devices: Devices, limits: Limits, lists: Lists, tries: int, way: Matrix, assigned: Indices
    ) -> float:
        """The best plan of three greedy constructions and `tries` improvements.

        Writes `way` (N, 2) and `assigned` (K,); returns what they earn.
        """
        _ = sources
        total, steps = devices.u.shape[0], limits.steps
        draft = Draft(
            np.zeros((steps, 2)), np.zeros(total), np.zeros(total), np.zeros(total),
            np.zeros(total, dtype=np.int64), np.zeros(min(limits.per_step, total)),
        )  # fmt: skip
        present, present_who = np.zeros_like(way), np.full_like(assigned, -1)
        trial, trial_who = np.zeros_like(way), np.empty_like(assigned)
        best, present_value = -1.0, -1.0
        for power in (0.0, 0.5, 1.0):
            draft.points[0, 0], draft.points[0, 1] = 0.0, 0.0
            draft.have[:] = 0.0
            count = extend(devices, limits, lists, min(1, steps), limits.length, power, draft)
            value = polish(draft.points, count, limits, devices, 0.0, trial, trial_who)
            if value > best:
                best = value
                copy_plan(trial, trial_who, way, assigned)
        copy_plan(way, assigned, present, present_who)
        present_value = best
        state = np.array([0x9E3779B97F4A7C15], dtype=np.uint64)
        for attempt in range(tries):
            cut = 1 + int(next_random(state) * min(LONGEST_CUT, steps - 1))
            first = 1 + int(next_random(state) * (steps - cut))
            power = 0.5 * int(next_random(state) * 3.0)
            # Polishing rounds corners, so that a path a little too long may fit.
            length = limits.length * (1.0 + 0.1 * next_random(state))
            count = cut_out(present, present_who, devices, first, first + cut, draft)
            count = extend(devices, limits, lists, count, length, power, draft)
            hopeless = HOPELESS * present_value
            value = polish(draft.points, count, limits, devices, hopeless, trial, trial_who)
            tolerance = TOLERANCE * (1.0 - attempt / tries)
            if value > present_value * (1.0 - tolerance * next_random(state)):
                present_value = value
                copy_plan(trial, trial_who, present, present_who)
                if value > best:
                    best = value
                    copy_plan(trial, trial_who, way, assigned)
        return best

    return explore


explore = _make(SOURCES)
