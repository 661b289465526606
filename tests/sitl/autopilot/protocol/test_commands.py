"""Commands as a ground station sends them: what is answered and what happens."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, of, the
from sitl_mavsdk import HOME

from sitl.autopilot.flying.flight_commands import mode_of_custom
from sitl.autopilot.flying.modes import AFTER, PILOTED, Mode, Trigger, possible

NAN = math.nan
OK, REJECTED, DENIED, UNSUPPORTED = (
    mav.MAV_RESULT_ACCEPTED,
    mav.MAV_RESULT_TEMPORARILY_REJECTED,
    mav.MAV_RESULT_DENIED,
    mav.MAV_RESULT_UNSUPPORTED,
)
ARM = mav.MAV_CMD_COMPONENT_ARM_DISARM
SET_MODE = mav.MAV_CMD_DO_SET_MODE
RELATIVE = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


def position(desk: Desk) -> np.ndarray:
    return desk.mass.belief.pos_ned_m


def degrees_e7(desk: Desk, north: float, east: float) -> tuple[int, int]:
    place = desk.mass.frame.to_geodetic(np.array([north, east, 0.0]))
    return round(place.lat_deg * 1e7), round(place.lon_deg * 1e7)


def test_everything_unknown_is_answered_unsupported() -> None:
    desk = Desk()
    known = desk.vehicle.autopilot.commands.known
    for number in (*range(1, 700), 2000, 2500, 3000, 31000, 42000, 65000):
        if number not in known:
            assert desk.command(number) == UNSUPPORTED, number


def test_arming_and_disarming() -> None:
    desk = Desk()
    assert desk.command(ARM, 2, 0) == DENIED
    assert desk.command(ARM, 1, 0) == OK
    assert of(desk.heard, "COMMAND_ACK")[-1].target_system == 255
    assert desk.mass.armed
    assert desk.command(ARM, 1, 0) == OK  # again changes nothing
    assert desk.vehicle.autopilot.flight.flights == 1
    assert not desk.vehicle.moving
    assert desk.command(ARM, 0, 0) == OK
    assert not desk.mass.armed


def test_not_ready_is_not_armed_and_says_why() -> None:
    desk = Desk(ready=False)
    assert desk.command(ARM, 1, 0) == REJECTED
    assert desk.texts() == ["COMPONENT_ARM_DISARM refused: aligning"]
    assert not desk.mass.armed


def test_nobody_arms_before_the_first_tick() -> None:
    """Or the flight would depend on how early a ground station calls."""
    desk = Desk(ready=False, ready_after_s=0.0)
    assert desk.mass.ready
    assert desk.command(ARM, 1, 0) == REJECTED
    assert desk.texts() == ["COMPONENT_ARM_DISARM refused: starting up"]
    desk.fly()
    assert desk.command(ARM, 1, 0) == OK


def test_in_the_air_only_force_disarms() -> None:
    desk = Desk()
    desk.take_off()
    assert desk.command(ARM, 0, 0) == REJECTED
    assert desk.mass.armed
    assert desk.command(ARM, 0, 21196) == OK
    assert not desk.mass.armed
    assert desk.vehicle.autopilot.mode is Mode.TERMINATED
    desk.fly()
    assert position(desk)[2] == 0.0
    assert desk.command(ARM, 1, 0) == REJECTED
    heartbeat = of(desk.pass_wall_time(1.1), "HEARTBEAT")[-1]
    assert heartbeat.system_status == mav.MAV_STATE_FLIGHT_TERMINATION


@pytest.mark.parametrize(
    ("frame", "z", "height"),
    [
        (None, HOME.alt_msl_m + 25.0, 25.0),
        (None, NAN, 10.0),
        (RELATIVE, 25.0, 25.0),
        (0, 513.0, 25.0),
    ],
)
def test_take_off_heights(frame: int | None, z: float, height: float) -> None:
    desk = Desk()
    desk.command(ARM, 1, 0)
    if frame is None:
        result = desk.command(mav.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, z)
    else:
        result = desk.command_int(mav.MAV_CMD_NAV_TAKEOFF, frame, (0, 0, 0, NAN), 0, 0, z)
    assert result == OK
    assert desk.vehicle.autopilot.mode is Mode.TAKEOFF
    desk.fly()
    assert position(desk) == pytest.approx([0.0, 0.0, -height])
    assert desk.vehicle.autopilot.mode is Mode.HOLD


def test_a_take_off_that_is_called_off_on_the_ground_stays_there() -> None:
    desk = Desk()
    desk.command(ARM, 1, 0)
    assert desk.command(mav.MAV_CMD_NAV_TAKEOFF) == OK
    assert desk.command(SET_MODE, 129, 4, 3) == OK
    assert not desk.vehicle.moving
    desk.fly(seconds=5.0)
    assert desk.mass.on_ground


def test_take_off_needs_arms_and_ground() -> None:
    desk = Desk()
    desk.command(ARM, 1, 0)
    below = desk.command(mav.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, HOME.alt_msl_m)
    assert below == REJECTED
    assert (
        "NAV_TAKEOFF refused: take-off altitude 488.0 m is not above the aircraft: both count from "
        "mean sea level, where it is at 488.0 m; give more than 488.5 m"
    ) in "".join(desk.texts())
    desk.take_off()
    assert desk.command(mav.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, 600.0) == REJECTED
    assert "NAV_TAKEOFF refused: already in the air" in desk.texts()


def test_a_retransmitted_command_is_answered_and_not_repeated() -> None:
    desk = Desk()
    desk.take_off()
    for confirmation in (0, 1, 2):
        assert desk.command(mav.MAV_CMD_DO_SET_HOME, 1, confirmation=confirmation) == OK
        if confirmation == 0:
            home = desk.vehicle.autopilot.flight.guard.home
            desk.vehicle.autopilot.flight.go_to(np.array([50.0, 0.0, -30.0]))
            desk.fly()
    assert desk.vehicle.autopilot.flight.guard.home == home
    # Another command of the same number whose first transmission was lost is no repetition.
    before = len(of(desk.heard, "HOME_POSITION"))
    assert desk.command(mav.MAV_CMD_REQUEST_MESSAGE, 148) == OK
    assert desk.command(mav.MAV_CMD_REQUEST_MESSAGE, 242, confirmation=1) == OK
    assert len(of(desk.heard, "HOME_POSITION")) == before + 1
    assert desk.command(mav.MAV_CMD_DO_SET_HOME, 1, confirmation=0) == OK
    assert desk.vehicle.autopilot.flight.guard.home != home


def test_a_retransmission_is_known_whoever_spoke_in_between() -> None:
    desk = Desk()
    desk.take_off()
    turn = (mav.MAV_CMD_CONDITION_YAW, 90, 20, 1, 1)
    assert desk.command(*turn) == OK
    desk.fly()
    asked = mav.MAVLink_command_long_message(1, 1, mav.MAV_CMD_REQUEST_MESSAGE, 0, 148, *[0] * 6)
    for other in range(10):
        station = mav.MAVLink(None, srcSystem=100 + other, srcComponent=190)
        desk.vehicle.receive(bytes(asked.pack(station)), desk.now)
    desk.exchange()
    assert desk.command(*turn, confirmation=1) == OK
    desk.fly()
    assert desk.mass.yaw_rad == pytest.approx(math.radians(90))


@pytest.mark.parametrize(("frame", "z"), [(RELATIVE, 40.0), (0, 528.0)])
def test_reposition_with_yaw(frame: int, z: float) -> None:
    desk = Desk()
    lat, lon = degrees_e7(desk, 120.0, -80.0)
    reposition = (mav.MAV_CMD_DO_REPOSITION, frame, (-1.0, 1.0, 0.0, 1.5), lat, lon, z)
    assert desk.command_int(*reposition) == REJECTED  # on the ground
    desk.take_off()
    assert desk.command_int(*reposition) == OK
    assert desk.vehicle.moving
    desk.fly(seconds=2.0)
    paths = len(desk.mass.paths)
    assert desk.command_int(*reposition) == OK  # under way already
    assert len(desk.mass.paths) == paths
    desk.fly()
    expected = desk.mass.frame.to_ned(lat * 1e-7, lon * 1e-7, 528.0)
    assert position(desk) == pytest.approx(expected, abs=0.02)
    assert desk.mass.yaw_rad == pytest.approx(1.5)


def test_a_landing_at_a_place_leads_straight_there() -> None:
    desk = Desk()
    lat, lon = degrees_e7(desk, 120.0, -80.0)
    desk.take_off()
    landing = (mav.MAV_CMD_NAV_LAND, RELATIVE, (0.0, 0.0, 0.0, NAN), lat, lon, 0.0)
    assert desk.command_int(*landing) == OK
    way = []
    while desk.vehicle.moving:
        desk.vehicle.step()
        way.append(position(desk))
    goal = desk.mass.frame.to_ned(lat * 1e-7, lon * 1e-7, HOME.alt_msl_m)
    assert way[-1] == pytest.approx(goal, abs=0.02)
    north, east, _ = np.array(way).T
    aside = (north * goal[1] - east * goal[0]) / np.hypot(*goal[:2])
    assert np.abs(aside).max() < 0.02


def test_reposition_of_nonsense_is_denied() -> None:
    desk = Desk()
    desk.take_off()
    far = desk.command_int(mav.MAV_CMD_DO_REPOSITION, 0, (-1, 1, 0, NAN), 990000000, 0, 500.0)
    assert far == DENIED
    local = desk.command_int(mav.MAV_CMD_DO_REPOSITION, 1, (-1, 1, 0, NAN), 10, 10, 500.0)
    assert local == DENIED
    assert not desk.vehicle.moving


def test_change_speed_rules_at_once_and_later() -> None:
    desk = Desk()
    assert desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 7.5, -1) == REJECTED
    assert "on the ground it would end with the mode HOLD" in "".join(desk.texts())
    desk.take_off()
    lat, lon = degrees_e7(desk, 100.0, 0.0)
    assert desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 4.0, -1) == OK
    desk.command_int(mav.MAV_CMD_DO_REPOSITION, RELATIVE, (NAN, 1, 0, NAN), lat, lon, 30.0)
    assert desk.mass.paths[-1].speeds_mps == pytest.approx([4.0])  # NaN keeps it
    desk.command_int(mav.MAV_CMD_DO_REPOSITION, RELATIVE, (-1, 1, 0, NAN), lat, lon, 30.0)
    assert desk.mass.paths[-1].speeds_mps == pytest.approx([10.0])
    desk.command_int(mav.MAV_CMD_DO_REPOSITION, RELATIVE, (2, 1, 0, NAN), lat, lon, 30.0)
    assert desk.mass.paths[-1].speeds_mps == pytest.approx([2.0])
    desk.command_int(mav.MAV_CMD_DO_REPOSITION, RELATIVE, (-1, 1, 0, NAN), lat, lon, 30.0)
    assert desk.mass.paths[-1].speeds_mps == pytest.approx([10.0])  # -1 is the default
    assert desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 12.0, -1) == OK
    assert desk.mass.paths[-1].speeds_mps == pytest.approx([12.0])
    assert desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, -2.0, -1) == OK
    assert desk.mass.paths[-1].speeds_mps == pytest.approx([10.0])  # MPC_XY_CRUISE
    assert desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 0.0, -1) == DENIED
    assert desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 2, 3.0, -1) == DENIED
    desk.fly()
    assert position(desk) == pytest.approx([100.0, 0.0, -30.0], abs=0.02)


def test_change_of_speed_keeps_the_heading_ordered() -> None:
    desk = Desk()
    desk.take_off()
    lat, lon = degrees_e7(desk, 60.0, 0.0)
    desk.command_int(mav.MAV_CMD_DO_REPOSITION, RELATIVE, (6.0, 1, 0, 1.0), lat, lon, 30.0)
    assert desk.mass.paths[-1].speeds_mps == pytest.approx([6.0])
    desk.fly()
    assert desk.mass.yaw_rad == pytest.approx(1.0)


def test_turn_to_and_by() -> None:
    desk = Desk()
    desk.take_off()
    turn = mav.MAV_CMD_CONDITION_YAW
    assert desk.command(turn, 90, 20, 0, 0) == OK
    desk.fly()
    assert desk.mass.yaw_rad == pytest.approx(math.radians(90))
    assert desk.command(turn, 30, 20, -1, 1) == OK
    desk.fly()
    assert desk.mass.yaw_rad == pytest.approx(math.radians(60))
    assert desk.command(turn, NAN) == DENIED


def test_home_is_not_moved_to_where_nobody_knows_that_it_is() -> None:
    desk = Desk(ready=False, ready_after_s=5.0)
    here = mav.MAV_CMD_DO_SET_HOME, 1, 0, 0, 0, 0, 0, 0
    assert desk.command(*here) == REJECTED
    assert "no position estimate" in "".join(desk.texts())
    desk.fly(seconds=6.0)
    assert desk.command(*here) == OK


def test_return_and_land_at_a_home_that_was_moved() -> None:
    desk = Desk()
    desk.take_off()
    lat, lon = degrees_e7(desk, 60.0, 40.0)
    at = desk.mass.frame.to_geodetic(np.array([60.0, 40.0, 0.0]))
    home = desk.command_int(mav.MAV_CMD_DO_SET_HOME, 0, (0, 0, 0, 0), lat, lon, at.alt_msl_m)
    assert home == OK
    heard = desk.exchange()
    assert desk.command(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH) == OK
    desk.fly()
    assert position(desk) == pytest.approx([60.0, 40.0, 0.0], abs=0.1)
    assert not desk.mass.armed
    modes = [text.split()[0] for text in desk.recorder.texts("mode")]
    assert modes == ["TAKEOFF", "HOLD", "RETURN", "LAND", "HOLD"]
    assert not of(heard, "COMMAND_ACK")


@pytest.mark.parametrize(
    ("north", "height", "highest"), [(80.0, 12.0, 30.0), (80.0, 45.0, 45.0), (8.0, 12.0, 12.0)]
)
def test_the_way_home_is_flown_at_a_safe_height(
    north: float, height: float, highest: float
) -> None:
    desk = Desk()
    desk.take_off(height)
    desk.vehicle.autopilot.flight.go_to(np.array([north, 0.0, -height]))
    desk.fly()
    before = len(desk.recorder.samples)
    assert desk.command(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH) == OK
    desk.fly()
    way = [sample.belief for sample in desk.recorder.samples[before:]]
    assert max(at.alt_rel_m for at in way) == pytest.approx(highest, abs=0.1)
    # Nowhere between start and home is it lower than that.
    between = [at.alt_rel_m for at in way if 1.0 < at.pos_ned_m[0] < north - 1.0]
    assert between
    assert min(between) == pytest.approx(highest, abs=0.1)


def test_land_here() -> None:
    desk = Desk()
    assert desk.command(mav.MAV_CMD_NAV_LAND) == REJECTED
    desk.take_off()
    assert desk.command(mav.MAV_CMD_NAV_LAND) == OK
    assert desk.command(mav.MAV_CMD_NAV_LAND) == OK
    desk.fly()
    assert desk.mass.on_ground
    assert not desk.mass.armed


@pytest.mark.parametrize(
    ("main", "sub", "mode"),
    [(4, 3, Mode.HOLD), (4, 5, Mode.RETURN), (4, 6, Mode.LAND)],
)
def test_px4_modes(main: int, sub: int, mode: Mode) -> None:
    desk = Desk()
    desk.take_off()
    assert desk.command(SET_MODE, 129, main, sub) == OK
    assert desk.vehicle.autopilot.mode is mode
    heartbeat = of(desk.pass_wall_time(1.1), "HEARTBEAT")[-1]
    assert heartbeat.custom_mode == main << 16 | sub << 24
    assert heartbeat.base_mode == 157


def test_modes_that_do_not_exist_or_cannot_be() -> None:
    desk = Desk()
    assert desk.command(SET_MODE, 1, 5, 0) == UNSUPPORTED  # acro
    assert desk.command(SET_MODE, 0, 4, 4) == UNSUPPORTED  # no custom mode
    assert desk.command(SET_MODE, 1, NAN, NAN) == UNSUPPORTED
    assert desk.command(SET_MODE, 1, 4.5, 4) == UNSUPPORTED
    desk.send(mav.MAVLink_set_mode_message(1, 0, Mode.RETURN.custom_mode))
    assert "Set mode refused: only custom modes" in desk.texts()
    assert desk.vehicle.autopilot.mode is Mode.HOLD
    desk.command(ARM, 1)
    assert desk.command(SET_MODE, 1, 6, 0) == REJECTED  # offboard, and nobody streams setpoints
    assert desk.command(SET_MODE, 1, 4, 4) == REJECTED
    assert "DO_SET_MODE refused: no mission uploaded" in desk.texts()
    desk.send(mav.MAVLink_set_mode_message(1, 1, Mode.RETURN.custom_mode))
    assert "Set mode refused: on the ground" in desk.texts()


@pytest.mark.parametrize(("off_m", "begins_m"), [(0.5, 0.5), (3.0, 0.0)])
def test_a_path_begins_at_the_point_that_is_held(off_m: float, begins_m: float) -> None:
    """The estimate wavers about that point; far off, something else is wrong."""
    desk = Desk()
    desk.take_off(30.0)
    desk.mass.cmd_pos_ned_m = np.array([off_m, 0.0, -30.0])
    assert desk.vehicle.autopilot.flight.go_to(np.array([70.0, 0.0, -30.0])) is None
    assert desk.mass.paths[-1].points_ned_m[0] == pytest.approx([begins_m, 0.0, -30.0], abs=1e-6)


def test_messages_on_request_and_at_intervals() -> None:
    desk = Desk()
    for number in (148, 242, 264, 115, 141, 42):
        before = len(desk.heard)
        assert desk.command(mav.MAV_CMD_REQUEST_MESSAGE, number) == OK
        assert [message.get_msgId() for message in desk.heard[before:]] == [number, 77]
    for older, number in (
        (mav.MAV_CMD_GET_HOME_POSITION, 242),
        (mav.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 148),
    ):
        before = len(desk.heard)
        assert desk.command(older) == OK
        assert [message.get_msgId() for message in desk.heard[before:]] == [number, 77]
    assert desk.command(mav.MAV_CMD_REQUEST_MESSAGE, 9999) == UNSUPPORTED
    assert desk.command(mav.MAV_CMD_REQUEST_MESSAGE, NAN) == UNSUPPORTED
    # Ground truth is not streamed unless somebody asks.
    assert not of(desk.pass_wall_time(3.0), "HIL_STATE_QUATERNION")
    assert desk.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, 115, 200_000) == OK
    assert len(of(desk.pass_wall_time(2.0, step=0.01), "HIL_STATE_QUATERNION")) in (10, 11)
    assert desk.command(mav.MAV_CMD_GET_MESSAGE_INTERVAL, 115) == OK
    assert of(desk.heard, "MESSAGE_INTERVAL")[-1].interval_us == 200_000
    assert desk.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, 115, -1) == OK
    assert desk.command(mav.MAV_CMD_GET_MESSAGE_INTERVAL, 115) == OK
    assert of(desk.heard, "MESSAGE_INTERVAL")[-1].interval_us == -1
    assert not of(desk.pass_wall_time(1.0), "HIL_STATE_QUATERNION")
    assert desk.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 500_000) == OK
    assert desk.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 0) == OK  # the default again
    assert desk.command(mav.MAV_CMD_GET_MESSAGE_INTERVAL, 30) == OK
    assert of(desk.heard, "MESSAGE_INTERVAL")[-1].interval_us == 100_000
    # The same as a message on request; one that is never streamed is "not available".
    for number, interval_us in ((30, 100_000), (115, -1), (253, 0), (9999, 0)):
        assert desk.command(mav.MAV_CMD_REQUEST_MESSAGE, 244, number) == OK
        said = of(desk.heard, "MESSAGE_INTERVAL")[-1]
        assert (said.message_id, said.interval_us) == (number, interval_us)
    for none in (NAN, math.inf, -1.0, 30.5, 65536.0):  # nothing that the message could hold
        assert desk.command(mav.MAV_CMD_REQUEST_MESSAGE, 244, none) == mav.MAV_RESULT_DENIED
    # The sign of life cannot be turned off.
    assert desk.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, 0, -1) == DENIED
    assert len(of(desk.pass_wall_time(5.0), "HEARTBEAT")) in (4, 5, 6)


@pytest.mark.parametrize("number", [math.inf, -math.inf, NAN, 3e38, -3e38])
def test_a_parameter_that_no_integer_holds_is_answered_like_any_other(number: float) -> None:
    desk = Desk()
    known = sorted(desk.vehicle.autopilot.commands.known)
    for command in known:
        for others in (0.0, 1.0, float(mav.MAVLINK_MSG_ID_ATTITUDE)):
            for index in range(7):
                params = [others] * 7
                params[index] = number
                desk.command(command, *params)
    desk.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_ATTITUDE, number)
    desk.command(mav.MAV_CMD_GET_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_ATTITUDE)
    assert of(desk.pass_wall_time(2.0), "HEARTBEAT")


def test_heartbeats_and_telemetry_go_on_while_simulated_time_stands_still() -> None:
    desk = Desk()
    at = desk.vehicle.t_ns
    heard = desk.pass_wall_time(60.0)
    assert 58 <= len(of(heard, "HEARTBEAT")) <= 61
    assert len(of(heard, "GLOBAL_POSITION_INT")) >= 300
    assert {message.time_boot_ms for message in of(heard, "ATTITUDE")} == {at // 1_000_000}


def test_pings_and_clock_comparisons_are_answered() -> None:
    desk = Desk()
    pong = the(desk.send(mav.MAVLink_ping_message(123, 7, 0, 0)), "PING")
    assert (pong.time_usec, pong.seq, pong.target_system) == (123, 7, 255)
    assert not of(desk.send(mav.MAVLink_ping_message(123, 7, 255, 190)), "PING")
    reply = the(desk.send(mav.MAVLink_timesync_message(0, 42)), "TIMESYNC")
    assert (reply.tc1, reply.ts1) == (desk.vehicle.t_ns, 42)  # the clock of telemetry's stamps


def test_what_arrives_in_flight_does_not_change_the_flight() -> None:
    def fly(*, talk: bool) -> bytes:
        desk = Desk()
        desk.take_off()
        desk.vehicle.autopilot.flight.go_to(np.array([70.0, 30.0, -30.0]))
        while desk.vehicle.moving:
            desk.vehicle.step()
            if talk:
                desk.now += 0.003
                desk.send(
                    mav.MAVLink_ping_message(1, 1, 0, 0),
                    mav.MAVLink_param_request_list_message(1, 1),
                    mav.MAVLink_mission_request_list_message(1, 1, 0),
                    mav.MAVLink_mission_count_message(1, 1, 3, 0),
                    mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
                )
                desk.command(mav.MAV_CMD_REQUEST_MESSAGE, 148)
                desk.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 10_000)
        return desk.recorder.track()

    assert fly(talk=True) == fly(talk=False)


def test_every_mode_but_terminated_can_be_left_and_every_number_is_its_own() -> None:
    assert {mode_of_custom(mode.custom_mode) for mode in Mode} == set(Mode)
    assert mode_of_custom(0) is None
    assert set(AFTER) == set(Mode) - {Mode.MISSION}  # whose last item says it
    for mode in Mode:
        orders = {trigger for trigger in Trigger if possible(mode, trigger)}
        if mode is Mode.TERMINATED:
            assert not orders
        else:
            assert orders | {Trigger.ORDER_TAKEOFF} == set(Trigger)
    starts = {mode for mode in Mode if possible(mode, Trigger.ORDER_TAKEOFF)}
    assert starts == PILOTED | {Mode.HOLD, Mode.TAKEOFF}
