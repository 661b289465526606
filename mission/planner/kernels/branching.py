"""Ways to split a node, each with the bounds of its children, and what they are worth."""

from typing import NamedTuple

import numpy as np

from mission.planner.kernels.bounds import LOOSE, Goal, Solver, aim, solve
from mission.planner.kernels.compiled import NONE, ZERO, Indices, Matrix, Vector, compiled, typed
from mission.planner.kernels.instance import Problem, Relaxation
from mission.planner.kernels.path import Path
from mission.planner.kernels.tree import BARRED, MERGED, Node, copy_node, insert, stops_needed

INSERTION, SPLIT, MERGE = typed(0), typed(1), typed(2)
POWER = 4.0
CHILD_COST = 0.02


class Family(NamedTuple):
    """One way to split a node, with those of its children that are left open."""

    score: Vector  # (2,) less is better; largest bound among the children closed
    what: Indices  # (4,) kind; device or position; radius; number of children
    detail: Indices  # (C,) gap (-1: not within the radius), interval row, or edge state
    number: Matrix  # (C, 3) as of a node
    y: Matrix  # (C, K, 2)


def make_family(devices: int) -> Family:
    """Room for the children of one branching."""
    children = devices + 2
    return Family(
        np.zeros(2),
        np.zeros(4, dtype=np.int64),
        np.zeros(children, dtype=np.int64),
        np.zeros((children, 3)),
        np.zeros((children, devices, 2)),
    )


@compiled
def copy_family(source: Family, target: Family) -> None:
    """Overwrite `target` with `source`."""
    for i in range(2):
        target.score[i] = source.score[i]
    for i in range(4):
        target.what[i] = source.what[i]
    for c in range(source.what[3]):
        target.detail[c] = source.detail[c]
        for i in range(3):
            target.number[c, i] = source.number[c, i]
        for i in range(source.y.shape[1]):
            target.y[c, i, 0], target.y[c, i, 1] = source.y[c, i, 0], source.y[c, i, 1]


@compiled
def _begin(family: Family, kind: int, what: int, radius: int) -> None:
    family.score[0], family.score[1] = 0.0, 0.0
    family.what[0], family.what[1], family.what[2], family.what[3] = kind, what, radius, 0


@compiled
def _offer(
    family: Family, detail: int, dual: float, others: float, parent: Node, child: Node, goal: Goal
) -> bool:
    """Take a child into the family unless its bound closes it. The score stands for the work
    below: the children's excess over the threshold as a share of the parent's, to a power."""
    bound = min(parent.number[0], dual + others)
    if bound <= goal.enough:
        family.score[1] = max(family.score[1], bound)
        return False
    c = family.what[3]
    family.what[3] = c + 1
    family.detail[c] = detail
    family.number[c, 0], family.number[c, 1], family.number[c, 2] = bound, dual, child.number[2]
    for i in range(child.size[0]):
        family.y[c, i, 0], family.y[c, i, 1] = child.y[i, 0], child.y[i, 1]
    share = (bound - goal.enough) / (parent.number[0] - goal.enough)
    family.score[0] += CHILD_COST + share**POWER
    return True


@compiled
def by_insertion(
    node: Node, device: int, path: Path, problem: Problem, goal: Goal, solver: Solver,
    family: Family,
) -> None:  # fmt: skip
    """Serve a device from within the next rung's radius, at each gap of the order, or not.

    On the last rung, gaps without a child are closed in the node's mask, for all descendants.
    """
    relaxation = problem.relaxation
    child, level = solver.child, node.level[device]
    radius = relaxation.ladder[level]
    others = goal.rest - relaxation.promise[device, level]
    _begin(family, INSERTION, device, radius)
    one = np.uint64(1)
    for gap in range(node.size[0] + 1):
        bit = one << np.uint64(gap)
        if node.mask[device] & bit == 0:
            continue
        copy_node(node, child)
        insert(child, device, gap, relaxation.row[level, radius])
        aim(child, gap, path, problem, goal.eps, solver)
        dual = solve(child, problem, goal, others, LOOSE, solver)
        dual = min(dual, node.number[1] + relaxation.promise[device, level])
        stays = _offer(family, gap, dual, others, node, child, goal)
        if not stays and radius == relaxation.radii.shape[0] - 1:
            node.mask[device] &= ~bit
    _offer(
        family, NONE, node.number[1], others + relaxation.promise[device, radius], node, node, goal
    )


@compiled
def by_split(
    node: Node, at: int, radius: int, problem: Problem, goal: Goal, solver: Solver, family: Family
) -> None:
    """Split the distance interval of the stop at a position."""
    relaxation = problem.relaxation
    child = solver.child
    inner, outer = relaxation.ends[node.interval[at], 0], relaxation.ends[node.interval[at], 1]
    _begin(family, SPLIT, at, radius)
    for side in range(2):
        row = relaxation.row[inner, radius] if side == 0 else relaxation.row[radius, outer]
        copy_node(node, child)
        child.interval[at] = row
        dual = min(node.number[1], solve(child, problem, goal, goal.rest, LOOSE, solver))
        _offer(family, row, dual, goal.rest, node, child, goal)


@compiled
def by_merge(
    node: Node, at: int, problem: Problem, goal: Goal, solver: Solver, family: Family
) -> None:
    """Make the stop at a position one with the stop before it, or keep them apart for good."""
    child = solver.child
    _begin(family, MERGE, at, ZERO)
    for edge in (MERGED, BARRED):
        copy_node(node, child)
        child.edge[at] = edge
        needed = stops_needed(child, problem.limits.per_step)
        if needed < 0 or needed > problem.limits.steps - 1:
            continue
        dual = node.number[1]
        if edge == MERGED:
            dual = min(dual, solve(child, problem, goal, goal.rest, LOOSE, solver))
        _offer(family, edge, dual, goal.rest, node, child, goal)


@compiled
def make_child(node: Node, family: Family, c: int, relaxation: Relaxation, child: Node) -> None:
    """Write child `c` of the family into `child`."""
    copy_node(node, child)
    kind, what, radius = family.what[0], family.what[1], family.what[2]
    detail = family.detail[c]
    if kind == INSERTION:
        if detail < 0:
            child.level[what] = radius
        else:
            insert(child, what, detail, relaxation.row[node.level[what], radius])
    elif kind == SPLIT:
        child.interval[what] = detail
    else:
        child.edge[what] = detail
    for i in range(3):
        child.number[i] = family.number[c, i]
    for i in range(child.size[0]):
        child.y[i, 0], child.y[i, 1] = family.y[c, i, 0], family.y[c, i, 1]
