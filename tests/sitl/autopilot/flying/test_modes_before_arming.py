"""Modes chosen before arming. What is expected was seen on PX4 v1.16 in its own simulation."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item, of
from sitl_mavsdk import HOME

from sitl.autopilot.flying.modes import Mode

ARM, SET_MODE, START = (
    mav.MAV_CMD_COMPONENT_ARM_DISARM,
    mav.MAV_CMD_DO_SET_MODE,
    mav.MAV_CMD_MISSION_START,
)
OK, REJECTED = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_TEMPORARILY_REJECTED
WAYPOINT = mav.MAV_CMD_NAV_WAYPOINT
# PX4's main and sub mode of each mode, and why it cannot be armed in it as it stands.
CHOICES = {
    (1, 0): "in mode MANUAL: no manual control input",
    (2, 0): "in mode ALTITUDE: no manual control input",
    (3, 0): "in mode POSITION: no manual control input",
    (7, 0): "in mode STABILIZED: no manual control input",
    (4, 2): "",
    (4, 3): "",
    (4, 4): "in mode MISSION: no mission uploaded",
    (4, 5): "in mode RETURN: on the ground",
    (4, 6): "in mode LAND: on the ground",
    (4, 8): "in mode FOLLOW: on the ground",
    (6, 0): "in mode OFFBOARD: no setpoints are streamed",
}


def shown(desk: Desk) -> tuple[int, int]:
    """PX4's main and sub mode in the newest heartbeat."""
    number = of(desk.pass_wall_time(1.1), "HEARTBEAT")[-1].custom_mode
    return number >> 16 & 0xFF, number >> 24


def may_be_armed(desk: Desk) -> bool:
    health = of(desk.pass_wall_time(1.1), "SYS_STATUS")[-1].onboard_control_sensors_health
    return bool(health & mav.MAV_SYS_STATUS_PREARM_CHECK)


def two_places() -> list[Any]:
    return [item(0, WAYPOINT, height=20.0), item(1, WAYPOINT, north=60.0, height=20.0)]


def mission_current(desk: Desk) -> tuple[int, int, int]:
    desk.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_MISSION_CURRENT)
    told = of(desk.heard, "MISSION_CURRENT")[-1]
    return told.seq, told.mission_state, told.mission_mode


def reached(desk: Desk) -> list[int]:
    desk.exchange()
    return [message.seq for message in of(desk.heard, "MISSION_ITEM_REACHED")]


@pytest.mark.parametrize("mode", CHOICES)
@pytest.mark.parametrize("old", [False, True])
def test_every_mode_is_taken_and_shown_and_some_keep_it_from_being_armed(
    mode: tuple[int, int], old: bool
) -> None:
    desk, why_not = Desk(), CHOICES[mode]
    if old:
        desk.send(mav.MAVLink_set_mode_message(1, 1, mode[0] << 16 | mode[1] << 24))
    else:
        assert desk.command(SET_MODE, 1, *mode) == OK
    assert shown(desk) == mode
    assert may_be_armed(desk) is (why_not == "")
    assert desk.command(ARM, 1) == (REJECTED if why_not else OK)
    assert why_not in "".join(desk.texts())
    assert desk.mass.armed is (why_not == "")
    assert shown(desk) == mode
    assert desk.command(SET_MODE, 1, 4, 3) == OK  # and any of them is left again
    assert shown(desk) == (4, 3)
    assert desk.command(ARM, 1) == OK
    assert not desk.vehicle.moving


def test_a_mission_that_is_chosen_before_arming_begins_with_it() -> None:
    """The order of PX4's own tests, and of QGroundControl."""
    desk = Desk()
    assert desk.upload(two_places()) == mav.MAV_MISSION_ACCEPTED
    assert desk.command(SET_MODE, 1, 4, 4) == OK
    assert mission_current(desk) == (0, mav.MISSION_STATE_NOT_STARTED, 1)
    desk.fly(seconds=3.0)
    assert not desk.mass.armed
    # What is flown is what is on board when it is armed.
    other = [item(0, WAYPOINT, height=25.0), item(1, WAYPOINT, east=40.0, height=25.0)]
    assert desk.upload(other) == mav.MAV_MISSION_ACCEPTED
    assert shown(desk) == (4, 4)
    assert desk.command(mav.MAV_CMD_DO_SET_MISSION_CURRENT, 1) == OK
    assert not desk.vehicle.moving
    assert desk.command(ARM, 1) == OK
    assert mission_current(desk) == (1, mav.MISSION_STATE_ACTIVE, 1)
    desk.fly()
    assert reached(desk) == [1]
    np.testing.assert_allclose(desk.mass.belief.pos_ned_m, [0.0, 40.0, -25.0], atol=0.02)
    assert desk.vehicle.autopilot.mode is Mode.HOLD


