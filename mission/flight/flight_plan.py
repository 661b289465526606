"""A round's plan as stops to fly: waypoints that coincide become one stop with several slots."""

from dataclasses import dataclass

import numpy as np

from flightdyn.state import GeodeticPoint
from mission.base import polyline
from mission.base.airspace import OPEN, Airspace
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.config.models import MissionConfig
from mission.planner.flyable import SAME_PLACE_M, acceptance_radius
from mission.planner.problem import RoundPlan, RoundProblem

_SETTLE_S = 1.0  # of hover after a climb
_CLIMB_RADIUS_M = 1.0  # of the altitude, where autopilots take the acceptance radius for it too


@dataclass(frozen=True)
class Stop:
    """One place to pass or to hover at, and the plan's time steps that are served there."""

    xy_m: Floats  # (2,) area coordinates
    steps: tuple[int, ...]
    hold_s: float = 0.0


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
        is always at its planned speed. Steps that share a hover are spread evenly over it.
        """
        legs_m = polyline.legs(self.points_m)
        slot_s: list[float] = []
        clock_s = 0.0
        for stop, leg_m in zip(self.stops, (*legs_m, 0.0), strict=True):
            share_s = stop.hold_s / max(len(stop.steps), 1)
            slot_s += [clock_s + share_s * rank for rank in range(len(stop.steps))]
            clock_s += stop.hold_s + leg_m / self.speed_mps
        return slot_s

    def positions(self, area: Area) -> tuple[GeodeticPoint, ...]:
        """The stops on the globe."""
        return tuple(
            area.frame.to_geodetic(area.to_ned(stop.xy_m, self.alt_rel_m)) for stop in self.stops
        )


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


def flight_of_round(
    problem: RoundProblem, plan: RoundPlan, *, hold_s: float, mission: MissionConfig
) -> FlightPlan:
    """The flight of a round's plan, with corners as wide as the plan bears.

    `hold_s` as in `stops_of`; speed and the widest acceptance radius are the mission's.
    """
    problem = problem.at(plan.altitude_m)
    radius_m = acceptance_radius(problem, plan, mission.acceptance_radius_m)
    stops = stops_of(plan, hold_s=hold_s)
    return FlightPlan(stops, problem.channel.altitude_m, mission.speed_mps, radius_m)


def direct_flight(
    start_m: Floats,
    end_m: Floats,
    *,
    altitude_m: float,
    mission: MissionConfig,
    airspace: Airspace = OPEN,
) -> FlightPlan:
    """The shortest way from one point (2,) of the area to another, serving nobody."""
    stops = tuple(Stop(point, ()) for point in airspace.way(start_m, end_m))
    widest_m = mission.acceptance_radius_m
    radius_m = widest_m if airspace.is_open else min(widest_m, airspace.margin_m / 2.0)
    return FlightPlan(stops, altitude_m, mission.speed_mps, radius_m)


def climb(at_m: Floats, altitude_m: float, *, mission: MissionConfig) -> FlightPlan:
    """Straight up or down above a point (2,), serving nobody."""
    return FlightPlan(
        (Stop(at_m, (), hold_s=_SETTLE_S),), altitude_m, mission.speed_mps, _CLIMB_RADIUS_M
    )
