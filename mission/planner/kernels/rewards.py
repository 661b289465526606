"""What devices earn at a distance, and what an assignment of them to steps earns."""

import math

from mission.planner.kernels.compiled import Indices, Matrix, compiled
from mission.planner.kernels.instance import Devices


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
