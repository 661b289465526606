"""A round's plan as stops to fly: waypoints that coincide become one stop with several slots."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flightdyn.state import GeodeticPoint
from mission.base import polyline
from mission.base.airspace import OPEN, Airspace
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.config.models import MissionConfig
from mission.planner.flyable import SAME_PLACE_M, acceptance_radius
from mission.planner.problem import RoundPlan, RoundProblem


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


@dataclass(frozen=True)
class FlightPlan:
    """What the pilot flies in one round. The first stop is where the aircraft already is."""

    stops: tuple[Stop, ...]
    alt_rel_m: float
    speed_mps: float
    acceptance_m: float

    @property
    def points_m(self) -> Floats:
        """(S, 2) the polyline in area coordinates."""
        return np.array([stop.xy_m for stop in self.stops])

    @property
    def stands(self) -> bool:
        """Whether there is nothing to fly: one stop, without a hover."""
        return len(self.stops) == 1 and self.stops[0].hold_s == 0.0

    def ideal_slot_s(self) -> list[float]:
        """(N,) when each step would be passed, in seconds after the start, by an aircraft that
        is always at its planned speed.
        """
        legs_m = polyline.legs(self.points_m)
        slot_s: list[float] = []
        clock_s = 0.0
        for stop, leg_m in zip(self.stops, (*legs_m, 0.0), strict=True):
            slot_s += [clock_s + begin_s for begin_s in stop.slots_s]
            clock_s += stop.hold_s + leg_m / self.speed_mps
        return slot_s

    def positions(self, area: Area) -> tuple[GeodeticPoint, ...]:
        """The stops on the globe."""
        return tuple(
            area.frame.to_geodetic(area.to_ned(stop.xy_m, self.alt_rel_m)) for stop in self.stops
        )


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


def flight_of_round(
    problem: RoundProblem, plan: RoundPlan, *, hold_s: float, mission: MissionConfig
) -> FlightPlan:
    """The flight of a round's plan, with corners as wide as the plan bears.

    `hold_s` as in `stops_of`; altitude, speed and the widest acceptance radius are the mission's.
    """
    radius_m = acceptance_radius(problem, plan, mission.acceptance_radius_m)
    stops = stops_of(plan, hold_s=hold_s, upload_s=problem.upload_s)
    return FlightPlan(stops, mission.altitude_m, mission.speed_mps, radius_m)


def direct_flight(
    start_m: Floats, end_m: Floats, *, mission: MissionConfig, airspace: Airspace = OPEN
) -> FlightPlan:
    """The shortest way from one point (2,) of the area to another, serving nobody."""
    stops = tuple(Stop(point, ()) for point in airspace.way(start_m, end_m))
    widest_m = mission.acceptance_radius_m
    radius_m = widest_m if airspace.is_open else min(widest_m, airspace.margin_m / 2.0)
    return FlightPlan(stops, mission.altitude_m, mission.speed_mps, radius_m)
