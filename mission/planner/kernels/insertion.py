"""Paths made of stops above devices: the best insertions, and stretches taken out again."""

import math
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.compiled import NONE, ZERO, Indices, Matrix, Vector, compiled
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
    legs: Vector  # (N,) length of the leg behind each point
    top: Vector  # (K_bar,) scratch


@compiled
def _rate(devices: Devices, lists: Lists, draft: Draft) -> None:
    """Work out the worths that are below 0: the best total gain of K_bar devices each."""
    # Loops stand inside the functions here: a call with as many arrays costs more than its work.
    top, have, delta = draft.top, draft.have, devices.delta
    begin, neighbour, share = lists.begin, lists.neighbour, lists.share
    for k in range(delta.shape[0]):
        if draft.worth[k] >= 0.0:
            continue
        for i in range(top.shape[0]):
            top[i] = 0.0
        for e in range(begin[k], begin[k + 1]):
            j = neighbour[e]
            gain = delta[j] * share[e] - have[j]
            if gain > top[0]:
                i = 0
                while i + 1 < top.shape[0] and top[i + 1] < gain:
                    top[i] = top[i + 1]
                    i += 1
                top[i] = gain
        total = 0.0
        for i in range(top.shape[0]):
            total += top[i]
        draft.worth[k] = total


@compiled
def serve(k: int, devices: Devices, lists: Lists, draft: Draft) -> None:
    """Serve the K_bar devices that gain most from above device k; their neighbours' worths fall."""
    for _ in range(draft.top.shape[0]):
        best, most = -1, 0.0
        for e in range(lists.begin[k], lists.begin[k + 1]):
            j = lists.neighbour[e]
            gain = devices.delta[j] * lists.share[e] - draft.have[j]
            if gain > most:
                best, most = j, gain
        if best < 0:
            break
        draft.have[best] += most
        for g in range(lists.begin[best], lists.begin[best + 1]):
            draft.worth[lists.neighbour[g]] = -1.0


@compiled
def _measure(draft: Draft, first: int, last: int, count: int) -> None:
    """Bring the lengths of the legs first..last-1 up to date."""
    points = draft.points
    for n in range(first, min(last, count - 1)):
        dx, dy = points[n + 1, 0] - points[n, 0], points[n + 1, 1] - points[n, 1]
        draft.legs[n] = math.sqrt(dx * dx + dy * dy)


@compiled
def _find_legs(at: int, power: float, devices: Devices, count: int, draft: Draft) -> None:
    """Find the shortest detour to each device, after point `at` was inserted; 0 for all anew.

    A leg is named by the point it leaves; behind the last point only the way there counts.
    """
    points, legs, u = draft.points, draft.legs, devices.u
    for k in range(u.shape[0]):
        first, last = at - 1, at + 1
        if at == 0 or draft.leg[k] == at - 1:  # the leg it had is no more
            draft.metres[k] = math.inf
            first, last = 0, count
        elif draft.leg[k] >= at:
            draft.leg[k] += 1
        ux, uy = u[k, 0], u[k, 1]
        least, found = draft.metres[k], -1
        out = math.sqrt((ux - points[first, 0]) ** 2 + (uy - points[first, 1]) ** 2)
        for leg in range(first, last):
            metres, back = out, 0.0
            if leg + 1 < count:
                back = math.sqrt((ux - points[leg + 1, 0]) ** 2 + (uy - points[leg + 1, 1]) ** 2)
                metres = out + back - legs[leg]
            if metres < least:
                least, found = metres, leg
            out = back
        if found >= 0:
            draft.metres[k], draft.leg[k] = least, found
            draft.ease[k] = 1.0
            if power == 0.5:
                draft.ease[k] = 1.0 / math.sqrt(max(least, 1.0))
            elif power == 1.0:
                draft.ease[k] = 1.0 / max(least, 1.0)


@compiled
def extend(
    devices: Devices, limits: Limits, lists: Lists, count: int, length: float, power: float,
    draft: Draft,
) -> int:  # fmt: skip
    """Insert stops above devices while the length allows; returns the number of points.

    `draft.points` and `draft.have` are given; each insertion has the most worth per added
    metre^power, with a power of 0, 1/2 or 1.
    """
    total = devices.u.shape[0]
    points = draft.points
    _measure(draft, ZERO, count, count)
    used = 0.0
    for n in range(count - 1):
        used += draft.legs[n]
    for k in range(total):
        draft.worth[k] = -1.0
    _rate(devices, lists, draft)
    _find_legs(ZERO, power, devices, count, draft)
    while count < limits.steps:
        best, rating = NONE, 0.0
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
            draft.legs[n] = draft.legs[n - 1]
        points[at, 0], points[at, 1] = devices.u[best, 0], devices.u[best, 1]
        count += 1
        _measure(draft, at - 1, at + 1, count)
        serve(best, devices, lists, draft)
        _rate(devices, lists, draft)
        _find_legs(at, power, devices, count, draft)
    return count


def make_draft(devices: int, limits: Limits) -> Draft:
    """Room for a path of that problem, with nothing in it but the start."""
    return Draft(
        np.zeros((limits.steps, 2)),
        np.zeros(devices),
        np.zeros(devices),
        np.zeros(devices),
        np.zeros(devices),
        np.zeros(devices, dtype=np.int64),
        np.zeros(limits.steps),
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
