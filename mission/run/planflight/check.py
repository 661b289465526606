"""What of an imported plan may be flown here, and the path that it means.

Everything that the autopilot would refuse is refused here first, by the autopilot's own rules,
and so is what it would take but what has no business in an unattended flight.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flightdyn.state import GeodeticPoint
from mission.base import polyline
from mission.base.arrays import Floats
from mission.base.errors import InputError
from sitl.autopilot.codec.names import command_name
from sitl.autopilot.flying import route
from sitl.autopilot.protocol.item_rules import PLACES, check_item
from sitl.autopilot.safety.fence import Fence, breach_of, compile_fence
from sitl.autopilot.values.enums import GLOBAL_FRAMES, Command, MissionResult
from sitl.autopilot.values.messages import MissionItem
from sitl.errors import SitlInputError
from sitl.vehicle import Vehicle

MAX_HEIGHT_M = 500.0
MAX_WAIT_S = 3600.0
ALLOWED = (
    Command.NAV_TAKEOFF,
    Command.NAV_WAYPOINT,
    Command.NAV_LOITER_TIME,
    Command.DO_CHANGE_SPEED,
    Command.NAV_RETURN_TO_LAUNCH,
    Command.NAV_LAND,
)
_LAST = (Command.NAV_RETURN_TO_LAUNCH, Command.NAV_LAND)
_KEEP, _DEFAULT = -1.0, -2.0  # DO_CHANGE_SPEED's other values


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


def here_means(items: Sequence[MissionItem], home: GeodeticPoint) -> tuple[MissionItem, ...]:
    """Take-offs and landings at 0, 0 get the place where they happen: that is what 0, 0 says."""
    lat_deg, lon_deg = home.lat_deg, home.lon_deg
    placed = []
    for item in items:
        found = item
        if item.command in (Command.NAV_TAKEOFF, Command.NAV_LAND) and item.x == item.y == 0.0:
            found = replace(item, x=lat_deg, y=lon_deg)
        if found.command in PLACES:
            lat_deg, lon_deg = found.x, found.y
        placed.append(found)
    return tuple(placed)


def check_items(
    items: Sequence[MissionItem],
    fence: Sequence[MissionItem],
    rally: Sequence[MissionItem],
    *,
    vehicle: Vehicle,
    source: str,
) -> PlannedPath:
    """Refuse what cannot or should not be flown; else the path.

    Raises:
        InputError: names the file (`source`), the item, what is wrong and what is allowed.
    """
    parameters, flight = vehicle.autopilot.parameters, vehicle.autopilot.flight
    for item in items:
        wrong = _wrong(item, last=item.seq == len(items) - 1)
        if wrong:
            raise InputError(f"{source}: item {item.seq}, {command_name(item.command)}: {wrong}")
    drawn = _drawn(fence, vehicle, source)
    reason = route.check_mission(
        items, frame=flight.frame, home=flight.home, farthest_m=parameters["MIS_DIST_1WP"]
    )
    if reason:
        raise InputError(f"{source}: {reason}")
    places = {item.seq: _place(item, vehicle) for item in items if item.command in PLACES}
    if not places:
        raise InputError(f"{source}: no item leads anywhere")
    for item in items:
        place = places.get(item.seq)
        if place is None or item.command == Command.NAV_LAND:
            continue
        height_m = -float(place[2])
        if not 1.0 <= height_m <= MAX_HEIGHT_M:
            raise InputError(
                f"{source}: item {item.seq}, {command_name(item.command)}: {height_m:.1f} m above "
                f"home; 1 to {MAX_HEIGHT_M:g} m are allowed"
            )
    here = np.zeros(3)
    for seq, place in places.items():
        steps = 2 + int(np.linalg.norm(place - here))  # a metre each, at most
        way = np.linspace(here, place, steps)
        if breach := breach_of(drawn, way, home_ned_m=flight.home_ned_m, parameters=parameters):
            name = command_name(items[seq].command)
            raise InputError(f"{source}: item {seq}, {name}: on the way there it is {breach}")
        here = place
    for item in rally:
        wrong = _wrong_rally(item, drawn, vehicle)
        if wrong:
            raise InputError(f"{source}: rally point {item.seq}: {wrong}")
    rally_ned_m = tuple(_place(item, vehicle) for item in rally)
    return _path(items, places, rally_ned_m, vehicle)


def _drawn(items: Sequence[MissionItem], vehicle: Vehicle, source: str) -> Fence:
    """The fence that the items draw."""
    for item in items:
        if refused := _refused(item):
            raise InputError(
                f"{source}: fence point {item.seq}, {command_name(item.command)}: {refused}"
            )
    try:
        return compile_fence(items, vehicle.autopilot.flight.frame)
    except SitlInputError as error:
        raise InputError(f"{source}: {error}") from None


def _place(item: MissionItem, vehicle: Vehicle) -> Floats:
    """(3,) NED of an item."""
    flight = vehicle.autopilot.flight
    return flight.frame.to_ned(item.x, item.y, route.item_altitude(item, flight.home))


def _wrong_rally(item: MissionItem, fence: Fence, vehicle: Vehicle) -> str:
    """Why no return should lead to a rally point; empty if nothing."""
    parameters, flight = vehicle.autopilot.parameters, vehicle.autopilot.flight
    if item.x == item.y == 0.0:
        return "it has no position"
    if refused := _refused(item):
        return refused
    place = _place(item, vehicle)
    distance_m = float(np.hypot(place[0], place[1]))
    if distance_m > parameters["MIS_DIST_1WP"]:
        return f"{distance_m:.0f} m from home; MIS_DIST_1WP allows less"
    height_m = route.item_altitude(item, flight.home) - flight.home.alt_msl_m
    if not 0.0 <= height_m <= MAX_HEIGHT_M:
        return f"{height_m:.1f} m above home; 0 to {MAX_HEIGHT_M:g} m are allowed"
    breach = breach_of(fence, place, home_ned_m=flight.home_ned_m, parameters=parameters)
    return f"it is {breach}" if breach else ""


def _wrong(item: MissionItem, *, last: bool) -> str:
    """What is wrong with an item by itself; empty if nothing."""
    if item.command not in ALLOWED:
        return "not supported; allowed are " + ", ".join(command.name for command in ALLOWED)
    if not item.autocontinue:
        return "stops without autocontinue, and nobody is there to go on"
    if item.command in PLACES:
        if item.frame not in GLOBAL_FRAMES:
            return f"frame {item.frame}; heights above home or sea level are allowed (0, 3, 5, 6)"
        if item.x == item.y == 0.0:
            return "it has no position"
    if item.command == Command.NAV_TAKEOFF and item.seq != 0:
        return "a take-off has to come first"
    if item.command in _LAST and not last:
        return "nothing may come after it"
    waits = item.command in (Command.NAV_WAYPOINT, Command.NAV_LOITER_TIME)
    if waits and item.params[0] > MAX_WAIT_S:
        return f"waits {item.params[0]:g} s; {MAX_WAIT_S:g} s at most"
    speed_mps = item.params[1] if item.command == Command.DO_CHANGE_SPEED else _KEEP
    if speed_mps not in (_KEEP, _DEFAULT) and not 0.5 <= speed_mps <= 30.0:
        return f"{speed_mps:g} m/s; 0.5 to 30 m/s are allowed"
    return _refused(item)


def _refused(item: MissionItem) -> str:
    """What the autopilot would not take of an item, with the value; empty if nothing."""
    result = check_item(item)
    if result is MissionResult.ACCEPTED:
        return ""
    parameters = (*item.params, item.x, item.y, item.z)
    number = re.fullmatch(r"INVALID_PARAM(\d)(_[XY])?", result.name)
    value = f" ({parameters[int(number[1]) - 1]:g})" if number else ""
    return f"refused by the autopilot: {result.name}{value}"


def _path(
    items: Sequence[MissionItem],
    places: dict[int, Floats],
    rally_ned_m: tuple[Floats, ...],
    vehicle: Vehicle,
) -> PlannedPath:
    flight, p = vehicle.autopilot.flight, vehicle.autopilot.parameters
    stages = route.compile_route(
        items,
        first=0,
        start=route.Start(np.zeros(3), on_ground=True),
        frame=flight.frame,
        home=flight.home,
        limits=route.Limits.of(p),
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
    ends = items[-1].command
    if ends == Command.NAV_LAND:
        height_m = -float(points[-1][2])
        slow_m = min(height_m, p["MPC_LAND_ALT2"])
        duration_s += (height_m - slow_m) / p["MPC_Z_VEL_MAX_DN"] + slow_m / p["MPC_LAND_SPEED"]
    array = np.array(points)
    array.flags.writeable = False
    return PlannedPath(array, duration_s, places, rally_ned_m, ends in _LAST)
