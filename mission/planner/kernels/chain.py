"""Polylines: length, nearest points, points merged and points added."""

import math
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.compiled import Matrix, Vector, compiled
from mission.planner.kernels.instance import Devices
from mission.planner.kernels.rewards import reward


@compiled
def chain_length(way: Matrix, count: int) -> float:
    """Length of the polyline through the first `count` points of `way`."""
    total = 0.0
    for n in range(1, count):
        dx, dy = way[n, 0] - way[n - 1, 0], way[n, 1] - way[n - 1, 1]
        total += math.sqrt(dx * dx + dy * dy)
    return total


@compiled
def shrink(way: Matrix, count: int, length: float) -> None:
    """Scale the first `count` points about the origin so that their polyline fits `length`."""
    have = chain_length(way, count)
    if have > length:
        scale = length / have
        for n in range(1, count):
            way[n, 0] *= scale
            way[n, 1] *= scale


@compiled
def foot(
    x: float, y: float, ax: float, ay: float, bx: float, by: float
) -> tuple[float, float, float]:
    """(share of the way from a to b, x, y) of the point of the leg that is nearest."""
    ex, ey = bx - ax, by - ay
    square = ex * ex + ey * ey
    t = 0.0
    if square > 0.0:
        t = min(1.0, max(0.0, ((x - ax) * ex + (y - ay) * ey) / square))
    return t, ax + t * ex, ay + t * ey


@compiled
def distance_to(x: float, y: float, way: Matrix, count: int) -> float:
    """Distance of a point from the polyline through the first `count` points."""
    least = (x - way[0, 0]) ** 2 + (y - way[0, 1]) ** 2
    for n in range(count - 1):
        _, qx, qy = foot(x, y, way[n, 0], way[n, 1], way[n + 1, 0], way[n + 1, 1])
        least = min(least, (x - qx) ** 2 + (y - qy) ** 2)
    return math.sqrt(least)


@compiled
def merge_nearest(way: Matrix, count: int) -> None:
    """Replace the closest pair of neighbours among `count` points by one (the start stays)."""
    pair, least = 1, math.inf
    for n in range(1, count):
        dx, dy = way[n, 0] - way[n - 1, 0], way[n, 1] - way[n - 1, 1]
        square = dx * dx + dy * dy
        if square < least:
            pair, least = n, square
    if pair > 1:
        way[pair - 1, 0] = 0.5 * (way[pair - 1, 0] + way[pair, 0])
        way[pair - 1, 1] = 0.5 * (way[pair - 1, 1] + way[pair, 1])
    for n in range(pair, count - 1):
        way[n, 0], way[n, 1] = way[n + 1, 0], way[n + 1, 1]


class Spare(NamedTuple):
    """Memory for putting spare points to use."""

    have: Vector  # (K,) what each device earns at its nearest point
    could: Vector  # (K,) and at the place of the path that is nearest
    along: Vector  # (K,) that place: number of the point before it, and share of the leg
    point: Matrix  # (K, 2) where it is
    position: Vector  # (N,) the points by the same measure
    points: Matrix  # (N, 2)


def make_spare(devices: int, steps: int) -> Spare:
    """Memory for problems of that size."""
    return Spare(
        np.zeros(devices),
        np.zeros(devices),
        np.zeros(devices),
        np.zeros((devices, 2)),
        np.zeros(steps),
        np.zeros((steps, 2)),
    )


@compiled
def fill_spare(way: Matrix, count: int, steps: int, devices: Devices, room: Spare) -> None:
    """Put the spare points where the path passes devices that no point serves well yet.

    They lie on the path and leave its shape as it is. What cannot be used stays at the end.
    """
    if count >= steps:
        return
    total = devices.u.shape[0]
    have, could, along, point = room.have, room.could, room.along, room.point
    position, points = room.position, room.points
    for k in range(total):
        ux, uy = devices.u[k, 0], devices.u[k, 1]
        near, least = math.inf, math.inf
        for n in range(count):
            ax, ay = way[n, 0], way[n, 1]
            near = min(near, (ux - ax) ** 2 + (uy - ay) ** 2)
            if n + 1 < count:
                t, qx, qy = foot(ux, uy, ax, ay, way[n + 1, 0], way[n + 1, 1])
                square = (ux - qx) ** 2 + (uy - qy) ** 2
                if square < least:
                    least, along[k], point[k, 0], point[k, 1] = square, n + t, qx, qy
        have[k] = devices.delta[k] * reward(math.sqrt(near), devices.rows)[0]
        could[k] = have[k]
        if least < near:
            could[k] = devices.delta[k] * reward(math.sqrt(least), devices.rows)[0]
    for n in range(steps):
        position[n] = n if n < count else steps  # the last ones, until they are put to use
        i = min(n, count - 1)
        points[n, 0], points[n, 1] = way[i, 0], way[i, 1]
    for n in range(count, steps):
        best = -1
        for k in range(total):
            gain = could[k] - have[k]
            if gain > 1e-9 * devices.delta[k] and (best < 0 or gain > could[best] - have[best]):
                best = k
        if best < 0:
            break
        position[n], points[n, 0], points[n, 1] = along[best], point[best, 0], point[best, 1]
        for k in range(total):
            dx, dy = point[best, 0] - devices.u[k, 0], point[best, 1] - devices.u[k, 1]
            f = devices.delta[k] * reward(math.sqrt(dx * dx + dy * dy), devices.rows)[0]
            have[k] = max(have[k], f)
    # Insertion sort: all but the spare points are in order already.
    for n in range(1, steps):
        key, x, y = position[n], points[n, 0], points[n, 1]
        i = n
        while i > 0 and position[i - 1] > key:
            position[i] = position[i - 1]
            points[i, 0], points[i, 1] = points[i - 1, 0], points[i - 1, 1]
            i -= 1
        position[i], points[i, 0], points[i, 1] = key, x, y
    for n in range(steps):
        way[n, 0], way[n, 1] = points[n, 0], points[n, 1]
