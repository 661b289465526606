"""Every field that the vehicle sends, through a flight, held against common.xml and the truth."""

import math
import os
import re
import time
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
import pymavlink
import pytest
from pymavlink.dialects.v20 import common as mav
from scipy.spatial.transform import Rotation
from sitl_desk import Desk, item, of, speed_item, the
from sitl_mavsdk import HOME, make_vehicle

import sitl.autopilot
import sitl.autopilot.codec.traffic
from flightdyn.faults import GnssJump, GnssOff
from flightdyn.state import BatteryState
from sitl.autopilot.codec.telemetry import TELEMETRY
from sitl.config import VehicleConfig
from sitl.logfolder import LogFolder

OK = mav.MAV_RESULT_ACCEPTED
NAN = math.nan
FT_M, PA_PER_PSF = 0.3048, 47.880258980336
FIELD_GAUSS = (0.214, 0.013, 0.43)  # the sensors' default
STANDARD_G, SEA_LEVEL_SLUGS_FT3 = 9.80665, 0.00237691
CONFIG = VehicleConfig.model_validate(
    {
        "aircraft": {
            "wind": {"speed_mps": 5.0, "from_deg": 250.0, "turbulence_severity": 2},
            # Low, critical and almost empty in one flight, with nothing done about it.
            "battery": {"capacity_mah": 1000, "initial": 0.2},
        },
        "parameters": {"COM_LOW_BAT_ACT": 0},
    }
)
NAMES = {mav.mavlink_map[kind].msgname: kind for kind in TELEMETRY}
# What every unit of the definitions is in SI units, degrees or fractions.
UNITS = {
    "degE7": 1e-7, "mm": 1e-3, "m": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "m/s": 1.0, "m/s/s": 1.0,
    "cdeg": 1e-2, "deg": 1.0, "rad": 1.0, "rad/s": 1.0, "mrad/s": 1e-3, "us": 1e-6, "ms": 1e-3,
    "mV": 1e-3, "cA": 1e-2, "%": 1e-2, "mAh": 1.0, "mG": STANDARD_G * 1e-3, "gauss": 1.0,
    "mgauss": 1e-3, "hPa": 100.0, "degC": 1.0, "cdegC": 1e-2,
}  # fmt: skip

PROPERTIES = (
    "atmosphere/P-psf", "atmosphere/T-R", "atmosphere/rho-slugs_ft3", "velocities/vt-fps",
    "attitude/phi-rad", "attitude/theta-rad", "attitude/psi-rad",
)  # fmt: skip


@dataclass
class Moment:
    """What the vehicle said at one instant, and what was true then."""

    said: dict[str, Any]
    t_s: float
    armed: bool
    pos: tuple[float, float, float]
    vel: tuple[float, float, float]
    rates: tuple[float, float, float]
    wind: tuple[float, float, float]
    force: tuple[float, float, float]
    battery: BatteryState
    setpoint: Any
    thrusts_n: tuple[float, ...]
    fdm: dict[str, float]


