"""What commands and items of missions, fences and rally points may hold: one table of orders.

Each order declares its seven parameters as MAVLink's definition (common.xml) has them: those that
are carried out with the numbers that can be, all others with their neutral values. What lies
outside is refused. So no field of an accepted order is passed over.
"""

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
    CommandOrder,
    MissionItem,
    bare_name,
)

Allowed: TypeAlias = tuple[Container[float], ...]  # a number is in one of them

_TERRAIN_FRAMES = frozenset(
    {mav.MAV_FRAME_GLOBAL_TERRAIN_ALT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT}
)
# Of orders without a place the frame says nothing; planners leave that of the row before.
_PLACELESS_FRAMES = GLOBAL_FRAMES | _TERRAIN_FRAMES | {mav.MAV_FRAME_MISSION}
_PLACE = {4: "latitude", 5: "longitude", 6: "altitude"}  # by index of the parameter
FORCE = 21196.0  # the magic number of forced arming and disarming
WRONG_FRAME = -1  # in place of the index of a parameter


class _Open:
    """NaN: left open."""

    def __contains__(self, value: object) -> bool:
        return isinstance(value, float) and math.isnan(value)

    def __str__(self) -> str:
        return "NaN"


class _Any(_Open):
    """Any number: its handler looks at it, or it says nothing to a multicopter."""

    def __contains__(self, value: object) -> bool:
        return True


_ANY: Allowed = (_Any(),)
_OPEN: Allowed = (_Open(),)
UNUSED: Allowed = ((0.0,), *_OPEN)  # "empty" and "reserved" ones


@dataclass(frozen=True, slots=True)
class Rule:
    """The seven parameters of an order, and the frames of its place."""

    params: tuple[Allowed, ...]
    frames: Container[int | None] = frozenset({None, *_PLACELESS_FRAMES})
    above_sea: bool = False  # its altitude, in the frames that count from home, too

    @property
    def placed(self) -> bool:
        """Whether parameters 5 and 6 are a latitude and a longitude."""
        return ranges.LATITUDE in self.params[4]

    def allowed(self, index: int, frame: int | None) -> Allowed:
        """The numbers that a parameter may have in a frame (None: of a COMMAND_LONG)."""
        allowed = self.params[index]
        if frame in RELATIVE_FRAMES and not self.above_sea and ranges.ALTITUDE in allowed:
            return (ranges.HEIGHT, *allowed[1:])
        return allowed

    def wrong(self, params: Iterable[float], frame: int | None) -> int | None:
        """The index of the first parameter that is refused, or WRONG_FRAME; None if none is."""
        if frame not in self.frames:
            return WRONG_FRAME
        for index, value in enumerate(params):
            if not any(value in part for part in self.allowed(index, frame)):
                return index
        return None

    def words(self, index: int, value: float, frame: int | None) -> str:
        """Why a parameter (or the frame) is refused, and what is allowed."""
        if index == WRONG_FRAME:
            return _frame_words(frame)
        name = f"parameter {index + 1} ="
        if self.placed and index in _PLACE:
            name = _PLACE[index]
        parts = [
            ", ".join(f"{number:g}" for number in part) if isinstance(part, tuple) else str(part)
            for part in self.allowed(index, frame)
        ]
        return f"{name} {value:g}, {', '.join(parts)} are allowed"


def _rule(*first: Allowed, seventh: Allowed = UNUSED) -> Rule:
    """An order without a place; parameters that are not named are unused."""
    return Rule((*first, *[UNUSED] * (6 - len(first)), seventh))


