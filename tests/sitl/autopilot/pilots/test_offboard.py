"""Offboard control: PX4's rules for setpoints, and what the real aircraft makes of them."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, of
from sitl_mavsdk import HOME, make_vehicle

from flightdyn.frames import LocalFrame, quaternion_from_euler, yaw_of
from flightdyn.state import Vector
from sitl.autopilot.flying.modes import Mode
from sitl.config import VehicleConfig

OK, REJECTED = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_TEMPORARILY_REJECTED
NAN = math.nan
# What the fields of a setpoint are ignored by.
POS, VEL, ACC, FORCE, YAW, YAW_RATE = 0b111, 0b111 << 3, 0b111 << 6, 1 << 9, 1 << 10, 1 << 11


def local(
    *,
    pos: tuple[float, ...] | None = None,
    vel: tuple[float, ...] | None = None,
    acc: tuple[float, ...] | None = None,
    yaw: float | None = None,
    yaw_rate: float | None = None,
    frame: int = mav.MAV_FRAME_LOCAL_NED,
    mask: int = 0,
) -> Any:
    """A setpoint of what is given; the rest is masked, and holds numbers that must not count."""
    for given, bits in ((pos, POS), (vel, VEL), (acc, ACC), (yaw, YAW), (yaw_rate, YAW_RATE)):
        mask |= 0 if given is not None else bits
    junk = (99.0, 99.0, 99.0)
    fields: Any = (*(pos or junk), *(vel or junk), *(acc or junk))
    turn = (9.0 if yaw is None else yaw, 9.0 if yaw_rate is None else yaw_rate)
    make: Any = mav.MAVLink_set_position_target_local_ned_message
    return make(0, 1, 1, frame, mask, *fields, *turn)


def attitude(
    q: tuple[float, ...], thrust: float, *, rates: tuple[float, ...] = (0, 0, 0), mask: int = 0b111
) -> Any:
    make: Any = mav.MAVLink_set_attitude_target_message
    return make(0, 1, 1, mask, q, *rates, thrust)


def offboard(desk: Desk) -> int:
    return desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 6, 0)


class Pilot:
    """The real aircraft without sensor noise, and somebody who streams setpoints at 10 Hz."""

    def __init__(self) -> None:
        aircraft = make_vehicle(
            config=VehicleConfig.model_validate({"aircraft": {"sensors": {"kind": "perfect"}}})
        ).aircraft
        self.desk = Desk(aircraft=aircraft)
        self.aircraft = aircraft

    def start(self) -> None:
        """To OFFBOARD, armed, on the ground."""
        self.desk.send(local(vel=(0.0, 0.0, 0.0)))
        assert offboard(self.desk) == OK
        assert self.desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0) == OK

    def stream(self, message: object, seconds: float) -> Vector:
        """Where the aircraft truly is at the end."""
        for _ in range(round(seconds * 10)):
            self.desk.send(message)
            self.desk.pass_wall_time(0.1)
            self.desk.fly(seconds=0.1)
        assert self.desk.vehicle.autopilot.mode is Mode.OFFBOARD
        return np.array(self.aircraft.truth.pos_ned_m)

    @property
    def velocity(self) -> Vector:
        return np.array(self.aircraft.truth.vel_ned_mps)

    @property
    def yaw(self) -> float:
        return yaw_of(self.aircraft.truth.q_frd_to_ned)


def test_the_mode_is_granted_while_setpoints_stream_in() -> None:
    desk = Desk()
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == OK
    assert offboard(desk) == REJECTED
    assert "DO_SET_MODE refused: no setpoints are streamed" in "".join(desk.texts())
    desk.send(local(pos=(0.0, 0.0, -5.0)))
    desk.now += 1.1  # COM_OF_LOSS_T is 1 s
    assert offboard(desk) == REJECTED
    desk.send(local(pos=(0.0, 0.0, -5.0)))
    assert offboard(desk) == OK
    assert desk.vehicle.autopilot.mode is Mode.OFFBOARD


def test_setpoints_do_nothing_in_other_modes() -> None:
    desk = Desk()
    desk.take_off(30.0)
    desk.send(local(vel=(5.0, 0.0, 0.0)))
    desk.fly(seconds=5.0)
    assert desk.mass.target is None
    assert desk.vehicle.autopilot.mode is Mode.HOLD


def test_whoever_streams_again_may_go_on() -> None:
    desk = Desk()
    desk.take_off(30.0)
    desk.send(local(vel=(0.0, 0.0, 0.0)))
    assert offboard(desk) == OK
    desk.pass_wall_time(1.2)
    assert desk.vehicle.autopilot.mode is Mode.RETURN
    desk.send(local(vel=(0.0, 0.0, 0.0)))
    assert "Offboard setpoints lost: over" in desk.texts()
    assert offboard(desk) == OK
    assert desk.vehicle.autopilot.mode is Mode.OFFBOARD


def test_a_lost_stream_is_taken_over_by_sticks() -> None:
    desk = Desk()
    desk.take_off(30.0)
    desk.send(local(vel=(0.0, 0.0, 0.0)))
    assert offboard(desk) == OK
    for _ in range(12):
        desk.send(mav.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
        desk.pass_wall_time(0.1)
    assert desk.vehicle.autopilot.mode is Mode.POSITION


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (local(), "neither position nor velocity nor acceleration"),
        (local(vel=(1.0, 0.0, 0.0), frame=mav.MAV_FRAME_LOCAL_OFFSET_NED), "frame 7"),
        (local(acc=(1.0, 0.0, 0.0), mask=FORCE), "force and bits beyond 11 are not supported"),
        (local(pos=(0.0, math.inf, 0.0)), "position inf: -100000 to 100000 m"),
        (local(vel=(0.0, 0.0, 1e30)), "velocity 1e+30: -100 to 100 m/s"),
        (local(acc=(-1e3, 0.0, 0.0)), "acceleration -1000: -100 to 100 m/s2"),
        (local(vel=(0.0, 0.0, 0.0), yaw_rate=-math.inf), "yaw rate -inf: -20 to 20 rad/s"),
        (local(vel=(0.0, 0.0, 0.0), yaw=-13.0), "yaw -13: -12.5664 to 12.5664 rad"),  # two turns
        (attitude((1, 0, 0, 0), 1.5), "thrust 1.5: 0 to 1"),
        (attitude((1, 0, 0, 0), NAN), "thrust nan: 0 to 1"),
        (attitude((0, 0, 0, 0), 0.5), "quaternion of length 0"),
        (attitude((NAN, 0, 0, 0), 0.5), "quaternion of length nan"),
        (attitude((1, 0, 0, 0), 0.5, mask=0b10000111), "neither attitude nor body rates"),
        (
            attitude((1, 0, 0, 0), 0.5, rates=(1e9, 0, 0), mask=0b10000000),
            "body rate 1e+09: -20",
        ),
    ],
)
def test_a_setpoint_that_cannot_be_flown_is_refused_once_and_is_no_stream(
    message: object, words: str
) -> None:
    desk = Desk()
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == OK
    for _ in range(5):
        desk.send(message)
    said = "".join(text for text in desk.texts() if text != "Ready for takeoff")
    assert said.count("Setpoint refused") == 1
    assert words in said
    assert offboard(desk) == REJECTED


def test_positions_velocities_and_headings_are_flown() -> None:
    pilot = Pilot()
    pilot.start()
    up = pilot.stream(local(pos=(0.0, 0.0, -5.0), yaw=0.0), 8.0)
    np.testing.assert_allclose(up, [0.0, 0.0, -5.0], atol=0.15)
    away = pilot.stream(local(pos=(8.0, -6.0, -7.0), yaw=math.pi / 2), 10.0)
    np.testing.assert_allclose(away, [8.0, -6.0, -7.0], atol=0.15)
    assert pilot.yaw == pytest.approx(math.pi / 2, abs=0.03)
    pilot.stream(local(vel=(3.0, 0.0, -1.0), yaw_rate=0.2), 4.0)
    np.testing.assert_allclose(pilot.velocity, [3.0, 0.0, -1.0], atol=0.15)
    turned = pilot.yaw
    pilot.stream(local(vel=(0.0, 0.0, 0.0), yaw_rate=0.2), 2.0)
    assert pilot.yaw - turned == pytest.approx(0.4, abs=0.03)
    # North by position, east by velocity, height left where it is.
    mixed = local(pos=(0.0, 0.0, 0.0), vel=(0.0, 2.0, 0.0), mask=0b110)
    before = np.array(pilot.aircraft.truth.pos_ned_m)
    after = pilot.stream(mixed, 12.0)
    assert after[0] == pytest.approx(0.0, abs=0.3)
    assert after[1] - before[1] == pytest.approx(24.0, abs=2.0)
    assert after[2] == pytest.approx(before[2], abs=0.5)


def test_a_velocity_in_the_body_frame_is_turned_with_the_nose() -> None:
    pilot = Pilot()
    pilot.start()
    pilot.stream(local(pos=(0.0, 0.0, -5.0), yaw=math.pi / 2), 8.0)
    pilot.stream(local(vel=(2.0, 1.0, 0.0), frame=mav.MAV_FRAME_BODY_NED), 4.0)
    np.testing.assert_allclose(pilot.velocity, [-1.0, 2.0, 0.0], atol=0.15)


@pytest.mark.parametrize(
    ("velocity", "north_east_down"),
    [
        ((2.0, 1.0, NAN), (-1.0, 2.0, NAN)),
        ((2.0, NAN, NAN), (0.0, 2.0, NAN)),
        ((NAN, 1.0, -3.0), (-1.0, 0.0, -3.0)),
        ((NAN, NAN, -3.0), (NAN, NAN, -3.0)),
    ],
)
def test_in_the_body_frame_each_component_is_open_for_itself(
    velocity: tuple[float, ...], north_east_down: tuple[float, ...]
) -> None:
    desk = Desk()
    desk.take_off()
    assert desk.command(mav.MAV_CMD_CONDITION_YAW, 90, 20, 0, 0) == OK
    desk.fly()
    desk.send(local(vel=velocity, frame=mav.MAV_FRAME_BODY_NED))
    assert offboard(desk) == OK
    assert desk.mass.target is not None
    assert desk.mass.target.vel == pytest.approx(north_east_down, abs=1e-6, nan_ok=True)


def test_a_position_that_moves_is_met_without_lag() -> None:
    pilot = Pilot()
    pilot.start()
    pilot.stream(local(pos=(0.0, 0.0, -5.0)), 8.0)
    for i in range(100):  # 3 m/s towards the north
        pilot.stream(local(pos=(0.3 * i, 0.0, -5.0), vel=(3.0, 0.0, 0.0)), 0.1)
    assert pilot.aircraft.truth.pos_ned_m[0] == pytest.approx(30.0, abs=0.5)


def test_an_acceleration_is_flown_up_to_the_greatest_speed() -> None:
    pilot = Pilot()
    pilot.start()
    pilot.desk.vehicle.autopilot.parameters.set("MPC_XY_VEL_MAX", 6.0)
    pilot.stream(local(pos=(0.0, 0.0, -5.0)), 8.0)
    pilot.stream(local(acc=(1.0, 0.0, 0.0)), 4.0)
    assert pilot.velocity[0] == pytest.approx(4.0, abs=0.3)
    pilot.stream(local(acc=(1.0, 0.0, 0.0)), 6.0)
    assert pilot.velocity[0] == pytest.approx(6.0, abs=0.3)


def test_a_global_position_is_the_same_place() -> None:
    pilot = Pilot()
    pilot.start()
    place = LocalFrame(HOME).to_geodetic(np.array([6.0, 3.0, -8.0]))
    lat, lon = round(place.lat_deg * 1e7), round(place.lon_deg * 1e7)
    mask = VEL | ACC | YAW | YAW_RATE
    for frame, altitude in (
        (mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 8.0),
        (mav.MAV_FRAME_GLOBAL_INT, HOME.alt_msl_m + 8.0),
    ):
        message = mav.MAVLink_set_position_target_global_int_message(
            0, 1, 1, frame, mask, lat, lon, altitude, 0, 0, 0, 0, 0, 0, 0, 0
        )
        there = pilot.stream(message, 9.0)
        np.testing.assert_allclose(there, [6.0, 3.0, -8.0], atol=0.15)


def test_attitude_and_rates_with_thrust() -> None:
    pilot = Pilot()
    pilot.start()
    pilot.stream(local(pos=(0.0, 0.0, -30.0), yaw=0.0), 14.0)
    lean = quaternion_from_euler(math.radians(15.0), 0.0, 0.3)
    pilot.stream(attitude(lean, 0.5), 1.5)
    np.testing.assert_allclose(pilot.aircraft.truth.q_frd_to_ned, lean, atol=0.02)
    assert pilot.velocity[1] > 1.5  # to the right, as it leans
    spin = attitude((1, 0, 0, 0), 0.5, rates=(0.0, 0.0, 0.6), mask=1 << 7)
    pilot.stream(spin, 1.5)
    assert pilot.aircraft.truth.omega_frd_radps[2] == pytest.approx(0.6, abs=0.05)


def test_thrust_is_the_share_of_the_rotors_speed() -> None:
    """The square root of what hovers, about a half, neither climbs nor sinks."""
    pilot = Pilot()
    pilot.start()
    pilot.stream(local(pos=(0.0, 0.0, -30.0), yaw=0.0), 14.0)
    frame = pilot.aircraft.vehicle.airframe
    hover = math.sqrt(frame.mass_kg * 9.81 / (4 * frame.rotor_max_thrust_n))
    for thrust, least, most in ((0.9 * hover, 0.5, 9.0), (1.1 * hover, -9.0, -0.5)):
        pilot.stream(local(vel=(0.0, 0.0, 0.0), yaw=0.0), 4.0)
        pilot.stream(attitude(quaternion_from_euler(0.0, 0.0, 0.0), thrust), 1.0)
        assert least < pilot.velocity[2] < most


def test_it_stands_until_a_setpoint_leads_up_and_disarms_when_it_has_landed() -> None:
    pilot = Pilot()
    pilot.start()
    assert pilot.stream(local(pos=(5.0, 0.0, 0.0)), 3.0) == pytest.approx([0.0, 0.0, 0.0], abs=0.1)
    pilot.stream(local(vel=(0.0, 0.0, -1.0)), 3.0)
    assert pilot.aircraft.truth.pos_ned_m[2] < -1.0
    desk = pilot.desk
    for _ in range(100):
        desk.send(local(vel=(0.0, 0.0, 0.6)))
        desk.pass_wall_time(0.1)
        desk.fly(seconds=0.1)
    assert not pilot.aircraft.armed
    assert desk.vehicle.autopilot.mode is Mode.HOLD


def test_the_heartbeat_says_px4s_mode() -> None:
    desk = Desk()
    desk.send(local(vel=(0.0, 0.0, 0.0)))
    assert offboard(desk) == OK
    heartbeat = of(desk.heard, "HEARTBEAT")[-1]
    assert heartbeat.custom_mode == 6 << 16
    assert heartbeat.base_mode & mav.MAV_MODE_FLAG_STABILIZE_ENABLED
    assert not heartbeat.base_mode & mav.MAV_MODE_FLAG_AUTO_ENABLED


# --- every field of a setpoint ------------------------------------------------------------------

_ALL: dict[str, Any] = {"vx": 1.0, "vy": 2.0, "vz": 3.0, "afx": 0.1, "afy": 0.2, "afz": 0.3}
_LOCAL = {"x": 10.0, "y": 20.0, "z": -30.0, **_ALL, "yaw": 0.5, "yaw_rate": 0.1}
_GLOBE = {"lat_int": 474000000, "lon_int": 85000000, "alt": 510.0, **_ALL, "yaw": 0.5}
_GLOBAL = {**_GLOBE, "yaw_rate": 0.1}
_ATTITUDE = {"body_yaw_rate": 0.1, "thrust": 0.5}
# Who it is for, and when it was sent by a clock of its sender's.
_ADDRESS = {"time_boot_ms": 0, "target_system": 1, "target_component": 1}
_KINDS: Any = {
    mav.MAVLink_set_position_target_local_ned_message: (_LOCAL, {"coordinate_frame": 1}),
    mav.MAVLink_set_position_target_global_int_message: (_GLOBAL, {"coordinate_frame": 5}),
    mav.MAVLink_set_attitude_target_message: (
        {**_ATTITUDE, "body_roll_rate": 0.0, "body_pitch_rate": 0.0},
        {"q": [1.0, 0.0, 0.0, 0.0]},
    ),
}


def _flown_by(make: Any, fields: dict[str, Any], mask: int = 0) -> tuple[Any, str]:
    """What the vehicle goes after, and what it says, on a setpoint with these fields."""
    desk = Desk()
    desk.take_off()
    desk.send(make(**_ADDRESS, type_mask=mask, **fields))
    offboard(desk)
    said = "".join(text for text in desk.texts() if "Setpoint" in text)
    return (desk.mass.target, desk.mass.attitude), said


@pytest.mark.parametrize(
    ("make", "name"), [(make, name) for make, (used, _) in _KINDS.items() for name in used]
)
def test_a_field_of_a_setpoint_is_flown_or_refused(make: Any, name: str) -> None:
    used, rest = _KINDS[make]
    fields = {**used, **rest}
    before, said = _flown_by(make, fields)
    assert not said
    changed = fields[name] + (100_000 if isinstance(fields[name], int) else 0.25)
    after, said = _flown_by(make, {**fields, name: changed})
    assert repr(after) != repr(before) or said


@pytest.mark.parametrize("make", _KINDS)
def test_a_setpoint_has_no_other_fields(make: Any) -> None:
    used, rest = _KINDS[make]
    known = {*used, *rest, *_ADDRESS, "type_mask"}
    assert set(make.fieldnames) - {"thrust_body"} == known


@pytest.mark.parametrize("make", _KINDS)
def test_every_bit_of_a_type_mask_leaves_something_out_or_is_refused(make: Any) -> None:
    used, rest = _KINDS[make]
    fields = {**used, **rest, "thrust_body": [0.0] * 3} if "q" in rest else {**used, **rest}
    fields = {k: v for k, v in fields.items() if k in make.fieldnames}
    whole, _ = _flown_by(make, fields)
    for bit in range(8 if "q" in rest else 16):
        part, said = _flown_by(make, fields, 1 << bit)
        neutral = "q" in rest and bit in (0, 1)  # rates of 0, which an attitude has anyway
        assert said or neutral or repr(part) != repr(whole), bit


def test_a_height_rules_beside_a_horizontal_velocity_in_every_frame() -> None:
    make = mav.MAVLink_set_position_target_global_int_message
    for frame, alt in ((6, 30.0), (5, HOME.alt_msl_m + 30.0)):
        fields = {"coordinate_frame": frame, **_GLOBAL, "alt": alt}
        (target, _), said = _flown_by(make, fields, 0b011 | ACC | YAW | YAW_RATE)
        assert not said
        assert target.pos[2] == pytest.approx(-30.0)
        assert math.isnan(target.pos[0])
        assert target.vel == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("fields", "mask", "words"),
    [
        ({"coordinate_frame": 8, **_LOCAL}, ACC, "frame 8 takes no position"),
        ({"coordinate_frame": 5, **_GLOBAL}, 0b010, "latitude and longitude belong"),
        ({"coordinate_frame": 1, **_LOCAL}, 1 << 12, "type mask 0x1000"),
    ],
)
def test_what_a_setpoint_cannot_order_is_refused(
    fields: dict[str, Any], mask: int, words: str
) -> None:
    make: Any = mav.MAVLink_set_position_target_local_ned_message
    if "alt" in fields:
        make = mav.MAVLink_set_position_target_global_int_message
    assert words in _flown_by(make, fields, mask)[1]


def test_a_roll_rate_beside_an_attitude_is_refused() -> None:
    desk = Desk()
    desk.send(attitude((1, 0, 0, 0), 0.5, rates=(0.2, 0.0, 0.0), mask=0))
    assert "roll or pitch rate beside an attitude" in "".join(desk.texts())