@dataclass
class Flown:
    desk: Desk
    started_ns: tuple[int, int]
    moments: list[Moment] = field(default_factory=list)

    def sample(self) -> None:
        """One message of every kind, and the truth of that instant."""
        heard = self.desk.pass_wall_time(1.0, step=1.0)
        aircraft = self.desk.vehicle.aircraft
        model, truth = aircraft.vehicle, aircraft.truth
        self.moments.append(
            Moment(
                {m.get_type(): m for m in heard if m.get_type() in NAMES},
                aircraft.t_ns * 1e-9,
                aircraft.armed,
                tuple(truth.pos_ned_m.tolist()),
                tuple(truth.vel_ned_mps.tolist()),
                tuple(truth.omega_frd_radps.tolist()),
                model.wind_ned(),
                model.specific_force(),
                aircraft.battery,
                aircraft.instruments().setpoint,
                model.rotor_thrusts_n(),
                {name: model._fdm[name] for name in PROPERTIES},
            )
        )

    def pass_time(self, seconds: int) -> None:
        for _ in range(seconds):
            self.desk.fly(seconds=1.0)
            self.sample()

    def until(self, arrived: Callable[[], bool]) -> None:
        for _ in range(200):
            self.pass_time(1)
            if arrived():
                return
        pytest.fail("never came to an end")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """Take-off, climb, cruise, hover, an orbit and a landing, most of it as a mission, in wind."""
    folder = tmp_path_factory.mktemp("logs")
    for number, size in ((1, 100), (2, 250)):
        log = folder / f"flight-000{number}.mcap"
        log.write_bytes(bytes(range(size)))
        os.utime(log, (0, 1.7e9 + number))
    before = time.time_ns()
    aircraft = make_vehicle(config=CONFIG).aircraft
    desk = Desk(CONFIG, aircraft=aircraft, logs=LogFolder(folder))
    flown = Flown(desk, (before, time.time_ns()))
    for kind in TELEMETRY.keys() - {mav.MAVLINK_MSG_ID_HEARTBEAT}:
        assert desk.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, kind, 1e6) == OK
    flown.pass_time(2)
    ask_for_everything(desk)
    hold = (8.0, 0.0, 0.0, NAN)
    mission = [
        item(0, mav.MAV_CMD_NAV_TAKEOFF, height=20.0),
        speed_item(1, 9.0),
        item(2, mav.MAV_CMD_NAV_WAYPOINT, north=90.0, east=60.0, height=35.0, params=hold),
        item(3, mav.MAV_CMD_NAV_LAND, north=70.0, east=60.0, height=0.0),
    ]
    assert desk.upload(mission) == mav.MAV_MISSION_ACCEPTED
    desk.send(mav.MAVLink_mission_request_list_message(1, 1))
    for seq in range(len(mission)):
        desk.send(mav.MAVLink_mission_request_int_message(1, 1, seq))
        desk.send(mav.MAVLink_mission_request_message(1, 1, seq))
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == OK
    flown.pass_time(2)
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    flight = desk.vehicle.autopilot.flight
    flown.until(lambda: flight.mission.current == 3)
    at = (NAN, NAN, HOME.alt_msl_m + 35.0)
    assert desk.command(mav.MAV_CMD_DO_ORBIT, 12.0, 4.0, 0, NAN, *at) == OK
    flown.pass_time(12)
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 4, 4) == OK
    flown.until(lambda: not desk.vehicle.aircraft.armed)
    flown.pass_time(2)
    return flown


def ask_for_everything(desk: Desk) -> None:
    """Provoke every answer of the protocols, at least twice and differently."""
    for name, value in ((b"MPC_LAND_SPEED", 0.7), (b"GF_ACTION", 2.0), (b"NO_SUCH", 1.0)):
        desk.send(
            mav.MAVLink_param_set_message(1, 1, name, value, mav.MAV_PARAM_TYPE_REAL32),
            mav.MAVLink_param_ext_set_message(1, 1, name, b"1", 9),
        )
    desk.send(mav.MAVLink_param_request_read_message(1, 1, b"", 900))
    desk.send(mav.MAVLink_param_request_list_message(1, 1))
    desk.pass_wall_time(0.5)
    desk.send(mav.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    for log in (0, 1):
        desk.send(mav.MAVLink_log_request_data_message(1, 1, log, 0, 1000))
        desk.pass_wall_time(0.2)
    for kind in range(3):
        desk.send(mav.MAVLink_mission_request_list_message(1, 1, kind))
        desk.send(mav.MAVLink_mission_request_int_message(1, 1, 7, kind))
    for number in (1, 2):
        desk.send(mav.MAVLink_ping_message(number, number, 0, 0))
        desk.send(mav.MAVLink_timesync_message(0, number))
        desk.send(mav.MAVLink_file_transfer_protocol_message(0, 1, 1, [number] + [0] * 250))
        desk.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_MESSAGE_INTERVAL, number)
        typed = mav.SERIAL_CONTROL_FLAG_RESPOND
        desk.send(mav.MAVLink_serial_control_message(10, typed, 0, 0, 1, [10] + [0] * 69))
        desk.fly(seconds=0.1)
    desk.command(mav.MAV_CMD_GET_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_STATUSTEXT)
    assert desk.command(mav.MAV_CMD_NAV_LAND) != OK  # on the ground
    desk.command(mav.MAV_CMD_CONDITION_YAW, 1e30)  # refused in more than one STATUSTEXT
    rally = mav.MAV_MISSION_TYPE_RALLY
    point = item(0, mav.MAV_CMD_NAV_RALLY_POINT, mission_type=rally)
    assert desk.upload([point], rally) == mav.MAV_MISSION_ACCEPTED