def _placed(
    *first: Allowed,
    here: Allowed = (),
    altitude: Allowed = (ranges.ALTITUDE,),
    above_sea: bool = False,
    command: bool = False,
) -> Rule:
    """An order with a place; what is left open of it (NaN) is that of the vehicle.

    `here`: _OPEN where it may be left open; of a command this holds for the altitude, too.
    """
    place = (
        (ranges.LATITUDE, *here),
        (ranges.LONGITUDE, *here),
        (*altitude, *(here if command else ())),
    )
    frames = GLOBAL_FRAMES | ({None} if command else set())
    return Rule((*first, *[UNUSED] * (4 - len(first)), *place), frames, above_sea)


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
    "choice of a landing": "DO_LAND_START",
}
ABSENT: Mapping[int, str] = {
    getattr(mav, f"MAV_CMD_{name}"): part
    for part, names in _PARTS.items()
    for name in names.split()
}

# Aeroplanes alone have these: pitch of a take-off, height of an aborted landing, radius of a
# loiter, the course on which to leave it. PX4's multicopters pass over them, too.
_AEROPLANE = _ANY
_HOLD: Allowed = (ranges.HOLD, *_OPEN)
_YAW: Allowed = (ranges.YAW, *_OPEN)
_SWITCH: Allowed = ((0.0, 1.0),)
_SWITCH_OR_OPEN: Allowed = (*_SWITCH, *_OPEN)
_ITEM: Allowed = (ranges.ITEM, *_OPEN)
_RADIUS: Allowed = (ranges.ORBIT_RADIUS, ranges.COUNTER_CLOCKWISE)
_NO_TIME: Allowed = ((0.0, -1.0), *_OPEN)
_RECEIVER: Allowed = ((0.0, 1.0, 2.0), *_OPEN)  # for messages that name one; none here does
# A multirotor that measures neither air nor ground speed takes both for the same; -1 keeps the
# speed, -2 returns to the default. It has no throttle to be set beside its height.
_CHANGE_SPEED = _rule(_SWITCH, (ranges.SPEED, (-1.0, -2.0)), ((0.0, -1.0, -2.0), *_OPEN))
_CONDITION_YAW = _rule(
    (ranges.YAW,), (ranges.TURN_RATE, *_OPEN), ((-1.0, 0.0, 1.0), *_OPEN), _SWITCH_OR_OPEN
)
_ROI_NONE, _ROI_MODE = _rule(), ((0.0, 3.0),)  # nothing, or a place
_UP_OR_DOWN = (_AEROPLANE, UNUSED, UNUSED, _YAW)
_LOITER = (UNUSED, UNUSED, _AEROPLANE, _YAW)

