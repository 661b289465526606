"""Who is served at which step, for fixed positions: rewards and the optimal assignment."""

import math

import numpy as np

from mission.planner.kernels.compiled import Indices, Matrix, Vector, compiled
from mission.planner.kernels.instance import Devices

CANDIDATES = 2


@compiled
def copy_plan(way: Matrix, assigned: Indices, to_way: Matrix, to_assigned: Indices) -> None:
    """Overwrite one plan with another. (Loops compile much faster than array assignments.)"""
    for n in range(to_way.shape[0]):
        to_way[n, 0], to_way[n, 1] = way[n, 0], way[n, 1]
    for k in range(to_assigned.shape[0]):
        to_assigned[k] = assigned[k]


@compiled
def reward(r: float, rows: Matrix) -> tuple[float, float, float]:
    """(f, f', f'') at r >= 0 metres, expanded about the nearest row of the 1 m table."""
    i = int(r + 0.5)
    if i >= rows.shape[0]:
        return 0.0, 0.0, 0.0
    d = r - i
    f2 = rows[i, 2]
    f1 = rows[i, 1] + f2 * d
    return rows[i, 0] + (rows[i, 1] + 0.5 * f2 * d) * d, f1, f2


@compiled
def earned(way: Matrix, assigned: Indices, devices: Devices) -> float:
    """sum of delta f over the devices assigned to a step (-1: to none)."""
    total = 0.0
    for k in range(assigned.shape[0]):
        n = assigned[k]
        if n >= 0:
            dx, dy = way[n, 0] - devices.u[k, 0], way[n, 1] - devices.u[k, 1]
            total += devices.delta[k] * reward(math.sqrt(dx * dx + dy * dy), devices.rows)[0]
    return total


@compiled
def match(way: Matrix, per_step: int, devices: Devices, assigned: Indices) -> float:
    """Assign every device to a step of `way` (N, 2) so that the most is earned.

    Every device goes to its nearest step; where that overfills one, the assignment problem is
    solved. Writes `assigned` (K,), -1 for a device that is not served; returns what is earned.
    """
    steps, count = way.shape[0], devices.u.shape[0]
    load = np.zeros(steps, dtype=np.int64)
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
            assigned[k] = -1
            continue
        assigned[k] = nearest
        load[nearest] += 1
        total += devices.delta[k] * f
        if load[nearest] > per_step:
            fits = False
    if fits:
        return total
    solve_sparsely(way, per_step, devices, assigned)
    return earned(way, assigned, devices)


@compiled
def solve_sparsely(way: Matrix, per_step: int, devices: Devices, assigned: Indices) -> None:
    """Solve the assignment among the devices that are worth most at their nearest step.

    Exact unless there are more than `CANDIDATES` devices for each place.
    """
    steps, count = way.shape[0], devices.u.shape[0]
    worth, best = np.empty((steps, count)), np.zeros(count)
    for n in range(steps):
        for k in range(count):
            dx, dy = way[n, 0] - devices.u[k, 0], way[n, 1] - devices.u[k, 1]
            f = devices.delta[k] * reward(math.sqrt(dx * dx + dy * dy), devices.rows)[0]
            worth[n, k] = f
            best[k] = max(best[k], f)
    most = CANDIDATES * per_step * steps
    if count <= most:
        solve_assignment(worth, per_step, assigned)
        return
    least = nth_largest(best.copy(), most)
    columns = np.empty(count, dtype=np.int64)
    used = 0
    for k in range(count):
        if best[k] >= least and best[k] > 0.0:
            columns[used] = k
            used += 1
    few = np.empty(used, dtype=np.int64)
    small = np.empty((steps, used))
    for n in range(steps):
        for j in range(used):
            small[n, j] = worth[n, columns[j]]
    solve_assignment(small, per_step, few)
    assigned[:] = -1
    for j in range(used):
        assigned[columns[j]] = few[j]


@compiled
def nth_largest(values: Vector, n: int) -> float:
    """The n-th largest value (n from 1), by quickselect (Hoare 1961); reorders `values`."""
    low, high, target = 0, values.shape[0] - 1, n - 1
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


@compiled
def solve_assignment(worth: Matrix, per_step: int, assigned: Indices) -> None:
    """Maximise the worth (N, K) of an assignment with `per_step` devices a step at most.

    Shortest augmenting paths with dual prices (Jonker and Volgenant 1987) on copies of the
    steps; the fewer of copies and devices are the rows.
    """
    steps, count = worth.shape
    copies = min(per_step, count)
    slots = steps * copies
    by_device = count <= slots
    rows, columns = (count, slots) if by_device else (slots, count)
    price_row, price = np.zeros(rows), np.zeros(columns)
    row_of = np.full(columns, -1, dtype=np.int64)
    column_of = np.full(rows, -1, dtype=np.int64)
    shortest, before = np.empty(columns), np.empty(columns, dtype=np.int64)
    done = np.empty(columns, dtype=np.bool_)
    for new in range(rows):
        shortest[:] = math.inf
        done[:] = False
        i, least, sink = new, 0.0, -1
        while sink < 0:
            nearest, closest = -1, math.inf
            for j in range(columns):
                if done[j]:
                    continue
                gain = worth[j // copies, i] if by_device else worth[i // copies, j]
                d = least - gain - price_row[i] - price[j]
                if d < shortest[j]:
                    shortest[j] = d
                    before[j] = i
                if shortest[j] < closest or (shortest[j] == closest and row_of[j] < 0):
                    closest, nearest = shortest[j], j
            least = closest
            done[nearest] = True
            if row_of[nearest] < 0:
                sink = nearest
            else:
                i = row_of[nearest]
        price_row[new] += least
        for j in range(columns):
            if done[j] and j != sink:
                price_row[row_of[j]] += least - shortest[j]
                price[j] -= least - shortest[j]
        j = sink
        while True:
            i = before[j]
            row_of[j] = i
            previous = column_of[i]
            column_of[i] = j
            j = previous
            if i == new:
                break
    assigned[:] = -1
    for i in range(rows):
        j = column_of[i]
        if by_device:
            if worth[j // copies, i] > 0.0:
                assigned[i] = j // copies
        elif worth[i // copies, j] > 0.0:
            assigned[j] = i // copies