# Fields that stay what they are through the flight, by the reason.
CONSTANT = {
    "the vehicle stays the same": """
        HEARTBEAT.type HEARTBEAT.autopilot HEARTBEAT.mavlink_version
        AUTOPILOT_VERSION.capabilities AUTOPILOT_VERSION.flight_sw_version AUTOPILOT_VERSION.uid
        SYS_STATUS.onboard_control_sensors_present SYS_STATUS.onboard_control_sensors_enabled
        BATTERY_STATUS.id BATTERY_STATUS.battery_function BATTERY_STATUS.type
        ODOMETRY.estimator_type ACTUATOR_OUTPUT_STATUS.active PARAM_VALUE.param_count""",
    "the only one": "HIGHRES_IMU.id RAW_IMU.id SERVO_OUTPUT_RAW.port",
    "a simulation has no such part": """
        AUTOPILOT_VERSION.board_version AUTOPILOT_VERSION.flight_custom_version
        AUTOPILOT_VERSION.middleware_sw_version AUTOPILOT_VERSION.middleware_custom_version
        AUTOPILOT_VERSION.os_sw_version AUTOPILOT_VERSION.os_custom_version
        AUTOPILOT_VERSION.vendor_id AUTOPILOT_VERSION.product_id AUTOPILOT_VERSION.uid2
        SYS_STATUS.load SYS_STATUS.drop_rate_comm SYS_STATUS.errors_comm SYS_STATUS.errors_count1
        SYS_STATUS.errors_count2 SYS_STATUS.errors_count3 SYS_STATUS.errors_count4
        SYS_STATUS.onboard_control_sensors_present_extended
        SYS_STATUS.onboard_control_sensors_enabled_extended
        SYS_STATUS.onboard_control_sensors_health_extended EXTENDED_SYS_STATE.vtol_state""",
    "not known, as its definition says it": """
        ALTITUDE.altitude_terrain ALTITUDE.bottom_clearance
        ATTITUDE_QUATERNION.repr_offset_q BATTERY_STATUS.temperature
        BATTERY_STATUS.energy_consumed BATTERY_STATUS.time_remaining BATTERY_STATUS.voltages_ext
        GPS_RAW_INT.yaw ODOMETRY.velocity_covariance ODOMETRY.quality
        SCALED_PRESSURE.temperature_press_diff WIND_COV.var_horiz WIND_COV.var_vert
        WIND_COV.horiz_accuracy WIND_COV.vert_accuracy""",
    "not known, and its definition has no word for that": """
        ESTIMATOR_STATUS.hagl_ratio ESTIMATOR_STATUS.tas_ratio GPS_RAW_INT.alt_ellipsoid
        GPS_RAW_INT.hdg_acc HIGHRES_IMU.diff_pressure SCALED_PRESSURE.press_diff""",
    "marked as not to be read": """
        ATTITUDE_TARGET.body_roll_rate ATTITUDE_TARGET.body_pitch_rate
        ATTITUDE_TARGET.body_yaw_rate""",
    "home, origin and circle stay where they are": """
        GPS_GLOBAL_ORIGIN.latitude GPS_GLOBAL_ORIGIN.longitude GPS_GLOBAL_ORIGIN.altitude
        HOME_POSITION.latitude HOME_POSITION.longitude HOME_POSITION.altitude HOME_POSITION.x
        HOME_POSITION.y HOME_POSITION.z HOME_POSITION.q HOME_POSITION.approach_x
        HOME_POSITION.approach_y HOME_POSITION.approach_z ORBIT_EXECUTION_STATUS.radius
        ORBIT_EXECUTION_STATUS.x ORBIT_EXECUTION_STATUS.y ORBIT_EXECUTION_STATUS.z""",
    "always given in that frame": """
        ODOMETRY.frame_id ODOMETRY.child_frame_id ORBIT_EXECUTION_STATUS.frame
        POSITION_TARGET_GLOBAL_INT.coordinate_frame POSITION_TARGET_LOCAL_NED.coordinate_frame""",
    "the receiver is as good all the way": """
        GPS_RAW_INT.fix_type GPS_RAW_INT.satellites_visible GPS_RAW_INT.eph GPS_RAW_INT.epv
        GPS_RAW_INT.h_acc GPS_RAW_INT.v_acc GPS_RAW_INT.vel_acc""",
    "nothing fails": """
        BATTERY_STATUS.mode BATTERY_STATUS.fault_bitmask ESTIMATOR_STATUS.flags
        ODOMETRY.reset_counter VIBRATION.clipping_0 VIBRATION.clipping_1 VIBRATION.clipping_2""",
    "every message has new readings": "HIGHRES_IMU.fields_updated",
    "there are four motors": " ".join(f"SERVO_OUTPUT_RAW.servo{i}_raw" for i in range(5, 17)),
    "an answer to the only station": " ".join(
        f"{name}.target_{part}"
        for name in ("COMMAND_ACK", "FILE_TRANSFER_PROTOCOL", "MISSION_ACK", "MISSION_COUNT",
                     "MISSION_ITEM", "MISSION_ITEM_INT", "MISSION_REQUEST_INT", "PARAM_ERROR",
                     "PING")
        for part in ("network", "system", "component")
    ),
    "the same answer to the same question": """
        COMMAND_ACK.progress COMMAND_ACK.result_param2 LOG_ENTRY.num_logs LOG_ENTRY.last_log_num
        MISSION_ITEM_INT.current MISSION_ITEM_INT.autocontinue MISSION_ITEM_INT.param3
        MISSION_ITEM_INT.mission_type MISSION_ITEM.current MISSION_ITEM.autocontinue
        MISSION_ITEM.param3 MISSION_ITEM.mission_type
        PARAM_EXT_ACK.param_result PARAM_EXT_ACK.param_type PARAM_EXT_ACK.param_value
        SERIAL_CONTROL.device SERIAL_CONTROL.flags
        SERIAL_CONTROL.timeout SERIAL_CONTROL.baudrate SERIAL_CONTROL.count
        SERIAL_CONTROL.data""",
}  # fmt: skip


