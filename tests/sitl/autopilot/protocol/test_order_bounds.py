"""The ends of every range that an order's numbers may lie in: taken there, refused beyond.

The numbers are the documented behaviour of a vehicle; whoever widens one says so here.
"""

import math

import pytest
from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.protocol.order_rules import COMMAND_RULES, ITEM_RULES

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
