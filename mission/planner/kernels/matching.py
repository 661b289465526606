"""Who is served at which step, for fixed positions."""

import math
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.assignment import Places, make_places, solve_assignment
from mission.planner.kernels.compiled import Indices, Matrix, Vector, compiled
from mission.planner.kernels.instance import Devices
from mission.planner.kernels.rewards import earned, reward


class Matching(NamedTuple):
    """Memory for the assignment of K devices to N steps."""

    load: Indices  # (N,)
    best: Vector  # (K,) what each earns at its nearest step
    places: Places


def make_matching(devices: int, steps: int, per_step: int) -> Matching:
    """Memory for problems of that size."""
    return Matching(
        np.zeros(steps, dtype=np.int64), np.zeros(devices), make_places(devices, steps, per_step)
    )


@compiled
def copy_plan(way: Matrix, assigned: Indices, to_way: Matrix, to_assigned: Indices) -> None:
    """Overwrite one plan with another."""
    for n in range(to_way.shape[0]):
        to_way[n, 0], to_way[n, 1] = way[n, 0], way[n, 1]
    for k in range(to_assigned.shape[0]):
        to_assigned[k] = assigned[k]


@compiled
def match(way: Matrix, per_step: int, devices: Devices, assigned: Indices, room: Matching) -> float:
    """Assign every device to a step of `way` (N, 2) so that the most is earned.

    Every device goes to its nearest step; where that overfills one, the assignment problem is
    solved. Writes `assigned` (K,), -1 for a device that is not served; returns what is earned.
    """
    steps, count = way.shape[0], devices.u.shape[0]
    load, best = room.load, room.best
    for n in range(steps):
        load[n] = 0
    total = 0.0
    fits = True
    for k in range(count):
        nearest, least = -1, math.inf
        for n in range(steps):
            dx, dy = way[n, 0] - devices.u[k, 0], way[n, 1] - devices.u[k, 1]
            square = dx * dx + dy * dy
            # Coincident steps share the load: the later one only if the earlier is full.
            if square < least or (square == least and load[nearest] >= per_step):
                nearest, least = n, square
        f = reward(math.sqrt(least), devices.rows)[0]
        if f <= 0.0:
            assigned[k], best[k] = -1, 0.0
            continue
        assigned[k] = nearest
        load[nearest] += 1
        best[k] = devices.delta[k] * f
        total += best[k]
        if load[nearest] > per_step:
            fits = False
    if fits:
        return total
    solve_assignment(way, per_step, devices, best, assigned, room.places)
    return earned(way, assigned, devices)


@compiled
def nth_largest(values: Vector, count: int, n: int) -> float:
    """The n-th largest (n from 1) of the first `count` values, by quickselect (Hoare 1961);
    reorders them."""
    low, high, target = 0, count - 1, n - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] > pivot:
                i += 1
            while values[j] < pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if target <= j:
            high = j
        elif target >= i:
            low = i
        else:
            break
    return float(values[target])
