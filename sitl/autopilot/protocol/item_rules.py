"""Validation rules for items of missions, fences and rally points: one table."""

import math
from collections import Counter
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec import ranges
from sitl.autopilot.codec.orders import (
    GLOBAL_FRAMES,
    RELATIVE_FRAMES,
    MissionItem,
    bare_name,
)

Allowed: TypeAlias = tuple[Container[float], ...]  # a number is in one of them; empty: any number

_TERRAIN_FRAMES = (mav.MAV_FRAME_GLOBAL_TERRAIN_ALT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT)
_PARAMS = (
    mav.MAV_MISSION_INVALID_PARAM1,
    mav.MAV_MISSION_INVALID_PARAM2,
    mav.MAV_MISSION_INVALID_PARAM3,
)


@dataclass(frozen=True, slots=True)
class _Rule:
    """Allowed parameters and place of a mission item of one command."""

    params: tuple[Allowed, ...] = ()  # the first ones, as far as they are looked at
    optional: bool = False  # these may be left open (NaN)
    ground: bool = False  # it has a latitude and a longitude
    height: bool = False  # and an altitude
    anywhere: bool = False  # both of the ground may be left open (NaN): "right here"

    def wrong(self, item: MissionItem) -> int | None:
        """The MAV_MISSION_RESULT that refuses an item; None where nothing does."""
        here = self.anywhere and math.isnan(item.x) and math.isnan(item.y)
        if self.ground and item.frame not in GLOBAL_FRAMES:
            return mav.MAV_MISSION_UNSUPPORTED_FRAME
        if self.ground and not here:
            if item.x not in ranges.LATITUDE:
                return mav.MAV_MISSION_INVALID_PARAM5_X
            if item.y not in ranges.LONGITUDE:
                return mav.MAV_MISSION_INVALID_PARAM6_Y
        if self.height and item.z not in _altitudes(item):
            return mav.MAV_MISSION_INVALID_PARAM7
        for value, allowed, result in zip(item.params, self.params, _PARAMS, strict=False):
            left_open = not allowed or (self.optional and math.isnan(value))
            if not (left_open or any(value in part for part in allowed)):
                return result
        return None


# Items for parts that the vehicle does not have: done in their order, as nothing.
_PARTS = {
    "camera": "DO_DIGICAM_CONFIGURE DO_DIGICAM_CONTROL DO_SET_CAM_TRIGG_DIST "
    "DO_SET_CAM_TRIGG_INTERVAL DO_TRIGGER_CONTROL OBLIQUE_SURVEY SET_CAMERA_MODE SET_CAMERA_ZOOM "
    "SET_CAMERA_FOCUS IMAGE_START_CAPTURE IMAGE_STOP_CAPTURE VIDEO_START_CAPTURE "
    "VIDEO_STOP_CAPTURE",
    "gimbal": "DO_MOUNT_CONFIGURE DO_MOUNT_CONTROL DO_GIMBAL_MANAGER_PITCHYAW "
    "DO_GIMBAL_MANAGER_CONFIGURE DO_SET_ROI_WPNEXT_OFFSET",
    "servo": "DO_SET_SERVO DO_REPEAT_SERVO DO_SET_ACTUATOR",
    "relay": "DO_SET_RELAY DO_REPEAT_RELAY",
    "gripper": "DO_GRIPPER",
    "winch": "DO_WINCH",
}
ABSENT: Mapping[int, str] = {
    getattr(mav, f"MAV_CMD_{name}"): part
    for part, names in _PARTS.items()
    for name in names.split()
}