# By the command, or by the command and its first parameter where that decides what the others are.
Table: TypeAlias = Mapping[int | tuple[int, float], Rule]
COMMAND_RULES: Table = {
    mav.MAV_CMD_COMPONENT_ARM_DISARM: _rule(_SWITCH, ((0.0, FORCE), *_OPEN)),
    mav.MAV_CMD_NAV_TAKEOFF: _placed(*_UP_OR_DOWN, here=_OPEN, command=True),
    mav.MAV_CMD_NAV_LAND: _placed(*_UP_OR_DOWN, here=_OPEN, command=True),
    mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: _rule(),
    mav.MAV_CMD_NAV_LOITER_UNLIM: _placed(*_LOITER, here=_OPEN, command=True),
    mav.MAV_CMD_DO_REPOSITION: _placed(
        (ranges.SPEED, ranges.BELOW_ZERO, *_OPEN),
        ((0.0, 1.0, 2.0, 3.0), *_OPEN),
        _AEROPLANE,
        (ranges.HEADING, *_OPEN),
        here=_OPEN,
        command=True,
    ),
    mav.MAV_CMD_DO_CHANGE_ALTITUDE: _rule(_ANY, (tuple(map(float, sorted(GLOBAL_FRAMES))),)),
    mav.MAV_CMD_DO_SET_ROI_LOCATION: _placed(command=True),
    mav.MAV_CMD_DO_SET_ROI_NONE: _ROI_NONE,
    mav.MAV_CMD_DO_SET_ROI: _placed(_ROI_MODE, command=True),
    (mav.MAV_CMD_DO_SET_ROI, mav.MAV_ROI_NONE): _ROI_NONE,
    mav.MAV_CMD_DO_CHANGE_SPEED: _CHANGE_SPEED,
    mav.MAV_CMD_CONDITION_YAW: _CONDITION_YAW,
    mav.MAV_CMD_DO_SET_MODE: _rule(_ANY, _ANY, _ANY),
    mav.MAV_CMD_MISSION_START: _rule(_ITEM, _ITEM),
    mav.MAV_CMD_DO_PAUSE_CONTINUE: _rule(_SWITCH),
    mav.MAV_CMD_DO_SET_MISSION_CURRENT: _rule((*_ITEM, (-1.0,)), _SWITCH_OR_OPEN),
    mav.MAV_CMD_DO_SET_HOME: _placed(_SWITCH, command=True),
    (mav.MAV_CMD_DO_SET_HOME, 1.0): _rule(_SWITCH),
    mav.MAV_CMD_DO_FLIGHTTERMINATION: _rule(_ANY),
    # Above mean sea level in every frame, as PX4 has it: MAVSDK names a relative one.
    mav.MAV_CMD_DO_ORBIT: _placed(
        (*_RADIUS, *_OPEN),
        (ranges.ORBIT_SPEED, *_OPEN),
        ((0.0, 1.0, 2.0, 3.0, 5.0), *_OPEN),
        (ranges.ARC, *_OPEN),
        here=_OPEN,
        above_sea=True,
        command=True,
    ),
    mav.MAV_CMD_DO_FENCE_ENABLE: _rule(_SWITCH),
    mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _rule(((1.0,),), seventh=((0.0, -1.0), *_OPEN)),
    mav.MAV_CMD_PREFLIGHT_STORAGE: _rule(_ANY, ((0.0, -1.0), *_OPEN)),
    mav.MAV_CMD_INJECT_FAILURE: _rule(_ANY, _ANY, _ANY),
    mav.MAV_CMD_GET_HOME_POSITION: _rule(),
    mav.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _rule(_SWITCH_OR_OPEN),
    mav.MAV_CMD_REQUEST_MESSAGE: _rule(_ANY, seventh=_RECEIVER),
    (mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_MESSAGE_INTERVAL): _rule(
        _ANY, _ANY, seventh=_RECEIVER
    ),
    mav.MAV_CMD_SET_MESSAGE_INTERVAL: _rule(
        _ANY, (ranges.INTERVAL, (-1.0, 0.0)), seventh=_RECEIVER
    ),
    mav.MAV_CMD_GET_MESSAGE_INTERVAL: _rule(_ANY),
}
_POLYGON, _CIRCLE, _GROUP = (ranges.CORNERS,), (ranges.FENCE_RADIUS,), (ranges.GROUP, *_OPEN)
_MISSION: Table = {
    mav.MAV_CMD_NAV_WAYPOINT: _placed(_HOLD, (ranges.ACCEPTANCE, *_OPEN), UNUSED, _YAW),
    mav.MAV_CMD_NAV_LOITER_UNLIM: _placed(*_LOITER),
    mav.MAV_CMD_NAV_LOITER_TIME: _placed(_HOLD, UNUSED, _AEROPLANE, _YAW),
    mav.MAV_CMD_NAV_LOITER_TO_ALT: _placed(_AEROPLANE, _AEROPLANE, UNUSED, _AEROPLANE),
    mav.MAV_CMD_NAV_LOITER_TURNS: _placed(
        (ranges.TURNS, *_OPEN), UNUSED, (*_RADIUS, (0.0,), *_OPEN), _YAW
    ),
    mav.MAV_CMD_NAV_TAKEOFF: _placed(*_UP_OR_DOWN, here=_OPEN),
    mav.MAV_CMD_NAV_LAND: _placed(*_UP_OR_DOWN, here=_OPEN),
    mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: _rule(),
    mav.MAV_CMD_NAV_DELAY: _rule((ranges.HOLD,), _NO_TIME, _NO_TIME, _NO_TIME),
    mav.MAV_CMD_CONDITION_DELAY: _rule((ranges.HOLD,)),
    mav.MAV_CMD_CONDITION_YAW: _CONDITION_YAW,
    mav.MAV_CMD_DO_CHANGE_SPEED: _CHANGE_SPEED,
    mav.MAV_CMD_DO_JUMP: _rule((ranges.ITEM,), (ranges.REPEATS,)),
    mav.MAV_CMD_DO_SET_ROI_LOCATION: _placed(),
    mav.MAV_CMD_DO_SET_ROI: _placed(_ROI_MODE),
    (mav.MAV_CMD_DO_SET_ROI, mav.MAV_ROI_NONE): _ROI_NONE,
    mav.MAV_CMD_DO_SET_ROI_NONE: _ROI_NONE,
    **dict.fromkeys(ABSENT, Rule((_ANY,) * 7, _Any())),
}
ITEM_RULES: Mapping[int, Table] = {
    mav.MAV_MISSION_TYPE_MISSION: _MISSION,
    mav.MAV_MISSION_TYPE_FENCE: {
        mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: _placed(_POLYGON, _GROUP, altitude=UNUSED),
        mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: _placed(_POLYGON, altitude=UNUSED),
        mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: _placed(_CIRCLE, _GROUP, altitude=UNUSED),
        mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: _placed(_CIRCLE, altitude=UNUSED),
    },
    mav.MAV_MISSION_TYPE_RALLY: {mav.MAV_CMD_NAV_RALLY_POINT: _placed()},
}
COMMANDS = frozenset(command for command in _MISSION if isinstance(command, int))
# What the nose turns to; items with a position to fly to; all that lead somewhere or keep there.
LOOKS = frozenset(
    {mav.MAV_CMD_DO_SET_ROI_LOCATION, mav.MAV_CMD_DO_SET_ROI, mav.MAV_CMD_DO_SET_ROI_NONE}
)
PLACES = frozenset(command for command in COMMANDS if _MISSION[command].placed) - LOOKS
NAVIGATION = PLACES | {mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, mav.MAV_CMD_NAV_DELAY}