def test_auto_without_a_sub_mode_is_the_mission() -> None:
    desk = Desk()
    assert desk.command(SET_MODE, 1, 4, 0) == OK
    assert shown(desk) == (4, 4)


def test_a_mission_that_may_not_be_flown_keeps_it_from_being_armed() -> None:
    desk = Desk()
    assert desk.upload(two_places()) == mav.MAV_MISSION_ACCEPTED
    assert desk.command(SET_MODE, 1, 4, 4) == OK
    desk.vehicle.autopilot.parameters.set("GF_MAX_HOR_DIST", 50.0)
    before = len(desk.recorder.of_kind("armed"))
    assert desk.command(ARM, 1) == REJECTED
    assert "the mission leads farther than 50 m from home" in "".join(desk.texts())
    assert not desk.mass.armed
    assert len(desk.recorder.of_kind("armed")) == before
    desk.vehicle.autopilot.parameters.set("GF_MAX_HOR_DIST", 0.0)
    assert desk.command(ARM, 1) == OK
    desk.fly()
    assert reached(desk) == [0, 1]


def test_take_off_before_arming_by_mode_and_by_command() -> None:
    desk = Desk()
    assert desk.command(SET_MODE, 1, 4, 2) == OK
    assert desk.command(ARM, 1) == OK
    desk.fly()
    assert desk.mass.belief.alt_rel_m == pytest.approx(10.0)  # MIS_TAKEOFF_ALT
    desk = Desk()
    nan = math.nan
    altitude = HOME.alt_msl_m + 17.0
    assert desk.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, nan, nan, nan, altitude) == OK
    assert shown(desk) == (4, 2)
    assert not desk.mass.armed
    assert desk.command(ARM, 1) == OK
    desk.fly()
    assert desk.mass.belief.alt_rel_m == pytest.approx(17.0)
    desk = Desk()
    assert desk.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, nan, nan, nan, HOME.alt_msl_m) == OK
    assert desk.command(ARM, 1) == REJECTED
    assert "is not above the aircraft" in "".join(desk.texts())
    assert not desk.mass.armed


def test_offboard_begins_with_arming_once_setpoints_stream() -> None:
    desk = Desk()
    assert desk.command(SET_MODE, 1, 6, 0) == OK
    assert desk.command(ARM, 1) == REJECTED
    climb = mav.MAVLink_set_position_target_local_ned_message(
        *(0, 1, 1, 1, 0b110111000111, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0), *[0.0] * 5
    )
    desk.send(climb)
    assert may_be_armed(desk) is False  # a second has passed
    desk.send(climb)
    assert desk.command(ARM, 1) == OK
    assert desk.mass.target is not None
    assert desk.mass.target.vel[2] == -1.0


def test_mission_start_arms() -> None:
    desk = Desk()
    assert desk.command(START, 0, 0) != OK
    assert not desk.mass.armed
    assert desk.upload(two_places()) == mav.MAV_MISSION_ACCEPTED
    assert desk.command(SET_MODE, 1, 4, 5) == OK
    assert desk.command(START, 0, 0) == REJECTED  # RETURN keeps it from being armed
    assert desk.command(SET_MODE, 1, 4, 3) == OK
    assert desk.command(START, 1, 0) == OK
    assert desk.mass.armed
    desk.fly()
    assert reached(desk) == [1]


def test_orders_of_the_air_are_refused_before_arming_whatever_the_mode() -> None:
    """PX4 takes these, too, and does nothing: here they name what is missing."""
    desk = Desk()
    assert desk.upload(two_places()) == mav.MAV_MISSION_ACCEPTED
    assert desk.command(SET_MODE, 1, 4, 4) == OK
    for command in (
        mav.MAV_CMD_NAV_LAND,
        mav.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        mav.MAV_CMD_DO_PAUSE_CONTINUE,
    ):
        params = (1,) if command == mav.MAV_CMD_DO_PAUSE_CONTINUE else ()
        assert desk.command(command, *params) == REJECTED
    assert "not armed" in "".join(desk.texts())
    assert desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 5, 0) == OK
    assert shown(desk) == (4, 4)
    assert not desk.vehicle.moving


def test_a_mode_is_not_chosen_while_it_starts_or_when_it_is_wrecked() -> None:
    desk = Desk(ready=False)
    assert desk.command(SET_MODE, 1, 4, 4) == REJECTED
    desk.fly()
    assert desk.command(mav.MAV_CMD_DO_FLIGHTTERMINATION, 1) == OK
    desk.fly()
    assert desk.command(SET_MODE, 1, 4, 4) == REJECTED
    assert desk.vehicle.autopilot.mode is Mode.TERMINATED
