"""What the items of a plan file mean as a path, or why they may not be flown.

What the autopilot would refuse is refused by the autopilot's own rules, and so is what it would
take but what has no business in an unattended flight.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint
from mission.base import polyline
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.flight.plan_file import PlanFile
from sitl.autopilot.codec.orders import GLOBAL_FRAMES, MissionItem, bare_name, command_name
from sitl.autopilot.fence import breach_of, compile_fence
from sitl.autopilot.flying import route
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.protocol.item_rules import PLACES, check_item, why_refused
from sitl.errors import SitlInputError

MAX_HEIGHT_M = 500.0
MAX_WAIT_S = 3600.0
ALLOWED = (
    mav.MAV_CMD_NAV_TAKEOFF,
    mav.MAV_CMD_NAV_WAYPOINT,
    mav.MAV_CMD_NAV_LOITER_TIME,
    mav.MAV_CMD_DO_CHANGE_SPEED,
    mav.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    mav.MAV_CMD_NAV_LAND,
)
_LAST = (mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, mav.MAV_CMD_NAV_LAND)
_KEEP, _DEFAULT = -1.0, -2.0  # DO_CHANGE_SPEED's other values
_KINDS = {
    mav.MAV_MISSION_TYPE_MISSION: "item",
    mav.MAV_MISSION_TYPE_FENCE: "fence point",
    mav.MAV_MISSION_TYPE_RALLY: "rally point",
}


@dataclass(frozen=True)
class PlannedPath:
    """What the items mean: from the ground at home to the last place."""

    points_ned_m: Floats  # (P, 3); the first is home
    duration_s: float  # of a flight always at planned speed
    places: dict[int, Floats]  # (3,) NED by sequence number of the item
    rally_ned_m: tuple[Floats, ...]  # (3,) each: where a return may lead beside home
    returns: bool  # comes home and lands by itself, or lands elsewhere

    @property
    def top_m(self) -> float:
        """The greatest height above home."""
        return -float(self.points_ned_m[:, 2].min())

    @property
    def path_m(self) -> float:
        """Horizontal length."""
        return polyline.length(self.points_ned_m[:, :2])


def placed(items: Sequence[MissionItem], home: GeodeticPoint) -> tuple[MissionItem, ...]:
    """Mission items with places for take-offs and landings that have none: where they happen."""
    lat_deg, lon_deg = home.lat_deg, home.lon_deg
    found_items = []
    for item in items:
        found = item
        nowhere = item.x == item.y == 0.0 or (math.isnan(item.x) and math.isnan(item.y))
        if item.command in (mav.MAV_CMD_NAV_TAKEOFF, mav.MAV_CMD_NAV_LAND) and nowhere:
            found = replace(item, x=lat_deg, y=lon_deg)
        if found.command in PLACES:
            lat_deg, lon_deg = found.x, found.y
        found_items.append(found)
    return tuple(found_items)


def planned_path(plan: PlanFile, home: GeodeticPoint, parameters: Parameters) -> PlannedPath:
    """The path of a plan that begins at `home`, for a vehicle with these parameters.

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

    def place_of(item: MissionItem) -> Floats:
        return route.place_of(item, frame, home)

    for item in plan.items:
        refuse(item, _wrong(item, last=item.seq == len(plan.items) - 1) or _refused(item))
    for item in plan.fence:
        refuse(item, _refused(item))
    try:
        fence = compile_fence(plan.fence, frame)
    except SitlInputError as error:
        raise InputError(f"{plan.path}: {error}") from None
    reason = route.check_mission(plan.items, frame=frame, home=home, farthest_m=p["MIS_DIST_1WP"])
    if reason:
        raise InputError(f"{plan.path}: {reason}")
    places = {item.seq: place_of(item) for item in plan.items if item.command in PLACES}
    if not places:
        raise InputError(f"{plan.path}: no item leads anywhere")
    here = np.zeros(3)
    for seq, place in places.items():
        item = plan.items[seq]
        if item.command != mav.MAV_CMD_NAV_LAND:
            refuse(item, bad_height(item, least_m=1.0))
        steps = 2 + int(np.linalg.norm(place - here))  # a metre each, at most
        way = np.linspace(here, place, steps)
        if breach := breach_of(fence, way, home_ned_m=np.zeros(3), parameters=p):
            refuse(item, f"the way there is partly {breach}")
        here = place
    for item in plan.rally:
        refuse(item, "it has no position" if item.x == item.y == 0.0 else _refused(item))
        place = place_of(item)
        if (away_m := float(np.hypot(place[0], place[1]))) > p["MIS_DIST_1WP"]:
            refuse(item, f"{away_m:.0f} m from home; MIS_DIST_1WP allows {p['MIS_DIST_1WP']:g}")
        refuse(item, bad_height(item, least_m=0.0))
        if breach := breach_of(fence, place, home_ned_m=np.zeros(3), parameters=p):
            refuse(item, f"it is {breach}")
    return _path(plan, places, tuple(place_of(item) for item in plan.rally), home, p)


def _wrong(item: MissionItem, *, last: bool) -> str:
    """Why an item has no business in an unattended flight; empty if it has."""
    if item.command not in ALLOWED:
        return "not supported; allowed are " + ", ".join(map(bare_name, ALLOWED))
    if not item.autocontinue:
        return "stops without autocontinue, and nobody is there to go on"
    if item.command in PLACES and item.frame in GLOBAL_FRAMES and item.x == item.y == 0.0:
        return "it has no position"
    if item.command == mav.MAV_CMD_NAV_TAKEOFF and item.seq != 0:
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
    verdict = check_item(item)
    return "" if verdict == mav.MAV_MISSION_ACCEPTED else why_refused(item, verdict)


def _path(
    plan: PlanFile,
    places: dict[int, Floats],
    rally_ned_m: tuple[Floats, ...],
    home: GeodeticPoint,
    p: Parameters,
) -> PlannedPath:
    stages = route.compile_route(
        plan.items, p, frame=LocalFrame(home), home=home, start=np.zeros(3), on_ground=True
    )
    points: list[Floats] = [np.zeros(3)]
    duration_s = 0.0
    last = max(places)
    for stage in stages:
        if isinstance(stage, route.Fly):
            legs_m = polyline.legs(stage.path.points_ned_m)
            duration_s += float((legs_m / stage.path.speeds_mps).sum())
            points += list(stage.path.points_ned_m[1:])
        # A hover at the last waypoint comes after it was reached, where the comparison ends.
        elif isinstance(stage, route.Wait) and (stage.reports or stage.seq != last):
            duration_s += stage.duration_s
    ends = plan.items[-1].command
    if ends == mav.MAV_CMD_NAV_LAND:
        height_m = -float(points[-1][2])
        slow_m = min(height_m, p["MPC_LAND_ALT2"])
        duration_s += (height_m - slow_m) / p["MPC_Z_VEL_MAX_DN"] + slow_m / p["MPC_LAND_SPEED"]
    array = np.array(points)
    array.flags.writeable = False
    return PlannedPath(array, duration_s, places, rally_ned_m, ends in _LAST)


def wait_of(item: MissionItem) -> float:
    """Seconds for which the vehicle hovers at an item."""
    waits = item.command in (mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_NAV_LOITER_TIME)
    return item.params[0] if waits and item.params[0] > 0.0 else 0.0
