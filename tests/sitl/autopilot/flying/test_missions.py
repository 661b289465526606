"""What missions mean: the paths and stops that items become, and how their progress is told."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item, of, speed_item, the
from sitl_mavsdk import HOME

from sitl.autopilot.flying import route
from sitl.autopilot.flying.modes import Mode

WAYPOINT = mav.MAV_CMD_NAV_WAYPOINT
ACCEPTED = mav.MAV_MISSION_ACCEPTED
NAN = math.nan


def start(desk: Desk) -> int:
    return desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 4, 4)


def current(desk: Desk) -> tuple[int, int, int, int]:
    desk.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_MISSION_CURRENT)
    message = of(desk.heard, "MISSION_CURRENT")[-1]
    return message.seq, message.total, message.mission_state, message.mission_mode


def reached(desk: Desk) -> list[int]:
    desk.exchange()
    return [message.seq for message in of(desk.heard, "MISSION_ITEM_REACHED")]


def test_one_path_through_fly_through_points_with_speeds_after_them() -> None:
    desk = Desk()
    desk.take_off(30.0)
    mission = [
        item(0, WAYPOINT, north=0.0, height=30.0),
        speed_item(1, 20.0),
        item(2, WAYPOINT, north=100.0, height=30.0, params=(0, 7.5, 0, NAN)),
        item(3, WAYPOINT, north=100.0, east=100.0, height=30.0),
        speed_item(4, 6.0),
        item(5, WAYPOINT, north=0.0, east=100.0, height=30.0),
    ]
    assert desk.upload(mission) == ACCEPTED
    assert current(desk) == (0, 6, mav.MISSION_STATE_NOT_STARTED, 2)
    assert start(desk) == mav.MAV_RESULT_ACCEPTED
    path = desk.mass.paths[-1]
    assert len(path.points_ned_m) == 5
    expected = [[0, 0, -30], [0, 0, -30], [100, 0, -30], [100, 100, -30], [0, 100, -30]]
    np.testing.assert_allclose(path.points_ned_m, expected, atol=0.02)
    assert path.speeds_mps == pytest.approx([10.0, 20.0, 20.0, 6.0])
    assert path.acceptance_m[1:] == pytest.approx([5.0, 7.5, 5.0, 5.0])
    desk.fly(seconds=3.0)
    assert current(desk) == (2, 6, mav.MISSION_STATE_ACTIVE, 1)
    desk.fly()
    assert reached(desk) == [0, 1, 2, 3, 4, 5]
    assert [event.seq for event in desk.recorder.of_kind("reached")] == [0, 2, 3, 5]
    assert current(desk) == (5, 6, mav.MISSION_STATE_COMPLETE, 2)
    assert desk.vehicle.autopilot.mode is Mode.HOLD


@pytest.mark.parametrize("height_m", [12.0, 45.0])
def test_a_take_off_in_the_air_leads_to_its_height(height_m: float) -> None:
    """Also to a lower one, where it stayed as high as it was."""
    desk = Desk()
    desk.take_off(30.0)
    desk.upload([item(0, mav.MAV_CMD_NAV_TAKEOFF, north=20.0, height=height_m)])
    start(desk)
    desk.fly()
    np.testing.assert_allclose(desk.mass.pos_ned_m, [20.0, 0.0, -height_m], atol=0.05)


def test_reached_is_told_with_truth_and_belief_of_its_tick() -> None:
    desk = Desk()
    desk.take_off(30.0)
    desk.upload([item(0, WAYPOINT, north=100.0), item(1, WAYPOINT, north=150.0)])
    start(desk)
    began = desk.vehicle.t_ns
    desk.fly()
    first, last = desk.recorder.of_kind("reached")
    assert first.t_ns - began == pytest.approx(10e9, abs=2 * desk.mass.dt_ns)
    assert first.belief.t_ns == first.t_ns
    assert first.belief.pos_ned_m == pytest.approx([100.0, 0.0, -30.0], abs=0.25)
    assert last.t_ns == desk.vehicle.t_ns  # time stops on the tick of the last item


def test_coinciding_points_are_all_reached() -> None:
    desk = Desk()
    desk.take_off(30.0)
    desk.upload([item(i, WAYPOINT, north=0.0 if i < 2 else 40.0) for i in range(5)])
    start(desk)
    desk.fly()
    assert reached(desk) == [0, 1, 2, 3, 4]


def test_hold_times_stop_and_wait_in_simulated_time() -> None:
    desk = Desk()
    desk.take_off(30.0)
    desk.upload(
        [
            item(0, WAYPOINT, north=50.0, params=(4.0, 0, 0, NAN)),
            item(1, mav.MAV_CMD_NAV_LOITER_TIME, north=100.0, params=(3.0, 0, 0, NAN)),
            item(2, mav.MAV_CMD_NAV_DELAY, params=(2.0, 0, 0, 0)),
            item(3, WAYPOINT, north=150.0),
        ]
    )
    start(desk)
    began = desk.vehicle.t_ns
    desk.fly()
    seconds = [(event.t_ns - began) * 1e-9 for event in desk.recorder.of_kind("reached")]
    assert seconds == pytest.approx([5.0 + 4, 5 + 4 + 5 + 3, 19.0, 24.0], abs=0.1)


@pytest.mark.parametrize("speed", [None, 12.0])
def test_a_hold_that_was_interrupted_is_held_anew(speed: float | None) -> None:
    desk = Desk()
    desk.take_off(30.0)
    held = item(0, WAYPOINT, north=50.0, params=(10.0, 0, 0, NAN))
    desk.upload([held, item(1, WAYPOINT, north=100.0)])
    start(desk)
    desk.fly(seconds=9.0)  # four of them at the waypoint
    assert reached(desk) == []
    if speed is not None:
        desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, speed)
    else:
        desk.command(PAUSE, 0)
        desk.fly()
        desk.command(PAUSE, 1)
    went_on = desk.vehicle.t_ns
    desk.fly()
    over = desk.recorder.of_kind("reached")[0]
    assert (over.seq, over.t_ns - went_on) == (0, pytest.approx(10e9, abs=1e9))
    assert over.belief.pos_ned_m == pytest.approx([50.0, 0.0, -30.0], abs=0.5)
    assert reached(desk) == [0, 1]


@pytest.mark.parametrize("height_m", [45.0, 18.0])
def test_loiter_to_altitude_stands_there_before_it_goes_on(height_m: float) -> None:
    desk = Desk()
    desk.take_off(30.0)
    to_alt = item(0, mav.MAV_CMD_NAV_LOITER_TO_ALT, north=50.0, height=height_m)
    assert desk.upload([to_alt, item(1, WAYPOINT, north=80.0, height=height_m)]) == ACCEPTED
    start(desk)
    desk.fly()
    points = [path.points_ned_m[-1] for path in desk.mass.paths[-2:]]
    np.testing.assert_allclose(points, [[50, 0, -height_m], [80, 0, -height_m]], atol=0.02)
    there, _ = desk.recorder.of_kind("reached")
    assert there.belief.pos_ned_m == pytest.approx([50.0, 0.0, -height_m], abs=0.25)


def test_a_mission_from_the_ground_climbs_straight_up_first() -> None:
    desk = Desk()
    higher = item(1, WAYPOINT, north=80.0, height=40.0)
    desk.upload([item(0, WAYPOINT, north=50.0, height=20.0), higher])
    desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0)
    assert start(desk) == mav.MAV_RESULT_ACCEPTED
    np.testing.assert_allclose(
        desk.mass.paths[-1].points_ned_m, [[0, 0, 0], [0, 0, -20]], atol=0.02
    )
    desk.fly()
    through = [[0, 0, -20], [50, 0, -20], [80, 0, -40]]  # slanting, and without a stop
    np.testing.assert_allclose(desk.mass.paths[-1].points_ned_m, through, atol=0.02)
    assert desk.mass.belief.pos_ned_m == pytest.approx([80.0, 0.0, -40.0], abs=0.02)


def test_take_off_item_then_land_item() -> None:
    desk = Desk()
    here = mav.MAVLink_mission_item_int_message(
        1, 1, 0, 3, mav.MAV_CMD_NAV_TAKEOFF, 0, 1, NAN, NAN, NAN, NAN,
        2**31 - 1, 2**31 - 1, 15.0, 0,
    )  # fmt: skip
    landing = item(2, mav.MAV_CMD_NAV_LAND, north=60.0, height=0.0)
    assert desk.upload([here, item(1, WAYPOINT, north=40.0, height=15.0), landing]) == ACCEPTED
    desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0)
    start(desk)
    desk.fly()
    assert reached(desk) == [0, 1, 2]
    assert desk.mass.belief.pos_ned_m == pytest.approx([60.0, 0.0, 0.0], abs=0.02)
    assert not desk.mass.armed
    assert current(desk)[2] == mav.MISSION_STATE_COMPLETE
    assert desk.vehicle.autopilot.mode is Mode.HOLD


def test_what_stands_behind_a_landing_is_not_judged() -> None:
    desk = Desk()
    desk.take_off(30.0)
    desk.vehicle.autopilot.parameters.set("GF_MAX_HOR_DIST", 100.0)
    landing = item(1, mav.MAV_CMD_NAV_LAND, north=60.0, height=0.0)
    endless = item(3, mav.MAV_CMD_DO_JUMP, params=(0, 30_000, 0, 0), frame=mav.MAV_FRAME_MISSION)
    mission = [item(0, WAYPOINT, north=40.0), landing, item(2, WAYPOINT, north=500.0), endless]
    assert desk.upload(mission) == ACCEPTED
    assert start(desk) == mav.MAV_RESULT_ACCEPTED
    desk.fly()
    assert reached(desk) == [0, 1]
    assert not desk.mass.armed
    assert current(desk)[2] == mav.MISSION_STATE_COMPLETE


def test_return_item_ends_the_mission_and_flies_home() -> None:
    desk = Desk()
    desk.take_off(30.0)
    home = item(1, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    desk.upload([item(0, WAYPOINT, north=80.0), home, item(2, WAYPOINT, north=500.0)])
    start(desk)
    desk.fly()
    assert reached(desk) == [0, 1]
    assert desk.mass.belief.pos_ned_m == pytest.approx([0.0, 0.0, 0.0], abs=0.1)
    modes = [text.split()[0] for text in desk.recorder.texts("mode")]
    assert modes[-4:] == ["MISSION", "RETURN", "LAND", "HOLD"]


def test_loiter_without_end_stays_in_the_mission_and_time_stands_still() -> None:
    desk = Desk()
    desk.take_off(30.0)
    loiter = item(0, mav.MAV_CMD_NAV_LOITER_UNLIM, north=20.0)
    desk.upload([loiter, item(1, WAYPOINT, north=50.0)])
    start(desk)
    desk.fly()
    assert desk.vehicle.autopilot.mode is Mode.MISSION
    assert current(desk)[2] == mav.MISSION_STATE_ACTIVE
    assert desk.mass.belief.pos_ned_m == pytest.approx([20.0, 0.0, -30.0], abs=0.02)


def test_jumps_repeat_and_end() -> None:
    desk = Desk()
    desk.take_off(30.0)
    jump = mav.MAVLink_mission_item_int_message(
        1, 1, 2, mav.MAV_FRAME_MISSION, mav.MAV_CMD_DO_JUMP, 0, 1, 0.0, 2.0, 0, 0, 0, 0, 0.0, 0
    )
    desk.upload([item(0, WAYPOINT), item(1, WAYPOINT, north=20.0), jump])
    start(desk)
    desk.fly()
    assert reached(desk) == [0, 1] * 3
    assert current(desk)[2] == mav.MISSION_STATE_COMPLETE


@pytest.mark.parametrize(("direction", "north_deg"), [(-1.0, 10.0), (1.0, 190.0), (NAN, 190.0)])
def test_a_relative_turn_in_a_mission_goes_the_way_it_says(
    direction: float, north_deg: float
) -> None:
    desk = Desk()
    desk.take_off(30.0)
    turn = mav.MAV_CMD_CONDITION_YAW
    frame = mav.MAV_FRAME_MISSION
    desk.upload(
        [
            item(0, turn, params=(100.0, 0.0, -1.0, 0.0), frame=frame),
            item(1, turn, params=(90.0, 0.0, direction, 1.0), frame=frame),
        ]
    )
    start(desk)
    desk.fly()
    assert desk.mass.yaw_rad == pytest.approx(math.remainder(math.radians(north_deg), math.tau))


MODE, PAUSE = mav.MAV_CMD_DO_SET_MODE, mav.MAV_CMD_DO_PAUSE_CONTINUE


@pytest.mark.parametrize(
    "orders", [[(PAUSE, 0), (PAUSE, 1)], [(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 10.0)]]
)
def test_jumps_are_neither_lost_nor_taken_again_after(orders: list[tuple[float, ...]]) -> None:
    desk = Desk()
    desk.take_off(30.0)
    jump = mav.MAVLink_mission_item_int_message(
        1, 1, 2, mav.MAV_FRAME_MISSION, mav.MAV_CMD_DO_JUMP, 0, 1, 0.0, 2.0, 0, 0, 0, 0, 0.0, 0
    )
    ends = item(0, WAYPOINT), item(1, WAYPOINT, north=40.0)
    desk.upload([*ends, jump, item(3, WAYPOINT, north=80.0)])
    start(desk)
    began_ns = desk.vehicle.t_ns
    for at_s, ahead in ((5.0, 0), (10.0, 1), (14.0, 0), (21.0, 3)):  # each way takes 4 s
        desk.fly(seconds=at_s - (desk.vehicle.t_ns - began_ns) * 1e-9)
        assert current(desk)[0] == ahead
        for number, *params in orders:
            assert desk.command(int(number), *params) == mav.MAV_RESULT_ACCEPTED
    desk.fly()
    assert reached(desk) == [0, 1] * 3 + [3]
    assert current(desk)[2] == mav.MISSION_STATE_COMPLETE


def test_missions_that_cannot_be_are_refused_whole() -> None:
    desk = Desk()
    good = [item(0, WAYPOINT, north=20.0)]
    desk.upload(good)
    jump = mav.MAVLink_mission_item_int_message(
        1, 1, 1, mav.MAV_FRAME_MISSION, mav.MAV_CMD_DO_JUMP, 0, 1, 7.0, 2.0, 0, 0, 0, 0, 0.0, 0
    )
    assert desk.upload([*good, jump]) == mav.MAV_MISSION_INVALID
    assert "Mission refused: item 1 jumps to item 7" in "".join(desk.texts())
    assert desk.upload([item(0, WAYPOINT, north=30_000.0)]) == mav.MAV_MISSION_INVALID
    endless = mav.MAVLink_mission_item_int_message(
        1, 1, 1, mav.MAV_FRAME_MISSION, mav.MAV_CMD_DO_JUMP, 0, 1, 0.0, 1e6, 0, 0, 0, 0, 0.0, 0
    )
    assert desk.upload([*good, endless]) == mav.MAV_MISSION_INVALID
    assert current(desk)[:2] == (0, 1)


@pytest.mark.parametrize("number", [0.0, NAN, math.inf, -math.inf, 1e30])
def test_items_without_a_place_come_back_or_are_refused(number: float) -> None:
    """Parameters five and six are floats in MISSION_ITEM, but not in MISSION_ITEM_INT."""
    desk = Desk()
    speed = mav.MAVLink_mission_item_message(
        1, 1, 0, mav.MAV_FRAME_MISSION, mav.MAV_CMD_DO_CHANGE_SPEED, 0, 1,
        1.0, 5.0, -1.0, 0.0, number, number, 0.0, 0,
    )  # fmt: skip
    if abs(number) > 0.0:
        assert desk.upload([speed]) == mav.MAV_MISSION_INVALID_PARAM5_X
        return
    assert desk.upload([speed]) == ACCEPTED
    heard = desk.send(mav.MAVLink_mission_request_int_message(1, 1, 0, 0))
    back = the(heard, "MISSION_ITEM_INT")
    assert (back.command, back.param2) == (mav.MAV_CMD_DO_CHANGE_SPEED, 5.0)


@pytest.mark.parametrize(
    ("pause", "go_on"), [((MODE, 129, 4, 3), (MODE, 129, 4, 4)), ((PAUSE, 0), (PAUSE, 1))]
)
def test_pause_and_resume_with_the_speed_that_ruled(
    pause: tuple[int, ...], go_on: tuple[int, ...]
) -> None:
    desk = Desk()
    desk.take_off(30.0)
    desk.upload([speed_item(0, 8.0), item(1, WAYPOINT, north=80.0), item(2, WAYPOINT, north=160.0)])
    start(desk)
    desk.fly(seconds=15.0)
    assert desk.command(*pause) == mav.MAV_RESULT_ACCEPTED
    desk.fly()
    assert current(desk) == (2, 3, mav.MISSION_STATE_PAUSED, 2)
    assert desk.command(*go_on) == mav.MAV_RESULT_ACCEPTED
    assert desk.mass.paths[-1].speeds_mps == pytest.approx([8.0])
    desk.fly()
    assert reached(desk) == [0, 1, 2]


def test_set_current_is_answered_and_jumps() -> None:
    desk = Desk()
    desk.take_off(30.0)
    assert current(desk)[2] == mav.MISSION_STATE_NO_MISSION
    desk.upload([item(i, WAYPOINT, north=50.0 * i) for i in range(4)])
    heard = desk.send(mav.MAVLink_mission_set_current_message(1, 1, 2))
    assert the(heard, "MISSION_CURRENT").seq == 2
    heard = desk.send(mav.MAVLink_mission_set_current_message(1, 1, 9))
    assert the(heard, "MISSION_CURRENT").seq == 2
    assert "Set current item refused" in "".join(desk.texts())
    command = mav.MAV_CMD_DO_SET_MISSION_CURRENT
    for seq, result, now in ((3, 0, 3), (9, 2, 3), (-5, 2, 3), (-1, 0, 3), (2, 0, 2)):
        assert (desk.command(command, seq), current(desk)[0]) == (result, now), seq
    start(desk)
    desk.fly()
    assert reached(desk) == [2, 3]
    # A complete mission starts again from its beginning.
    assert start(desk) == mav.MAV_RESULT_ACCEPTED
    desk.fly()
    assert reached(desk) == [2, 3, 0, 1, 2, 3]


def test_where_a_mission_in_flight_cannot_go_on_it_is_not_sent() -> None:
    desk = Desk()
    desk.take_off(30.0)
    over = item(4, mav.MAV_CMD_DO_JUMP, params=(0, 0, 0, 0), frame=mav.MAV_FRAME_MISSION)
    north_m = (50.0, 100.0, 400.0, 50.0)
    desk.upload([*(item(i, WAYPOINT, north=north) for i, north in enumerate(north_m)), over])
    start(desk)
    desk.fly(seconds=6.0)
    desk.vehicle.autopilot.parameters.set("GF_MAX_HOR_DIST", 200.0)
    path = desk.mass.paths[-1]
    for seq, why in ((4, "holds nothing to fly"), (0, "the mission leads farther than 200 m")):
        result = desk.command(mav.MAV_CMD_DO_SET_MISSION_CURRENT, seq)
        assert result == mav.MAV_RESULT_DENIED
        assert why in "".join(desk.texts())
        assert current(desk) == (1, 5, mav.MISSION_STATE_ACTIVE, 1)
        assert desk.mass.paths[-1] is path
    assert desk.command(mav.MAV_CMD_DO_SET_MISSION_CURRENT, 3) == mav.MAV_RESULT_ACCEPTED
    assert current(desk)[0] == 3
    assert desk.mass.paths[-1] is not path


def test_a_mission_being_flown_is_not_replaced() -> None:
    desk = Desk()
    desk.take_off(30.0)
    assert start(desk) == mav.MAV_RESULT_TEMPORARILY_REJECTED
    desk.upload([item(0, WAYPOINT, north=100.0)])
    start(desk)
    desk.fly(seconds=1.0)
    assert desk.upload([item(0, WAYPOINT)]) == mav.MAV_MISSION_DENIED
    cleared = desk.send(mav.MAVLink_mission_clear_all_message(1, 1, 0))
    assert the(cleared, "MISSION_ACK").type == mav.MAV_MISSION_DENIED
    assert start(desk) == mav.MAV_RESULT_ACCEPTED  # again changes nothing
    desk.fly()
    assert reached(desk) == [0]


def test_speeds_respect_the_vertical_limits() -> None:
    desk = Desk()
    desk.take_off(30.0)
    up_and_over = item(1, WAYPOINT, north=40.0, height=60.0)
    desk.upload([speed_item(0, 20.0), up_and_over, item(2, WAYPOINT, north=40.0, height=30.0)])
    start(desk)
    # 4 m/s of climb over 30 m up and 40 m along: 4 * 50 / 30; straight down 3 m/s.
    assert desk.mass.paths[-1].speeds_mps == pytest.approx([4 * 50 / 30, 3.0], rel=1e-3)


def test_absolute_altitudes() -> None:
    desk = Desk()
    desk.take_off(30.0)
    place = item(0, WAYPOINT, north=10.0, height=HOME.alt_msl_m + 45.0, frame=mav.MAV_FRAME_GLOBAL)
    desk.upload([place])
    start(desk)
    desk.fly()
    assert desk.mass.belief.alt_rel_m == pytest.approx(45.0, abs=0.01)


def test_a_refused_item_says_which_why_and_the_limit() -> None:
    desk = Desk()
    far = [item(0, WAYPOINT, height=30.0), item(1, WAYPOINT, north=30_000.0, height=30.0)]
    assert desk.upload(far) == mav.MAV_MISSION_INVALID
    high = [item(0, WAYPOINT, height=30.0), item(1, WAYPOINT, height=15_000.0)]
    assert desk.upload(high) == mav.MAV_MISSION_INVALID_PARAM7
    assert desk.upload([item(0, mav.MAV_CMD_DO_PARACHUTE)]) == mav.MAV_MISSION_UNSUPPORTED
    terrain = item(0, WAYPOINT, frame=mav.MAV_FRAME_GLOBAL_TERRAIN_ALT)
    assert desk.upload([terrain]) == mav.MAV_MISSION_UNSUPPORTED_FRAME
    wide = item(0, mav.MAV_CMD_NAV_LOITER_TURNS, params=(1.0, 0.0, 1001.0, 0.0))
    assert desk.upload([wide]) == mav.MAV_MISSION_INVALID_PARAM3
    text = "".join(desk.texts())
    assert "Mission refused: item 1 is 30 km from home, MIS_DIST_1WP allows 20 km" in text
    assert "item 1 NAV_WAYPOINT (16): altitude 15000, -500 to 10000 m above home" in text
    assert "item 0 DO_PARACHUTE (208): is not supported" in text
    assert "frame 10 counts heights from the terrain, of which nothing is known here" in text
    assert "parameter 3 = 1001, 1 to 1000 m, -1000 to -1 m, 0, NaN are allowed" in text


def test_what_has_no_body_is_done_as_nothing_in_its_order_and_told_once() -> None:
    desk = Desk()
    desk.take_off(30.0)
    none = mav.MAV_FRAME_MISSION
    mission = [
        item(0, mav.MAV_CMD_SET_CAMERA_MODE, frame=none, params=(0.0, 2.0, NAN, NAN)),
        item(1, WAYPOINT, north=40.0),
        item(2, mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST, frame=none, params=(25.0, 0.0, 1.0, 0.0)),
        item(3, WAYPOINT, north=80.0),
        item(4, mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST, frame=none),
        item(5, mav.MAV_CMD_DO_SET_SERVO, frame=none, params=(9.0, 1500.0, 0.0, 0.0)),
        item(6, mav.MAV_CMD_DO_LAND_START, frame=none),
        item(7, mav.MAV_CMD_DO_SET_RELAY, frame=none),
    ]
    assert desk.upload(mission) == ACCEPTED
    start(desk)
    assert len(desk.mass.paths[-1].points_ned_m) == 3  # without a stop
    desk.fly()
    assert reached(desk) == list(range(8))
    assert [event.seq for event in desk.recorder.of_kind("reached")] == [1, 3]
    (told,) = [text for text in desk.recorder.of_kind("status") if "not on board" in text.text]
    assert told.text == (
        "Skipped, as not on board: 1 x SET_CAMERA_MODE (camera), 2 x DO_SET_CAM_TRIGG_DIST "
        "(camera), 1 x DO_SET_SERVO (servo), 1 x DO_LAND_START (choice of a landing), "
        "1 x DO_SET_RELAY (relay)"
    )


@pytest.mark.parametrize(
    ("turns", "radius_m", "swept_deg"),
    [(2.0, 20.0, 720.0), (0.75, -20.0, -270.0), (1.0, 0.0, 360.0)],
)
def test_turns_round_a_place_are_flown(turns: float, radius_m: float, swept_deg: float) -> None:
    desk = Desk()
    desk.take_off(30.0)
    circle = item(0, mav.MAV_CMD_NAV_LOITER_TURNS, north=100.0, params=(turns, 0.0, radius_m, 0.0))
    desk.upload([circle, item(1, WAYPOINT, north=100.0, east=100.0)])
    start(desk)
    size_m = abs(radius_m) or 10.0
    np.testing.assert_allclose(
        desk.mass.paths[-1].points_ned_m[-1], [100.0 - size_m, 0.0, -30.0], atol=0.02
    )
    phases, speeds = [], []
    while not reached(desk):
        desk.vehicle.step()
        if (target := desk.mass.target) is not None and target.pos is not None:
            north, east, down = target.pos
            assert np.hypot(north - 100.0, east) == pytest.approx(size_m, abs=0.02)
            assert down == pytest.approx(-30.0, abs=0.02)
            phases.append(math.atan2(east, north - 100.0))
            speeds.append(np.hypot(*target.vel[:2]))
    # Slower than the cruise speed where it would press too hard inwards.
    assert speeds == pytest.approx([min(10.0, math.sqrt(2.0 * size_m))] * len(speeds))
    swept = math.degrees(np.unwrap(phases)[-1] - np.unwrap(phases)[0])
    assert swept == pytest.approx(swept_deg, abs=2.0)
    desk.fly()
    assert reached(desk) == [0, 1]


def test_turns_round_a_place_keep_within_the_fence() -> None:
    desk = Desk()
    desk.take_off(30.0)
    desk.vehicle.autopilot.parameters.set("GF_MAX_HOR_DIST", 110.0)
    desk.upload([item(0, mav.MAV_CMD_NAV_LOITER_TURNS, north=100.0, params=(1.0, 0.0, 20.0, 0.0))])
    assert start(desk) == mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert "the mission leads" in "".join(desk.texts())


def test_the_fence_is_asked_about_a_circle_once_however_often_it_is_flown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    desk, asked = Desk(), []
    desk.take_off(30.0)
    guard = desk.vehicle.autopilot.flight.guard
    monkeypatch.setattr(guard, "forbidden", lambda places: asked.append(len(places)))
    turns = item(0, mav.MAV_CMD_NAV_LOITER_TURNS, north=20.0, params=(1000.0, 0.0, 20.0, 0.0))
    again = item(1, mav.MAV_CMD_DO_JUMP, params=(0, 2000, 0, 0), frame=mav.MAV_FRAME_MISSION)
    assert desk.upload([turns, again]) == ACCEPTED
    assert start(desk) == mav.MAV_RESULT_ACCEPTED
    assert asked[0] < 2001 * 80


def test_after_many_turns_and_a_quarter_the_mission_goes_on_where_they_end() -> None:
    desk = Desk()
    desk.take_off(30.0)
    turns = item(0, mav.MAV_CMD_NAV_LOITER_TURNS, north=20.0, params=(999.25, 0.0, 20.0, 0.0))
    assert desk.upload([turns, item(1, WAYPOINT, north=80.0)]) == ACCEPTED
    flight = desk.vehicle.autopilot.flight
    onwards = flight._stages(flight.mission)[-1]
    assert isinstance(onwards, route.Fly)  # from the south clockwise by a quarter: in the west
    np.testing.assert_allclose(onwards.path.points_ned_m[0], [20.0, -20.0, -30.0], atol=0.05)


def test_the_nose_turns_to_what_is_looked_at_from_its_item_on() -> None:
    desk = Desk()
    desk.take_off(30.0)
    look = item(1, mav.MAV_CMD_DO_SET_ROI_LOCATION, north=50.0, east=70.0, height=0.0)
    mission = [
        item(0, WAYPOINT, north=40.0), look, item(2, WAYPOINT, north=80.0),
        item(3, mav.MAV_CMD_DO_SET_ROI_NONE, frame=mav.MAV_FRAME_MISSION),
        item(4, WAYPOINT, north=120.0),
    ]  # fmt: skip
    desk.upload(mission)
    start(desk)
    looked: dict[int, Any] = {}
    while len(done := reached(desk)) < len(mission):
        looked[len(done)] = desk.mass.interest_ned_m
        desk.vehicle.step()
    assert looked[0] is None
    np.testing.assert_allclose(looked[2], [50.0, 70.0, 0.0], atol=0.02)
    assert looked[4] is None


@pytest.mark.parametrize(
    ("radius_m", "speed_mps", "flown_mps"),
    [(20.0, 3.0, 3.0), (-20.0, 3.0, -3.0), (20.0, -3.0, -3.0), (-20.0, -3.0, 3.0),
     (20.0, 0.0, 0.0), (NAN, NAN, 2.0)],
)  # fmt: skip
def test_a_circle_is_flown_the_way_that_radius_and_speed_say(
    radius_m: float, speed_mps: float, flown_mps: float
) -> None:
    desk = Desk()
    desk.take_off(30.0)
    orbit = mav.MAV_CMD_DO_ORBIT, radius_m, speed_mps, 0, NAN, NAN, NAN, NAN
    assert desk.command(*orbit) == ACCEPTED
    found = desk.vehicle.autopilot._orbits.current
    assert found is not None
    assert found.speed_mps == flown_mps
    assert math.copysign(1.0, found.speed_mps) == math.copysign(1.0, flown_mps)


def test_a_speed_that_cannot_be_held_is_said_each_time_anew() -> None:
    desk = Desk()
    desk.take_off(30.0)
    words = "Ordered speed cannot be held"
    for limited, times in ((False, 0), (True, 1), (True, 1), (False, 1), (True, 2)):
        desk.mass.progress.speed_limited = limited
        desk.fly(seconds=1.0)
        assert desk.recorder.texts("status").count(words) == times
