"""Telemetry of the parts: sensors, setpoints, motors, filter. From our values to pymavlink's."""

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import Triple, euler_from_quaternion, rotation_matrix
from flightdyn.instruments import Instruments
from flightdyn.physics.atmosphere import altitude_m, temperature_k
from sitl.autopilot.codec import units as u
from sitl.autopilot.codec.message import MavlinkMessage
from sitl.autopilot.values.enums import Frame, Message
from sitl.autopilot.values.snapshot import Dials, Snapshot

_NAN3 = (math.nan, math.nan, math.nan)
_ZERO_C_K = 273.15
_G_MPS2 = 9.80665
_PWM_LEAST, _PWM_SPAN = 1000, 1000
_UNUSED = [0] * 8
_FIELDS_WITHOUT_FIELD = 0b1101000111111  # accelerometer, gyroscope, pressures, temperature
_FIELD = 0b111000000
_IGNORE_ALL = 0b110111111111


def _field(i: Instruments) -> Triple:
    return i.readings.field_gauss or (0.0, 0.0, 0.0)


def _temperature_c(i: Instruments) -> float:
    return temperature_k(altitude_m(i.readings.pressure_pa)) - _ZERO_C_K


def _highres_imu(s: Snapshot, d: Dials) -> MavlinkMessage:
    r = d.instruments.readings
    return mav.MAVLink_highres_imu_message(
        u.us(s.t_ns),
        *r.specific_force_mps2,
        *r.rates_radps,
        *_field(d.instruments),
        abs_pressure=r.pressure_pa / 100,  # hPa
        diff_pressure=0.0,  # there is no such sensor, and no bit for it below
        pressure_alt=altitude_m(r.pressure_pa),
        temperature=_temperature_c(d.instruments),
        fields_updated=_FIELDS_WITHOUT_FIELD | (0 if r.field_gauss is None else _FIELD),
    )


def _thousandths(i: Instruments) -> list[int]:
    """Specific force in mG, rates in mrad/s, field in mgauss."""
    r = i.readings
    force = [u.int16(part / _G_MPS2 * 1e3) for part in r.specific_force_mps2]
    return [*force, *(u.int16(part * 1e3) for part in (*r.rates_radps, *_field(i)))]


def _scaled_imu(s: Snapshot, d: Dials) -> MavlinkMessage:
    cdeg_c = u.int16(_temperature_c(d.instruments) * 100)
    return mav.MAVLink_scaled_imu_message(u.ms(s.t_ns), *_thousandths(d.instruments), cdeg_c)


def _raw_imu(s: Snapshot, d: Dials) -> MavlinkMessage:
    cdeg_c = u.int16(_temperature_c(d.instruments) * 100)
    return mav.MAVLink_raw_imu_message(
        u.us(s.t_ns), *_thousandths(d.instruments), id=0, temperature=cdeg_c
    )


def _scaled_pressure(s: Snapshot, d: Dials) -> MavlinkMessage:
    return mav.MAVLink_scaled_pressure_message(
        time_boot_ms=u.ms(s.t_ns),
        press_abs=d.instruments.readings.pressure_pa / 100,
        press_diff=0.0,
        temperature=u.int16(_temperature_c(d.instruments) * 100),
    )


def _odometry(s: Snapshot, d: Dials) -> MavlinkMessage:
    r = rotation_matrix(tuple(map(float, s.belief.q_frd_to_ned)))  # type: ignore[arg-type]
    n, e, w = map(float, s.belief.vel_ned_mps)
    body = [r[i] * n + r[3 + i] * e + r[6 + i] * w for i in range(3)]
    stds = d.instruments.readings.stds
    return mav.MAVLink_odometry_message(
        time_usec=u.us(s.t_ns),
        frame_id=mav.MAV_FRAME_LOCAL_NED,
        child_frame_id=mav.MAV_FRAME_BODY_FRD,
        x=float(s.belief.pos_ned_m[0]),
        y=float(s.belief.pos_ned_m[1]),
        z=float(s.belief.pos_ned_m[2]),
        q=[float(part) for part in s.belief.q_frd_to_ned],
        vx=body[0],
        vy=body[1],
        vz=body[2],
        rollspeed=float(s.belief.omega_frd_radps[0]),
        pitchspeed=float(s.belief.omega_frd_radps[1]),
        yawspeed=float(s.belief.omega_frd_radps[2]),
        pose_covariance=_covariance(None if stds is None else [*stds[0:3], *stds[6:9]]),
        velocity_covariance=_covariance(None),  # known in NED only
        estimator_type=mav.MAV_ESTIMATOR_TYPE_AUTOPILOT,
    )


