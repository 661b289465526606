"""Where the items of a mission lead, whoever flies them; items as records of the log, and back."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import common as mav

from mission.base.area import Area
from mission.base.arrays import Bools, Floats, Ints
from mission.log.values import MissionRecord
from sitl.autopilot.codec.orders import GLOBAL_FRAMES, MissionItem, bare_name
from sitl.autopilot.flying.orbit import DEFAULT_RADIUS_M
from sitl.autopilot.flying.route import MAX_STEPS, flown_order, item_altitude, repeats

KINDS = {
    mav.MAV_MISSION_TYPE_MISSION: "mission",
    mav.MAV_MISSION_TYPE_FENCE: "fence",
    mav.MAV_MISSION_TYPE_RALLY: "rally",
}
_TERRAIN = (mav.MAV_FRAME_GLOBAL_TERRAIN_ALT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT)
_CIRCLES = (mav.MAV_CMD_NAV_LOITER_TURNS,)
_TAKEOFFS = (mav.MAV_CMD_NAV_TAKEOFF, mav.MAV_CMD_NAV_VTOL_TAKEOFF)
RETURNS = (mav.MAV_CMD_NAV_RETURN_TO_LAUNCH,)
_LANDINGS = (mav.MAV_CMD_NAV_LAND, mav.MAV_CMD_NAV_VTOL_LAND)
_LEADS = (  # straight to their place
    mav.MAV_CMD_NAV_WAYPOINT,
    mav.MAV_CMD_NAV_SPLINE_WAYPOINT,
    mav.MAV_CMD_NAV_LOITER_TIME,
    mav.MAV_CMD_NAV_LOITER_UNLIM,
    mav.MAV_CMD_NAV_LOITER_TO_ALT,
    mav.MAV_CMD_NAV_PAYLOAD_PLACE,
)
_WITHOUT_PLACE = (0, mav.MAV_CMD_NAV_DELAY, mav.MAV_CMD_NAV_GUIDED_ENABLE, mav.MAV_CMD_NAV_LAST)
_CORNERS = 24  # of a circle
_MOST_LAPS = 50.0
_NOWHERE: Floats = np.full(3, math.nan)
_ENDLESS = 500  # times that a jump without end is taken
_LOW_M = 1.0  # below this a flight begins on the ground


def record_of(t_ns: int, kind: int, items: Sequence[MissionItem]) -> MissionRecord:
    """Return the log record of a mission, fence or rally list (`kind`: MAV_MISSION_TYPE)."""
    rows = [
        (i.seq, i.command, i.frame, *i.params, i.x, i.y, i.z, int(i.autocontinue)) for i in items
    ]
    return MissionRecord(t_ns, KINDS[kind], tuple(tuple(map(float, row)) for row in rows))


def items_of(record: MissionRecord) -> tuple[MissionItem, ...]:
    """Return the items of a log record: the inverse of `record_of`, but for their mission type."""
    return tuple(
        MissionItem(int(seq), int(command), int(frame), (p1, p2, p3, p4), x, y, z, 0, bool(auto))
        for seq, command, frame, p1, p2, p3, p4, x, y, z, auto in record.items
    )


def returns(items: Sequence[MissionItem]) -> bool:
    """Whether a mission ends by a return or a landing."""
    return bool(items) and items[-1].command in RETURNS + _LANDINGS


def leads_on(items: Sequence[MissionItem], seq: int) -> bool:
    """Whether a mission leads to a place after item `seq`, other than by its return or landing."""
    return any(i.seq > seq and i.command in _LEADS + _TAKEOFFS + _CIRCLES for i in items)


@dataclass(frozen=True)
class MissionPath:
    """Where a mission leads from one of its items on, jumps and circles included."""

    points_m: Floats  # (P, 3) area coordinates; the first is where it begins
    seqs: Ints  # (P,) the item whose place a point is; -1 where it is none's
    height_known: Bools  # (P,) not where the vehicle chooses
    given: int  # how many of the points come before a return, whose way the vehicle chooses
    left_out: Mapping[str, int]  # items that lead nowhere that is known here, by command


def place_m(item: MissionItem, area: Area, here_m: Floats = _NOWHERE) -> Floats:
    """Return an item's place (3,) in area coordinates; `here_m` replaces what it leaves open."""
    x, y = here_m[:2]
    if not (math.isnan(item.x) or math.isnan(item.y) or item.x == item.y == 0.0):
        x, y = area.from_ned(area.frame.to_ned(item.x, item.y, area.home.alt_msl_m)).tolist()
    z = item.z if item.frame in _TERRAIN else item_altitude(item, area.home) - area.home.alt_msl_m
    return np.array([x, y, here_m[2] if math.isnan(z) else z])


