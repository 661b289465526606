"""Branch and bound: the best plan, and a bound that no plan exceeds.

A node fixes the visiting order of some devices, an interval of distance for each, which
neighbours share a stop, and how near the other devices can be served at most. Its bound is the
dual of the order plus what the others promise. It is split where its relaxed path falls short
of the promise most: a device is inserted at every gap or declared out of reach of a radius, a
distance interval is cut in two, or, once the path keeps its promise but has too many stops, two
neighbours are merged or kept apart. Of a few candidates the one with the least work left below
it is taken.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.ascent import FINE, Polish, make_polish, polish
from mission.planner.kernels.bounds import Goal, Solver, make_solver, rest_of, tighten
from mission.planner.kernels.branching import (
    Family,
    by_insertion,
    by_merge,
    by_split,
    copy_family,
    make_child,
    make_family,
)
from mission.planner.kernels.compiled import (
    SOURCES,
    Flags,
    Indices,
    Matrix,
    Vector,
    cached,
    compiled,
    views,
)
from mission.planner.kernels.instance import Limits, Problem, Relaxation, smallest_problem
from mission.planner.kernels.matching import copy_plan
from mission.planner.kernels.path import Path, at_stops, make_path, recover
from mission.planner.kernels.tree import (
    PLACED,
    UNDECIDED,
    Node,
    Tree,
    best_open,
    make_node,
    make_tree,
    pop,
    push,
    stops_now,
)

BARRIER_SHARE = 2.5e-4  # of the best value: what the barrier may add to a bound, a leg
TINY = 1e-4  # of the best value: an excess not worth branching on
PROBES = 3  # devices compared before one is branched on


class Room(NamedTuple):
    """Memory for a search."""

    tree: Tree
    node: Node
    child: Node
    path: Path
    solver: Solver
    family: Family
    rival: Family
    tried: Flags  # (K,)
    promises: Vector  # (K,)
    polish: Polish
    way: Matrix  # (N, 2)
    assigned: Indices  # (K,)


def make_room(devices: int, limits: Limits, nodes: int) -> Room:
    """Memory for a problem of that size and so many nodes that are open at most."""
    return Room(
        make_tree(nodes, devices),
        make_node(devices),
        make_node(devices),
        make_path(devices),
        make_solver(devices),
        make_family(devices),
        make_family(devices),
        np.zeros(devices, dtype=np.bool_),
        np.zeros(devices),
        make_polish(devices, limits, devices + 1),
        np.zeros((limits.steps, 2)),
        np.zeros(devices, dtype=np.int64),
    )


@compiled
def pick_device(node: Node, path: Path, relaxation: Relaxation, least: float, tried: Flags) -> int:
    """The device to be decided about with the largest excess above `least`, not tried; or -1."""
    best = -1
    last = relaxation.radii.shape[0] - 1
    for k in range(node.level.shape[0]):
        undecided = node.level[k] != PLACED and node.level[k] < last
        if undecided and not tried[k] and path.excess[k] > least:
            least = path.excess[k]
            best = k
    return best


@compiled
def pick_stop(node: Node, path: Path, relaxation: Relaxation, least: float) -> int:
    """The position with the largest excess above `least` and an interval to cut; or -1."""
    best = -1
    for i in range(node.size[0]):
        row = node.interval[i]
        excess = path.excess[node.order[i]]
        if relaxation.ends[row, 1] - relaxation.ends[row, 0] > 1 and excess > least:
            least = excess
            best = i
    return best


@compiled
def pick_edge(node: Node, path: Path) -> int:
    """The undecided edge with the shortest leg; or -1."""
    best, least = -1, math.inf
    for i in range(node.size[0]):
        if node.edge[i] == UNDECIDED:
            dx = path.points[i + 1, 0] - path.points[i, 0]
            dy = path.points[i + 1, 1] - path.points[i, 1]
            if dx * dx + dy * dy < least:
                best, least = i, dx * dx + dy * dy
    return best


@compiled
def cut_radius(node: Node, at: int, path: Path, relaxation: Relaxation) -> int:
    """Where to cut the interval of the stop at a position: next to its relaxed distance."""
    row = node.interval[at]
    have = path.radius[node.order[at]]
    best = int(relaxation.ends[row, 0]) + 1
    for b in range(best + 1, relaxation.ends[row, 1]):
        if abs(relaxation.radii[b] - have) < abs(relaxation.radii[best] - have):
            best = b
    return best


@compiled
def branch(
    node: Node, path: Path, problem: Problem, goal: Goal, least: float, solver: Solver,
    family: Family, rival: Family, tried: Flags,
) -> float:  # fmt: skip
    """Find a way to split the node into `family`; -1 if it is a leaf, else the largest bound
    among the parts of it that were closed on the way. `rival` and `tried` (K,) are memory."""
    for k in range(tried.shape[0]):
        tried[k] = False
    at = pick_stop(node, path, problem.relaxation, least)
    if at < 0 and pick_device(node, path, problem.relaxation, least, tried) < 0:
        tighten(node, problem, goal, solver)
        recover(node, problem, path)
        at_stops(node, problem, path)
        at = pick_stop(node, path, problem.relaxation, least)
    found, closed = False, 0.0
    if at >= 0:
        radius = cut_radius(node, at, path, problem.relaxation)
        by_split(node, at, radius, problem, goal, solver, family)
        found, closed = True, family.score[1]
    for _ in range(PROBES):
        k = pick_device(node, path, problem.relaxation, least, tried)
        if k < 0 or (found and family.what[3] == 0):
            break
        tried[k] = True
        by_insertion(node, k, path, problem, goal, solver, rival)
        closed = max(closed, rival.score[1])
        if not found or rival.score[0] < family.score[0]:
            copy_family(rival, family)
            found = True
    if found:
        return closed
    if stops_now(node) < problem.limits.steps:
        return -1.0
    by_merge(node, pick_edge(node, path), problem, goal, solver, family)
    return float(family.score[1])


Search = Callable[[Problem, float, int, Room, Matrix, Indices, float], tuple[float, float, int]]


def _make(sources: str) -> Search:
    @cached
    def search(
        problem: Problem,
        gap: float,
        max_nodes: int,
        room: Room,
        way: Matrix,
        assigned: Indices,
        value: float,
    ) -> tuple[float, float, int]:
        """Improve on a plan until none can be better by more than the gap, or the nodes run out.

        Args:
            problem: at least one device, a positive length, and something to be won.
            gap: relative gap (bound - value) / bound that is enough.
            max_nodes: nodes that are looked into at most.
            room: memory; nodes for which it has none are closed with their bound.
            way: (N, 2) the plan to start from, overwritten with the best one.
            assigned: (K,) its assignment, likewise.
            value: what it earns, above 0.

        Returns:
            (value, upper bound, nodes).
        """
        _ = sources
        problem, room, way, assigned = views(problem), views(room), views(way), views(assigned)
        devices, limits, relaxation = problem.devices, problem.limits, problem.relaxation
        tree, node, path, family = room.tree, room.node, room.path, room.family
        node.number[0] = rest_of(node, limits, relaxation, room.promises)
        node.number[2] = node.number[0] / limits.length
        push(tree, node)
        closed = value  # the largest bound among all that was closed
        nodes = 0
        while tree.used[0] > 0:
            enough = value / (1.0 - gap)
            if best_open(tree) <= enough or nodes >= max_nodes:
                closed = max(closed, best_open(tree))
                break
            pop(tree, node)
            nodes += 1
            if recover(node, problem, path) > value:
                better = polish(
                    path.points, node.size[0] + 1, limits, devices, 0.0, FINE, room.way,
                    room.assigned, room.polish,
                )  # fmt: skip
                if better > value:
                    value = better
                    copy_plan(room.way, room.assigned, way, assigned)
                    enough = value / (1.0 - gap)
            if node.number[0] <= enough:
                closed = max(closed, node.number[0])
                continue
            eps = BARRIER_SHARE * value / max(node.size[0] + 1, 3)
            rest = rest_of(node, limits, relaxation, room.promises)
            goal = Goal(rest, eps, enough, value / limits.length)
            cut_off = branch(
                node, path, problem, goal, TINY * value, room.solver, family, room.rival, room.tried
            )
            if cut_off < 0.0:
                closed = max(closed, node.number[0])
                continue
            closed = max(closed, cut_off)
            for c in range(family.what[3]):
                make_child(node, family, c, relaxation, room.child)
                if not push(tree, room.child):
                    closed = max(closed, room.child.number[0])
        return value, closed, nodes

    return search


search = _make(SOURCES)


def rehearse() -> None:
    """Search a problem whose plan cannot be better."""
    problem = smallest_problem()
    way, assigned = np.zeros((problem.limits.steps, 2)), np.zeros(1, dtype=np.int64)
    search(problem, 0.0, 1, make_room(1, problem.limits, 1), way, assigned, 1.0)
