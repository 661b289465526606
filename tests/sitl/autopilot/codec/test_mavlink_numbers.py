"""Every number and every unit on the wire, held against pymavlink's own tables."""

import importlib.metadata
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_mavsdk import HOME

from flightdyn.frames import LocalFrame, quaternion_from_euler
from flightdyn.instruments import Instruments, Readings
from flightdyn.state import BatteryState, GnssFix, Kinematics
from sitl.autopilot.codec.instruments import INSTRUMENTS, DeferredValues, Snapshot
from sitl.autopilot.codec.orders import (
    CommandOrder,
    MissionItem,
    Outbox,
    Peer,
    read_item,
    read_order,
)
from sitl.autopilot.codec.telemetry import TELEMETRY
from sitl.autopilot.codec.wire import Wire, whole_frames
from sitl.autopilot.reporter import Reporter

FRAME = LocalFrame(HOME)
POSITION = np.array([321.5, -123.25, -61.75])
VELOCITY = np.array([3.21, -4.56, -0.78])
RATES = np.array([0.11, -0.22, 0.33])
TRUE_POSITION = np.array([322.0, -124.0, -60.5])
TRUE_VELOCITY = np.array([3.5, -4.25, -0.5])
ROLL, PITCH, YAW = 0.2, -0.1, -2.0
FIX = GnssFix(11_600_000_000, np.array([320.0, -122.0, -63.0]), VELOCITY, 0.7, 1.9, 0.12, 14)
HOME_NED = np.array([5.0, 6.0, -7.0])
FORCE = (0.6, -0.3, -9.7)
INSTRUMENTS_READ = Instruments(
    # The standard atmosphere's pressure at 550 m.
    Readings((0.0, 0.0, 0.0), FORCE, 94_890.0, None, (0.0, 0.0, 0.0), None),
    setpoint=None,
    q_wanted=(1.0, 0.0, 0.0, 0.0),
    throttle=0.496,
    motors=(0.5,) * 4,
    wind_ned_mps=np.array([0.21, -0.56, 0.0]),
    true_force_mps2=FORCE,
)
BOOTED_S = 1_767_225_600  # the first of January 2026