def mission_path(
    items: Sequence[MissionItem],
    area: Area,
    start_m: Floats,
    *,
    first: int = 0,
    rally_m: Sequence[Floats] = (),
    climbs_straight: bool = False,
) -> MissionPath:
    """The path of a mission that begins at `start_m`, (3,) area coordinates, with item `first`.

    A return leads to the nearest of home and the rally points `rally_m`, (3,) each; a take-off to
    its place, or where the vehicle `climbs_straight` only up.
    """
    points, seqs, known = [np.array(start_m, dtype=np.float64)], [-1], [True]
    given, left_out = None, Counter[str]()

    def go(place_m: Floats, seq: int, *, height: bool = True) -> None:
        points.append(place_m)
        seqs.append(seq)
        known.append(height)

    def land(place_m: Floats, seq: int) -> None:
        go(np.array([*place_m[:2], points[-1][2]]), -1, height=False)
        go(np.array([*place_m[:2], 0.0]), seq, height=False)

    jumps = {seq: n if n >= 0 else _ENDLESS for seq, n in repeats(items).items()}
    for item in flown_order(items, first, jumps):
        if len(points) > MAX_STEPS:
            break
        command, level = item.command, item.frame not in _TERRAIN
        placed = item.frame in GLOBAL_FRAMES or not level
        if command in RETURNS:
            ends = [np.array(area.home_m), *(place[:2] for place in rally_m)]
            here, given = points[-1][:2], len(points)
            land(min(ends, key=lambda end: float(np.linalg.norm(end - here))), item.seq)
            break
        if not placed and (command in _LEADS + _TAKEOFFS + _LANDINGS + _CIRCLES):
            left_out[bare_name(command)] += 1
        elif command in _LANDINGS:
            land(place_m(item, area, points[-1]), item.seq)
        elif command in _TAKEOFFS + _LEADS + _CIRCLES:
            here = points[-1]
            at_m = place_m(item, area, here)
            if climbs_straight and command in _TAKEOFFS:
                at_m[:2] = here[:2]
            if command in _TAKEOFFS or (len(points) == 1 and here[2] < _LOW_M):
                go(np.array([*here[:2], max(here[2], at_m[2])]), -1)
            if command in _CIRCLES:
                laps = min(max(0.0, item.params[0]), _MOST_LAPS)
                for point in _circle(at_m, item.params[2], here, laps=laps):
                    go(point, -1, height=level)
                seqs[-1] = item.seq
            else:
                go(at_m, item.seq, height=level)
        elif command <= mav.MAV_CMD_NAV_LAST and command not in _WITHOUT_PLACE:
            left_out[bare_name(command)] += 1
    return MissionPath(
        np.array(points),
        np.array(seqs, dtype=np.int64),
        np.array(known),
        given or len(points),
        left_out,
    )


def _circle(centre_m: Floats, radius_m: float, here_m: Floats, *, laps: float) -> Floats:
    """Return (n, 3) points of circles from the one nearest `here_m` on, clockwise, or anticlockwise
    with a negative radius."""
    # Left open, it is the same for our vehicle and, unless it is set otherwise, for ArduCopter.
    radius_m = radius_m if abs(radius_m) > 0.0 else DEFAULT_RADIUS_M
    east, north = (here_m - centre_m)[:2].tolist()
    turned = np.linspace(0.0, laps, math.ceil(laps * _CORNERS) + 1)
    bearing = math.atan2(east, north) + turned * math.copysign(math.tau, radius_m)
    away = np.column_stack((np.sin(bearing), np.cos(bearing), np.zeros(len(bearing))))
    return np.asarray(centre_m + abs(radius_m) * away)