def rule_of(table: Table, order: CommandOrder | MissionItem) -> Rule | None:
    """The rule of an order; None if the vehicle has nothing for it."""
    return table.get((order.command, order.params[0]), table.get(order.command))


def check_item(item: MissionItem) -> tuple[int, str]:
    """The MAV_MISSION_RESULT of an item, and why it is refused and what is allowed, in words."""
    rule = rule_of(ITEM_RULES.get(item.mission_type, {}), item)
    if rule is None:
        return mav.MAV_MISSION_UNSUPPORTED, "is not supported"
    seven = (*item.params, item.x, item.y, item.z)
    wrong = rule.wrong(seven, item.frame)
    if wrong is None and rule.placed and math.isnan(item.x) != math.isnan(item.y):
        wrong = 4 if math.isnan(item.x) else 5  # half a place
    if wrong is None:
        return mav.MAV_MISSION_ACCEPTED, ""
    words = rule.words(wrong, seven[wrong], item.frame)
    if wrong == WRONG_FRAME:
        return mav.MAV_MISSION_UNSUPPORTED_FRAME, words
    return mav.MAV_MISSION_INVALID_PARAM1 + wrong, words


def absent(items: Iterable[MissionItem]) -> str:
    """Which items are for parts that the vehicle does not have, in words; empty if none."""
    counts = Counter(item.command for item in items if item.command in ABSENT)
    named = [f"{n} x {bare_name(command)} ({ABSENT[command]})" for command, n in counts.items()]
    return ", ".join(named)


def _frame_words(frame: int | None) -> str:
    if frame not in _TERRAIN_FRAMES:
        return f"frame {frame}, 0, 3, 5 and 6 are supported"
    return (
        f"frame {frame} counts heights from the terrain, of which nothing is known here: plan "
        "them above launch or sea level (QGroundControl: Relative To Launch, Calc Above Terrain)"
    )
