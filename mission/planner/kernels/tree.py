"""The open nodes of the branch and bound: a pool of rows and a heap, best bound first."""

from typing import NamedTuple

import numpy as np

from mission.planner.kernels.compiled import Indices, Masks, Matrix, Vector, compiled

# State of the edge before a stop: may its two stops be one?
UNDECIDED, MERGED, BARRED = 0, 1, 2
PLACED = -1  # level of a device that stands in the order


class Node(NamedTuple):
    """One node, unpacked. The first m entries of the arrays by position count."""

    number: Vector  # (3,) bound; share of it that the path's dual gives; multiplier mu
    size: Indices  # (1,) m, devices in the order
    order: Indices  # (K,) by position: device
    interval: Indices  # (K,) by position: row of the distance interval
    edge: Indices  # (K,) by position: edge to the stop before it, the start for position 0
    y: Matrix  # (K, 2) by position: dual of that edge
    level: Indices  # (K,) by device: PLACED, or index of the radius it is out of reach of
    mask: Masks  # (K,) by device: gaps of the order that it may still be inserted in


class Tree(NamedTuple):
    """Rows of nodes; `heap[:used[0]]` are open, `spare[:used[1]]` unused."""

    number: Matrix
    size: Indices
    order: Indices
    interval: Indices
    edge: Indices
    y: Matrix
    level: Indices
    mask: Masks
    heap: Indices
    spare: Indices
    used: Indices  # (2,) open nodes; unused rows


def make_node(devices: int) -> Node:
    """An empty node: nothing in the order, every device open everywhere."""
    return Node(
        np.zeros(3),
        np.zeros(1, dtype=np.int64),
        np.zeros(devices, dtype=np.int64),
        np.zeros(devices, dtype=np.int64),
        np.zeros(devices, dtype=np.int64),
        np.zeros((devices, 2)),
        np.zeros(devices, dtype=np.int64),
        np.ones(devices, dtype=np.uint64),
    )


def make_tree(rows: int, devices: int) -> Tree:
    """An empty pool of that many rows."""
    return Tree(
        np.zeros((rows, 3)),
        np.zeros(rows, dtype=np.int64),
        np.zeros((rows, devices), dtype=np.int16),
        np.zeros((rows, devices), dtype=np.int16),
        np.zeros((rows, devices), dtype=np.int8),
        np.zeros((rows, devices, 2)),
        np.zeros((rows, devices), dtype=np.int8),
        np.zeros((rows, devices), dtype=np.uint64),
        np.zeros(rows, dtype=np.int64),
        np.arange(rows - 1, -1, -1),
        np.array([0, rows]),
    )


@compiled
def push(tree: Tree, node: Node) -> bool:
    """Keep a copy of the node among the open ones; False if the pool is full."""
    if tree.used[1] == 0:
        return False
    tree.used[1] -= 1
    row = tree.spare[tree.used[1]]
    for i in range(3):
        tree.number[row, i] = node.number[i]
    m = node.size[0]
    tree.size[row] = m
    for i in range(m):
        tree.order[row, i] = node.order[i]
        tree.interval[row, i] = node.interval[i]
        tree.edge[row, i] = node.edge[i]
        tree.y[row, i, 0], tree.y[row, i, 1] = node.y[i, 0], node.y[i, 1]
    for k in range(node.level.shape[0]):
        tree.level[row, k], tree.mask[row, k] = node.level[k], node.mask[k]
    heap, number = tree.heap, tree.number
    i = tree.used[0]
    tree.used[0] += 1
    heap[i] = row
    while i > 0:
        up = (i - 1) // 2
        if number[heap[up], 0] >= number[heap[i], 0]:
            break
        heap[up], heap[i] = heap[i], heap[up]
        i = up
    return True


@compiled
def best_open(tree: Tree) -> float:
    """The largest bound among the open nodes; there must be one."""
    return float(tree.number[tree.heap[0], 0])