SNAPSHOT = Snapshot(
    t_ns=12_345_000_000,
    booted_ns=BOOTED_S * 10**9,
    belief=Kinematics(
        12_345_000_000,
        POSITION,
        VELOCITY,
        np.array(quaternion_from_euler(ROLL, PITCH, YAW)),
        RATES,
    ),
    position=FRAME.to_geodetic(POSITION),
    truth=Kinematics(
        12_345_000_000, TRUE_POSITION, TRUE_VELOCITY, np.array([0.5, 0.5, 0.5, 0.5]), RATES
    ),
    true_position=FRAME.to_geodetic(TRUE_POSITION),
    origin=HOME,
    home=FRAME.to_geodetic(HOME_NED),
    home_ned_m=HOME_NED,
    home_yaw_rad=math.pi / 2,
    gnss=FIX,
    gnss_position=FRAME.to_geodetic(FIX.pos_ned_m),
    battery=BatteryState(15.87, 11.25, 1234.0, 0.61),
    charge_state=mav.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
    custom_mode=67371008,
    armed=True,
    system_state=mav.MAV_STATE_ACTIVE,
    landed_state=mav.MAV_LANDED_STATE_IN_AIR,
    sensors_present=mav.MAV_SYS_STATUS_SENSOR_3D_GYRO,
    sensors_healthy=mav.MAV_SYS_STATUS_SENSOR_3D_GYRO,
    armed_t_ns=1_500_000_000,
    took_off_t_ns=2_750_000_000,
    landed_t_ns=9_250_000_000,
    flights=3,
    mission=mav.MAVLink_mission_current_message(4, 9, mav.MISSION_STATE_ACTIVE, 1),
    read_deferred=lambda: DeferredValues(INSTRUMENTS_READ, None, {}, None),
)
COURSE_DEG = math.degrees(math.atan2(VELOCITY[1], VELOCITY[0])) % 360
YAW_DEG = math.degrees(YAW) % 360
# What every unit of the tables is in SI units, degrees or fractions.
UNITS = {
    "degE7": 1e-7, "mm": 1e-3, "m": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "m/s": 1.0,
    "cdeg": 1e-2, "deg": 1.0, "rad": 1.0, "rad/s": 1.0, "us": 1e-6, "ms": 1e-3,
    "mV": 1e-3, "cA": 1e-2, "%": 1e-2, "d%": 1e-3, "c%": 1e-4, "mAh": 1.0, "mG": 9.80665e-3,
}  # fmt: skip
_ALT = SNAPSHOT.position.alt_msl_m
_TRUE_ALT = SNAPSHOT.true_position.alt_msl_m
_GNSS = SNAPSHOT.gnss_position
assert _GNSS is not None
T = 12.345
# Of the standard atmosphere: the root of the density at the aircraft over that at sea level, and
# the altitude of the measured pressure.
DENSITY_ROOT = (1 - 2.25577e-5 * _ALT) ** (4.25588 / 2)
BARO_M = 44_330.77 * (1 - (948.90 / 1013.25) ** 0.190263)
# The physical value of every field that has a unit and that the vehicle knows.
EXPECTED: dict[str, dict[str, float]] = {
    "SYS_STATUS": {
        "voltage_battery": 15.87, "current_battery": 11.25, "battery_remaining": 0.61,
        "load": 0.0, "drop_rate_comm": 0.0,
    },
    "SYSTEM_TIME": {"time_boot_ms": T, "time_unix_usec": BOOTED_S + T},
    "GPS_RAW_INT": {
        "time_usec": 11.6, "lat": _GNSS.lat_deg, "lon": _GNSS.lon_deg, "alt": _GNSS.alt_msl_m,
        "vel": math.hypot(3.21, 4.56), "cog": COURSE_DEG,
        "h_acc": 0.7, "v_acc": 1.9, "vel_acc": 0.12,
    },
    "ATTITUDE": {
        "time_boot_ms": T, "roll": ROLL, "pitch": PITCH, "yaw": YAW,
        "rollspeed": 0.11, "pitchspeed": -0.22, "yawspeed": 0.33,
    },
    "ATTITUDE_QUATERNION": {
        "time_boot_ms": T, "rollspeed": 0.11, "pitchspeed": -0.22, "yawspeed": 0.33,
    },
    "LOCAL_POSITION_NED": {
        "time_boot_ms": T, "x": 321.5, "y": -123.25, "z": -61.75,
        "vx": 3.21, "vy": -4.56, "vz": -0.78,
    },
    "GLOBAL_POSITION_INT": {
        "time_boot_ms": T, "lat": SNAPSHOT.position.lat_deg, "lon": SNAPSHOT.position.lon_deg,
        "alt": _ALT, "relative_alt": _ALT - SNAPSHOT.home.alt_msl_m,
        "vx": 3.21, "vy": -4.56, "vz": -0.78, "hdg": YAW_DEG,
    },
    "VFR_HUD": {
        "airspeed": math.sqrt(3**2 + 4**2 + 0.78**2) * DENSITY_ROOT,
        "groundspeed": math.hypot(3.21, 4.56), "heading": round(YAW_DEG), "throttle": 0.5,
        "alt": _ALT, "climb": 0.78,
    },
    "ALTITUDE": {
        "time_usec": T, "altitude_monotonic": BARO_M, "altitude_amsl": _ALT,
        "altitude_local": 61.75, "altitude_relative": _ALT - SNAPSHOT.home.alt_msl_m,
    },
    "HOME_POSITION": {
        "latitude": SNAPSHOT.home.lat_deg, "longitude": SNAPSHOT.home.lon_deg,
        "altitude": SNAPSHOT.home.alt_msl_m, "x": 5.0, "y": 6.0, "z": -7.0, "time_usec": T,
        "approach_x": 5.0, "approach_y": 6.0, "approach_z": -7.0,
    },
    "GPS_GLOBAL_ORIGIN": {
        "latitude": HOME.lat_deg, "longitude": HOME.lon_deg, "altitude": HOME.alt_msl_m,
        "time_usec": T,
    },
    "BATTERY_STATUS": {
        "current_battery": 11.25, "current_consumed": 1234.0, "battery_remaining": 0.61,
    },
    "FLIGHT_INFORMATION": {
        "time_boot_ms": T, "arming_time_utc": 1.5, "takeoff_time_utc": 2.75, "landing_time": 9.25,
    },
    "HIL_STATE_QUATERNION": {
        "time_usec": T, "rollspeed": 0.11, "pitchspeed": -0.22, "yawspeed": 0.33,
        "lat": SNAPSHOT.true_position.lat_deg, "lon": SNAPSHOT.true_position.lon_deg,
        "alt": _TRUE_ALT, "vx": 3.5, "vy": -4.25, "vz": -0.5,
        "true_airspeed": math.sqrt(3.29**2 + 3.69**2 + 0.5**2),
        "ind_airspeed": math.sqrt(3.29**2 + 3.69**2 + 0.5**2) * DENSITY_ROOT,
        "xacc": 0.6, "yacc": -0.3, "zacc": -9.7,
    },
}  # fmt: skip
# Fields with a unit whose value is MAVLink's "unknown" or not given: nothing here measures them.
UNKNOWN: dict[str, dict[str, Any]] = {
    "GPS_RAW_INT": {"alt_ellipsoid": 0, "hdg_acc": 0, "yaw": 0},
    "ALTITUDE": {"altitude_terrain": -10_000.0, "bottom_clearance": -1.0},
    "BATTERY_STATUS": {
        "temperature": 32767, "energy_consumed": -1, "time_remaining": 0,
        "voltages": [15870] + [65535] * 9, "voltages_ext": [0] * 4,
    },
}  # fmt: skip


