"""What sticks, a target and setpoints order of the aircraft: every number worked by hand."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from scipy.spatial.transform import Rotation
from sitl_desk import Desk
from sitl_mavsdk import HOME

from flightdyn.frames import LocalFrame
from sitl.autopilot.flying.modes import Mode

NAN, OK = math.nan, mav.MAV_RESULT_ACCEPTED
YAW = math.radians(30.0)
PARAMETERS = {
    "MPC_VEL_MANUAL": 9.0, "MPC_Z_VEL_MAX_UP": 3.6, "MPC_Z_VEL_MAX_DN": 1.8, "MPC_MAN_Y_MAX": 90.0,
    "MPC_MAN_TILT_MAX": 40.0, "MPC_XY_VEL_MAX": 12.0, "FLW_TGT_DST": 10.0, "FLW_TGT_HT": 12.0,
    "FLW_TGT_FA": 30.0, "FLW_TGT_MAX_VEL": 3.0, "FLW_TGT_RS": 0.25,
}  # fmt: skip
LIMITS = (12.0, 3.6, 1.8)  # speed, climb and descent


def flying(*messages: Any, mode: tuple[int, int], yaw_rad: float = YAW) -> Desk:
    """A point mass 30 m over home that heads for 30 degrees, in a mode, after these messages."""
    desk = Desk()
    for name, value in PARAMETERS.items():
        assert desk.vehicle.autopilot.parameters.set(name, value), name
    desk.take_off(1.0)
    desk.mass.pos_ned_m, desk.mass.yaw_rad = np.array([0.0, 0.0, -30.0]), yaw_rad
    desk.send(*messages)
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 129, *mode) == OK
    return desk


def held(pitch: int, roll: int, throttle: int, yaw: int) -> Any:
    return mav.MAVLink_manual_control_message(1, pitch, roll, throttle, yaw, 0)


def channels(*widths_us: int) -> Any:
    make: Any = mav.MAVLink_rc_channels_override_message
    return make(1, 1, *widths_us, *(65535,) * 4)


@pytest.mark.parametrize(
    ("message", "ahead_right_up", "turn_degps"),
    [
        # A tenth of the way does nothing; what is beyond counts from there.
        (held(550, 0, 500, 0), (4.5, 0.0, 0.0), 0.0),
        (held(-1000, 0, 500, 0), (-9.0, 0.0, 0.0), 0.0),
        (held(0, -550, 500, 0), (0.0, -4.5, 0.0), 0.0),
        (held(100, -100, 550, 100), (0.0, 0.0, 0.0), 0.0),
        (held(-100, 100, 450, -100), (0.0, 0.0, 0.0), 0.0),
        (held(910, 820, 500, 0), (9.0 * 0.9 / 1.204159, 9.0 * 0.8 / 1.204159, 0.0), 0.0),
        (held(0, 0, 775, 0), (0.0, 0.0, 1.8), 0.0),
        (held(0, 0, 225, 0), (0.0, 0.0, -0.9), 0.0),
        (held(0, 0, 1000, 1000), (0.0, 0.0, 3.6), 90.0),
        (held(0, 0, 0, -325), (0.0, 0.0, -1.8), -22.5),
        # Out of range is no such axis.
        (held(1001, 32767, 1001, -1001), (0.0, 0.0, 0.0), 0.0),
        (held(-1001, -32767, -1, 0), (0.0, 0.0, 0.0), 0.0),
        # Roll, pitch, throttle, yaw; 0 is no such channel, and a pulse ends at 1000 and 2000 us.
        (channels(1775, 1225, 1775, 1662), (-4.5, 4.5, 1.8), 0.224 / 0.9 * 90.0),
        (channels(900, 0, 2100, 0), (0.0, -9.0, 3.6), 0.0),
        (channels(0, 2100, 0, 900), (9.0, 0.0, 0.0), -90.0),
        (channels(0, 2000, 1000, 0), (9.0, 0.0, -1.8), 0.0),
    ],
)
def test_sticks_order_a_velocity_along_the_nose(
    message: Any, ahead_right_up: tuple[float, float, float], turn_degps: float
) -> None:
    target = flying(message, mode=(3, 0)).mass.target
    assert target is not None
    ahead, right, up = ahead_right_up
    c, s = math.sqrt(0.75), 0.5
    assert target.vel == pytest.approx((c * ahead - s * right, s * ahead + c * right, -up))
    assert target.yaw_rate == pytest.approx(math.radians(turn_degps))
    assert math.isnan(target.yaw)
    assert target[5:8] == LIMITS
    assert not target.drifting


def test_a_channel_of_65535_stays_as_it_is() -> None:
    desk = flying(channels(1500, 1775, 1225, 2000), mode=(3, 0), yaw_rad=0.0)
    desk.send(channels(1225, 65535, 65535, 65535))
    desk.fly(seconds=0.02)
    assert desk.mass.target is not None
    assert desk.mass.target.vel == pytest.approx((4.5, -4.5, 0.9))
    assert desk.mass.target.yaw_rate == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("mode", [Mode.ALTITUDE, Mode.STABILIZED, Mode.MANUAL])
@pytest.mark.parametrize(
    ("message", "roll_deg", "pitch_deg", "turn_degps", "throttle", "climb_mps"),
    [
        (held(500, 250, 500, 0), 10.0, -20.0, 0.0, 0.5, 0.0),
        (held(-1000, -500, 775, 550), -20.0, 40.0, 45.0, 0.775, 1.8),
        (held(0, 0, 0, -1000), 0.0, 0.0, -90.0, 0.0, -1.8),
    ],
)
def test_sticks_order_a_lean(
    mode: Mode, message: Any, roll_deg: float, pitch_deg: float, turn_degps: float,
    throttle: float, climb_mps: float,
) -> None:  # fmt: skip
    desk = flying(message, mode=mode.value)
    for looks in (1, 2):  # each 20 ms the heading ordered goes on
        order = desk.mass.attitude
        assert order is not None
        yaw_deg = 30.0 + looks * 0.02 * turn_degps
        x, y, z, w = Rotation.from_euler(
            "ZYX", (yaw_deg, pitch_deg, roll_deg), degrees=True
        ).as_quat()
        assert order.q_frd_to_ned == pytest.approx((w, x, y, z))
        assert order.rates_radps == pytest.approx((0.0, 0.0, math.radians(turn_degps)))
        if mode is Mode.ALTITUDE:
            assert (order.collective, order.climb_mps) == (None, pytest.approx(climb_mps))
        else:  # the rotors' thrust goes with the square of their speed
            assert (order.collective, order.climb_mps) == (pytest.approx(throttle**2), 0.0)
        desk.fly(seconds=0.02)


def test_on_the_ground_the_heading_ordered_is_the_present_one() -> None:
    desk = Desk()
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0) == OK
    desk.send(held(0, 0, 0, 1000))
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 129, *Mode.STABILIZED.value) == OK
    desk.fly(seconds=0.4)
    desk.mass.yaw_rad = 1.0
    desk.fly(seconds=0.02)
    order = desk.mass.attitude
    assert order is not None
    assert order.q_frd_to_ned is not None
    turned = 1.0 + math.radians(60.0) * 0.02
    assert order.q_frd_to_ned[3] == pytest.approx(math.sin(turned / 2))


# --- a target to follow ---------------------------------------------------------------------------


def target_at(
    north: float, east: float, height: float = 0.0, vel: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> Any:
    point = LocalFrame(HOME).to_geodetic(np.array([north, east, -height]))
    return mav.MAVLink_follow_target_message(
        0, 3, round(point.lat_deg * 1e7), round(point.lon_deg * 1e7), point.alt_msl_m, vel,
        (0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0), 0,
    )  # fmt: skip


def beside(north: float, east: float, course_deg: float) -> tuple[float, float]:
    """10 m from a place, 30 degrees to the right of a course."""
    angle = math.radians(course_deg + 30.0)
    return north + 10.0 * math.cos(angle), east + 10.0 * math.sin(angle)


def followed(desk: Desk, *messages: Any) -> Any:
    desk.send(*messages)
    desk.fly(seconds=0.12)
    assert desk.mass.target is not None
    return desk.mass.target


def test_the_place_beside_a_target_turns_with_its_course() -> None:
    desk = flying(mode=(4, 8))
    rest = desk.mass.target
    assert rest is not None
    assert all(map(math.isnan, (*rest.pos, *rest.vel, *rest.acc)))
    to = followed(desk, target_at(50.0, 20.0))
    assert to.pos == pytest.approx((*beside(50.0, 20.0, 0.0), -12.0), abs=0.02)
    assert (to.vel, to[5:8]) == ((0.0, 0.0, 0.0), (3.0, *LIMITS[1:]))
    assert to.yaw == pytest.approx(math.atan2(20.0, 50.0), abs=0.01)
    # Three quarters of each turn count; at 1 m/s and below there is no course.
    for vel, course_deg in (
        ((0.0, 2.0, 0.5), 67.5),
        ((1.0, 0.0, 0.0), 67.5),
        ((0.0, -1.0, NAN), 67.5),
        ((0.0, -1.01, 0.0), 67.5 - 0.75 * 157.5),
    ):
        to = followed(desk, target_at(50.0, 20.0, vel=vel))
        assert to.pos == pytest.approx((*beside(50.0, 20.0, course_deg), -12.0), abs=0.02)
        assert to.vel == pytest.approx((vel[0], vel[1], 0.0))
        assert to.speed_mps == pytest.approx(3.0 + math.hypot(vel[0], vel[1]))
    here = desk.mass.pos_ned_m
    assert to.yaw == pytest.approx(math.atan2(20.0 - here[1], 50.0 - here[0]), abs=0.01)
    assert followed(desk, target_at(50.0, 20.0, vel=(6.0, 8.0, 0.0))).speed_mps == 12.0


def test_a_silent_target_goes_on_for_three_seconds() -> None:
    desk = flying(mode=(4, 8))
    followed(desk, target_at(50.0, 20.0, vel=(4.0, 3.0, -1.0)))
    course_deg = 0.75 * math.degrees(math.atan2(3.0, 4.0))
    desk.now += 3.0
    to = followed(desk)
    assert to.pos == pytest.approx((*beside(62.0, 29.0, course_deg), -12.0), abs=0.02)
    desk.now += 0.01
    assert all(map(math.isnan, (*followed(desk).pos, *followed(desk).vel)))


@pytest.mark.parametrize(
    ("rule", "target_m", "home_m", "flown_m"),
    [
        (0, 20.0, 0.0, 12.0), (1, 20.0, 0.0, 12.0), (2, 20.0, 0.0, 32.0),
        (2, -10.5, 0.0, 2.0), (2, -9.5, 0.0, 2.5), (1, 20.0, 5.0, 17.0), (2, -10.0, 5.0, 7.0),
    ],
)  # fmt: skip
def test_the_height_over_a_target_or_over_home(
    rule: int, target_m: float, home_m: float, flown_m: float
) -> None:
    desk = flying(mode=(4, 8))
    desk.vehicle.autopilot.parameters.set("FLW_TGT_ALT_M", rule)
    lat, lon, alt = HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m + home_m
    assert desk.command(mav.MAV_CMD_DO_SET_HOME, 0, 0, 0, 0, lat, lon, alt) == OK
    to = followed(desk, target_at(50.0, 20.0, target_m, vel=(1.0, 1.0, -0.5)))
    assert to.pos[2] == pytest.approx(-flown_m, abs=0.01)
    assert to.vel[2] == (-0.5 if rule == 2 else 0.0)
    unknown = followed(desk, target_at(50.0, 20.0, target_m, vel=(1.0, 1.0, NAN)))
    assert unknown.vel == (1.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("message", "taken"),
    [
        (target_at(99_000.0, 0.0), True),
        (target_at(0.0, -100_500.0), False),
        (target_at(50.0, 20.0, vel=(0.0, 0.0, 100.5)), False),
        (target_at(50.0, 20.0, vel=(0.0, -100.5, 0.0)), False),
        (target_at(50.0, 20.0, 20_100.0), False),
    ],
)
def test_an_impossible_target_is_dropped(message: Any, taken: bool) -> None:
    to = followed(flying(mode=(4, 8)), message)
    assert math.isnan(to.pos[0]) != taken


# --- setpoints ------------------------------------------------------------------------------------


def setpoint(frame: int, mask: int, x: float, y: float, z: float, *rest: float) -> Any:
    """Of a position and (3,) velocity, (3,) acceleration, yaw, yaw rate."""
    make: Any = mav.MAVLink_set_position_target_local_ned_message
    if frame not in (mav.MAV_FRAME_LOCAL_NED, mav.MAV_FRAME_BODY_NED):
        make = mav.MAVLink_set_position_target_global_int_message
    return make(0, 1, 1, frame, mask, x, y, z, *rest)


REST = (1.0, 2.0, 3.0, 0.5, 0.25, 0.125, 0.75, 0.0625)
PLACE = LocalFrame(HOME).to_geodetic(np.array([60.0, -40.0, -25.0]))
LAT, LON = round(PLACE.lat_deg * 1e7), round(PLACE.lon_deg * 1e7)
ALT = PLACE.alt_msl_m


@pytest.mark.parametrize(
    ("frame", "place", "flown"),
    [
        (1, (60.0, -40.0, -25.0), (60.0, -40.0, -25.0)),
        (0, (LAT, LON, ALT), (60.0, -40.0, -25.0)),
        (5, (LAT, LON, ALT), (60.0, -40.0, -25.0)),
        (3, (LAT, LON, ALT - HOME.alt_msl_m - 5.0), (60.0, -40.0, -25.0)),
        (6, (LAT, LON, ALT - HOME.alt_msl_m - 5.0), (60.0, -40.0, -25.0)),
        (5, (LAT, LON, NAN), (60.0, -40.0, NAN)),
        (6, (2**31 - 1, 2**31 - 1, 20.0), (NAN, NAN, -25.0)),
    ],
)
def test_a_position_in_every_frame(
    frame: int, place: tuple[float, float, float], flown: tuple[float, float, float]
) -> None:
    """Home is 5 m above the origin of the local frame."""
    desk = flying(setpoint(1, 0, 0.0, 0.0, -30.0, *REST), mode=(6, 0))
    home = HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m + 5.0
    assert desk.command(mav.MAV_CMD_DO_SET_HOME, 0, 0, 0, 0, *home) == OK
    desk.send(setpoint(frame, 0, *place, *REST))
    to = desk.mass.target
    assert to is not None
    assert to.pos == pytest.approx(flown, abs=0.02, nan_ok=True)
    assert (to.vel, to.acc, to.yaw, to.yaw_rate) == (REST[:3], REST[3:6], *REST[6:])
    assert to[5:8] == LIMITS


def test_velocity_and_acceleration_are_turned_out_of_the_body() -> None:
    to = flying(setpoint(8, 0b111, 0, 0, 0, *REST), mode=(6, 0)).mass.target
    assert to is not None
    c, s = math.sqrt(0.75), 0.5
    assert to.vel == pytest.approx((c * 1.0 - s * 2.0, s * 1.0 + c * 2.0, 3.0))
    assert to.acc == pytest.approx((c * 0.5 - s * 0.25, s * 0.5 + c * 0.25, 0.125))


@pytest.mark.parametrize(
    ("mask", "names"),
    [
        (1 << bit, {name})
        for bit, name in enumerate(
            ("px", "py", "pz", "vx", "vy", "vz", "ax", "ay", "az", "", "yaw", "rate")
        )
        if name
    ],
)
def test_each_bit_leaves_out_its_own_field(mask: int, names: set[str]) -> None:
    to = flying(setpoint(1, mask, 7.0, 8.0, -9.0, *REST), mode=(6, 0)).mass.target
    assert to is not None
    given = zip(
        ("px", "py", "pz", "vx", "vy", "vz", "ax", "ay", "az", "yaw", "rate"),
        (*to.pos, *to.vel, *to.acc, to.yaw, to.yaw_rate),
        strict=True,
    )
    assert {name for name, value in given if math.isnan(value)} == names


def attitude(q: tuple[float, ...], rates: tuple[float, ...], thrust: float, mask: int) -> Any:
    make: Any = mav.MAVLink_set_attitude_target_message
    return make(0, 1, 1, mask, q, *rates, thrust)


@pytest.mark.parametrize(
    ("message", "q", "rates", "collective"),
    [
        (attitude((0.56, 0.0, 0.72, 0.0), (0, 0, 0.25), 0.5, 0),
         (0.6139, 0.0, 0.7894, 0.0), (0.0, 0.0, 0.25), 0.25),
        (attitude((1.08, 0, 0, 0), (9, 9, 9), 1.0, 0b111), (1, 0, 0, 0), (0, 0, 0), 1.0),
        (attitude((0, 0, 0, 0), (0.5, -0.25, 9), 0.0, 1 << 7 | 1 << 2), None, (0.5, -0.25, 0), 0.0),
        (attitude((0, 0, 0, 0), (0.5, -0.25, -20), 0.3, 1 << 7), None, (0.5, -0.25, -20), 0.09),
    ],
)  # fmt: skip
def test_an_attitude_is_ordered_as_it_is_told(
    message: Any, q: tuple[float, ...] | None, rates: tuple[float, ...], collective: float
) -> None:
    order = flying(message, mode=(6, 0)).mass.attitude
    assert order is not None
    assert order.q_frd_to_ned == (q if q is None else pytest.approx(q, abs=1e-4))
    assert order.rates_radps == pytest.approx(rates)
    assert order.collective == pytest.approx(collective)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (attitude((0.88, 0, 0, 0), (0, 0, 0), 0.5, 0), "length 0.88"),
        (attitude((1.12, 0, 0, 0), (0, 0, 0), 0.5, 0), "length 1.12"),
        (attitude((1, 0, 0, 0), (0, -0.5, 0), 0.5, 0), "pitch rate beside an attitude"),
        (attitude((1, 0, 0, 0), (0, 0, 0), 0.5, 1 << 6), "thrust nan"),
        (attitude((1, 0, 0, 0), (0, 0, 0), 0.5, 1 << 3), "type mask 0x8"),
        (attitude((1, 0, 0, 0), (0, 0, 0), 0.5, 1 << 4), "type mask 0x10"),
        (attitude((1, 0, 0, 0), (0, 0, 0), 0.5, 1 << 5), "type mask 0x20"),
        (attitude((1, 0, 0, 0), (0, 0, 0), 0.5, 1 << 7 | 1), "neither attitude nor body rates"),
        (attitude((1, 0, 0, 0), (0, 0, 0), 0.5, 1 << 7 | 2), "neither attitude nor body rates"),
        (setpoint(2, 0, LAT, LON, ALT, *REST), "frame 2; 0, 1, 3, 5, 6 and 8"),
        (setpoint(8, 0b011, 0, 0, 1, *REST), "frame 8 takes no position"),
        (setpoint(5, 0, LAT, round(87.0e7), ALT, *REST), "km away"),
        (setpoint(5, 0, LAT, 2**31 - 1, ALT, *REST), "belong together"),
    ],
)
def test_what_is_no_setpoint_is_refused(message: Any, words: str) -> None:
    desk = Desk()
    desk.send(message)
    assert words in "".join(desk.texts())
