"""What a node's relaxation looks like: its path, and where it promises more than it can keep."""

import math
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.chain import distance_to
from mission.planner.kernels.compiled import Matrix, Vector, compiled
from mission.planner.kernels.instance import Problem
from mission.planner.kernels.lagrangian import spline
from mission.planner.kernels.rewards import reward
from mission.planner.kernels.tree import PLACED, Node


class Path(NamedTuple):
    """The relaxed path of a node."""

    points: Matrix  # (K + 1, 2) the start, then the stops in order
    radius: Vector  # (K,) by device: distance it is served from, if in the order
    excess: Vector  # (K,) by device: what the bound promises beyond what the path brings


def make_path(devices: int) -> Path:
    """Room for a path of that many stops."""
    return Path(np.zeros((devices + 1, 2)), np.zeros(devices), np.zeros(devices))


@compiled
def recover(node: Node, problem: Problem, path: Path) -> float:
    """Fill `path` from the node's dual; returns what it would earn with a stop everywhere."""
    devices, relaxation = problem.devices, problem.relaxation
    m = node.size[0]
    points = path.points
    real = 0.0
    for i in range(m):
        k, row = node.order[i], node.interval[i]
        wx, wy = node.y[i, 0], node.y[i, 1]
        if i + 1 < m:
            wx -= node.y[i + 1, 0]
            wy -= node.y[i + 1, 1]
        z = math.sqrt(wx * wx + wy * wy)
        s = z / devices.delta[k]
        h, h1, _ = spline(
            s, relaxation.coefficients[row], relaxation.spacing[row], relaxation.hi[row]
        )
        shift = h1 / z if z > 0.0 else 0.0
        points[i + 1, 0] = devices.u[k, 0] - shift * wx
        points[i + 1, 1] = devices.u[k, 1] - shift * wy
        path.radius[k] = h1
        f = devices.delta[k] * reward(h1, devices.rows)[0]
        path.excess[k] = devices.delta[k] * (h - s * h1) - f
        real += f
    for k in range(node.level.shape[0]):
        if node.level[k] != PLACED:
            d = distance_to(devices.u[k, 0], devices.u[k, 1], points, m + 1)
            f = devices.delta[k] * reward(d, devices.rows)[0]
            path.excess[k] = relaxation.promise[k, node.level[k]] - f
            real += f
    return real


@compiled
def at_stops(node: Node, problem: Problem, path: Path) -> None:
    """Count for devices off the order only what the stops bring, not the legs between them."""
    devices, relaxation = problem.devices, problem.relaxation
    for k in range(node.level.shape[0]):
        if node.level[k] != PLACED:
            least = math.inf
            for i in range(node.size[0] + 1):
                dx = path.points[i, 0] - devices.u[k, 0]
                dy = path.points[i, 1] - devices.u[k, 1]
                least = min(least, dx * dx + dy * dy)
            f = devices.delta[k] * reward(math.sqrt(least), devices.rows)[0]
            path.excess[k] = relaxation.promise[k, node.level[k]] - f