@compiled
def pop(tree: Tree, node: Node) -> None:
    """Unpack the open node with the largest bound, and free its row."""
    heap, number = tree.heap, tree.number
    row = heap[0]
    tree.used[0] -= 1
    last = tree.used[0]
    heap[0] = heap[last]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= last:
            break
        if child + 1 < last and number[heap[child + 1], 0] > number[heap[child], 0]:
            child += 1
        if number[heap[i], 0] >= number[heap[child], 0]:
            break
        heap[i], heap[child] = heap[child], heap[i]
        i = child
    tree.spare[tree.used[1]] = row
    tree.used[1] += 1
    for i in range(3):
        node.number[i] = tree.number[row, i]
    m = tree.size[row]
    node.size[0] = m
    for i in range(m):
        node.order[i] = tree.order[row, i]
        node.interval[i] = tree.interval[row, i]
        node.edge[i] = tree.edge[row, i]
        node.y[i, 0], node.y[i, 1] = tree.y[row, i, 0], tree.y[row, i, 1]
    for k in range(node.level.shape[0]):
        node.level[k], node.mask[k] = tree.level[row, k], tree.mask[row, k]


@compiled
def copy_node(source: Node, target: Node) -> None:
    """Overwrite `target` with `source`."""
    for i in range(3):
        target.number[i] = source.number[i]
    target.size[0] = source.size[0]
    m = source.size[0]
    for i in range(m):
        target.order[i] = source.order[i]
        target.interval[i] = source.interval[i]
        target.edge[i] = source.edge[i]
        target.y[i, 0], target.y[i, 1] = source.y[i, 0], source.y[i, 1]
    for k in range(source.level.shape[0]):
        target.level[k], target.mask[k] = source.level[k], source.mask[k]


@compiled
def insert(node: Node, device: int, gap: int, row: int) -> None:
    """Put a device in a gap of the order, with a distance interval; its y is left to the caller.

    Between two merged stops it belongs to the same stop. A bar between two stops says nothing
    about either new edge alone and is forgotten.
    """
    m = node.size[0]
    new_edge = UNDECIDED
    if gap < m and node.edge[gap] == MERGED:
        new_edge = MERGED
    for i in range(m, gap, -1):
        node.order[i], node.interval[i] = node.order[i - 1], node.interval[i - 1]
        node.edge[i] = node.edge[i - 1]
        node.y[i, 0], node.y[i, 1] = node.y[i - 1, 0], node.y[i - 1, 1]
    node.order[gap], node.interval[gap], node.edge[gap] = device, row, new_edge
    if gap < m:
        node.edge[gap + 1] = new_edge
    node.size[0] = m + 1
    node.level[device] = PLACED
    one = np.uint64(1)
    g = np.uint64(gap)
    low = (one << g) - one
    for k in range(node.level.shape[0]):
        if node.level[k] != PLACED:
            old = node.mask[k]
            bit = (old >> g) & one
            above = (old >> (g + one)) << (g + one + one)
            node.mask[k] = (old & low) | (bit << g) | (bit << (g + one)) | above


@compiled
def stops_needed(node: Node, per_step: int) -> int:
    """Fewest stops after the start that serve the order; -1 if the merges overfill one.

    Stops serve stretches of the order, so that filling each as far as it goes is optimal.
    """
    m, edge = node.size[0], node.edge
    needed, load, i = 0, 0, 0
    while i < m:
        run = 1
        while i + run < m and edge[i + run] == MERGED:
            run += 1
        if run > per_step:
            return -1
        if edge[i] != BARRED and load + run <= per_step:
            load += run
        else:
            needed += 1
            load = run
        i += run
    return needed


@compiled
def stops_now(node: Node) -> int:
    """Stops after the start if no more are merged."""
    count = 0
    for i in range(node.size[0]):
        if node.edge[i] != MERGED:
            count += 1
    return count
