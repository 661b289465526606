"""A round's plan as it is flown: stops, how fast and how sharply between them, and the mission
items that are uploaded, and that the round's plan file holds."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from pymavlink.dialects.v20 import common as mav

from mission.base.airspace import Airspace
from mission.base.area import Area, on_globe
from mission.base.arrays import Bools, Floats
from mission.config.models import MissionConfig
from mission.planner.flyable import Stop, acceptance_radius, cut_behind, stops_of
from mission.planner.performance import Foreseen, Performance
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem
from sitl.autopilot.codec.orders import MissionItem

_SETTLE_S = 1.0  # of hover after a climb
_CLIMB_RADIUS_M = 1.0  # of the altitude, where autopilots take the acceptance radius for it too
DEG_E7 = 1e7  # places travel in whole ten-millionths of a degree
_GROUND_SPEED = 1.0
_UNCHANGED = -1.0


@dataclass(frozen=True)
class Demand:
    """What flights ask of the vehicle: speed, height, distance from home, acceptance radius."""

    speed_mps: float
    altitude_m: float  # above home
    distance_m: float  # farthest from home
    acceptance_m: float


@dataclass(frozen=True)
class FlightPlan:
    """What the pilot flies in one round, or in a part of one. The first stop is where the aircraft
    already is."""

    stops: tuple[Stop, ...]
    alt_rel_m: float
    speed_mps: float
    acceptance_m: float
    is_part: bool = False  # of a round: the vehicle holds at its first stop already
    goes_on: bool = False  # with a round that has begun: what passed since its last part counts

    @property
    def points_m(self) -> Floats:
        """(S, 2) the polyline in area coordinates."""
        return np.array([stop.xy_m for stop in self.stops])

    @property
    def stands(self) -> bool:
        """Whether there is nothing to fly: one stop, without a hover."""
        return len(self.stops) == 1 and self.stops[0].hold_s == 0.0

    @property
    def waits(self) -> bool:
        """Whether it is a hover where the vehicle holds already."""
        return self.is_part and len(self.stops) == 1

    def foreseen(self, performance: Performance) -> Foreseen:
        """Predict arrival times (s), duration (s) and energy (J) of the flight."""
        holds_s = [stop.hold_s for stop in self.stops]
        return performance.foresee(self.points_m, holds_s, self.acceptance_m)

    def parts(self, serves: Bools) -> Iterator["FlightPlan"]:
        """The flight cut behind each stop with a step that `serves` (N,), as `cut_behind` does."""
        for stops in cut_behind(self.stops, serves):
            goes_on = self.goes_on or stops[0] is not self.stops[0]
            yield replace(self, stops=stops, is_part=True, goes_on=goes_on)

    def slot_s(self, foreseen: Foreseen) -> list[float]:
        """(N,) when each step is passed, in seconds after the start."""
        return [
            float(arrived_s) + begin_s
            for stop, arrived_s in zip(self.stops, foreseen.arrived_s, strict=True)
            for begin_s in stop.slots_s
        ]


def flight_of_round(
    problem: RoundProblem, plan: RoundPlan, *, hold_s: float, mission: MissionConfig
) -> FlightPlan:
    """Return the flight of a round's plan, with the widest acceptance radius that the plan allows.

    `hold_s` as in `stops_of`; speed and the greatest possible radius are the mission's.
    """
    problem = problem.at(plan.altitude_m)
    radius_m = acceptance_radius(problem, plan, mission.acceptance_radius_m)
    stops = stops_of(plan, hold_s=hold_s, upload_s=problem.upload_s)
    return FlightPlan(stops, problem.channel.altitude_m, mission.speed_mps, radius_m)


def direct_flight(
    start_m: Floats, end_m: Floats, *, altitude_m: float, mission: MissionConfig, airspace: Airspace
) -> FlightPlan:
    """The shortest way from one point (2,) of the area to another, serving nobody."""
    stops = tuple(Stop(point, ()) for point in airspace.way(start_m, end_m))
    widest_m = mission.acceptance_radius_m
    radius_m = widest_m if airspace.is_open else min(widest_m, airspace.margin_m / 2.0)
    return FlightPlan(stops, altitude_m, mission.speed_mps, radius_m)


def climb(at_m: Floats, altitude_m: float, *, mission: MissionConfig) -> FlightPlan:
    """Return a vertical climb or descent to `altitude_m` above a point (2,), serving nobody."""
    return FlightPlan(
        (Stop(at_m, (), hold_s=_SETTLE_S),), altitude_m, mission.speed_mps, _CLIMB_RADIUS_M
    )


def mission_items(plan: FlightPlan, area: Area) -> list[MissionItem]:
    """The stops as items: the first stop, the speed of all legs, the other stops.

    The first stop is where the vehicle already is; the speed stands after it because autopilots
    apply DO_CHANGE_SPEED to the leg after the item before it. See `stop_items`.
    """
    places = on_globe(area, plan.points_m, plan.alt_rel_m)
    waypoints = [
        MissionItem(
            seq=seq,
            command=mav.MAV_CMD_NAV_WAYPOINT,
            frame=mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
            params=(stop.hold_s, plan.acceptance_m, 0.0, math.nan),
            x=round(place.lat_deg * DEG_E7) / DEG_E7,
            y=round(place.lon_deg * DEG_E7) / DEG_E7,
            z=plan.alt_rel_m,
        )
        for seq, stop, place in zip(stop_items(plan), plan.stops, places, strict=True)
    ]
    speed = MissionItem(
        seq=1,
        command=mav.MAV_CMD_DO_CHANGE_SPEED,
        frame=mav.MAV_FRAME_MISSION,
        params=(_GROUND_SPEED, plan.speed_mps, _UNCHANGED, 0.0),
        x=0.0,
        y=0.0,
        z=0.0,
    )
    return [waypoints[0], speed, *waypoints[1:]]


def stop_items(plan: FlightPlan) -> list[int]:
    """The number of every stop among the `mission_items`."""
    return [0, *range(2, len(plan.stops) + 1)]
