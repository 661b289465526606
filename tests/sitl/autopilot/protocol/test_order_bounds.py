"""The ends of every range that an order's numbers may lie in: taken there, refused beyond.

The numbers are the documented behaviour of a vehicle; whoever widens one says so here.
"""

import math

import pytest
from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import CommandOrder, MissionItem, bare_name
from sitl.autopilot.protocol.order_rules import (
    ABSENT,
    COMMAND_RULES,
    ITEM_RULES,
    check_item,
    rule_of,
)

ABOVE_SEA, ABOVE_HOME = mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT
MISSION, FENCE = ITEM_RULES[mav.MAV_MISSION_TYPE_MISSION], ITEM_RULES[mav.MAV_MISSION_TYPE_FENCE]


@pytest.mark.parametrize(
    ("rule", "index", "low", "high"),
    [
        (MISSION[mav.MAV_CMD_NAV_WAYPOINT], 0, 0.0, 86_400.0),  # s of holding: a day
        (MISSION[mav.MAV_CMD_NAV_WAYPOINT], 1, 0.0, 10_000.0),  # m of acceptance
        (MISSION[mav.MAV_CMD_NAV_WAYPOINT], 3, -360.0, 360.0),  # deg of heading
        (MISSION[mav.MAV_CMD_NAV_WAYPOINT], 4, -90.0, 90.0),
        (MISSION[mav.MAV_CMD_NAV_WAYPOINT], 5, -180.0, 180.0),
        (MISSION[mav.MAV_CMD_NAV_DELAY], 0, 0.0, 86_400.0),
        (MISSION[mav.MAV_CMD_NAV_LOITER_TURNS], 0, 0.0, 1_000.0),
        (MISSION[mav.MAV_CMD_NAV_LOITER_TURNS], 2, -1_000.0, 1_000.0),
        (MISSION[mav.MAV_CMD_DO_JUMP], 0, 0.0, 65_535.0),  # of a 16-bit number of an item
        (MISSION[mav.MAV_CMD_DO_JUMP], 1, 0.0, 1_000_000.0),
        (FENCE[mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION], 0, 3.0, 5_000.0),  # corners
        (FENCE[mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION], 1, 0.0, 255.0),  # 8-bit group
        (FENCE[mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION], 0, 0.01, 1e6),  # m of radius
        (COMMAND_RULES[mav.MAV_CMD_DO_CHANGE_SPEED], 1, 0.1, 100.0),  # m/s; -1, -2 are names
        (COMMAND_RULES[mav.MAV_CMD_CONDITION_YAW], 1, 0.0, 60.0),  # deg/s
        (COMMAND_RULES[mav.MAV_CMD_DO_REPOSITION], 0, -100.0, 0.0),  # below: the default speed
        (COMMAND_RULES[mav.MAV_CMD_DO_REPOSITION], 0, 0.1, 100.0),
        (COMMAND_RULES[mav.MAV_CMD_DO_REPOSITION], 3, -4 * 3.1415927, 4 * 3.1415927),  # rad
        (COMMAND_RULES[mav.MAV_CMD_DO_ORBIT], 0, 1.0, 1_000.0),
        (COMMAND_RULES[mav.MAV_CMD_DO_ORBIT], 0, -1_000.0, -1.0),  # the other way round
        (COMMAND_RULES[mav.MAV_CMD_DO_ORBIT], 1, -10.0, 10.0),
        (COMMAND_RULES[mav.MAV_CMD_DO_ORBIT], 3, 0.0, 6_284.0),  # rad: a thousand turns
        (COMMAND_RULES[mav.MAV_CMD_SET_MESSAGE_INTERVAL], 1, 2_000.0, 1e10),  # us: to 500 Hz
    ],
)
def test_the_ends_of_a_range_are_allowed_and_nothing_beyond(rule, index, low, high):
    def taken(value):
        return any(value in part for part in rule.allowed(index, ABOVE_SEA))

    beyond = max(1e-6, 1e-6 * abs(low)), max(1e-6, 1e-6 * abs(high))
    assert taken(low)
    assert taken(high)
    assert not taken(low - beyond[0])
    assert not taken(high + beyond[1])


def test_heights_are_bounded_as_their_frame_counts_them():
    rule = MISSION[mav.MAV_CMD_NAV_WAYPOINT]
    for frame, low, high in ((ABOVE_SEA, -1_000.0, 20_000.0), (ABOVE_HOME, -500.0, 10_000.0)):
        for height, is_taken in ((low, True), (high, True), (low - 1, False), (high + 1, False)):
            wrong = rule.wrong((0, 0, 0, math.nan, 47.0, 8.0, height), frame)
            assert wrong == (None if is_taken else 6), (frame, height)