def names(reason: str) -> set[str]:
    return set(CONSTANT[reason].split())


def test_a_field_is_constant_for_a_reason_only(flown: Flown) -> None:
    heard = defaultdict(list)
    for message in flown.desk.heard:
        heard[message.get_type()].append(message)
    source = set(Path(sitl.autopilot.__path__[0]).rglob("*.py"))
    source -= {Path(sitl.autopilot.codec.traffic.__file__)}  # of others; this one flies alone
    made = re.findall(r"mav\.MAVLink_(\w+)_message\(", "".join(map(Path.read_text, source)))
    assert {*NAMES, *(name.upper() for name in made)} <= set(heard)
    constant = {
        f"{name}.{part}"
        for name, messages in heard.items()
        for part in messages[0].fieldnames
        if len({repr(getattr(message, part)) for message in messages}) == 1
    }
    listed = {name for reason in CONSTANT for name in names(reason)}
    assert constant - listed == set()
    assert {name for name in listed - constant if name.split(".")[0] in NAMES} == set()


@cache
def invalid() -> dict[str, str]:
    """What common.xml calls the invalid value of a field, by message and field."""
    folder = Path(pymavlink.__path__[0]) / "dialects" / "v20"
    return {
        f"{message.get('name')}.{part.get('name')}": part.get("invalid", "")
        for name in ("minimal", "standard", "common")
        for message in ET.parse(folder / f"{name}.xml").getroot().iter("message")
        for part in message.iter("field")
        if part.get("invalid") is not None
    }


NUMBERS = {"UINT8_MAX": 255, "INT16_MAX": 32767, "UINT16_MAX": 65535, "NaN": NAN}


def is_invalid(name: str, value: Any) -> bool:
    """Whether a field has its invalid value; of `[x:]` the first element decides, of `[x]` all."""
    said = invalid()[name]
    word = said.strip("[:]")
    wanted = NUMBERS[word] if word in NUMBERS else float(word)
    parts = value if isinstance(value, list) else [value]
    return all(
        part == pytest.approx(wanted, nan_ok=True) for part in parts[: 1 if ":" in said else None]
    )