_HOLD: Allowed = (ranges.HOLD,)
_LOITER = _Rule((_HOLD,), optional=True, ground=True, height=True)
_OPEN_PLACE = _Rule(ground=True, height=True, anywhere=True)
_DELAY = _Rule((_HOLD,))
_RADIUS: Allowed = (ranges.ORBIT_RADIUS, ranges.COUNTER_CLOCKWISE, (0.0,))
_FENCE_POLYGON = _Rule(((ranges.CORNERS,),), ground=True)
_FENCE_CIRCLE = _Rule(((ranges.FENCE_RADIUS,),), ground=True)
_MISSION: Mapping[int, _Rule] = {
    mav.MAV_CMD_NAV_WAYPOINT: _Rule(
        (_HOLD, (ranges.ACCEPTANCE,)), optional=True, ground=True, height=True
    ),
    mav.MAV_CMD_NAV_LOITER_UNLIM: _LOITER,
    mav.MAV_CMD_NAV_LOITER_TIME: _LOITER,
    mav.MAV_CMD_NAV_LOITER_TO_ALT: _Rule(ground=True, height=True),
    mav.MAV_CMD_NAV_LOITER_TURNS: _Rule(
        ((ranges.TURNS,), (), _RADIUS), optional=True, ground=True, height=True
    ),
    mav.MAV_CMD_NAV_TAKEOFF: _OPEN_PLACE,
    mav.MAV_CMD_NAV_LAND: _OPEN_PLACE,
    mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: _Rule(),
    mav.MAV_CMD_NAV_DELAY: _DELAY,
    mav.MAV_CMD_CONDITION_DELAY: _DELAY,
    mav.MAV_CMD_CONDITION_YAW: _Rule(((ranges.TURN,),)),
    # Air and ground speed are the same to a multirotor that measures neither; -1 keeps the speed,
    # -2 returns to the default.
    mav.MAV_CMD_DO_CHANGE_SPEED: _Rule((((0.0, 1.0),), (ranges.SPEED, (-1.0, -2.0)))),
    mav.MAV_CMD_DO_JUMP: _Rule(((ranges.ITEM,), (ranges.REPEATS,))),
    mav.MAV_CMD_DO_SET_ROI_LOCATION: _Rule(ground=True, height=True),
    mav.MAV_CMD_DO_SET_ROI: _Rule((((0.0, 3.0),),), ground=True, height=True),
    mav.MAV_CMD_DO_SET_ROI_NONE: _Rule(),
    mav.MAV_CMD_DO_LAND_START: _Rule(),  # a mark for whoever looks for the landing; nobody does
    **dict.fromkeys(ABSENT, _Rule()),
}
_RULES: Mapping[int, Mapping[int, _Rule]] = {
    mav.MAV_MISSION_TYPE_MISSION: _MISSION,
    mav.MAV_MISSION_TYPE_FENCE: {
        mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: _FENCE_POLYGON,
        mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: _FENCE_POLYGON,
        mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: _FENCE_CIRCLE,
        mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: _FENCE_CIRCLE,
    },
    mav.MAV_MISSION_TYPE_RALLY: {mav.MAV_CMD_NAV_RALLY_POINT: _Rule(ground=True, height=True)},
}
COMMANDS = frozenset(_MISSION)
# What the nose turns to; items with a position to fly to; all that lead somewhere or keep there.
LOOKS = frozenset(
    {mav.MAV_CMD_DO_SET_ROI_LOCATION, mav.MAV_CMD_DO_SET_ROI, mav.MAV_CMD_DO_SET_ROI_NONE}
)
PLACES = frozenset(command for command, rule in _MISSION.items() if rule.ground) - LOOKS
NAVIGATION = PLACES | {mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, mav.MAV_CMD_NAV_DELAY}


def check_item(item: MissionItem) -> int:
    """MAV_MISSION_ACCEPTED where the vehicle can carry out `item`, or what is wrong with it."""
    rule = _RULES.get(item.mission_type, {}).get(item.command)
    wrong = mav.MAV_MISSION_UNSUPPORTED if rule is None else rule.wrong(item)
    return wrong or mav.MAV_MISSION_ACCEPTED


def why_refused(item: MissionItem, verdict: int) -> str:
    """What `check_item` has against an item, in words: why, and what is allowed."""
    above = "home" if item.frame in RELATIVE_FRAMES else "mean sea level"
    allowed = f"{_altitudes(item)} above {above} are allowed"
    words = {
        mav.MAV_MISSION_UNSUPPORTED: "is not supported",
        mav.MAV_MISSION_UNSUPPORTED_FRAME: _frame(item),
        mav.MAV_MISSION_INVALID_PARAM5_X: f"latitude {item.x:g}, -90 to 90 are allowed",
        mav.MAV_MISSION_INVALID_PARAM6_Y: f"longitude {item.y:g}, -180 to 180 are allowed",
        mav.MAV_MISSION_INVALID_PARAM7: f"altitude {item.z:g} m, {allowed}",
    }
    return words.get(verdict) or _param(item, _PARAMS.index(verdict))


def absent(items: Iterable[MissionItem]) -> str:
    """Which items are for parts that the vehicle does not have, in words; empty if none."""
    counts = Counter(item.command for item in items if item.command in ABSENT)
    named = [f"{n} x {bare_name(command)} ({ABSENT[command]})" for command, n in counts.items()]
    return ", ".join(named)


def _param(item: MissionItem, index: int) -> str:
    allowed = _RULES[item.mission_type][item.command].params[index]
    parts = [
        str(part) if isinstance(part, ranges.Range) else ", ".join(f"{v:g}" for v in part)
        for part in allowed
        if isinstance(part, ranges.Range | tuple)
    ]
    return f"parameter {index + 1} = {item.params[index]:g}, {', '.join(parts)} are allowed"


def _frame(item: MissionItem) -> str:
    if item.frame not in _TERRAIN_FRAMES:
        return f"frame {item.frame}, 0, 3, 5 and 6 are supported"
    return (
        f"frame {item.frame} counts heights from the terrain, of which nothing is known here: plan "
        "them above launch or sea level (QGroundControl: Relative To Launch, Calc Above Terrain)"
    )


def _altitudes(item: MissionItem) -> ranges.Range:
    """The altitudes that an item may have, in its frame."""
    return ranges.HEIGHT if item.frame in RELATIVE_FRAMES else ranges.ALTITUDE
