"""How far orders may lead: MIS_DIST_1WP from home, and home itself not for ever farther away."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item, of, the
from sitl_mavsdk import HOME

from flightdyn.frames import LocalFrame
from sitl.autopilot.flying.modes import Mode
from sitl.autopilot.flying.route import too_far

OK, DENIED = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_DENIED
WAYPOINT, RALLY = mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_MISSION_TYPE_RALLY
ABSOLUTE, NAN = mav.MAV_FRAME_GLOBAL, math.nan
DEGREE_M = 111_180.0  # of latitude, at HOME's


def degrees(north_m: float) -> tuple[int, int]:
    return round((HOME.lat_deg + north_m / DEGREE_M) * 1e7), round(HOME.lon_deg * 1e7)


def far_side() -> tuple[int, int]:
    """The place below HOME on the other side of the earth: beside it in the plane at HOME."""
    through = LocalFrame(HOME).to_geodetic(np.array([0.0, 0.0, 12_734_000.0]))
    plane = LocalFrame(HOME).to_ned(through.lat_deg, through.lon_deg, HOME.alt_msl_m)
    assert math.hypot(plane[0], plane[1]) < 500.0
    assert through.lat_deg < -40.0
    return round(through.lat_deg * 1e7), round(through.lon_deg * 1e7)


def move_home(desk: Desk, north_m: float) -> int:
    place = (*degrees(north_m), HOME.alt_msl_m)
    return desk.command_int(mav.MAV_CMD_DO_SET_HOME, ABSOLUTE, (0, 0, 0, NAN), *place)


def placed(command: int, x: int, y: int, *, mission_type: int = 0) -> Any:
    return mav.MAVLink_mission_item_int_message(
        1, 1, 0, 6, command, 0, 1, 0.0, 0.0, 0.0, NAN, x, y, 30.0, mission_type
    )


def test_what_is_near_counts_from_where_home_is() -> None:
    desk = Desk()
    desk.take_off()
    desk.vehicle.autopilot.parameters.set("MIS_DIST_1WP", 1000.0)
    assert move_home(desk, 5_000.0) == OK
    for north_m, near in ((5_000.0, True), (5_900.0, True), (4_100.0, True), (0.0, False)):
        x, y = degrees(north_m)
        uploaded = desk.upload([placed(WAYPOINT, x, y)])
        assert uploaded == (mav.MAV_MISSION_ACCEPTED if near else mav.MAV_MISSION_INVALID)
        rally = placed(mav.MAV_CMD_NAV_RALLY_POINT, x, y, mission_type=RALLY)
        assert desk.upload([rally], RALLY) == uploaded
        for command, params in (
            (mav.MAV_CMD_DO_REPOSITION, (-1, 1, 0, NAN)),
            (mav.MAV_CMD_DO_ORBIT, (20, 2, 0, NAN)),
        ):
            result = desk.command_int(command, ABSOLUTE, params, x, y, HOME.alt_msl_m + 30.0)
            assert result == (OK if near else DENIED)
    texts = "".join(desk.texts())
    for words in ("Mission refused: item 0 is", "Rally refused: item 0 is", "the orbit is"):
        assert f"{words} 5000 m from home, MIS_DIST_1WP allows 1000 m" in texts


def test_home_cannot_walk_away() -> None:
    desk = Desk()
    desk.vehicle.autopilot.parameters.set("MIS_DIST_1WP", 100_000.0)
    assert [move_home(desk, north_m) for north_m in (30e3, 60e3, 90e3)] == [OK] * 3
    assert move_home(desk, 120e3) == DENIED
    assert "120 km from where the vehicle started, the most is 100 km" in "".join(desk.texts())
    assert of(desk.pass_wall_time(1.1), "HOME_POSITION")[-1].latitude == degrees(90e3)[0]
    # Nor do items: this one is 60 km from home.
    assert desk.upload([placed(WAYPOINT, *degrees(150e3))]) == mav.MAV_MISSION_INVALID
    assert desk.upload([placed(WAYPOINT, *degrees(95e3))]) == mav.MAV_MISSION_ACCEPTED


@pytest.mark.parametrize(
    ("ground_m", "words"),
    [(40.0, "Touched down 40 m above home"), (4.0, ""), (0.0, ""), (-3.0, "")],
)
def test_ground_that_lies_above_home_is_told(ground_m: float, words: str) -> None:
    """Home's height is what a landing slows down by, as on PX4 without a range finder."""
    desk = Desk()
    desk.take_off(30.0)
    home = (*degrees(0.0), HOME.alt_msl_m - ground_m)
    assert desk.command_int(mav.MAV_CMD_DO_SET_HOME, ABSOLUTE, (0, 0, 0, NAN), *home) == OK
    assert desk.command(mav.MAV_CMD_NAV_LAND) == OK
    desk.fly()
    desk.exchange()
    assert not desk.mass.armed
    texts = "".join(desk.texts())
    assert words in texts
    assert ("Touched down" in texts) is bool(words)


def test_a_mission_is_judged_again_where_home_has_moved() -> None:
    desk = Desk()
    assert desk.upload([placed(WAYPOINT, *degrees(0.0))]) == mav.MAV_MISSION_ACCEPTED
    desk.take_off()
    assert move_home(desk, 30e3) == OK
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 1, 4, 4) == mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert "item 0 is 30 km from home, MIS_DIST_1WP allows 20 km" in "".join(desk.texts())
    assert move_home(desk, 0.0) == OK
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 1, 4, 4) == OK