def test_what_is_unknown_is_said_as_the_definition_has_it(flown: Flown) -> None:
    unknown = names("not known, as its definition says it")
    in_words = {  # of the fields' descriptions
        "ALTITUDE.altitude_terrain": lambda value: value < -1000,
        "ALTITUDE.bottom_clearance": lambda value: value < 0,
        "BATTERY_STATUS.time_remaining": lambda value: value == 0,
        "BATTERY_STATUS.voltages_ext": lambda value: not any(value),
    }
    assert unknown - set(in_words) <= set(invalid())
    not_yet = {"FLIGHT_INFORMATION.landing_time"}
    for moment in [m for m in flown.moments if m.pos[2] < -5.0] + flown.moments[-1:]:
        for name in unknown | {name for name in invalid() if name.split(".")[0] in NAMES}:
            kind, part = name.split(".")
            if kind not in moment.said or (name in not_yet and moment.armed):
                continue
            value = getattr(moment.said[kind], part)
            right = in_words[name](value) if name in in_words else is_invalid(name, value)
            assert right == (name in unknown), (name, value)


Truth = dict[str, tuple[float, float]]  # by field: value in SI units or degrees, and tolerance


def each(pattern: str, parts: Iterable[float], tolerance: float) -> Truth:
    """The fields of three axes, named by `pattern`."""
    named = zip("xyz", parts, strict=True)
    return {pattern.format(axis): (float(part), tolerance) for axis, part in named}