# Of each parameter that chooses the whole numbers that it may be, by orders as they are sent: c of
# a command, m of a mission's item; and whether it may be left open (?).
CHOICES = {
    "c COMPONENT_ARM_DISARM 1": "0 1", "c COMPONENT_ARM_DISARM 2": "0 21196 ?",
    "c DO_REPOSITION 2": "0 1 2 3 ?", "c DO_CHANGE_ALTITUDE 2": "0 3 5 6", "c DO_SET_ROI 1": "0 3",
    "c DO_CHANGE_SPEED 1": "0 1", "c DO_CHANGE_SPEED 3": "-2 -1 0 ?", "m DO_CHANGE_SPEED 1": "0 1",
    "m DO_CHANGE_SPEED 3": "-2 -1 0 ?", "c CONDITION_YAW 3": "-1 0 1 ?",
    "c CONDITION_YAW 4": "0 1 ?", "m CONDITION_YAW 3": "-1 0 1 ?", "m CONDITION_YAW 4": "0 1 ?",
    "c DO_PAUSE_CONTINUE 1": "0 1", "c DO_SET_MISSION_CURRENT 2": "0 1 ?", "c DO_SET_HOME 1": "0 1",
    "c DO_ORBIT 3": "0 1 2 3 5 ?", "c DO_FENCE_ENABLE 1": "0 1",
    "c PREFLIGHT_REBOOT_SHUTDOWN 1": "1", "c PREFLIGHT_REBOOT_SHUTDOWN 7": "-1 0 ?",
    "c PREFLIGHT_STORAGE 2": "-1 0 ?", "c REQUEST_AUTOPILOT_CAPABILITIES 1": "0 1 ?",
    "c REQUEST_MESSAGE 7": "0 1 2 ?", "c SET_MESSAGE_INTERVAL 2": "-1 0 21196",
    "c SET_MESSAGE_INTERVAL 7": "0 1 2 ?", "m NAV_DELAY 2": "-1 0 ?", "m NAV_DELAY 3": "-1 0 ?",
    "m NAV_DELAY 4": "-1 0 ?", "m DO_SET_ROI 1": "0 3",
}  # fmt: skip
# Ranges, whose ends are above, or any number; with a ? where they may be left open.
RANGES = """
c NAV_TAKEOFF 1? 4?; c NAV_LAND 1? 4?; c NAV_LOITER_UNLIM 3? 4?; c DO_REPOSITION 1? 3? 4?
c DO_CHANGE_ALTITUDE 1?; c DO_CHANGE_SPEED 2; c CONDITION_YAW 1 2?; c DO_SET_MODE 1? 2? 3?
c MISSION_START 1? 2?; c DO_SET_MISSION_CURRENT 1?; c DO_FLIGHTTERMINATION 1?
c DO_ORBIT 1? 2? 4?; c PREFLIGHT_STORAGE 1?; c INJECT_FAILURE 1? 2? 3?; c REQUEST_MESSAGE 1?
c SET_MESSAGE_INTERVAL 1?; c GET_MESSAGE_INTERVAL 1?; m NAV_WAYPOINT 1? 2? 4?
m NAV_LOITER_UNLIM 3? 4?; m NAV_LOITER_TIME 1? 3? 4?; m NAV_LOITER_TO_ALT 1? 2? 4?
m NAV_LOITER_TURNS 1? 3? 4?; m NAV_TAKEOFF 1? 4?; m NAV_LAND 1? 4?; m NAV_DELAY 1
m CONDITION_DELAY 1; m CONDITION_YAW 1 2?; m DO_CHANGE_SPEED 2; m DO_JUMP 1 2
"""
# With a place, which may be left open: also its altitude (?), or not (~).
PLACES = """
c NAV_TAKEOFF ?; c NAV_LAND ?; c NAV_LOITER_UNLIM ?; c DO_REPOSITION ?; c DO_ORBIT ?
c DO_SET_ROI_LOCATION; c DO_SET_ROI; c DO_SET_HOME; m NAV_WAYPOINT; m NAV_LOITER_UNLIM
m NAV_LOITER_TIME; m NAV_LOITER_TO_ALT; m NAV_LOITER_TURNS; m NAV_TAKEOFF ~; m NAV_LAND ~
m DO_SET_ROI_LOCATION; m DO_SET_ROI
"""
_PROBES = [half / 2 for half in range(-6, 45)] + [21196.0, math.nan]


