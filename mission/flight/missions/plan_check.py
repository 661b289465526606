"""Checks whether a plan file may be flown, and the path that its items describe.

The checks refuse what the autopilot would refuse, by its own rules, and what it would accept but
is not fit for an unattended flight.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.config import LimitsConfig
from flightdyn.foresight import SETTLING_S, STOPPING_S
from flightdyn.frames import LocalFrame
from flightdyn.guidance.path import FlightPath, passing_times
from flightdyn.state import GeodeticPoint
from mission.base import polyline
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.flight.missions.mission_path import mission_path, place_m
from mission.flight.missions.plan_file import PlanFile
from sitl.autopilot.codec.orders import GLOBAL_FRAMES, MissionItem, command_name
from sitl.autopilot.fence import breach_of, compile_fence
from sitl.autopilot.flying import route
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.protocol.order_rules import COMMANDS, NAVIGATION, PLACES, check_item

MAX_HEIGHT_M = 500.0
MAX_WAIT_S = 3600.0
ALLOWED = COMMANDS - {mav.MAV_CMD_NAV_LOITER_UNLIM}  # which nobody is there to end
_LAST = (mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, mav.MAV_CMD_NAV_LAND)
_WAITS = (
    mav.MAV_CMD_NAV_WAYPOINT,
    mav.MAV_CMD_NAV_LOITER_TIME,
    mav.MAV_CMD_NAV_DELAY,
    mav.MAV_CMD_CONDITION_DELAY,
)
_KEEP, _DEFAULT = -1.0, -2.0  # DO_CHANGE_SPEED's other values
_BEFORE_M = 1e-3  # a place, where it is passed before what is waited there
_KINDS = {
    mav.MAV_MISSION_TYPE_MISSION: "item",
    mav.MAV_MISSION_TYPE_FENCE: "fence point",
    mav.MAV_MISSION_TYPE_RALLY: "rally point",
}


@dataclass(frozen=True)
class CheckedPath:
    """Path of a plan file from the ground at home to the last place, with its return or landing."""

    points_ned_m: Floats  # (P, 3); the first is home
    places: tuple[tuple[int, Floats], ...]  # items in the order in which they are flown, (3,) each
    rally_ned_m: tuple[Floats, ...]  # (3,) each: where a return may lead beside home
    returns: bool  # comes home and lands by itself, or lands elsewhere
    slot_s: Floats  # (P,) when each point is passed in calm air; the last one: when all is over


def nowhere(item: MissionItem) -> bool:
    """Whether an item has no place: it is carried out where the vehicle is."""
    return item.x == item.y == 0.0 or (math.isnan(item.x) and math.isnan(item.y))


def placed(items: Sequence[MissionItem], home: GeodeticPoint) -> tuple[MissionItem, ...]:
    """Return the items; take-offs and landings without a place get the one where they happen."""
    lat_deg, lon_deg = home.lat_deg, home.lon_deg
    found_items = []
    for item in items:
        with_place = item
        if item.command in (mav.MAV_CMD_NAV_TAKEOFF, mav.MAV_CMD_NAV_LAND) and nowhere(item):
            with_place = replace(item, x=lat_deg, y=lon_deg)
        if with_place.command in PLACES:
            lat_deg, lon_deg = with_place.x, with_place.y
        found_items.append(with_place)
    return tuple(found_items)


def checked_path(
    plan: PlanFile, home: GeodeticPoint, *, parameters: Parameters, limits: LimitsConfig
) -> CheckedPath:
    """The path of a plan that begins at `home`, for a vehicle with these parameters that keeps to
    these limits.

    Raises:
        InputError: names the file, the item, what is wrong and what is allowed.
    """
    frame, p = LocalFrame(home), parameters

    def refuse(item: MissionItem, wrong: str) -> None:
        if wrong:
            name = f"{_KINDS[item.mission_type]} {item.seq}, {command_name(item.command)}"
            raise InputError(f"{plan.path}: {name}: {wrong}")

    def bad_height(item: MissionItem, *, least_m: float) -> str:
        height_m = route.item_altitude(item, home) - home.alt_msl_m
        if least_m <= height_m <= MAX_HEIGHT_M:
            return ""
        return f"{height_m:.1f} m above home; {least_m:g} to {MAX_HEIGHT_M:g} m are allowed"

    leading = NAVIGATION - {mav.MAV_CMD_NAV_DELAY}  # which may be on the ground
    first_seq = next((item.seq for item in plan.items if item.command in leading), 0)
    for item in plan.items:
        first, last = item.seq <= first_seq, item.seq == len(plan.items) - 1
        refuse(item, _wrong(item, first=first, last=last) or _refused(item))
    for item in plan.fence:
        refuse(item, _refused(item))
    try:
        fence = compile_fence(plan.fence, frame)
    except InputError as error:
        raise InputError(f"{plan.path}: {error}") from None
    reason = route.check_mission(plan.items, frame=frame, home=home, farthest_m=p["MIS_DIST_1WP"])
    if reason:
        raise InputError(f"{plan.path}: {reason}")
    area = Area.at((1.0, 1.0), (0.0, 0.0), home)
    rally = [place_m(item, area) for item in plan.rally]
    way = mission_path(plan.items, area, np.zeros(3), rally_m=rally)
    points = area.to_ned(way.points_m[:, :2], way.points_m[:, 2])
    places, begin = [], 0
    for at in np.flatnonzero(way.seqs >= 0).tolist():
        item = plan.items[way.seqs[at]]
        if item.command not in PLACES:
            continue
        if item.command != mav.MAV_CMD_NAV_LAND:
            refuse(item, bad_height(item, least_m=1.0))
        leg = _metre_by_metre(points[begin : at + 1])
        if breach := breach_of(fence, leg, home_ned_m=np.zeros(3), parameters=p):
            refuse(item, f"the way there is partly {breach}")
        places.append((item.seq, points[at]))
        begin = at
    if not places:
        raise InputError(f"{plan.path}: no item leads anywhere")
    rally_ned_m: list[Floats] = []
    for item in plan.rally:
        refuse(item, "it has no position" if item.x == item.y == 0.0 else _refused(item))
        place = route.place_of(item, frame, home)
        refuse(item, route.too_far(place, np.zeros(3), farthest_m=p["MIS_DIST_1WP"]))
        refuse(item, bad_height(item, least_m=0.0))
        if breach := breach_of(fence, place, home_ned_m=np.zeros(3), parameters=p):
            refuse(item, f"it is {breach}")
        rally_ned_m.append(place)
    ends = plan.items[-1].command in _LAST
    slot_s = _slot_s(plan.items, home, p, limits, points)
    return CheckedPath(points, tuple(places), tuple(rally_ned_m), ends, slot_s)


def _wrong(item: MissionItem, *, first: bool, last: bool) -> str:
    """Return why an item is not fit for an unattended flight; empty if it is."""
    if item.command not in ALLOWED:
        return "not flown here; docs/vehicles.md, Fly a plan, says which commands are"
    if not item.autocontinue:
        return "stops without autocontinue, and nobody is there to go on"
    if item.command in PLACES and item.frame in GLOBAL_FRAMES and item.x == item.y == 0.0:
        return "it has no position"
    if item.command == mav.MAV_CMD_NAV_TAKEOFF and not first:
        return "a take-off has to come first"
    if item.command in _LAST and not last:
        return "nothing may come after it"
    if wait_of(item) > MAX_WAIT_S:
        return f"waits {wait_of(item):g} s; {MAX_WAIT_S:g} s at most"
    speed_mps = item.params[1] if item.command == mav.MAV_CMD_DO_CHANGE_SPEED else _KEEP
    if speed_mps not in (_KEEP, _DEFAULT) and not 0.5 <= speed_mps <= 30.0:
        return f"{speed_mps:g} m/s; 0.5 to 30 m/s are allowed"
    return ""


def _refused(item: MissionItem) -> str:
    """What the autopilot has against an item; empty if nothing."""
    return check_item(item)[1]


def _slot_s(
    items: Sequence[MissionItem],
    home: GeodeticPoint,
    p: Parameters,
    limits: LimitsConfig,
    points_ned_m: Floats,
) -> Floats:
    """When the items lead past each of the points (P, 3), the last of which a landing ends at."""
    stages = route.compile_route(
        items, p, frame=LocalFrame(home), home=home, start=np.zeros(3), on_ground=True
    )
    end_ned_m, here = points_ned_m[-1], np.zeros(3)
    along_m, t_s = [0.0], [SETTLING_S]  # the latter where it ends

    def passed(path: FlightPath) -> None:
        times_s, before_s = passing_times(path, limits), t_s[-1]
        along_m.extend((along_m[-1] + polyline.along(path.points_ned_m)).tolist())
        t_s.extend((before_s + np.asarray(times_s)).tolist())
        took(0.0, before_s + (float(times_s[-1]) + STOPPING_S))

    def took(metres: float, until_s: float) -> None:
        along_m.append(along_m[-1] + metres)
        t_s.append(until_s)

    for stage in stages:
        match stage:
            case route.Fly(path):
                passed(path)
                here = path.points_ned_m[-1]
            case route.Wait(wait_s):
                took(0.0, t_s[-1] + wait_s)
            case route.Circle(orbit, phase_rad):
                metres = orbit.turns * math.tau * orbit.radius_m
                took(metres, t_s[-1] + metres / abs(orbit.speed_mps))
                here = orbit.after(phase_rad, orbit.turns)
            case route.End(command):
                down_m = float(here[2])
                if command == mav.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                    far = float(np.linalg.norm((end_ned_m - here)[:2])) > p["RTL_MIN_DIST"]
                    down_m = min(down_m, -p["RTL_RETURN_ALT"] if far else 0.0)
                    points = np.array([here, (*here[:2], down_m), (*end_ned_m[:2], down_m)])
                    speeds, radii = np.full(2, p["MPC_XY_CRUISE"]), np.full(3, p["NAV_ACC_RAD"])
                    passed(FlightPath(points, speeds, radii))
                slow_m = min(-down_m, p["MPC_LAND_ALT2"])
                fast_s = (-down_m - slow_m) / p["MPC_Z_VEL_MAX_DN"]
                took(-down_m, t_s[-1] + (fast_s + slow_m / p["MPC_LAND_SPEED"]))
    at_m = polyline.along(points_ned_m)
    reached_m = at_m * (along_m[-1] / (at_m[-1] or 1.0)) - _BEFORE_M
    slot_s = np.interp(reached_m, along_m, t_s) - SETTLING_S
    slot_s[-1] = t_s[-1]
    return slot_s


def _metre_by_metre(points: Floats) -> Floats:
    """A polyline with points a metre apart at most."""
    parts = [
        np.linspace(a, b, 2 + int(np.linalg.norm(b - a))) for a, b in itertools.pairwise(points)
    ]
    return np.vstack(parts)


def wait_of(item: MissionItem) -> float:
    """Seconds for which the vehicle hovers at an item."""
    return item.params[0] if item.command in _WAITS and item.params[0] > 0.0 else 0.0
