"""What each mission item may be, judged as it is uploaded."""

import math
from collections.abc import Callable
from dataclasses import replace

from sitl.autopilot.values import ranges
from sitl.autopilot.values.enums import (
    GLOBAL_FRAMES,
    RELATIVE_FRAMES,
    Command,
    MissionResult,
    MissionType,
)
from sitl.autopilot.values.messages import MissionItem

# Items with a position; those of the second set may leave it open (NaN): "right here".
_PLACES = frozenset({Command.NAV_WAYPOINT, Command.NAV_LOITER_UNLIM, Command.NAV_LOITER_TIME})
_OPEN_PLACES = frozenset({Command.NAV_TAKEOFF, Command.NAV_LAND})
_DELAYS = frozenset({Command.NAV_DELAY, Command.CONDITION_DELAY})
_PLAIN = frozenset(
    {
        Command.NAV_RETURN_TO_LAUNCH,
        Command.CONDITION_YAW,
        Command.DO_CHANGE_SPEED,
        Command.DO_JUMP,
        *_DELAYS,
    }
)
_FENCE_POLYGONS = frozenset(
    {Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION}
)
_FENCE_CIRCLES = frozenset({Command.NAV_FENCE_CIRCLE_INCLUSION, Command.NAV_FENCE_CIRCLE_EXCLUSION})
PLACES = _PLACES | _OPEN_PLACES
NAVIGATION = PLACES | frozenset({Command.NAV_RETURN_TO_LAUNCH, Command.NAV_DELAY})
_SPEED_TYPES = (0, 1)  # air speed, ground speed: the same to a multirotor that measures neither


def check_item(item: MissionItem) -> MissionResult:
    """Whether the vehicle can carry out `item`, and if not, what is wrong with it."""
    return _CHECKS[item.mission_type](item)


def why_refused(item: MissionItem, verdict: MissionResult) -> str:
    """What `check_item` has against an item, in words: why, and what is allowed."""
    above = "home" if item.frame in RELATIVE_FRAMES else "mean sea level"
    allowed = f"{_altitudes(item)} above {above} are allowed"
    words = {
        MissionResult.UNSUPPORTED: "is not supported",
        MissionResult.UNSUPPORTED_FRAME: f"frame {item.frame}, 0, 3, 5 and 6 are supported",
        MissionResult.INVALID_PARAM5_X: f"latitude {item.x:g}, -90 to 90 are allowed",
        MissionResult.INVALID_PARAM6_Y: f"longitude {item.y:g}, -180 to 180 are allowed",
        MissionResult.INVALID_PARAM7: f"altitude {item.z:g} m, {allowed}",
        MissionResult.INVALID_PARAM1: f"parameter 1 = {item.params[0]:g} is not possible",
        MissionResult.INVALID_PARAM2: f"parameter 2 = {item.params[1]:g} is not possible",
    }
    return words.get(verdict, verdict.name)


def _mission(item: MissionItem) -> MissionResult:
    if item.command in _PLACES:
        return _place(item) or _times(item) or MissionResult.ACCEPTED
    if item.command in _OPEN_PLACES:
        here = math.isnan(item.x) and math.isnan(item.y)
        return _place(replace(item, x=0.0, y=0.0) if here else item) or MissionResult.ACCEPTED
    if item.command in _PLAIN:
        return _plain(item) or MissionResult.ACCEPTED
    return MissionResult.UNSUPPORTED


def _place(item: MissionItem) -> MissionResult | None:
    wrong = _horizontal(item)
    if wrong is not None:
        return wrong
    return None if item.z in _altitudes(item) else MissionResult.INVALID_PARAM7


def _altitudes(item: MissionItem) -> ranges.Range:
    """The altitudes that an item may have, in its frame."""
    return ranges.HEIGHT if item.frame in RELATIVE_FRAMES else ranges.ALTITUDE


def _times(item: MissionItem) -> MissionResult | None:
    """Hold time and acceptance radius: not given (NaN), or in range."""
    first, second = item.params[0], item.params[1]
    if not (math.isnan(first) or first in ranges.HOLD):
        return MissionResult.INVALID_PARAM1
    waypoint = item.command == Command.NAV_WAYPOINT
    if waypoint and not (math.isnan(second) or second in ranges.ACCEPTANCE):
        return MissionResult.INVALID_PARAM2
    return None


def _plain(item: MissionItem) -> MissionResult | None:
    first, second = item.params[0], item.params[1]
    if item.command == Command.DO_CHANGE_SPEED:
        if first not in _SPEED_TYPES:
            return MissionResult.INVALID_PARAM1
        # -1 keeps the speed, -2 returns to the default.
        kept = second in (-1.0, -2.0)
        return None if kept or second in ranges.SPEED else MissionResult.INVALID_PARAM2
    if item.command in _DELAYS:
        return None if first in ranges.HOLD else MissionResult.INVALID_PARAM1
    if item.command == Command.CONDITION_YAW:
        return None if first in ranges.TURN else MissionResult.INVALID_PARAM1
    if item.command == Command.DO_JUMP:
        if not ranges.whole(first, ranges.ITEM):
            return MissionResult.INVALID_PARAM1
        return None if ranges.whole(second, ranges.REPEATS) else MissionResult.INVALID_PARAM2
    return None


def _fence(item: MissionItem) -> MissionResult:
    if item.command == Command.NAV_FENCE_RETURN_POINT:
        return MissionResult.UNSUPPORTED
    if item.command in _FENCE_POLYGONS:
        if not ranges.whole(item.params[0], ranges.CORNERS):
            return MissionResult.INVALID_PARAM1
    elif item.command in _FENCE_CIRCLES:
        if item.params[0] not in ranges.FENCE_RADIUS:
            return MissionResult.INVALID_PARAM1
    else:
        return MissionResult.UNSUPPORTED
    return _horizontal(item) or MissionResult.ACCEPTED


def _rally(item: MissionItem) -> MissionResult:
    if item.command != Command.NAV_RALLY_POINT:
        return MissionResult.UNSUPPORTED
    return _place(item) or MissionResult.ACCEPTED


def _horizontal(item: MissionItem) -> MissionResult | None:
    if item.frame not in GLOBAL_FRAMES:
        return MissionResult.UNSUPPORTED_FRAME
    if item.x not in ranges.LATITUDE:
        return MissionResult.INVALID_PARAM5_X
    return None if item.y in ranges.LONGITUDE else MissionResult.INVALID_PARAM6_Y


_CHECKS: dict[MissionType, Callable[[MissionItem], MissionResult]] = {
    MissionType.MISSION: _mission,
    MissionType.FENCE: _fence,
    MissionType.RALLY: _rally,
    MissionType.ALL: lambda _: MissionResult.UNSUPPORTED,
}