def truth(m: Moment) -> dict[str, Truth]:
    """The physical value of fields with a unit, from the simulated world and closed forms."""
    lat, lon, alt = pymap3d.ned2geodetic(*m.pos, HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m)
    north, east, down = m.vel
    roll, pitch, yaw = (m.fdm[f"attitude/{angle}-rad"] for angle in ("phi", "theta", "psi"))
    heading = math.degrees(yaw)
    to_body = Rotation.from_euler("ZYX", [yaw, pitch, roll]).inv()
    speed, height = math.hypot(north, east), alt - HOME.alt_msl_m
    through_air = m.fdm["velocities/vt-fps"] * FT_M
    indicated = through_air * math.sqrt(m.fdm["atmosphere/rho-slugs_ft3"] / SEA_LEVEL_SLUGS_FT3)
    pressure = m.fdm["atmosphere/P-psf"] * PA_PER_PSF
    celsius = {"temperature": (m.fdm["atmosphere/T-R"] / 1.8 - 273.15, 0.3)}
    rotors = [math.sqrt(max(0.0, thrust) / 16.6) for thrust in m.thrusts_n]
    # As far as the estimate may be from the truth.
    at_m, at_deg, up_m, at_mps, lean, turned = 4.0, 4.0 / 111e3, 3.0, 0.8, 0.06, 0.15
    body_rates = ("rollspeed", "pitchspeed", "yawspeed")
    rates = {name: (part, 0.1) for name, part in zip(body_rates, m.rates, strict=True)}
    place = {"lat": (lat, at_deg), "lon": (lon, at_deg), "alt": (alt, up_m)}
    local = each("{}", m.pos, at_m)
    velocity = each("v{}", m.vel, at_mps)
    imu = each("{}acc", m.force, 0.5) | each("{}gyro", m.rates, 0.1)
    imu |= each("{}mag", to_body.apply(FIELD_GAUSS), 0.1) | celsius
    home = {
        "latitude": (HOME.lat_deg, 0.0), "longitude": (HOME.lon_deg, 0.0),
        "altitude": (HOME.alt_msl_m, 0.0),
    }  # fmt: skip
    battery = {
        "current_battery": (m.battery.current_a, 0.0),
        "battery_remaining": (m.battery.remaining, 0.0),
    }
    found: dict[str, Truth] = {
        "SYS_STATUS": battery | {"voltage_battery": (m.battery.voltage_v, 0.0)},
        "BATTERY_STATUS": battery | {"current_consumed": (m.battery.consumed_mah, 0.0)},
        # Of an instant up to 0.4 s ago.
        "GPS_RAW_INT": {
            "lat": (lat, 2 * at_deg), "lon": (lon, 2 * at_deg), "alt": (alt, 9.0),
            "vel": (speed, 2.0), "h_acc": (0.702, 1e-3), "v_acc": (1.971, 1e-3),
            "vel_acc": (0.09, 1e-3),
        },
        "ATTITUDE": rates | {"roll": (roll, lean), "pitch": (pitch, lean), "yaw": (yaw, turned)},
        "ATTITUDE_QUATERNION": rates,
        "LOCAL_POSITION_NED": local | velocity,
        "GLOBAL_POSITION_INT": place | velocity
        | {"relative_alt": (height, up_m), "hdg": (heading, math.degrees(turned))},
        "VFR_HUD": {
            "airspeed": (indicated, at_mps), "groundspeed": (speed, at_mps),
            "heading": (heading, math.degrees(turned)),
            "throttle": (float(np.mean(rotors)) if m.armed else 0.0, 0.12),
            "alt": (alt, up_m), "climb": (-down, at_mps),
        },
        "ALTITUDE": {
            "altitude_monotonic": (alt, up_m), "altitude_amsl": (alt, up_m),
            "altitude_local": (-m.pos[2], up_m), "altitude_relative": (height, up_m),
        },
        "HOME_POSITION": home | each("{}", (0, 0, 0), 0.0) | each("approach_{}", (0, 0, 0), 0.0),
        "GPS_GLOBAL_ORIGIN": home,
        "HIL_STATE_QUATERNION": {name: (part, 1e-6) for name, (part, _) in rates.items()}
        | each("v{}", m.vel, 1e-9) | each("{}acc", m.force, 1e-9)
        | {
            "lat": (lat, 1e-9), "lon": (lon, 1e-9), "alt": (alt, 1e-6),
            "true_airspeed": (through_air, 0.02), "ind_airspeed": (indicated, 0.02),
        },
        "SCALED_IMU": imu,
        "RAW_IMU": imu,
        "HIGHRES_IMU": imu | {"abs_pressure": (pressure, 15.0)},
        "SCALED_PRESSURE": celsius | {"press_abs": (pressure, 15.0)},
        "SERVO_OUTPUT_RAW": {
            f"servo{i}_raw": (1e-3 * (1 + rotor), 0.0) for i, rotor in enumerate(rotors, 1)
        },
        "ODOMETRY": local | rates | each("v{}", to_body.apply(m.vel), 1.5),
        "WIND_COV": each("wind_{}", m.wind, 1e-6) | {"wind_alt": (alt, up_m)},
        "ORBIT_EXECUTION_STATUS": {"radius": (12.0, 0.0), "z": (HOME.alt_msl_m + 35.0, 1e-3)},
    }  # fmt: skip
    if speed > 3.0:
        found["GPS_RAW_INT"]["cog"] = (math.degrees(math.atan2(east, north)), 20.0)
    if m.setpoint is not None:
        to = m.setpoint
        target = each("v{}", to.v, 1e-5) | each("af{}", to.a, 1e-5)
        target |= {"yaw": (to.yaw, 1e-5), "yaw_rate": (to.yaw_rate, 1e-5)}
        found["POSITION_TARGET_LOCAL_NED"] = target | each("{}", to.p, 1e-4)
        lat, lon, alt = pymap3d.ned2geodetic(*to.p, HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m)
        found["POSITION_TARGET_GLOBAL_INT"] = target | {
            "lat_int": (lat, 1e-9), "lon_int": (lon, 1e-9), "alt": (alt, 1e-4),
        }  # fmt: skip
    return found


def off(value: float, wanted: float, unit: str) -> float:
    """How far a value is from the wanted one, of angles the short way round."""
    turn = {"rad": math.tau, "deg": 360.0, "cdeg": 360.0}.get(unit, 0.0)
    return abs(math.remainder(value - wanted, turn)) if turn else abs(value - wanted)


