"""A plan as stops: waypoints that coincide become one, with several time steps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
    begins_s: tuple[float, ...] = ()  # of each step, after the arrival; (): spread over the hover

    @property
    def slots_s(self) -> tuple[float, ...]:
        """When each step begins, in seconds after the arrival; the first at 0."""
        count = len(self.steps)
        return self.begins_s or tuple(self.hold_s * rank / count for rank in range(count))


def stops_of(
    plan: RoundPlan, *, hold_s: float = 0.0, upload_s: Floats | None = None
) -> tuple[Stop, ...]:
    """Merge consecutive waypoints closer than `SAME_PLACE_M` to the first of them.

    `hold_s` is the least hover at every stop but the first; with one stop in all, at that one.
    Corners between waypoints are stops without a step, and without a hover. `upload_s` (K,) is how
    long each device sends: each step then lasts until its devices have sent, one after another,
    and a stop until all of its steps have.
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
    stops = (
        Stop(point, tuple(served), hold_s if served and (alone or index > 0) else 0.0)
        for index, (point, served) in enumerate(groups)
    )
    if upload_s is None:
        return tuple(stops)
    busy_s = plan.schedule @ upload_s  # (N,)
    return tuple(_until_sent(stop, busy_s[list(stop.steps)].tolist()) for stop in stops)


def _until_sent(stop: Stop, busy_s: Sequence[float]) -> Stop:
    """The stop, with each of its steps given as long as its devices send."""
    begins_s: list[float] = []
    free_s = 0.0
    for begin_s, step_s in zip(stop.slots_s, busy_s, strict=True):
        begins_s.append(max(begin_s, free_s))
        free_s = begins_s[-1] + step_s
    return replace(stop, hold_s=max(stop.hold_s, free_s), begins_s=tuple(begins_s))
