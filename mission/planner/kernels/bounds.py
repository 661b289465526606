"""Bounds of nodes: the dual of the order plus what the other devices promise."""

import math
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.compiled import ZERO, Indices, Vector, compiled
from mission.planner.kernels.dual import minimise
from mission.planner.kernels.instance import Limits, Problem, Relaxation
from mission.planner.kernels.lagrangian import FREE, Work, evaluate, make_work
from mission.planner.kernels.matching import nth_largest
from mission.planner.kernels.path import Path
from mission.planner.kernels.tree import MERGED, PLACED, Node, make_node

# A child's dual is minimised until what is left to gain is under this share of its excess over
# the threshold: it will stay open anyway.
LOOSE = 0.25


class Goal(NamedTuple):
    """What bounds of a node's children are measured against."""

    rest: float  # bound of what the devices off the order bring
    eps: float  # barrier weight
    enough: float  # a bound at or under this closes a node
    mu: float  # a multiplier of the right size


class Solver(NamedTuple):
    """Scratch shared by all bounds of a search."""

    work: Work
    child: Node
    factor: Vector
    mu: Vector
    steps: Indices  # (1,) Newton steps taken so far


def make_solver(devices: int) -> Solver:
    """Scratch for that many devices."""
    return Solver(
        make_work(devices),
        make_node(devices),
        np.ones(devices),
        np.zeros(1),
        np.zeros(1, dtype=np.int64),
    )


@compiled
def rest_of(node: Node, limits: Limits, relaxation: Relaxation, promises: Vector) -> float:
    """Bound of what the devices off the order can bring, within the places that are left.

    `promises` (K,) is memory.
    """
    room = limits.steps * limits.per_step - node.size[0]
    total, count = 0.0, ZERO
    for k in range(node.level.shape[0]):
        if node.level[k] != PLACED:
            total += relaxation.promise[k, node.level[k]]
            count += 1
    if count <= room:
        return total
    if room <= 0:
        return 0.0
    i = 0
    for k in range(node.level.shape[0]):
        if node.level[k] != PLACED:
            promises[i] = relaxation.promise[k, node.level[k]]
            i += 1
    nth_largest(promises, count, room)
    total = 0.0
    for i in range(room):  # quickselect leaves the largest ones in front
        total += promises[i]
    return total


@compiled
def _set_factors(node: Node, solver: Solver) -> None:
    for i in range(node.size[0]):
        solver.factor[i] = FREE if node.edge[i] == MERGED else 1.0


@compiled
def solve(
    node: Node, problem: Problem, goal: Goal, others: float, loose: float, solver: Solver
) -> float:
    """Minimise the dual of a node in place, down to where with `others` it closes the node."""
    _set_factors(node, solver)
    m = node.size[0]
    enough = goal.enough - others
    solver.mu[0] = node.number[2]
    least, steps, centred = minimise(
        m, node.order, node.interval, solver.factor, problem.devices, problem.relaxation,
        problem.limits.length, goal.eps, enough, loose, node.y, solver.mu, solver.work,
    )  # fmt: skip
    solver.steps[0] += steps
    if not centred:
        # Too near the boundary of the cones: start again from their middle.
        for i in range(m):
            node.y[i, 0], node.y[i, 1] = 0.0, 0.0
        solver.mu[0] = goal.mu
        value, steps, centred = minimise(
            m, node.order, node.interval, solver.factor, problem.devices, problem.relaxation,
            problem.limits.length, goal.eps, enough, loose, node.y, solver.mu, solver.work,
        )  # fmt: skip
        least = min(least, value)
        solver.steps[0] += steps
    node.number[2] = solver.mu[0]
    return least


@compiled
def tighten(node: Node, problem: Problem, goal: Goal, solver: Solver) -> None:
    """Minimise the dual of a node to the end, and lower its bound."""
    dual = solve(node, problem, goal, goal.rest, 0.0, solver)
    node.number[1] = min(node.number[1], dual)
    node.number[0] = min(node.number[0], node.number[1] + goal.rest)


@compiled
def _barrier_value(node: Node, problem: Problem, eps: float, solver: Solver) -> float:
    return evaluate(
        node.size[0], node.order, node.interval, solver.factor, problem.devices,
        problem.relaxation, problem.limits.length, eps, node.y, node.number[2], solver.work,
    )[1]  # fmt: skip


@compiled
def aim(node: Node, gap: int, path: Path, problem: Problem, eps: float, solver: Solver) -> None:
    """Start values of the edges at a device just inserted: straight on, or towards the device
    and back, whichever is nearer to the minimum."""
    _set_factors(node, solver)
    y, u, points = node.y, problem.devices.u, path.points
    k = node.order[gap]
    inner = gap + 1 < node.size[0]
    px, py = 0.0, 0.0
    if inner:
        px, py = y[gap + 1, 0], y[gap + 1, 1]
    y[gap, 0], y[gap, 1] = px, py
    plain = _barrier_value(node, problem, eps, solver)
    ax, ay = u[k, 0] - points[gap, 0], u[k, 1] - points[gap, 1]
    scale = 0.9 * node.number[2] / (math.sqrt(ax * ax + ay * ay) + 1e-9)
    y[gap, 0], y[gap, 1] = scale * ax, scale * ay
    if inner:
        bx, by = points[gap + 1, 0] - u[k, 0], points[gap + 1, 1] - u[k, 1]
        scale = 0.9 * node.number[2] / (math.sqrt(bx * bx + by * by) + 1e-9)
        y[gap + 1, 0], y[gap + 1, 1] = scale * bx, scale * by
    if not _barrier_value(node, problem, eps, solver) < plain:
        y[gap, 0], y[gap, 1] = px, py
        if inner:
            y[gap + 1, 0], y[gap + 1, 1] = px, py