def over_the_wire(message: Any) -> Any:
    sender = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    heard = mav.MAVLink(None).parse_buffer(message.pack(sender))
    assert heard
    return heard[0]


@pytest.mark.parametrize(
    "kind",
    sorted(set(TELEMETRY) - set(INSTRUMENTS)),
    ids=lambda kind: mav.mavlink_map[kind].msgname,
)
def test_every_field_is_in_the_unit_of_the_table(kind: int) -> None:
    message = over_the_wire(TELEMETRY[kind](SNAPSHOT))
    expected = EXPECTED.get(message.msgname, {})
    unknown = UNKNOWN.get(message.msgname, {})
    assert set(message.fieldunits_by_name) == set(expected) | set(unknown)
    for field, unit in message.fieldunits_by_name.items():
        value = getattr(message, field)
        if field in unknown:
            assert value == pytest.approx(unknown[field], nan_ok=True), field
            continue
        scale = UNITS[unit]
        # Half a step of an integer field, or single precision of a float one.
        tolerance = max(0.5001 * scale if isinstance(value, int) else 0.0, 1e-6 * abs(value))
        assert value * scale == pytest.approx(expected[field], abs=tolerance), field


def test_fields_without_unit() -> None:
    heartbeat = over_the_wire(TELEMETRY[mav.MAVLINK_MSG_ID_HEARTBEAT](SNAPSHOT))
    assert (heartbeat.base_mode, heartbeat.custom_mode) == (157, 67371008)  # PX4 in a mission
    attitude = over_the_wire(TELEMETRY[mav.MAVLINK_MSG_ID_ATTITUDE_QUATERNION](SNAPSHOT))
    q = np.array([attitude.q1, attitude.q2, attitude.q3, attitude.q4])
    np.testing.assert_allclose(q, SNAPSHOT.belief.q_frd_to_ned, atol=1e-7)
    gnss = over_the_wire(TELEMETRY[mav.MAVLINK_MSG_ID_GPS_RAW_INT](SNAPSHOT))
    assert (gnss.fix_type, gnss.eph, gnss.epv, gnss.satellites_visible) == (3, 69, 112, 14)
    home = over_the_wire(TELEMETRY[mav.MAVLINK_MSG_ID_HOME_POSITION](SNAPSHOT))
    assert home.q == pytest.approx([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])  # to the east
    battery = over_the_wire(TELEMETRY[mav.MAVLINK_MSG_ID_BATTERY_STATUS](SNAPSHOT))
    assert battery.charge_state == mav.MAV_BATTERY_CHARGE_STATE_EMERGENCY
    version = over_the_wire(TELEMETRY[mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION](SNAPSHOT))
    assert version.capabilities & mav.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    number = version.flight_sw_version
    said = f"{number >> 24}.{number >> 16 & 255}.{number >> 8 & 255}"
    assert said == importlib.metadata.version("aerofed")


ITEM = MissionItem(
    seq=4, command=16, frame=3, params=(1.5, 2.5, 0.0, math.nan), x=47.1234567, y=-8.7654321, z=61.5
)


def test_positions_of_items_are_degrees_inside_and_deg_e7_on_the_wire() -> None:
    sent = over_the_wire(ITEM.message(Peer(255, 190)))
    assert (sent.x, sent.y, sent.z) == (471234567, -87654321, 61.5)
    assert (sent.target_system, sent.target_component) == (255, 190)
    item = read_item(sent)
    assert (item.x, item.y) == pytest.approx((ITEM.x, ITEM.y), abs=1e-12)
    assert math.isnan(item.params[3])
    assert replace(item, x=ITEM.x, y=ITEM.y, params=ITEM.params) == ITEM
    # By the message without integers, degrees travel as they are.
    plain = mav.MAVLink_mission_item_message(1, 1, 4, 3, 16, 0, 1, 0, 0, 0, 0, 47.5, -8.5, 61.5)
    assert (read_item(over_the_wire(plain)).x, read_item(over_the_wire(plain)).y) == (47.5, -8.5)


