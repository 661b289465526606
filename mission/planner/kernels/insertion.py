"""First plans: devices inserted into the path one by one, where they add most."""

import math

import numpy as np

from mission.planner.kernels.ascent import polish, project
from mission.planner.kernels.compiled import Indices, Matrix, compiled
from mission.planner.kernels.instance import Devices, Limits
from mission.planner.kernels.matching import reward


@compiled
def insert_greedily(devices: Devices, limits: Limits, power: float, way: Matrix) -> int:
    """Path over device positions; each insertion has the most gain per added metre^power.

    The gain counts every device that the two new legs pass. Writes `way`; returns its count.
    """
    total = devices.u.shape[0]
    have = np.empty(total)
    placed = np.zeros(total, dtype=np.bool_)
    way[0, 0], way[0, 1] = 0.0, 0.0
    for k in range(total):
        d = math.sqrt(devices.u[k, 0] ** 2 + devices.u[k, 1] ** 2)
        have[k] = devices.delta[k] * reward(d, devices.rows)[0]
    count, used = 1, 0.0
    legs = np.empty((3, 2))
    while count < limits.steps:
        best, best_at, best_rating, best_metres = -1, 0, 0.0, 0.0
        for k in range(total):
            if placed[k]:
                continue
            ux, uy = devices.u[k, 0], devices.u[k, 1]
            for at in range(1, count + 1):
                ax, ay = way[at - 1, 0], way[at - 1, 1]
                metres = math.sqrt((ux - ax) ** 2 + (uy - ay) ** 2)
                legs[0, 0], legs[0, 1], legs[1, 0], legs[1, 1] = ax, ay, ux, uy
                points = 2
                if at < count:
                    bx, by = way[at, 0], way[at, 1]
                    metres += math.sqrt((ux - bx) ** 2 + (uy - by) ** 2)
                    metres -= math.sqrt((ax - bx) ** 2 + (ay - by) ** 2)
                    legs[2, 0], legs[2, 1] = bx, by
                    points = 3
                if used + metres > limits.length:
                    continue
                gain = 0.0
                for j in range(total):
                    if placed[j]:
                        continue
                    d = project(devices.u[j, 0], devices.u[j, 1], legs, points)[0]
                    gain += max(0.0, devices.delta[j] * reward(d, devices.rows)[0] - have[j])
                rating = gain / max(metres, 1.0) ** power
                if gain > 1e-9 and rating > best_rating:
                    best, best_at, best_rating, best_metres = k, at, rating, metres
        if best < 0:
            break
        for n in range(count, best_at, -1):
            way[n, 0], way[n, 1] = way[n - 1, 0], way[n - 1, 1]
        way[best_at, 0], way[best_at, 1] = devices.u[best, 0], devices.u[best, 1]
        count += 1
        used += best_metres
        placed[best] = True
        for j in range(total):
            d = project(devices.u[j, 0], devices.u[j, 1], way, count)[0]
            have[j] = max(have[j], devices.delta[j] * reward(d, devices.rows)[0])
    return count


@compiled
def first_plan(devices: Devices, limits: Limits, way: Matrix, assigned: Indices) -> float:
    """The best of three greedy insertions, each polished. Writes `way` and `assigned`."""
    points = np.zeros((limits.steps, 2))
    path, who = np.empty_like(way), np.empty_like(assigned)
    best = polish(points, 1, limits, devices, way, assigned)
    for power in (0.0, 0.5, 1.0):
        count = insert_greedily(devices, limits, power, points)
        value = polish(points, count, limits, devices, path, who)
        if value > best:
            best = value
            way[:] = path
            assigned[:] = who
    return best