def _covariance(stds: list[float] | None) -> list[float]:
    """The upper right triangle of a diagonal (6, 6) covariance; NaN first where unknown."""
    if stds is None:
        return [math.nan] + [0.0] * 20
    return [float(stds[i]) ** 2 if i == j else 0.0 for i in range(6) for j in range(i, 6)]


def _attitude_target(s: Snapshot, d: Dials) -> MavlinkMessage:
    i = d.instruments
    return mav.MAVLink_attitude_target_message(
        time_boot_ms=u.ms(s.t_ns),
        type_mask=0b111,  # the rates are the attitude loop's own
        q=list(i.q_wanted),
        body_roll_rate=0.0,
        body_pitch_rate=0.0,
        body_yaw_rate=0.0,
        thrust=math.sqrt(i.collective),  # of the rotors' speed, as it is ordered
    )


def _position_target(s: Snapshot, d: Dials) -> MavlinkMessage:
    to = d.instruments.setpoint
    head = (u.ms(s.t_ns), int(Frame.LOCAL_NED))
    if to is None:
        return mav.MAVLink_position_target_local_ned_message(
            *head, _IGNORE_ALL, *_NAN3, *_NAN3, *_NAN3, math.nan, math.nan
        )
    return mav.MAVLink_position_target_local_ned_message(
        *head, 0, *to.p, *to.v, *to.a, to.yaw, to.yaw_rate
    )


def _position_target_global(s: Snapshot, d: Dials) -> MavlinkMessage:
    to, place = d.instruments.setpoint, d.target
    head = (u.ms(s.t_ns), int(Frame.GLOBAL_INT))
    if to is None or place is None:
        return mav.MAVLink_position_target_global_int_message(
            *head, _IGNORE_ALL, 0, 0, *_NAN3[:1], *_NAN3, *_NAN3, math.nan, math.nan
        )
    return mav.MAVLink_position_target_global_int_message(
        *head,
        0,
        u.deg_e7(place.lat_deg),
        u.deg_e7(place.lon_deg),
        place.alt_msl_m,
        *to.v,
        *to.a,
        to.yaw,
        to.yaw_rate,
    )


def _servos(s: Snapshot, d: Dials) -> MavlinkMessage:
    pwm = [round(_PWM_LEAST + _PWM_SPAN * share) for share in d.instruments.motors]
    return mav.MAVLink_servo_output_raw_message(
        u.us(s.t_ns) % 2**32, 0, *(pwm + _UNUSED)[:8], *_UNUSED
    )


def _actuators(s: Snapshot, d: Dials) -> MavlinkMessage:
    motors = d.instruments.motors
    return mav.MAVLink_actuator_output_status_message(
        time_usec=u.us(s.t_ns), active=len(motors), actuator=[*motors, *[0.0] * (32 - len(motors))]
    )


def _wind(s: Snapshot, d: Dials) -> MavlinkMessage:
    north, east, down = map(float, d.instruments.wind_ned_mps)
    return mav.MAVLink_wind_cov_message(
        time_usec=u.us(s.t_ns),
        wind_x=north,
        wind_y=east,
        wind_z=down,
        var_horiz=0.0,
        var_vert=0.0,
        wind_alt=s.position.alt_msl_m,
        horiz_accuracy=0.0,
        vert_accuracy=0.0,
    )


def _vibration(s: Snapshot, d: Dials) -> MavlinkMessage:
    return mav.MAVLink_vibration_message(
        u.us(s.t_ns), *d.instruments.readings.vibration_mps2, 0, 0, 0
    )