def test_the_other_side_of_the_earth_is_not_beside_home() -> None:
    desk, (x, y) = Desk(), far_side()
    desk.take_off()
    assert desk.upload([placed(WAYPOINT, x, y)]) == mav.MAV_MISSION_INVALID
    rally = placed(mav.MAV_CMD_NAV_RALLY_POINT, x, y, mission_type=RALLY)
    assert desk.upload([rally], RALLY) == mav.MAV_MISSION_INVALID
    for command, params in (
        (mav.MAV_CMD_DO_REPOSITION, (-1, 1, 0, NAN)),
        (mav.MAV_CMD_DO_ORBIT, (20, 2, 0, NAN)),
        (mav.MAV_CMD_DO_SET_HOME, (0, 0, 0, NAN)),
        (mav.MAV_CMD_DO_SET_ROI_LOCATION, (0, 0, 0, 0)),
    ):
        assert desk.command_int(command, ABSOLUTE, params, x, y, 500.0) == DENIED, command
    assert "km from where the vehicle started, the most is 100 km" in "".join(desk.texts())
    desk.send(
        mav.MAVLink_set_position_target_global_int_message(
            0, 1, 1, 5, 0b110111111000, x, y, 500.0, *[0.0] * 8
        )
    )
    assert "Setpoint refused: position 127" in "".join(desk.texts())
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 1, 4, 8) == OK
    desk.send(
        mav.MAVLink_follow_target_message(
            0, 1, x, y, 500.0, [0.0] * 3, [0.0] * 3, [1.0, 0, 0, 0], [0.0] * 3, [0.0] * 3, 0
        )
    )
    desk.fly(seconds=1.0)
    assert desk.vehicle.autopilot.mode is Mode.FOLLOW
    target = desk.mass.target
    assert target is not None
    assert all(map(math.isnan, target.pos))  # no position was taken: it stays


@pytest.mark.parametrize(
    ("place", "home", "words"),
    [
        ((0, 1000, 0), (0, 0, 0), ""),
        ((0, 1001, 0), (0, 0, 0), "1001 m from home, MIS_DIST_1WP allows 1000 m"),
        ((0, 1001, 0), (0, 2, 0), ""),
        ((0, 500, -900), (0, 0, 0), ""),  # height is no distance
        ((99e3, 0, 0), (99e3, 900, 0), ""),
        ((100.1e3, 0, 0), (99.9e3, 0, 0), "100 km from where the vehicle started, the most is"),
    ],
)
def test_both_bounds(place: tuple[float, ...], home: tuple[float, ...], words: str) -> None:
    told = too_far(np.array(place), np.array(home), farthest_m=1000.0)
    assert told.startswith(words)
    assert bool(told) is bool(words)


def jumping(desk: Desk) -> None:
    items = [item(seq, WAYPOINT, north=20.0 * seq, height=20.0) for seq in range(3)]
    jump = mav.MAVLink_mission_item_int_message(
        1, 1, 3, 2, mav.MAV_CMD_DO_JUMP, 0, 1, 1.0, 1.0, 0.0, 0.0, 0, 0, 0.0, 0
    )
    assert desk.upload([*items, jump]) == mav.MAV_MISSION_ACCEPTED


def told(desk: Desk) -> tuple[int, int]:
    desk.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_MISSION_CURRENT)
    message = of(desk.heard, "MISSION_CURRENT")[-1]
    return message.seq, message.mission_state


def test_the_current_item_is_the_one_being_flown_and_no_jump() -> None:
    desk = Desk()
    desk.take_off(20.0)
    jumping(desk)
    heard = desk.send(mav.MAVLink_mission_set_current_message(1, 1, 3))
    assert the(heard, "MISSION_CURRENT").seq == 3  # that it was set is acknowledged by its number
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 1, 4, 4) == OK
    assert told(desk) == (1, mav.MISSION_STATE_ACTIVE)
    desk.fly(seconds=1.0)
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 1, 4, 3) == OK
    assert told(desk) == (1, mav.MISSION_STATE_PAUSED)
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 1, 4, 4) == OK
    desk.fly()
    desk.exchange()
    # The jump was taken when it was gone on with, and is not taken again.
    assert [message.seq for message in of(desk.heard, "MISSION_ITEM_REACHED")] == [1, 2]
    assert told(desk) == (2, mav.MISSION_STATE_COMPLETE)


def test_the_last_item_is_told_before_the_mission_is_complete() -> None:
    """All that a station hears at once is in the order in which it happened."""
    desk = Desk()
    desk.take_off(20.0)
    jumping(desk)
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 1, 4, 4) == OK
    desk.fly()
    heard = desk.exchange()
    kinds = [message.get_type() for message in heard]
    assert of(heard, "MISSION_ITEM_REACHED")[-1].seq == 2
    last = len(kinds) - 1 - kinds[::-1].index("MISSION_ITEM_REACHED")
    complete = [
        index
        for index, message in enumerate(heard)
        if message.get_type() == "MISSION_CURRENT"
        and message.mission_state == mav.MISSION_STATE_COMPLETE
    ]
    assert complete
    assert last < min(complete)