def test_every_number_is_in_its_unit(flown: Flown) -> None:
    checked = {f"FLIGHT_INFORMATION.{part}" for part in FLIGHT_TIMES} | {
        "BATTERY_STATUS.voltages", "ESTIMATOR_STATUS.pos_horiz_accuracy", "GPS_RAW_INT.time_usec",
        "ESTIMATOR_STATUS.pos_vert_accuracy", "SYSTEM_TIME.time_unix_usec",
    }  # below  # fmt: skip
    for moment in flown.moments:
        for kind, message in moment.said.items():
            fields = truth(moment).get(kind, {})
            for clock in {"time_usec", "time_boot_ms"} & set(message.fieldnames):
                late_s = 0.45 if kind == "GPS_RAW_INT" else 1e-3
                fields[clock] = (moment.t_s, late_s)
            for part, (wanted, tolerance) in fields.items():
                unit, value = message.fieldunits_by_name[part], getattr(message, part)
                # Half a step of an integer field, or single precision of a float one.
                step = 0.5001 * UNITS[unit] if isinstance(value, int) else 1e-6 * (1 + abs(wanted))
                error = off(value * UNITS[unit], wanted, unit)
                assert error <= tolerance + step, (kind, part, value, wanted)
                checked.add(f"{kind}.{part}")
    united = {
        f"{name}.{part}"
        for name, kind in NAMES.items()
        for part in mav.mavlink_map[kind].fieldunits_by_name
    }
    assert united - checked - {name for reason in CONSTANT for name in names(reason)} == set()


FLIGHT_TIMES = {"arming_time_utc": 1e-6, "takeoff_time_utc": 1e-6, "landing_time": 1e-3}


def test_when_it_was_armed_took_off_and_landed(flown: Flown) -> None:
    """The first and last instants off the ground are known to a second, of the samples."""
    armed_ns, disarmed_ns = (event.t_ns for event in flown.desk.recorder.of_kind("armed"))
    flying = [moment for moment in flown.moments if moment.pos[2] < -0.2]
    told = [
        [getattr(m.said["FLIGHT_INFORMATION"], part) * s for part, s in FLIGHT_TIMES.items()]
        for m in (flown.moments[0], *flying, flown.moments[-1])
    ]
    assert told[0] == [0, 0, 0]
    armed_s, took_off_s, landed_s = told[-1]
    assert all(row == [armed_s, took_off_s, 0] for row in told[1:-1])
    assert armed_s == pytest.approx(armed_ns * 1e-9, abs=1e-6)
    assert armed_s < took_off_s <= flying[0].t_s <= took_off_s + 1.5
    # It is disarmed COM_DISARM_LAND (1 s) after it has landed.
    assert landed_s == pytest.approx(disarmed_ns * 1e-9 - 1.0, abs=0.15)
    states = [m.said["EXTENDED_SYS_STATE"].landed_state for m in flown.moments]
    assert [b for a, b in zip([None, *states], states, strict=False) if a != b] == [
        mav.MAV_LANDED_STATE_ON_GROUND, mav.MAV_LANDED_STATE_TAKEOFF, mav.MAV_LANDED_STATE_IN_AIR,
        mav.MAV_LANDED_STATE_LANDING, mav.MAV_LANDED_STATE_ON_GROUND,
    ]  # fmt: skip


def test_the_date_is_that_of_switching_on_and_passes_as_simulated_time_does(flown: Flown) -> None:
    for moment in flown.moments:
        said = moment.said["SYSTEM_TIME"]
        zero_us = said.time_unix_usec - moment.t_s * 1e6
        assert flown.started_ns[0] / 1e3 - 1 <= zero_us <= flown.started_ns[1] / 1e3 + 1
    # The stamps of TIMESYNC are those of telemetry, and never 0, which would be a question.
    replies = [m.tc1 for m in of(flown.desk.heard, "TIMESYNC")]
    assert replies[1] - replies[0] == 100_000_000
    early = Desk(ready=False)
    assert the(early.send(mav.MAVLink_timesync_message(0, 42)), "TIMESYNC").tc1 == 1


def test_the_battery_from_full_to_almost_empty(flown: Flown) -> None:
    states = []
    for moment in flown.moments:
        said = moment.said["BATTERY_STATUS"]
        assert said.voltages == [round(moment.battery.voltage_v * 1e3)] + [65535] * 9
        states.append(said.charge_state)
        if moment.armed:  # "always healthy when armed"
            health = moment.said["SYS_STATUS"].onboard_control_sensors_health
            assert health & mav.MAV_SYS_STATUS_PREARM_CHECK
    assert [b for a, b in zip([None, *states], states, strict=False) if a != b] == [1, 2, 3, 4]


