"""Every field of the messages about sensors, setpoints and motors, from readings all unlike."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from scipy.spatial.transform import Rotation

from flightdyn.guidance.control import Setpoint
from flightdyn.instruments import Instruments, Readings
from flightdyn.state import GeodeticPoint, Kinematics
from sitl.autopilot.codec.instruments import INSTRUMENTS

NAN, ZERO = math.nan, [0.0] * 21
T_NS = 4_300_123_456_789  # beyond 2**32 us
X, Y, Z, W = Rotation.from_euler("ZYX", (2.0, -0.4, 0.3)).as_quat()
VELOCITY = (3.0, -4.0, 1.5)
STDS = np.array([0.3, 0.4, 0.7, 0.01, 0.02, 0.03, 0.1, 0.2, 0.5])
READINGS = Readings(
    rates_radps=(0.1, -0.2, 0.3), specific_force_mps2=(1.0, -2.0, -9.80665),
    # The standard atmosphere at 1000 m: 898.746 hPa, 281.65 K.
    pressure_pa=89_874.6, field_gauss=(0.25, -0.125, 0.5), vibration_mps2=(0.01, 0.02, 0.03),
    stds=STDS,
)  # fmt: skip
SETPOINT = Setpoint((1.0, 2.0, -3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0), 0.5, 0.25)
PLACE = GeodeticPoint(47.5, -8.25, 512.5)


def told(kind: str, *, readings: Readings = READINGS, **changed: Any) -> dict[str, Any] | None:
    """The fields of a message, over the wire."""
    instruments = Instruments(
        readings, changed.pop("setpoint", SETPOINT), (0.5, -0.5, 0.5, -0.5), 0.625,
        (0.25, 0.5, 0.75, 1.0), np.array([-1.0, 2.0, 0.5]), (0.0, 0.0, -9.8),
    )  # fmt: skip
    deferred = {"target": PLACE, "innovation_ratios": {}, "orbit": (-12.5, PLACE)}
    deferred |= {key: changed.pop(key) for key in tuple(changed) if key in deferred}
    belief = Kinematics.of(T_NS, 10.0, 20.0, -30.0, *VELOCITY, W, X, Y, Z, 0.4, 0.5, -0.6)
    moment: Any = SimpleNamespace(**{
        "t_ns": T_NS, "belief": belief, "position": GeodeticPoint(47.0, 8.0, 530.0), "armed": True,
        "gnss": None, "deferred": SimpleNamespace(instruments=instruments, **deferred), **changed,
    })  # fmt: skip
    message = INSTRUMENTS[getattr(mav, f"MAVLINK_MSG_ID_{kind}")](moment)
    if message is None:
        return None
    heard: Any = mav.MAVLink(None).parse_buffer(message.pack(mav.MAVLink(None)))
    fields: dict[str, Any] = heard[0].to_dict()
    assert fields.pop("mavpackettype") == kind
    return fields


IMU = {
    "xacc": 102, "yacc": -204, "zacc": -1000, "xgyro": 100, "ygyro": -200, "zgyro": 300,
    "xmag": 250, "ymag": -125, "zmag": 500, "temperature": 850,
}  # fmt: skip
US, MS = 4_300_123_456, 4_300_123
N, E, D = Rotation.from_quat((X, Y, Z, W)).inv().apply(VELOCITY).tolist()
POSE = {0: 0.09, 6: 0.16, 11: 0.49, 15: 0.01, 18: 0.04, 20: 0.25}
ORDERED = {
    "type_mask": 0, "vx": 4.0, "vy": 5.0, "vz": 6.0, "afx": 7.0, "afy": 8.0, "afz": 9.0,
    "yaw": 0.5, "yaw_rate": 0.25, "time_boot_ms": MS,
}  # fmt: skip
EXPECTED: dict[str, dict[str, Any]] = {
    "RAW_IMU": {"time_usec": US, "id": 0, **IMU},
    "SCALED_IMU": {"time_boot_ms": MS, **IMU},
    "SCALED_PRESSURE": {
        "time_boot_ms": MS, "press_abs": 898.746, "press_diff": 0.0, "temperature": 850,
        "temperature_press_diff": 0,
    },
    "HIGHRES_IMU": {
        "time_usec": US, "xacc": 1.0, "yacc": -2.0, "zacc": -9.80665, "xgyro": 0.1, "ygyro": -0.2,
        "zgyro": 0.3, "xmag": 0.25, "ymag": -0.125, "zmag": 0.5, "abs_pressure": 898.746,
        "diff_pressure": 0.0, "pressure_alt": pytest.approx(1000.0, abs=0.1),
        "temperature": pytest.approx(8.5, abs=0.001), "id": 0,
        "fields_updated": 0b1101111111111,  # all but the difference of pressures
    },
    "SERVO_OUTPUT_RAW": {
        "time_usec": US % 2**32, "port": 0, "servo1_raw": 1250, "servo2_raw": 1500,
        "servo3_raw": 1750, "servo4_raw": 2000, **{f"servo{i}_raw": 0 for i in range(5, 17)},
    },
    "ACTUATOR_OUTPUT_STATUS": {
        "time_usec": US, "active": 15, "actuator": [0.25, 0.5, 0.75, 1.0] + [0.0] * 28,
    },
    "ATTITUDE_TARGET": {
        "time_boot_ms": MS, "type_mask": 7, "q": [0.5, -0.5, 0.5, -0.5], "thrust": 0.625,
        "body_roll_rate": 0.0, "body_pitch_rate": 0.0, "body_yaw_rate": 0.0,
    },
    "POSITION_TARGET_LOCAL_NED": {"coordinate_frame": 1, "x": 1.0, "y": 2.0, "z": -3.0, **ORDERED},
    "POSITION_TARGET_GLOBAL_INT": {
        "coordinate_frame": 5, "lat_int": 475000000, "lon_int": -82500000, "alt": 512.5, **ORDERED,
    },
    "WIND_COV": {
        "time_usec": US, "wind_x": -1.0, "wind_y": 2.0, "wind_z": 0.5, "var_horiz": NAN,
        "var_vert": NAN, "wind_alt": 530.0, "horiz_accuracy": 0.0, "vert_accuracy": 0.0,
    },
    "VIBRATION": {
        "time_usec": US, "vibration_x": 0.01, "vibration_y": 0.02, "vibration_z": 0.03,
        "clipping_0": 0, "clipping_1": 0, "clipping_2": 0,
    },
    "ODOMETRY": {
        "time_usec": US, "frame_id": 1, "child_frame_id": 12, "x": 10.0, "y": 20.0, "z": -30.0,
        "q": [W, X, Y, Z], "vx": N, "vy": E, "vz": D, "rollspeed": 0.4, "pitchspeed": 0.5,
        "yawspeed": -0.6, "pose_covariance": [POSE.get(i, 0.0) for i in range(21)],
        "velocity_covariance": [NAN] + [0.0] * 20, "reset_counter": 0, "estimator_type": 8,
        "quality": 0,
    },
    "ORBIT_EXECUTION_STATUS": {
        "time_usec": US, "radius": -12.5, "frame": 5, "x": 475000000, "y": -82500000, "z": 512.5,
    },
    "ESTIMATOR_STATUS": {
        "time_usec": US, "flags": 1 | 2 | 4 | 8 | 32 | 256, "vel_ratio": 0.0,
        "pos_horiz_ratio": 0.0, "pos_vert_ratio": 0.0, "mag_ratio": 0.0, "hagl_ratio": 0.0,
        "tas_ratio": 0.0, "pos_horiz_accuracy": 0.5, "pos_vert_accuracy": 0.7,
    },
}  # fmt: skip


def same(found: dict[str, Any] | None, expected: dict[str, Any]) -> None:
    assert found is not None
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        close = value
        if isinstance(value, float | list):
            close = pytest.approx(value, rel=1e-6, abs=1e-7, nan_ok=True)
        assert found[name] == close, name


@pytest.mark.parametrize("kind", EXPECTED)
def test_every_field_has_its_reading(kind: str) -> None:
    same(told(kind), EXPECTED[kind])


def test_every_message_is_looked_at() -> None:
    assert {mav.mavlink_map[number].msgname for number in INSTRUMENTS} == set(EXPECTED)


def test_what_there_is_not_is_left_out() -> None:
    bare = READINGS._replace(field_gauss=None, stds=None)
    no_field = {"xmag": 0, "ymag": 0, "zmag": 0}
    same(told("RAW_IMU", readings=bare), EXPECTED["RAW_IMU"] | no_field)
    high = told("HIGHRES_IMU", readings=bare)
    same(high, EXPECTED["HIGHRES_IMU"] | no_field | {"fields_updated": 0b1101000111111})
    unknown = {"pose_covariance": [NAN, *ZERO[1:]]}
    same(told("ODOMETRY", readings=bare), EXPECTED["ODOMETRY"] | unknown)
    flat = {"pos_horiz_accuracy": 0.0, "pos_vert_accuracy": 0.0}
    same(told("ESTIMATOR_STATUS", readings=bare), EXPECTED["ESTIMATOR_STATUS"] | flat)
    disarmed = {"type_mask": 0b11000111}
    same(told("ATTITUDE_TARGET", armed=False), EXPECTED["ATTITUDE_TARGET"] | disarmed)
    none = dict.fromkeys(("vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), NAN)
    none |= {"type_mask": 0b110111111111}
    local = dict.fromkeys("xyz", NAN)
    same(told("POSITION_TARGET_LOCAL_NED", setpoint=None),
         EXPECTED["POSITION_TARGET_LOCAL_NED"] | none | local)  # fmt: skip
    same(told("POSITION_TARGET_GLOBAL_INT", setpoint=None, target=None),
         EXPECTED["POSITION_TARGET_GLOBAL_INT"] | none | {"lat_int": 0, "lon_int": 0, "alt": NAN},
    )  # fmt: skip
    assert told("ORBIT_EXECUTION_STATUS", orbit=None) is None


@pytest.mark.parametrize(("ratio", "glitch"), [(0.999, 0), (1.0, 1024), (1.2, 1024)])
@pytest.mark.parametrize("kind", ["gnss position", "gnss velocity"])
def test_a_refused_fix_is_a_glitch(kind: str, ratio: float, glitch: int) -> None:
    said = told("ESTIMATOR_STATUS", innovation_ratios={kind: ratio}, gnss=object())
    assert said is not None
    assert said["flags"] == 1 | 2 | 4 | 8 | 16 | 32 | 256 | 512 | glitch


def test_freezing_air_is_not_without_a_thermometer() -> None:
    """0 means that there is none; at 2307.69 m it is 0 degrees."""
    pressure_pa = 101_325.0 * (273.15 / 288.15) ** 5.25588
    said = told("RAW_IMU", readings=READINGS._replace(pressure_pa=pressure_pa))
    assert said is not None
    assert said["temperature"] == 1
