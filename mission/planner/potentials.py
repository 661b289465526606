"""A bound from potentials: which devices take part in it, and how long it is lowered."""

from dataclasses import replace

import numpy as np

from mission.base.arrays import Floats, Ints
from mission.planner.native.library import (
    MOST_DEVICES,
    MOST_MESHES,
    Devices,
    Found,
    Limits,
    lower_potentials,
)

MANY_TURNS = 3000  # with more devices than are searched
SOME_MESHES, SOME_TURNS = 3, 1500  # for what a search has left open
ROUGH_MESHES = 2  # where a bound need not be the best, in as many turns
NEARLY = 0.02  # a gap that more meshes are not worth their time for with so many devices
DEAR = 0.9  # of the price of a place: what a device must be worth to take part
TOGETHER = 8  # neighbours that are worked out together


def by_potentials(
    devices: Devices, limits: Limits, *, plan: Found, gap: float, most_turns: int, rough: bool
) -> Found:
    """The plan with a bound from potentials, where that is lower.

    Raises:
        MemoryError: there is too little memory.
    """
    price = price_of_place(devices, limits, plan)
    dear = devices.delta * devices.rows[:, 0].max() >= DEAR * price
    some = np.flatnonzero(dear)
    some = some[by_strips(devices.u[some])]
    many = len(devices.delta) > MOST_DEVICES
    meshes, turns = (MOST_MESHES, MANY_TURNS) if many else (SOME_MESHES, SOME_TURNS)
    bound = lower_potentials(
        Devices(devices.u[some], devices.delta[some], devices.rows),
        limits,
        plan=plan,
        price=price,
        left_out=devices.delta[~dear].max(initial=0.0),
        gap=max(gap, NEARLY) if many else gap,
        turns=min(turns, most_turns),
        meshes=ROUGH_MESHES if rough else meshes,
        may_halve=many,
    )
    return replace(plan, bound=bound)


def price_of_place(devices: Devices, limits: Limits, plan: Found) -> float:
    """What the last place is worth in a plan that uses all of them; 0 in others."""
    served = plan.assigned >= 0
    if served.sum() < limits.steps * limits.per_step:
        return 0.0
    away = np.linalg.norm(devices.u[served] - plan.way[plan.assigned[served]], axis=1)
    success = np.interp(away, np.arange(len(devices.rows)), devices.rows[:, 0])
    return float((devices.delta[served] * success).min())


def by_strips(u: Floats) -> Ints:
    """An order of places (K, 2) in which so many in a row are neighbours: strip by strip."""
    x = u[:, 0] - u[:, 0].min()
    strips = 1 + int(np.sqrt(len(u) / TOGETHER))
    return np.lexsort((u[:, 1], np.floor(x * strips / max(x.max(), 1e-9))))
