"""Good plans for any number of devices: many rough ones, of which the best are mended.

Where the path heads decides most of what it earns, and no small change turns it round: paths
are built towards devices all over the area, and the best few kept. Those are improved by taking
a stretch out, filling the gap by insertions that look at the nearest neighbours of a device
only, polishing, and keeping the result unless it earns less by more than a tolerance that falls
to nothing (threshold accepting, Dueck and Scheuer 1990).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.ascent import FINE, Polish, make_polish, polish
from mission.planner.kernels.compiled import (
    SOURCES,
    Cube,
    Indices,
    Masks,
    Matrix,
    Vector,
    cached,
    compiled,
    views,
)
from mission.planner.kernels.insertion import (
    Draft,
    Lists,
    cut_out,
    extend,
    make_draft,
    serve,
)
from mission.planner.kernels.instance import Devices, Limits, smallest_problem
from mission.planner.kernels.matching import copy_plan

POOL = 4  # rough plans that are mended
TOLERANCE = 0.01  # of the value, at the first try
LONGEST_CUT = 20  # stops
HOPELESS = 0.85  # of the present value: below it after one ascent, a try is given up
ROUGH = 1e-4  # relative rise worth another turn while plans are compared
SAME = 1e-6  # relative difference in value under which two plans are taken for one
EXCESS = 0.05  # of the length: polishing rounds corners, so that a path a little too long fits


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
def spread_out(devices: Devices, length: float, anchors: Indices, away: Vector) -> int:
    """Fill `anchors` with devices in reach, each as far as can be from the start and the ones
    before it; returns how many there are. `away` (K,) is memory."""
    count = devices.u.shape[0]
    for k in range(count):
        away[k] = math.sqrt(devices.u[k, 0] ** 2 + devices.u[k, 1] ** 2)
        if away[k] > length:
            away[k] = -1.0
    wanted: int = anchors.shape[0]
    for i in range(wanted):
        far = 0
        for k in range(count):
            if away[k] > away[far]:
                far = k
        if away[far] <= 1.0:
            return i
        anchors[i] = far
        for k in range(count):
            dx, dy = devices.u[k, 0] - devices.u[far, 0], devices.u[k, 1] - devices.u[far, 1]
            away[k] = min(away[k], math.sqrt(dx * dx + dy * dy))
    return wanted


class Pool(NamedTuple):
    """The best plans so far, best first."""

    value: Vector  # (P,) -1 where there is none
    way: Cube  # (P, N, 2)
    assigned: Indices  # (P, K)


class Room(NamedTuple):
    """Memory for an exploration."""

    draft: Draft
    pool: Pool
    anchors: Indices  # (S,)
    away: Vector  # (K,)
    state: Masks  # (1,) of the random numbers
    polish: Polish
    way: Matrix  # (N, 2) the plan last made
    assigned: Indices  # (K,)
    present_way: Matrix  # (N, 2) the plan that is mended
    present: Indices  # (K,)


def make_room(devices: int, limits: Limits, starts: int) -> Room:
    """Memory for a problem of that size and so many starts."""
    steps = limits.steps
    return Room(
        make_draft(devices, limits),
        Pool(
            np.full(POOL, -1.0),
            np.zeros((POOL, steps, 2)),
            np.full((POOL, devices), -1, dtype=np.int64),
        ),
        np.zeros(min(starts, devices), dtype=np.int64),
        np.zeros(devices),
        np.array([0x9E3779B97F4A7C15], dtype=np.uint64),
        make_polish(devices, limits, steps),
        np.zeros((steps, 2)),
        np.zeros(devices, dtype=np.int64),
        np.zeros((steps, 2)),
        np.zeros(devices, dtype=np.int64),
    )


@compiled
def enter(pool: Pool, value: float, way: Matrix, assigned: Indices) -> None:
    """Take a plan into the pool, unless it has as good ones only, or this one already."""
    size = pool.value.shape[0]
    if value <= pool.value[size - 1]:
        return
    for p in range(size):
        if abs(value - pool.value[p]) <= SAME * value:
            return
    p = size - 1
    while p > 0 and pool.value[p - 1] < value:
        pool.value[p] = pool.value[p - 1]
        copy_plan(pool.way[p - 1], pool.assigned[p - 1], pool.way[p], pool.assigned[p])
        p -= 1
    pool.value[p] = value
    copy_plan(way, assigned, pool.way[p], pool.assigned[p])


@compiled
def mend(
    devices: Devices, limits: Limits, lists: Lists, tries: int, room: Room, way: Matrix,
    assigned: Indices, value: float,
) -> float:  # fmt: skip
    """Improve a plan in place by `tries` stretches taken out and filled anew."""
    steps, state, draft = limits.steps, room.state, room.draft
    copy_plan(way, assigned, room.present_way, room.present)
    present_value = value
    for attempt in range(tries):
        cut = 1 + int(next_random(state) * min(LONGEST_CUT, steps - 1))
        first = 1 + int(next_random(state) * (steps - cut))
        power = 0.5 * int(next_random(state) * 3.0)
        length = limits.length * (1.0 + 2.0 * EXCESS * next_random(state))
        count = cut_out(room.present_way, room.present, devices, first, first + cut, draft)
        count = extend(devices, limits, lists, count, length, power, draft)
        hopeless = HOPELESS * present_value
        got = polish(
            draft.points, count, limits, devices, hopeless, ROUGH, room.way, room.assigned,
            room.polish,
        )  # fmt: skip
        tolerance = TOLERANCE * (1.0 - attempt / tries)
        if got > present_value * (1.0 - tolerance * next_random(state)):
            present_value = got
            copy_plan(room.way, room.assigned, room.present_way, room.present)
            if got > value:
                value = got
                copy_plan(room.way, room.assigned, way, assigned)
    return value


Explore = Callable[[Devices, Limits, Lists, int, Room, Matrix, Indices], float]


def _make(sources: str) -> Explore:
    @cached
    def explore(
        devices: Devices,
        limits: Limits,
        lists: Lists,
        tries: int,
        room: Room,
        way: Matrix,
        assigned: Indices,
    ) -> float:
        """The best of paths towards devices all over the area, after `tries` changes.

        Writes `way` (N, 2) and `assigned` (K,); returns what they earn.
        """
        _ = sources
        devices, lists, room = views(devices), views(lists), views(room)
        way, assigned = views(way), views(assigned)
        draft, pool = room.draft, room.pool
        reachable = spread_out(devices, limits.length, room.anchors, room.away)
        for i in range(-3, reachable):
            for k in range(devices.u.shape[0]):
                draft.have[k] = 0.0
            count = 1
            if i >= 0:
                k = room.anchors[i]
                draft.points[1, 0], draft.points[1, 1] = devices.u[k, 0], devices.u[k, 1]
                serve(k, devices, lists, draft)
                count = 2
            power, length = 0.0, limits.length * (1.0 + EXCESS)
            if i < 0:
                power, length = -0.5 * (i + 1), limits.length
            count = extend(devices, limits, lists, count, length, power, draft)
            hopeless = HOPELESS * pool.value[POOL - 1]
            value = polish(
                draft.points, count, limits, devices, hopeless, ROUGH, room.way, room.assigned,
                room.polish,
            )  # fmt: skip
            enter(pool, value, room.way, room.assigned)
        best = 0
        for p in range(POOL):
            if pool.value[p] > 0.0:
                pool.value[p] = mend(
                    devices, limits, lists, tries // (2 * POOL), room, pool.way[p],
                    pool.assigned[p], pool.value[p],
                )  # fmt: skip
                if pool.value[p] > pool.value[best]:
                    best = p
        value = mend(
            devices, limits, lists, tries - tries // 2, room, pool.way[best],
            pool.assigned[best], pool.value[best],
        )  # fmt: skip
        copy_plan(pool.way[best], pool.assigned[best], way, assigned)
        finest = polish(
            pool.way[best], limits.steps, limits, devices, 0.0, FINE, room.way, room.assigned,
            room.polish,
        )  # fmt: skip
        if finest > value:
            value = finest
            copy_plan(room.way, room.assigned, way, assigned)
        return value

    return explore


explore = _make(SOURCES)


def rehearse() -> None:
    """Explore a problem in which there is nothing to find."""
    devices, limits, _ = smallest_problem()
    lists = Lists(np.array([0, 1]), np.zeros(1, dtype=np.int64), np.zeros(1))
    way, assigned = np.zeros((limits.steps, 2)), np.zeros(1, dtype=np.int64)
    explore(devices, limits, lists, 0, make_room(1, limits, 1), way, assigned)
