"""Flight plans as the mission items that are uploaded, and as they have to come back."""

import math
from collections.abc import Sequence
from copy import copy

import numpy as np
from mavsdk.plugins.mission_raw import MissionItem

from flightdyn.state import GeodeticPoint
from mission.flight.flight_plan import FlightPlan
from mission.flight.pilot.dialects import Dialect

FRAME_MISSION = 2  # of what has no place; PX4 knows such a command in no other frame
FRAME_GLOBAL_RELATIVE_ALT_INT = 6
NAV_WAYPOINT = 16
DO_CHANGE_SPEED = 178
_GROUND_SPEED = 1.0
_UNCHANGED = -1.0


def mission_items(plan: FlightPlan, positions: Sequence[GeodeticPoint]) -> list[MissionItem]:
    """The stops as MAVLink items: the first stop, the speed of all legs, the other stops.

    The first stop is where the vehicle already is; the speed stands after it because autopilots
    apply DO_CHANGE_SPEED to the leg after the item before it. See `stop_items`.
    """
    waypoints = [
        _item(
            NAV_WAYPOINT,
            stop.hold_s,
            plan.acceptance_m,
            0.0,
            math.nan,
            at=position,
            z=plan.alt_rel_m,
        )
        for stop, position in zip(plan.stops, positions, strict=True)
    ]
    speed = _item(DO_CHANGE_SPEED, _GROUND_SPEED, plan.speed_mps, _UNCHANGED, 0.0)
    return _numbered([waypoints[0], speed, *waypoints[1:]])


def stop_items(plan: FlightPlan) -> list[int]:
    """The number of every stop among the `mission_items`."""
    return [0, *range(2, len(plan.stops) + 1)]


def as_dialect(items: Sequence[MissionItem], dialect: Dialect) -> list[MissionItem]:
    """A mission as a family of autopilots takes it."""
    taken = [copy(item) for item in items]
    if dialect.home_first:
        # The autopilot puts its own home there.
        taken.insert(0, _item(NAV_WAYPOINT, 0.0, 0.0, 0.0, 0.0, at=None))
        taken[0].frame = FRAME_GLOBAL_RELATIVE_ALT_INT
        taken[0].x, taken[0].y = items[0].x, items[0].y
    if dialect.finite:
        for item in taken:
            params = (item.param1, item.param2, item.param3, item.param4)
            item.param1, item.param2, item.param3, item.param4 = (
                0.0 if math.isnan(param) else param for param in params
            )
    if dialect.whole_holds:
        for item in taken:
            if item.command == NAV_WAYPOINT:
                item.param1 = float(math.ceil(item.param1))
    return _numbered(taken, current=dialect.first_item)


def _numbered(items: list[MissionItem], *, current: int = 0) -> list[MissionItem]:
    for seq, item in enumerate(items):
        item.seq = seq
        item.current = int(seq == current)
    return items


def same_mission(sent: list[MissionItem], back: list[MissionItem], dialect: Dialect) -> bool:
    """Whether the items that came back are those sent, as far as the dialect keeps them."""
    first = dialect.first_item
    return _essence(sent[first:], dialect) == _essence(back[first:], dialect)


def _essence(items: list[MissionItem], dialect: Dialect) -> list[tuple[int, ...]]:
    """What must come back unchanged; heights travel in cm."""
    return [
        (
            item.seq,
            item.command,
            item.x,
            item.y,
            round(item.z * 100),
            _thousandths(item.param1) if item.command == NAV_WAYPOINT else 0,
            _thousandths(item.param2) if dialect.keeps_radius else 0,
        )
        for item in items
    ]


def _thousandths(param: float) -> int:
    """Of a parameter as it travels: a 32-bit float; one that is left open may come back as 0."""
    return 0 if math.isnan(param) else round(float(np.float32(param)) * 1000)


def _item(
    command: int, *params: float, at: GeodeticPoint | None = None, z: float = 0.0
) -> MissionItem:
    """MAVSDK takes a field that is left out for NaN, so every one is set."""
    return MissionItem(
        seq=0,
        frame=FRAME_MISSION if at is None else FRAME_GLOBAL_RELATIVE_ALT_INT,
        command=command,
        current=0,
        autocontinue=1,
        param1=params[0],
        param2=params[1],
        param3=params[2],
        param4=params[3],
        x=0 if at is None else round(at.lat_deg * 1e7),
        y=0 if at is None else round(at.lon_deg * 1e7),
        z=z,
        mission_type=0,
    )