def _rows(text):
    rows = [row.split() for row in text.replace("\n", ";").split(";") if row]
    return {" ".join(words[:2]): words[2:] for words in rows}


def test_every_parameter_of_every_order_may_be_what_it_says_and_else_nothing():
    ranged, places = _rows(RANGES), _rows(PLACES)
    for kind, table in (("c", COMMAND_RULES), ("m", MISSION)):
        for command, rule in table.items():
            if not isinstance(command, int) or command in ABSENT:
                continue
            name = f"{kind} {bare_name(command)}"
            open_ = places.get(name)
            elsewhere = {0, 2, 3, 5, 6, 10, 11, None}
            frames = (
                elsewhere if open_ is None else {0, 3, 5, 6} | ({None} if kind == "c" else set())
            )
            assert {f for f in (*range(-1, 22), None) if f in rule.frames} == frames, name
            assert rule.placed == (open_ is not None), name
            assert rule.above_sea == (name == "c DO_ORBIT")
            for index in range(7):
                taken = [v for v in _PROBES if any(v in part for part in rule.params[index])]
                left_open = any(map(math.isnan, taken))
                where = f"{name} {index + 1}"
                if (numbers := CHOICES.get(where)) is not None:
                    said = [f"{v:g}".replace("nan", "?") for v in taken]
                    assert " ".join(said) == numbers, where
                elif open_ is not None and index > 3:
                    assert left_open == bool(open_ and (index < 6 or open_ == ["?"])), where
                elif (given := [w for w in ranged.get(name, ()) if w[0] == str(index + 1)]) != []:
                    assert left_open == given[0].endswith("?"), where
                    assert len(taken) > 2, where
                else:
                    assert [v for v in taken if v == v] == [0.0], where
                    assert left_open, where


def test_speeds_below_zero_are_names():
    for table in (COMMAND_RULES, MISSION):
        rule = table[mav.MAV_CMD_DO_CHANGE_SPEED]
        for speed, wrong in ((-1.0, None), (-2.0, None), (-1.5, 1), (-3.0, 1), (0.0, 1)):
            assert rule.wrong((1.0, speed, -1.0, 0.0, 0.0, 0.0, 0.0), None) == wrong


@pytest.mark.parametrize(
    ("command", "first", "others"),
    [
        (mav.MAV_CMD_DO_SET_HOME, 1.0, (0.0,)), (mav.MAV_CMD_DO_SET_ROI, 0.0, (3.0,)),
        (mav.MAV_CMD_REQUEST_MESSAGE, 244.0, (243.0, 245.0)),
    ],
)  # fmt: skip
def test_a_first_parameter_may_decide_what_the_others_are(command, first, others):
    def rule(number):
        return rule_of(COMMAND_RULES, CommandOrder(command, (number, *(0.0,) * 6)))

    assert rule(first) is COMMAND_RULES[command, first]
    assert all(rule(other) is COMMAND_RULES[command] for other in others)
    if command == mav.MAV_CMD_REQUEST_MESSAGE:  # of which message's interval
        assert rule(244.0).wrong((244.0, 30.0, 0.0, 0.0, 0.0, 0.0, 0.0), None) is None
        assert rule(30.0).wrong((30.0, 30.0, 0.0, 0.0, 0.0, 0.0, 0.0), None) == 1
    else:  # which needs no place
        assert rule(first).wrong((first, *(math.nan,) * 6), None) is None
        assert rule(others[0]).wrong((others[0], *(math.nan,) * 6), None) == 4


@pytest.mark.parametrize(
    ("place", "result", "words"),
    [
        ((47.0, 8.0, 30.0), mav.MAV_MISSION_ACCEPTED, ""),
        ((math.nan, 8.0, 30.0), mav.MAV_MISSION_INVALID_PARAM5_X, "latitude nan"),
        ((47.0, math.nan, 30.0), mav.MAV_MISSION_INVALID_PARAM6_Y, "longitude nan"),
        ((math.nan, math.nan, 30.0), mav.MAV_MISSION_ACCEPTED, ""),
        ((47.0, 8.0, 1e5), mav.MAV_MISSION_INVALID_PARAM7, "altitude 100000"),
    ],
)
def test_half_a_place_is_none(place, result, words):
    takeoff = MissionItem(0, mav.MAV_CMD_NAV_TAKEOFF, 3, (0.0, 0.0, 0.0, 0.0), *place)
    found, said = check_item(takeoff)
    assert found == result
    assert said.startswith(words)
