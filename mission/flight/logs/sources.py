"""Where the logs of other programs have the signals of a flight: a row each.

DataFlash since ArduCopter 3.5: https://ardupilot.org/copter/docs/logmessages.html, ULog:
https://docs.px4.io/main/en/msg_docs/, telemetry logs: https://mavlink.io/en/messages/common.html.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from mission.base.arrays import Floats
from mission.log.signals import Source, euler_deg

_Making: TypeAlias = Callable[[Floats], Floats]


def _but(*unknown: float, scale: float = 1.0) -> _Making:
    """Values, but for those that stand for an unknown one."""
    return lambda values: np.where(np.isin(values, unknown), np.nan, values * scale)


def _masked(bits: int, scale: float = 1.0) -> _Making:
    """Values whose last column, a type mask, says by some bits that they are to be ignored."""
    return lambda values: np.where(
        values[:, -1:].astype(int) & bits, np.nan, values[:, :-1] * scale
    )


def _of_kinds(*kinds: int) -> _Making:
    """Values whose last column says their kind: those of some kinds."""
    return lambda values: np.where(np.isin(values[:, -1:], kinds), values[:, :-1], np.nan)


_NO_CELL = 65535
_MADE: dict[str, _Making | float] = {
    "rad": 180.0 / np.pi, "cm": 0.01, "mm": 0.001,
    "quaternion": euler_deg,
    "sum": lambda values: values.sum(axis=1, keepdims=True),
    "used": lambda values: values[:, np.isfinite(values).any(axis=0)],
    "not 0": _but(0), "not 255": _but(255), "DOP": _but(0, 65535, scale=0.01),
    "mm, not 0": _but(0, scale=0.001),
    "m, known": _but(4294967.5),  # the receiver's 2**32 - 1 mm as a float
    "%": 0.01, "%, cA": _but(-1, scale=0.01),
    "cells": lambda mv: np.where(mv == _NO_CELL, 0.0, mv / 1e3).sum(axis=1, keepdims=True),
    "of WP": _of_kinds(1, 3), "of WP, Pos": _of_kinds(1, 2, 3),
    "known xy": lambda v: np.column_stack((np.where(v[:, 3:], v[:, :2], np.nan), v[:, 2])),
    "mask 7": _masked(7), "mask 56": _masked(56), "mask 3, 1e-7": _masked(3, 1e-7),
}  # fmt: skip


def _sources(table: str) -> tuple[Source, ...]:
    """Rows of signal and first axis, message, columns (`q[4]`: four of them), and how it is made
    of them; `plain cm`: centimetres where the log does not tell units. `BAT 1`: the second one."""
    found = []
    for row in table.strip().splitlines():
        name, message, names, how, *_ = (*(part.strip() for part in row.split("|")), "")
        signal, _, axis = name.partition(" ")
        columns = [
            f"{column}[{n}]" if count else column
            for column, _, count in (each.rstrip("]").partition("[") for each in names.split())
            for n in range(int(count or 1))
        ]
        plain = 0.01 if how.endswith("plain cm") else 1.0
        by = _MADE.get(how.removesuffix(", plain cm"), 1.0)
        found.append(Source(signal, message, " ".join(columns), by, int(axis or 0), plain))
    return tuple(found)


# Positions in one message an axis since 4.2, before in two; before 4.0 in centimetres.
DATAFLASH = _sources(
    "\n".join(
        f"{told}{what} {n}|PSC{axis}|{letters}{axis}"
        for n, axis in enumerate("NED")
        for told, what, letters in (
            ("wanted_", "position_m", "TP"),
            ("", "position_m", "P"),
            ("wanted_", "velocity_mps", "TV"),
            ("", "velocity_mps", "V"),
        )
    )
) + _sources("""
wanted_position_m   | PSC    | TPX TPY
position_m          | PSC    | PX PY
wanted_velocity_mps | PSC    | TVX TVY
velocity_mps        | PSC    | VX VY
wanted_position_m   | NTUN   | DPosX DPosY             | plain cm
position_m          | NTUN   | PosX PosY               | plain cm
wanted_velocity_mps | NTUN   | DVelX DVelY             | plain cm
velocity_mps        | NTUN   | VelX VelY               | plain cm
goal_m              | GUIP   | pX pY Type              | of WP, Pos, plain cm
goal_m              | GUID   | pX pY Type              | of WP, plain cm
wanted_height_m     | CTUN   | DAlt
height_m            | CTUN   | Alt
wanted_attitude_deg | ATT    | DesRoll DesPitch DesYaw
attitude_deg        | ATT    | Roll Pitch Yaw
wanted_rates_degps  | RATE   | RDes PDes YDes
rates_degps         | RATE   | R P Y
vibration_mps2      | VIBE   | VibeX VibeY VibeZ
clips               | VIBE   | Clip0 Clip1 Clip2
clips               | VIBE   | Clip
clips 1             | VIBE 1 | Clip
clips 2             | VIBE 2 | Clip
innovation_ratio    | XKF4   | SV SP SH SM
innovation_ratio    | NKF4   | SV SP SH SM
innovation_ratio    | EKF4   | SV SP SH SM
gnss_fix            | GPS    | Status
satellites          | GPS    | NSats
hdop                | GPS    | HDop
gnss_accuracy_m     | GPA    | HAcc
voltage_v 1         | BAT 1  | Volt
current_a 1         | BAT 1  | Curr
remaining 1         | BAT 1  | RemPct                  | %
voltage_v 1         | CUR2   | Volt
current_a 1         | CUR2   | Curr
""")
# What the position controller was given; its velocity is what it asks for in all.
ULOG = _sources("""
wanted_position_m   | vehicle_local_position_setpoint | x y z
wanted_velocity_mps | vehicle_local_position_setpoint | vx vy vz
wanted_position_m   | trajectory_setpoint             | position[3]
wanted_velocity_mps | trajectory_setpoint             | velocity[3]
position_m          | vehicle_local_position          | x y z xy_valid                  | known xy
velocity_mps        | vehicle_local_position          | vx vy vz v_xy_valid             | known xy
position_m          | vehicle_local_position          | x y z
velocity_mps        | vehicle_local_position          | vx vy vz
wanted_attitude_deg | vehicle_attitude_setpoint       | q_d[4]                          | quaternion
wanted_attitude_deg | vehicle_attitude_setpoint       | roll_body pitch_body yaw_body   | rad
attitude_deg        | vehicle_attitude                | q[4]                            | quaternion
attitude_deg        | vehicle_attitude                | roll pitch yaw                  | rad
wanted_rates_degps  | vehicle_rates_setpoint          | roll pitch yaw                  | rad
rates_degps         | vehicle_angular_velocity        | xyz[3]                          | rad
rates_degps         | vehicle_attitude                | rollspeed pitchspeed yawspeed   | rad
vibration_mps2      | vehicle_imu_status              | accel_vibration_metric
clips               | vehicle_imu_status              | accel_clipping[3]               | sum
innovation_ratio    | estimator_status                | vel_test_ratio
innovation_ratio 1  | estimator_status                | pos_test_ratio
innovation_ratio 2  | estimator_status                | hgt_test_ratio
innovation_ratio 3  | estimator_status                | hdg_test_ratio
innovation_ratio 3  | estimator_status                | mag_test_ratio
gnss_fix            | vehicle_gps_position            | fix_type
satellites          | vehicle_gps_position            | satellites_used
hdop                | vehicle_gps_position            | hdop                            | not 0
gnss_accuracy_m     | vehicle_gps_position            | eph                             | m, known
gnss_fix            | sensor_gps                      | fix_type
satellites          | sensor_gps                      | satellites_used
hdop                | sensor_gps                      | hdop                            | not 0
gnss_accuracy_m     | sensor_gps                      | eph                             | m, known
motors              | actuator_motors                 | control[12]                     | used
""")
TLOG = _sources("""
goal_deg            | POSITION_TARGET_GLOBAL_INT | lat_int lon_int type_mask        | mask 3, 1e-7
height_error_m      | NAV_CONTROLLER_OUTPUT      | alt_error
position_m          | LOCAL_POSITION_NED         | x y z
velocity_mps        | LOCAL_POSITION_NED         | vx vy vz
velocity_mps        | GLOBAL_POSITION_INT        | vx vy vz                             | cm
height_m            | GLOBAL_POSITION_INT        | relative_alt                         | mm
wanted_attitude_deg | ATTITUDE_TARGET            | q[4]                                 | quaternion
wanted_attitude_deg | NAV_CONTROLLER_OUTPUT      | nav_roll nav_pitch nav_bearing
attitude_deg        | ATTITUDE                   | roll pitch yaw                       | rad
wanted_rates_degps  | ATTITUDE_TARGET | body_roll_rate body_pitch_rate body_yaw_rate | rad
rates_degps         | ATTITUDE                   | rollspeed pitchspeed yawspeed        | rad
clips               | VIBRATION                  | clipping_0 clipping_1 clipping_2
innovation_ratio    | EKF_STATUS_REPORT          | velocity_variance
innovation_ratio 1  | EKF_STATUS_REPORT          | pos_horiz_variance
innovation_ratio 2  | EKF_STATUS_REPORT          | pos_vert_variance
innovation_ratio 3  | EKF_STATUS_REPORT          | compass_variance
innovation_ratio    | ESTIMATOR_STATUS   | vel_ratio pos_horiz_ratio pos_vert_ratio mag_ratio
gnss_fix            | GPS_RAW_INT                | fix_type
satellites          | GPS_RAW_INT                | satellites_visible                   | not 255
hdop                | GPS_RAW_INT                | eph                                  | DOP
gnss_accuracy_m     | GPS_RAW_INT                | h_acc                                | mm, not 0
voltage_v           | BATTERY_STATUS             | voltages[10]                         | cells
current_a           | BATTERY_STATUS             | current_battery                      | %, cA
remaining           | BATTERY_STATUS             | battery_remaining                    | %, cA
voltage_v 1         | BATTERY_STATUS 1           | voltages[10]                         | cells
current_a 1         | BATTERY_STATUS 1           | current_battery                      | %, cA
remaining 1         | BATTERY_STATUS 1           | battery_remaining                    | %, cA
""")
# ArduPilot's target is where it heads for; PX4's VIBRATION has the accelerometers' in z only.
OF_ARDUPILOT = _sources("vibration_mps2 | VIBRATION | vibration_x vibration_y vibration_z")
OF_PX4 = _sources("""
wanted_position_m   | POSITION_TARGET_LOCAL_NED | x y z type_mask    | mask 7
wanted_velocity_mps | POSITION_TARGET_LOCAL_NED | vx vy vz type_mask | mask 56
vibration_mps2      | VIBRATION                 | vibration_z
""")