def test_the_estimate_is_as_good_as_it_says(flown: Flown) -> None:
    for moment in flown.moments:
        said, at = moment.said["ESTIMATOR_STATUS"], moment.said["LOCAL_POSITION_NED"]
        across_m = math.hypot(at.x - moment.pos[0], at.y - moment.pos[1])
        assert 0.3 < said.pos_horiz_accuracy < 2.0
        assert across_m < 4 * said.pos_horiz_accuracy
        assert 0.0 < said.pos_vert_accuracy < 0.5


def test_dilution_of_precision_is_that_of_satellites_all_over_the_sky(flown: Flown) -> None:
    rng = np.random.default_rng(1)
    up = rng.uniform(math.sin(math.radians(10.0)), 1.0, 200_000)
    round_ = rng.uniform(0.0, math.tau, len(up))
    level = np.sqrt(1 - up**2)
    sight = np.column_stack([level * np.cos(round_), level * np.sin(round_), up, np.ones(len(up))])
    cofactors = np.linalg.inv(sight.T @ sight / len(up) * 14)
    fix = flown.moments[-1].said["GPS_RAW_INT"]
    assert fix.satellites_visible == 14
    assert fix.eph / 100 == pytest.approx(math.sqrt(cofactors[0, 0] + cofactors[1, 1]), rel=0.01)
    assert fix.epv / 100 == pytest.approx(math.sqrt(cofactors[2, 2]), rel=0.01)


def test_without_a_fix_and_with_a_wrong_one() -> None:
    desk = Desk(aircraft=make_vehicle().aircraft)
    desk.take_off(20.0)
    desk.vehicle.aircraft.inject(GnssJump(north_m=40.0))
    desk.fly(seconds=1.0)
    assert asked(desk, "ESTIMATOR_STATUS").flags & mav.ESTIMATOR_GPS_GLITCH
    desk.vehicle.aircraft.inject(GnssOff())
    desk.fly(seconds=3.0)
    said = asked(desk, "GPS_RAW_INT")
    assert said.fix_type == mav.GPS_FIX_TYPE_NO_FIX
    for part in ("eph", "epv", "vel", "cog", "satellites_visible"):
        assert is_invalid(f"GPS_RAW_INT.{part}", getattr(said, part)), part
    assert not asked(desk, "ESTIMATOR_STATUS").flags & mav.ESTIMATOR_POS_HORIZ_ABS


def test_motors_off_nothing_is_commanded(flown: Flown) -> None:
    for moment in (flown.moments[0], flown.moments[-1]):
        target = moment.said["ATTITUDE_TARGET"]
        ignored = (
            mav.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
            | mav.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE
        )
        assert (target.type_mask & ignored, target.thrust) == (ignored, 0.0)
        assert moment.said["VFR_HUD"].throttle == 0
    flying = flown.moments[len(flown.moments) // 2].said["ATTITUDE_TARGET"]
    assert (flying.type_mask, flying.thrust) == (0b111, pytest.approx(0.5, abs=0.1))


def test_home_has_the_heading_of_the_take_off() -> None:
    config = VehicleConfig.model_validate({"aircraft": {"heading_deg": 120.0}})
    desk = Desk(aircraft=make_vehicle(config=config).aircraft)
    w, x, y, z = asked(desk, "HOME_POSITION").q
    assert (x, y) == (0.0, 0.0)
    assert math.degrees(2 * math.atan2(z, w)) == pytest.approx(120.0, abs=8.0)


def test_without_a_mission_there_is_no_number_of_items() -> None:
    desk = Desk()
    assert is_invalid("MISSION_CURRENT.total", asked(desk, "MISSION_CURRENT").total)
    desk.upload([item(0, mav.MAV_CMD_NAV_WAYPOINT)])
    assert asked(desk, "MISSION_CURRENT").total == 1


def asked(desk: Desk, name: str) -> Any:
    assert desk.command(mav.MAV_CMD_REQUEST_MESSAGE, NAMES[name]) == OK
    return of(desk.heard, name)[-1]