def _estimator_status(s: Snapshot, d: Dials) -> MavlinkMessage:
    flags = mav.ESTIMATOR_ATTITUDE | mav.ESTIMATOR_VELOCITY_HORIZ | mav.ESTIMATOR_VELOCITY_VERT
    flags |= mav.ESTIMATOR_POS_HORIZ_REL | mav.ESTIMATOR_POS_VERT_ABS
    flags |= mav.ESTIMATOR_PRED_POS_HORIZ_REL
    if s.gnss is not None:
        flags |= mav.ESTIMATOR_POS_HORIZ_ABS | mav.ESTIMATOR_PRED_POS_HORIZ_ABS
    stds = d.instruments.readings.stds
    across, upright = (0.0, 0.0)
    if stds is not None:
        across, upright = math.hypot(stds[0], stds[1]), float(stds[2])
    ratio = d.innovation_ratios
    return mav.MAVLink_estimator_status_message(
        time_usec=u.us(s.t_ns),
        flags=flags,
        vel_ratio=ratio.get("gnss velocity", 0.0),
        pos_horiz_ratio=ratio.get("gnss position", 0.0),
        pos_vert_ratio=ratio.get("baro", 0.0),
        mag_ratio=ratio.get("heading", 0.0),
        hagl_ratio=0.0,
        tas_ratio=0.0,
        pos_horiz_accuracy=across,
        pos_vert_accuracy=upright,
    )


def _sim_state(s: Snapshot, d: Dials) -> MavlinkMessage:
    w, x, y, z = (float(part) for part in s.truth.q_frd_to_ned)
    place, std = s.true_position, d.instruments.readings.stds
    return mav.MAVLink_sim_state_message(
        w,
        x,
        y,
        z,
        *euler_from_quaternion((w, x, y, z)),
        *d.instruments.readings.specific_force_mps2,
        *map(float, s.truth.omega_frd_radps),
        place.lat_deg,
        place.lon_deg,
        place.alt_msl_m,
        0.0 if std is None else math.hypot(std[0], std[1]),
        0.0 if std is None else float(std[2]),
        *map(float, s.truth.vel_ned_mps),
        lat_int=u.deg_e7(place.lat_deg),
        lon_int=u.deg_e7(place.lon_deg),
    )


def _orbit(s: Snapshot, d: Dials) -> MavlinkMessage:
    place = d.orbit
    radius, point = (0.0, s.position) if place is None else place
    return mav.MAVLink_orbit_execution_status_message(
        time_usec=u.us(s.t_ns),
        radius=radius,
        frame=int(Frame.GLOBAL_INT),
        x=u.deg_e7(point.lat_deg),
        y=u.deg_e7(point.lon_deg),
        z=point.alt_msl_m,
    )


_ENCODERS: dict[Message, Callable[[Snapshot, Dials], MavlinkMessage]] = {
    Message.RAW_IMU: _raw_imu,
    Message.SCALED_IMU: _scaled_imu,
    Message.SCALED_PRESSURE: _scaled_pressure,
    Message.SERVO_OUTPUT_RAW: _servos,
    Message.ATTITUDE_TARGET: _attitude_target,
    Message.POSITION_TARGET_LOCAL_NED: _position_target,
    Message.POSITION_TARGET_GLOBAL_INT: _position_target_global,
    Message.HIGHRES_IMU: _highres_imu,
    Message.SIM_STATE: _sim_state,
    Message.ESTIMATOR_STATUS: _estimator_status,
    Message.WIND_COV: _wind,
    Message.VIBRATION: _vibration,
    Message.ODOMETRY: _odometry,
    Message.ORBIT_EXECUTION_STATUS: _orbit,
    Message.ACTUATOR_OUTPUT_STATUS: _actuators,
}

INSTRUMENTED = frozenset(_ENCODERS)


def encode_instruments(kind: Message, snapshot: Snapshot, dials: Dials) -> MavlinkMessage:
    """The pymavlink message of `kind`, which is one of `INSTRUMENTED`."""
    return _ENCODERS[kind](snapshot, dials)
