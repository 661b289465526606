"""What each mission item may be, judged as it is uploaded."""

import math
from dataclasses import replace

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec import ranges
from sitl.autopilot.codec.orders import GLOBAL_FRAMES, RELATIVE_FRAMES, MissionItem

# Items with a position; those of the second set may leave it open (NaN): "right here".
_PLACES = frozenset(
    {mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_NAV_LOITER_UNLIM, mav.MAV_CMD_NAV_LOITER_TIME}
)
_OPEN_PLACES = frozenset({mav.MAV_CMD_NAV_TAKEOFF, mav.MAV_CMD_NAV_LAND})
_DELAYS = frozenset({mav.MAV_CMD_NAV_DELAY, mav.MAV_CMD_CONDITION_DELAY})
_PLAIN = frozenset(
    {
        mav.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        mav.MAV_CMD_CONDITION_YAW,
        mav.MAV_CMD_DO_CHANGE_SPEED,
        mav.MAV_CMD_DO_JUMP,
        *_DELAYS,
    }
)
_FENCE_POLYGONS = frozenset(
    {mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION}
)
_FENCE_CIRCLES = frozenset(
    {mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION}
)
PLACES = _PLACES | _OPEN_PLACES
NAVIGATION = PLACES | frozenset({mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, mav.MAV_CMD_NAV_DELAY})
_SPEED_TYPES = (0, 1)  # air speed, ground speed: the same to a multirotor that measures neither


def check_item(item: MissionItem) -> int:
    """MAV_MISSION_ACCEPTED where the vehicle can carry out `item`, or what is wrong with it."""
    match item.mission_type:
        case mav.MAV_MISSION_TYPE_MISSION:
            wrong = _mission(item)
        case mav.MAV_MISSION_TYPE_FENCE:
            wrong = _fence(item)
        case mav.MAV_MISSION_TYPE_RALLY if item.command == mav.MAV_CMD_NAV_RALLY_POINT:
            wrong = _place(item)
        case _:
            wrong = mav.MAV_MISSION_UNSUPPORTED
    return wrong or mav.MAV_MISSION_ACCEPTED


def why_refused(item: MissionItem, verdict: int) -> str:
    """What `check_item` has against an item, in words: why, and what is allowed."""
    above = "home" if item.frame in RELATIVE_FRAMES else "mean sea level"
    allowed = f"{_altitudes(item)} above {above} are allowed"
    words = {
        mav.MAV_MISSION_UNSUPPORTED: "is not supported",
        mav.MAV_MISSION_UNSUPPORTED_FRAME: f"frame {item.frame}, 0, 3, 5 and 6 are supported",
        mav.MAV_MISSION_INVALID_PARAM5_X: f"latitude {item.x:g}, -90 to 90 are allowed",
        mav.MAV_MISSION_INVALID_PARAM6_Y: f"longitude {item.y:g}, -180 to 180 are allowed",
        mav.MAV_MISSION_INVALID_PARAM7: f"altitude {item.z:g} m, {allowed}",
        mav.MAV_MISSION_INVALID_PARAM1: f"parameter 1 = {item.params[0]:g} is not possible",
        mav.MAV_MISSION_INVALID_PARAM2: f"parameter 2 = {item.params[1]:g} is not possible",
    }
    return words[verdict]


def _mission(item: MissionItem) -> int | None:
    if item.command in _PLACES:
        return _place(item) or _times(item)
    if item.command in _OPEN_PLACES:
        here = math.isnan(item.x) and math.isnan(item.y)
        return _place(replace(item, x=0.0, y=0.0) if here else item)
    return _plain(item) if item.command in _PLAIN else mav.MAV_MISSION_UNSUPPORTED


def _place(item: MissionItem) -> int | None:
    high = None if item.z in _altitudes(item) else mav.MAV_MISSION_INVALID_PARAM7
    return _horizontal(item) or high


def _altitudes(item: MissionItem) -> ranges.Range:
    """The altitudes that an item may have, in its frame."""
    return ranges.HEIGHT if item.frame in RELATIVE_FRAMES else ranges.ALTITUDE


def _times(item: MissionItem) -> int | None:
    """Hold time and acceptance radius: not given (NaN), or in range."""
    first, second = item.params[0], item.params[1]
    if not (math.isnan(first) or first in ranges.HOLD):
        return mav.MAV_MISSION_INVALID_PARAM1
    waypoint = item.command == mav.MAV_CMD_NAV_WAYPOINT
    if waypoint and not (math.isnan(second) or second in ranges.ACCEPTANCE):
        return mav.MAV_MISSION_INVALID_PARAM2
    return None


def _plain(item: MissionItem) -> int | None:
    first, second = item.params[0], item.params[1]
    if item.command == mav.MAV_CMD_DO_CHANGE_SPEED:
        if first not in _SPEED_TYPES:
            return mav.MAV_MISSION_INVALID_PARAM1
        # -1 keeps the speed, -2 returns to the default.
        kept = second in (-1.0, -2.0)
        return None if kept or second in ranges.SPEED else mav.MAV_MISSION_INVALID_PARAM2
    if item.command in _DELAYS:
        return None if first in ranges.HOLD else mav.MAV_MISSION_INVALID_PARAM1
    if item.command == mav.MAV_CMD_CONDITION_YAW:
        return None if first in ranges.TURN else mav.MAV_MISSION_INVALID_PARAM1
    if item.command == mav.MAV_CMD_DO_JUMP:
        if not ranges.whole(first, ranges.ITEM):
            return mav.MAV_MISSION_INVALID_PARAM1
        return None if ranges.whole(second, ranges.REPEATS) else mav.MAV_MISSION_INVALID_PARAM2
    return None


def _fence(item: MissionItem) -> int | None:
    size = item.params[0]
    if item.command in _FENCE_POLYGONS:
        possible = ranges.whole(size, ranges.CORNERS)
    elif item.command in _FENCE_CIRCLES:
        possible = size in ranges.FENCE_RADIUS
    else:
        return mav.MAV_MISSION_UNSUPPORTED
    return _horizontal(item) if possible else mav.MAV_MISSION_INVALID_PARAM1


def _horizontal(item: MissionItem) -> int | None:
    if item.frame not in GLOBAL_FRAMES:
        return mav.MAV_MISSION_UNSUPPORTED_FRAME
    if item.x not in ranges.LATITUDE:
        return mav.MAV_MISSION_INVALID_PARAM5_X
    return None if item.y in ranges.LONGITUDE else mav.MAV_MISSION_INVALID_PARAM6_Y