def test_command_int_scales_positions_only() -> None:
    for number, expected in (
        (mav.MAV_CMD_DO_REPOSITION, 12.5),
        (mav.MAV_CMD_REQUEST_MESSAGE, 125e6),
    ):
        order = mav.MAVLink_command_int_message(1, 1, 6, number, 0, 0, 0, 0, 0, 0, 125000000, 1, 2)
        body = read_order(over_the_wire(order))
        assert (body.command, body.frame) == (number, 6)
        assert body.params[4] == pytest.approx(expected)
    long = mav.MAVLink_command_long_message(
        1, 1, mav.MAV_CMD_DO_SET_HOME, 3, 0, 0, 0, 0, 12.5, 1, 2
    )
    read = read_order(over_the_wire(long))
    assert read == CommandOrder(179, (0, 0, 0, 0, 12.5, 1, 2), confirmation=3)


def test_nobody_elses_messages_are_read() -> None:
    station = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    wire = Wire(1, 1)
    other_vehicle = mav.MAVLink_mission_request_list_message(2, 1, 0)
    camera = mav.MAVLink_mission_request_list_message(1, 100, 0)
    everybody = mav.MAVLink_mission_request_list_message(0, 0, 0)
    sticks = [mav.MAVLink_manual_control_message(to, 0, 0, 500, 0, 0) for to in (0, 1, 2)]
    assert wire.read(other_vehicle.pack(station)) == []
    assert wire.read(camera.pack(station)) == []
    assert len(wire.read(everybody.pack(station))) == 1
    assert [len(wire.read(held.pack(station))) for held in sticks] == [1, 1, 0]


def test_ones_own_words_and_answers_to_nobodys_ping_are_not_read() -> None:
    ask, answer = (mav.MAVLink_ping_message(1, 2, to, to) for to in (0, 1))
    for system, component, heard in ((255, 190, 1), (1, 1, 0), (1, 2, 1), (2, 1, 1)):
        sender = mav.MAVLink(None, srcSystem=system, srcComponent=component)
        assert len(Wire(1, 1).read(ask.pack(sender))) == heard
        assert Wire(1, 1).read(answer.pack(sender)) == []


def test_frames_are_numbered_up_to_255() -> None:
    wire = Wire(7, 9)
    for number in (*range(256), 0, 1):
        frame = wire.pack(mav.MAVLink_system_time_message(1, 2))
        assert (frame[4], frame[5], frame[6]) == (number, 7, 9)


def test_whole_frames_of_a_stream_are_told_from_the_rest() -> None:
    station = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    one, two = (
        bytes(mav.MAVLink_mission_request_list_message(1, 1, kind).pack(station)) for kind in (0, 1)
    )
    damaged = bytearray(one)
    damaged[10] ^= 0xFF
    assert whole_frames(one + two) == (one + two, b"")
    assert whole_frames(b"noise" + one + bytes(damaged) + two[:7]) == (one, two[:7])
    assert whole_frames(two[:7]) == (b"", two[:7])


def test_damaged_datagrams_do_not_harm_the_next() -> None:
    station = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    wire = Wire(1, 1)
    good = bytes(mav.MAVLink_mission_request_list_message(1, 1, 0).pack(station))
    damaged = bytearray(good)
    damaged[10] ^= 0xFF
    # A lone start byte announces a frame of up to 280 bytes, which never comes.
    for noise in (b"\xfd", b"\xfd\xff", good[:9], bytes(damaged), b"noise", b"\xfe\x00"):
        assert wire.read(noise) == []
        assert len(wire.read(good + good)) == 2


def test_long_status_texts_are_split_and_end_with_a_short_chunk() -> None:
    outbox = Outbox()
    reporter = Reporter(outbox, lambda *_: None)
    for length in (1, 50, 51, 100, 120):
        text = "".join(chr(97 + i % 26) for i in range(length))
        reporter.say(text)
        heard = [over_the_wire(message) for _, message in outbox.take()]
        assert "".join(chunk.text for chunk in heard) == text
        assert [chunk.chunk_seq for chunk in heard] == list(range(len(heard)))
        assert len({chunk.id for chunk in heard}) == 1
        assert (heard[0].id == 0) == (length <= 50)
        assert len(heard) == 1 or len(heard[-1].text) < 50


def test_long_status_texts_are_numbered_from_1_to_65535_and_again() -> None:
    """0 is the number of those in one message, and there are 16 bits."""
    outbox = Outbox()
    reporter = Reporter(outbox, lambda *_: None)
    for _ in range(65_536):
        reporter.say("x" * 51)
    said = [message.to_dict() for _, message in outbox.take()]
    numbers = [message["id"] for message in said if message["chunk_seq"] == 0]
    assert numbers[:2] == [1, 2]
    assert numbers[-2:] == [65535, 1]
