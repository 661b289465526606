"""A plan as stops: waypoints that coincide become one, with several time steps."""

import math
from dataclasses import dataclass

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
    steps = {at: step for step, at in enumerate(plan.stops_at.tolist())}
    groups: list[tuple[int, list[int]]] = []  # the first point of the route, and the steps
    route = plan.route_m.tolist()
    for at, point in enumerate(route):
        if not groups or math.dist(point, route[groups[-1][0]]) > SAME_PLACE_M:
            groups.append((at, []))
        if at in steps:
            groups[-1][1].append(steps[at])
    alone = len(groups) == 1
    busy_s = None if upload_s is None else (plan.schedule @ upload_s).tolist()  # (N,)
    stops: list[Stop] = []
    for index, (at, served) in enumerate(groups):
        hover_s = hold_s if served and (alone or index > 0) else 0.0
        begins_s: list[float] = []
        if busy_s is not None:
            free_s = 0.0
            for rank, step in enumerate(served):
                begins_s.append(max(hover_s * rank / len(served), free_s))
                free_s = begins_s[-1] + busy_s[step]
            hover_s = max(hover_s, free_s)
        stops.append(Stop(plan.route_m[at], tuple(served), hover_s, tuple(begins_s)))
    return tuple(stops)
