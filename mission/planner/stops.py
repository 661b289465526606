"""A plan as stops: waypoints that coincide become one, with several time steps."""

from dataclasses import dataclass

import numpy as np

from mission.base.arrays import Floats
from mission.planner.problem import RoundPlan

SAME_PLACE_M = 0.5  # waypoints nearer than this are flown as one; no flight tells them apart


@dataclass(frozen=True)
class Stop:
    """One place to pass or to hover at, and the plan's time steps that are served there."""

    xy_m: Floats  # (2,) area coordinates
    steps: tuple[int, ...]
    hold_s: float = 0.0


def stops_of(plan: RoundPlan, *, hold_s: float = 0.0) -> tuple[Stop, ...]:
    """Merge consecutive waypoints closer than `SAME_PLACE_M` to the first of them.

    `hold_s` is the hover at every stop but the first; with one stop in all, at that one. Corners
    between waypoints are stops without a step, and without a hover.
    """
    groups: list[tuple[Floats, list[int]]] = []
    steps = {int(at): step for step, at in enumerate(plan.stops_at)}
    for at, point in enumerate(plan.route_m):
        here = [steps[at]] if at in steps else []
        if groups and float(np.linalg.norm(point - groups[-1][0])) <= SAME_PLACE_M:
            groups[-1][1].extend(here)
        else:
            groups.append((np.asarray(point, dtype=np.float64), here))
    alone = len(groups) == 1
    return tuple(
        Stop(point, tuple(served), hold_s if served and (alone or index > 0) else 0.0)
        for index, (point, served) in enumerate(groups)
    )
