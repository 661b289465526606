"""Flying by sticks, round a place, after somebody, with an eye on something."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item, speed_item
from sitl_mavsdk import HOME, make_vehicle

from flightdyn.aircraft import Aircraft
from flightdyn.frames import LocalFrame, wrap_pi, yaw_of
from sitl.autopilot.flying.modes import Mode
from sitl.config import VehicleConfig

OK, REJECTED, DENIED = (
    mav.MAV_RESULT_ACCEPTED,
    mav.MAV_RESULT_TEMPORARILY_REJECTED,
    mav.MAV_RESULT_DENIED,
)
NAN = math.nan
ALTITUDE, POSITION, STABILIZED = (2, 0), (3, 0), (7, 0)


class Flight:
    """The real aircraft without sensor noise, hovering at 20 m, and somebody who flies it."""

    def __init__(self, *, height_m: float | None = 20.0) -> None:
        vehicle = make_vehicle(
            config=VehicleConfig.model_validate({"aircraft": {"sensors": {"kind": "perfect"}}})
        )
        self.aircraft: Aircraft = vehicle.aircraft
        self.desk = Desk(aircraft=self.aircraft)
        if height_m is None:
            assert self.desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0) == OK
        else:
            self.desk.take_off(height_m)

    def go_on(self, seconds: float, *messages: Any) -> None:
        """Let time pass, saying these at 10 Hz."""
        for _ in range(round(seconds * 10)):
            self.desk.send(*messages)
            self.desk.pass_wall_time(0.1)
            self.desk.fly(seconds=0.1)

    def sticks(self, mode: tuple[int, int], message: Any, seconds: float) -> None:
        """Fly in a mode by sticks that are held."""
        self.desk.send(message)
        assert self.desk.command(mav.MAV_CMD_DO_SET_MODE, 129, *mode) == OK
        self.go_on(seconds, message)

    @property
    def mode(self) -> Mode:
        return self.desk.vehicle.autopilot.mode

    @property
    def velocity(self) -> Any:
        return np.array(self.aircraft.truth.vel_ned_mps)

    @property
    def position(self) -> Any:
        return np.array(self.aircraft.truth.pos_ned_m)

    @property
    def yaw(self) -> float:
        return yaw_of(self.aircraft.truth.q_frd_to_ned)


def held(*, pitch: int = 0, roll: int = 0, throttle: int = 500, yaw: int = 0) -> Any:
    return mav.MAVLink_manual_control_message(1, pitch, roll, throttle, yaw, 0)


def place(north: float, east: float) -> tuple[float, float]:
    point = LocalFrame(HOME).to_geodetic(np.array([north, east, 0.0]))
    return point.lat_deg, point.lon_deg


@pytest.mark.parametrize("mode", [(1, 0), ALTITUDE, POSITION, STABILIZED])
def test_nobody_flies_by_sticks_that_nobody_moves(mode: tuple[int, int]) -> None:
    desk = Desk()
    desk.take_off()
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 129, *mode) == REJECTED
    assert "DO_SET_MODE refused: no manual control input" in desk.texts()
    desk.send(held())
    desk.now += 0.6  # COM_RC_LOSS_T is 0.5 s
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 129, *mode) == REJECTED
    desk.send(held())
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 129, *mode) == OK


def test_position_control() -> None:
    flight = Flight()
    flight.sticks(POSITION, held(yaw=1000), 2.0)
    assert flight.yaw == pytest.approx(2 * math.radians(60.0), abs=0.35)
    flight.go_on(2.0, held())
    yaw, before = flight.yaw, flight.position
    flight.go_on(6.0, held(pitch=550, throttle=1000))
    # Half of the way beyond the deadzone is half of the 10 m/s, straight ahead.
    ahead = np.array([5.0 * math.cos(yaw), 5.0 * math.sin(yaw), -4.0])
    np.testing.assert_allclose(flight.velocity, ahead, atol=0.3)
    assert flight.position[2] < before[2] - 15.0
    flight.go_on(4.0, held())
    rest = flight.position
    flight.go_on(4.0, held())
    np.testing.assert_allclose(flight.position, rest, atol=0.2)
    flight.go_on(3.0, held(roll=-1000))
    right = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    assert flight.velocity @ right == pytest.approx(-10.0, abs=0.7)


def test_altitude_control_leans_and_keeps_the_height() -> None:
    flight = Flight()
    flight.sticks(ALTITUDE, held(pitch=300), 3.0)
    q = flight.aircraft.truth.q_frd_to_ned
    pitch = math.degrees(math.asin(2 * (q[0] * q[2] - q[3] * q[1])))
    assert pitch == pytest.approx(-0.3 * 35.0, abs=1.0)
    assert flight.velocity[0] > 3.0
    assert flight.position[2] == pytest.approx(-20.0, abs=0.5)
    flight.go_on(3.0, held(throttle=275))
    assert flight.velocity[2] == pytest.approx(1.5, abs=0.3)


def test_stabilized_flight_from_the_ground_and_back() -> None:
    flight = Flight(height_m=None)
    flight.sticks(STABILIZED, held(throttle=0), 2.0)
    assert flight.position[2] == pytest.approx(0.0, abs=0.05)
    flight.go_on(1.5, held(throttle=620))
    assert flight.velocity[2] < -2.0
    flight.go_on(3.0, held(throttle=500))
    assert flight.position[2] < -5.0
    assert flight.desk.command(mav.MAV_CMD_DO_SET_MODE, 129, *POSITION) == OK
    flight.go_on(40.0, held(throttle=250))
    assert not flight.aircraft.armed
    assert not flight.aircraft.crashed
    assert flight.mode is Mode.HOLD


def test_rc_channels_are_sticks_too() -> None:
    flight = Flight()

    def channels(a: int, b: int, c: int, d: int) -> Any:
        rest = (65535,) * 4
        return mav.MAVLink_rc_channels_override_message(1, 1, a, b, c, d, *rest)

    flight.sticks(POSITION, channels(1500, 2000, 1500, 1500), 4.0)
    assert flight.velocity[0] == pytest.approx(10.0, abs=0.7)
    flight.go_on(3.0, channels(65535, 1500, 65535, 65535))
    assert flight.velocity[0] == pytest.approx(0.0, abs=0.3)
    flight.go_on(1.0, channels(0, 0, 0, 0))  # let go of: no sticks any more
    assert flight.mode is Mode.RETURN


@pytest.mark.slow
@pytest.mark.parametrize("clockwise", [True, False])
def test_an_orbit_is_a_circle(clockwise: bool) -> None:
    flight = Flight()
    lat, lon = place(30.0, 0.0)
    radius = 15.0 if clockwise else -15.0
    assert flight.desk.command(34, radius, 4.0, 0, NAN, lat, lon, HOME.alt_msl_m + 25.0) == OK
    assert flight.mode is Mode.ORBIT
    flight.go_on(20.0)
    turned = 0.0
    for _ in range(200):
        before = flight.position - [30.0, 0.0, -25.0]
        flight.go_on(0.1)
        after = flight.position - [30.0, 0.0, -25.0]
        assert math.hypot(after[0], after[1]) == pytest.approx(15.0, abs=0.5)
        assert after[2] == pytest.approx(0.0, abs=0.4)
        assert math.hypot(*flight.velocity[:2]) == pytest.approx(4.0, abs=0.5)
        inwards = math.atan2(-after[1], -after[0])
        assert abs(wrap_pi(flight.yaw - inwards)) < 0.15
        turned += wrap_pi(math.atan2(after[1], after[0]) - math.atan2(before[1], before[0]))
    assert turned == pytest.approx(math.copysign(20.0 * 4.0 / 15.0, radius), rel=0.05)


@pytest.mark.parametrize(
    ("params", "words"),
    [
        (
            (0.5, 2, 0, NAN, NAN, NAN, NAN),
            "1 = 0.5, 1 to 1000 m, -1000 to -1 m, NaN are allowed",
        ),
        ((math.inf, 2, 0, NAN, NAN, NAN, NAN), "parameter 1 = inf"),
        ((10, 50, 0, NAN, NAN, NAN, NAN), "parameter 2 = 50, -10 to 10 m/s"),
        ((10, 2, 9, NAN, NAN, NAN, NAN), "parameter 3 = 9, 0, 1, 2, 3, 5, NaN are allowed"),
        ((10, 2, 0, NAN, 91, 8, NAN), "latitude 91, -90 to 90 deg"),
        (
            (10, 2, 0, NAN, NAN, NAN, math.inf),
            "altitude inf, -1000 to 20000 m above",
        ),
        ((10, 2, 0, NAN, 48.4, 8.5, NAN), "111 km from home, MIS_DIST_1WP allows 20 km"),
    ],
)
def test_an_orbit_that_cannot_be_is_denied(params: tuple[float, ...], words: str) -> None:
    desk = Desk()
    desk.take_off()
    assert desk.command(34, *params) == DENIED
    assert words in "".join(desk.texts())
    assert desk.vehicle.autopilot.mode is Mode.HOLD


def test_an_orbit_keeps_within_the_fence() -> None:
    desk = Desk()
    desk.take_off()
    desk.vehicle.autopilot.parameters.set("GF_MAX_HOR_DIST", 50.0)
    lat, lon = place(40.0, 0.0)
    assert desk.command(34, 8, 2, 0, NAN, lat, lon, NAN) == OK
    assert desk.command(34, 12, 2, 0, NAN, lat, lon, NAN) == DENIED


def follow_target(north: float, east: float, alt_msl_m: float, vel: tuple[float, ...]) -> Any:
    lat, lon = place(north, east)
    return mav.MAVLink_follow_target_message(
        0, 3, round(lat * 1e7), round(lon * 1e7), alt_msl_m, vel, (0, 0, 0), (1, 0, 0, 0),
        (0, 0, 0), (0, 0, 0), 0,
    )  # fmt: skip


@pytest.mark.slow
def test_it_follows_behind_and_waits_for_a_target_that_is_silent() -> None:
    flight = Flight()
    parameters = flight.desk.vehicle.autopilot.parameters
    parameters.set("FLW_TGT_DST", 10.0)
    parameters.set("FLW_TGT_HT", 12.0)
    assert flight.desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 4, 8) == OK
    flight.go_on(3.0)
    np.testing.assert_allclose(flight.position, [0.0, 0.0, -20.0], atol=0.3)
    for i in range(40):  # somebody walks north at 2 m/s, and tells it once a second
        flight.desk.send(follow_target(20.0 + 2.0 * i, 5.0, HOME.alt_msl_m, (2.0, 0.0, 0.0)))
        flight.go_on(1.0)
    beside = [20.0 + 2.0 * 40 - 10.0, 5.0, -12.0]
    np.testing.assert_allclose(flight.position, beside, atol=0.7)
    assert flight.yaw == pytest.approx(0.0, abs=0.1)
    flight.go_on(8.0)
    rest = flight.position
    flight.go_on(3.0)
    np.testing.assert_allclose(flight.position, rest, atol=0.2)
    assert flight.mode is Mode.FOLLOW


def test_following_keeps_off_the_ground_and_drops_impossible_targets() -> None:
    flight = Flight()
    flight.desk.vehicle.autopilot.parameters.set("FLW_TGT_ALT_M", 2)
    assert flight.desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 4, 8) == OK
    for vel in ((math.inf, 0, 0), (1e30, 0, 0)):
        flight.desk.send(follow_target(500.0, 0.0, HOME.alt_msl_m, vel))
    flight.desk.send(follow_target(500.0, 0.0, math.inf, (0, 0, 0)))
    flight.go_on(2.0)
    assert flight.position[0] == pytest.approx(0.0, abs=0.3)
    flight.go_on(12.0, follow_target(10.0, 0.0, HOME.alt_msl_m - 50.0, (0, 0, 0)))
    np.testing.assert_allclose(flight.position, [2.0, 0.0, -2.0], atol=0.4)


def test_it_looks_at_a_place_on_its_way_until_told_otherwise() -> None:
    flight = Flight()
    lat, lon = place(0.0, 50.0)
    assert flight.desk.command(mav.MAV_CMD_DO_SET_ROI_LOCATION, 0, 0, 0, 0, lat, lon, 488.0) == OK
    goal = place(50.0, 0.0)
    reposition = (mav.MAV_CMD_DO_REPOSITION, -1, 1, 0, NAN, *goal, HOME.alt_msl_m + 20.0)
    assert flight.desk.command(*reposition) == OK
    flight.go_on(20.0)
    assert flight.position[0] == pytest.approx(50.0, abs=0.3)
    assert flight.yaw == pytest.approx(math.radians(135.0), abs=0.05)
    assert flight.desk.command(mav.MAV_CMD_DO_SET_ROI_NONE) == OK
    back = (mav.MAV_CMD_DO_REPOSITION, -1, 1, 0, NAN, *place(0.0, 0.0), HOME.alt_msl_m + 20.0)
    assert flight.desk.command(*back) == OK
    flight.go_on(6.0)
    assert abs(wrap_pi(flight.yaw - math.pi)) < 0.05
    assert flight.desk.command(mav.MAV_CMD_DO_SET_ROI_LOCATION, 0, 0, 0, 0, 91, 8, 0) == DENIED
    assert flight.desk.command(mav.MAV_CMD_DO_SET_ROI, 0) == OK
    assert flight.desk.command(mav.MAV_CMD_DO_SET_ROI, 4) == DENIED


@pytest.mark.parametrize("command", ["CONDITION_YAW", "DO_REPOSITION", "NAV_LAND", "DO_ORBIT"])
def test_the_later_of_a_heading_and_a_place_to_look_at_counts(command: str) -> None:
    flight = Flight()
    look = (mav.MAV_CMD_DO_SET_ROI_LOCATION, 0, 0, 0, 0, *place(0.0, 50.0), HOME.alt_msl_m)
    assert flight.desk.command(*look) == OK
    flight.go_on(4.0)
    assert flight.yaw == pytest.approx(math.radians(90.0), abs=0.05)
    orders: dict[str, tuple[Any, ...]] = {
        "CONDITION_YAW": (mav.MAV_CMD_CONDITION_YAW, 180, 0, 0, 0),
        "DO_REPOSITION": (mav.MAV_CMD_DO_REPOSITION, -1, 1, 0, math.pi),
        "NAV_LAND": (mav.MAV_CMD_NAV_LAND, 0, 0, 0, 180),
        "DO_ORBIT": (mav.MAV_CMD_DO_ORBIT, 20, 3, mav.ORBIT_YAW_BEHAVIOUR_HOLD_INITIAL_HEADING),
    }
    assert flight.desk.command(*orders[command]) == OK
    flight.go_on(4.0 if command == "NAV_LAND" else 15.0)
    if command == "DO_ORBIT":  # it heads for the circle, to the north, and keeps that
        assert abs(wrap_pi(flight.yaw)) < 0.2
    else:
        assert abs(wrap_pi(flight.yaw - math.pi)) < 0.05
    if command != "NAV_LAND":
        assert flight.desk.command(*look) == OK
        flight.go_on(4.0)
        north, east, _ = flight.position
        assert abs(wrap_pi(flight.yaw - math.atan2(50.0 - east, -north))) < 0.1


def test_modes_with_a_heading_of_their_own_look_at_no_place() -> None:
    flight = Flight()
    flight.desk.send(held())
    assert flight.desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 3, 0) == OK
    look = (mav.MAV_CMD_DO_SET_ROI_LOCATION, 0, 0, 0, 0, *place(0.0, 50.0), HOME.alt_msl_m)
    assert flight.desk.command(*look) == DENIED
    assert "mode POSITION has a heading of its own" in "".join(flight.desk.texts())


@pytest.mark.parametrize("before", [mav.MAV_CMD_DO_CHANGE_SPEED, mav.MAV_CMD_NAV_WAYPOINT])
def test_what_comes_before_a_wait_on_the_ground_does_not_lift_it(before: int) -> None:
    """An order for a speed, or a waypoint on the ground: it hovered there, and tipped over."""
    desk = Desk(aircraft=make_vehicle().aircraft)  # with sensors that are not exact
    first = speed_item(0, 8.0)
    if before == mav.MAV_CMD_NAV_WAYPOINT:
        first = item(0, before, height=0.0)
    wait = item(1, mav.MAV_CMD_NAV_DELAY, params=(40, 0, 0, 0), frame=mav.MAV_FRAME_MISSION)
    up = item(2, mav.MAV_CMD_NAV_TAKEOFF, height=20.0)
    assert desk.upload([first, wait, up]) == mav.MAV_MISSION_ACCEPTED
    assert desk.command(mav.MAV_CMD_MISSION_START, 0, 0) == OK
    desk.fly(seconds=38.0)
    aircraft = desk.vehicle.aircraft
    assert (desk.vehicle.autopilot.mode, aircraft.on_ground) == (Mode.MISSION, True)
    np.testing.assert_allclose(aircraft.truth.pos_ned_m, 0.0, atol=0.1)
    desk.fly(seconds=15.0)
    assert aircraft.truth.pos_ned_m[2] == pytest.approx(-20.0, abs=1.0)


def test_a_mission_looks_at_its_place_on_circles_too() -> None:
    flight = Flight()
    mission = [
        item(0, mav.MAV_CMD_DO_SET_ROI_LOCATION, north=200.0, height=0.0),
        item(1, mav.MAV_CMD_NAV_LOITER_TURNS, north=30.0, height=20.0, params=(2, 0, 15, NAN)),
    ]
    assert flight.desk.upload(mission) == mav.MAV_MISSION_ACCEPTED
    assert flight.desk.command(mav.MAV_CMD_MISSION_START, 0, 0) == OK
    flight.go_on(12.0)
    north, east, _ = flight.position
    assert math.hypot(north - 30.0, east) == pytest.approx(15.0, abs=0.5)
    assert abs(wrap_pi(flight.yaw - math.atan2(-east, 200.0 - north))) < 0.05


def test_the_altitude_is_changed_on_the_spot() -> None:
    flight = Flight()
    command = mav.MAV_CMD_DO_CHANGE_ALTITUDE
    assert flight.desk.command(command, 30.0, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT) == OK
    flight.desk.fly()
    np.testing.assert_allclose(flight.position, [0.0, 0.0, -30.0], atol=0.3)
    assert flight.desk.command(command, HOME.alt_msl_m + 25.0, mav.MAV_FRAME_GLOBAL) == OK
    flight.desk.fly()
    np.testing.assert_allclose(flight.position, [0.0, 0.0, -25.0], atol=0.3)
    assert flight.desk.command(command, NAN, mav.MAV_FRAME_GLOBAL) == DENIED
    assert flight.desk.command(command, 30.0, mav.MAV_FRAME_LOCAL_NED) == DENIED


def test_a_turn_of_the_real_aircraft_has_its_direction_and_rate() -> None:
    flight = Flight()
    assert flight.desk.command(mav.MAV_CMD_CONDITION_YAW, 270, 20, 1, 0) == OK
    flight.go_on(7.0)  # 0 to 270 clockwise, at 20 deg/s
    assert math.degrees(flight.yaw) == pytest.approx(140.0, abs=8.0)
    flight.go_on(10.0)
    assert math.degrees(flight.yaw) % 360 == pytest.approx(270.0, abs=2.0)
    assert flight.mode is Mode.HOLD
    np.testing.assert_allclose(flight.position, [0.0, 0.0, -20.0], atol=0.3)


def test_the_real_aircraft_keeps_the_heading_of_its_items() -> None:
    flight = Flight()
    hold = (5.0, 0.0, 0.0, 200.0)
    mission = [
        item(0, mav.MAV_CMD_NAV_WAYPOINT, north=60.0, height=20.0, params=(0.0, 0.0, 0.0, 90.0)),
        item(1, mav.MAV_CMD_NAV_WAYPOINT, north=60.0, east=60.0, height=20.0, params=hold),
        item(2, mav.MAV_CMD_NAV_LAND, north=60.0, east=90.0, params=(0.0, 0.0, 0.0, 300.0)),
    ]
    assert flight.desk.upload(mission) == mav.MAV_MISSION_ACCEPTED
    assert flight.desk.command(mav.MAV_CMD_MISSION_START) == OK
    flight.go_on(6.0)
    assert math.degrees(flight.yaw) == pytest.approx(90.0, abs=3.0)
    flight.go_on(12.0)
    np.testing.assert_allclose(flight.position[:2], [60.0, 60.0], atol=0.5)  # it holds
    assert math.degrees(flight.yaw) % 360 == pytest.approx(200.0, abs=3.0)
    flight.desk.fly()
    assert math.degrees(flight.yaw) % 360 == pytest.approx(300.0, abs=3.0)
    np.testing.assert_allclose(flight.position[:2], [60.0, 90.0], atol=0.5)
