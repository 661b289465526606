"""The snapshot behind all telemetry; messages about sensors, setpoints, motors and the filter."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import Triple, rotation_matrix
from flightdyn.instruments import Instruments
from flightdyn.physics.air import altitude_m, temperature_k
from flightdyn.physics.power import density_ratio
from flightdyn.state import BatteryState, GeodeticPoint, GnssFix, Kinematics, Vector
from sitl.autopilot.codec import units as u

_NAN11 = (math.nan,) * 11
_ZERO_C_K = 273.15
_PWM_LEAST, _PWM_SPAN = 1000, 1000
_UNUSED = [0] * 8
_FIELDS_WITHOUT_FIELD = 0b1101000111111  # accelerometer, gyroscope, pressures, temperature
_FIELD = 0b111000000
_IGNORE_ALL = 0b110111111111


@dataclass(frozen=True, slots=True)
class DeferredValues:
    """Values that only some telemetry messages need and that cost more to collect."""

    instruments: Instruments
    target: GeodeticPoint | None  # where the guidance wants to be
    innovation_ratios: Mapping[str, float]  # by kind of measurement; refused from 1 on
    orbit: tuple[float, GeodeticPoint] | None  # radius (m, positive clockwise) and middle


@dataclass(frozen=True)
class Snapshot:
    """Everything that telemetry messages are made from."""

    t_ns: int
    booted_ns: int  # the date of simulated time zero, since 1970
    belief: Kinematics
    position: GeodeticPoint  # of `belief`
    truth: Kinematics
    true_position: GeodeticPoint  # of `truth`
    origin: GeodeticPoint  # of the local frame
    home: GeodeticPoint
    home_ned_m: Vector
    home_yaw_rad: float  # heading at take-off
    gnss: GnssFix | None  # the last solution, None where there is no current one
    gnss_position: GeodeticPoint | None
    battery: BatteryState
    charge_state: int  # MAV_BATTERY_CHARGE_STATE
    custom_mode: int
    armed: bool
    system_state: int  # MAV_STATE
    landed_state: int  # MAV_LANDED_STATE
    sensors_present: int  # bits of MAV_SYS_STATUS_SENSOR
    sensors_healthy: int
    armed_t_ns: int  # when it was armed last; 0 for never
    took_off_t_ns: int  # after that, 0 for not yet
    landed_t_ns: int
    flights: int  # how often it was armed
    mission: mav.MAVLink_message  # MISSION_CURRENT
    read_deferred: Callable[[], DeferredValues]

    @cached_property
    def deferred(self) -> DeferredValues:
        """The values that only some messages need, read once."""
        return self.read_deferred()


def airspeeds_mps(s: Snapshot, moving: Kinematics) -> tuple[float, float]:
    """Speed through the air at a velocity over ground: true, and as a pitot tube indicates it."""
    true = math.dist(moving.vel_ned_mps, s.deferred.instruments.wind_ned_mps)
    return true, true * math.sqrt(density_ratio(s.position.alt_msl_m))


def _field(i: Instruments) -> Triple:
    return i.readings.field_gauss or (0.0, 0.0, 0.0)


def _temperature_c(i: Instruments) -> float:
    return temperature_k(altitude_m(i.readings.pressure_pa)) - _ZERO_C_K


def _highres_imu(s: Snapshot) -> mav.MAVLink_message:
    r = s.deferred.instruments.readings
    return mav.MAVLink_highres_imu_message(
        u.us(s.t_ns),
        *r.specific_force_mps2,
        *r.rates_radps,
        *_field(s.deferred.instruments),
        abs_pressure=r.pressure_pa / 100,  # hPa
        diff_pressure=0.0,  # there is no such sensor, and no bit for it below
        pressure_alt=altitude_m(r.pressure_pa),
        temperature=_temperature_c(s.deferred.instruments),
        fields_updated=_FIELDS_WITHOUT_FIELD | (0 if r.field_gauss is None else _FIELD),
    )


def _imu(s: Snapshot) -> dict[str, int]:
    """Fields of RAW_IMU and SCALED_IMU: mG, mrad/s, mgauss and hundredths of a degree."""
    i = s.deferred.instruments
    r = i.readings
    names = (f"{axis}{kind}" for kind in ("acc", "gyro", "mag") for axis in "xyz")
    others = (u.int16(value * 1e3) for value in (*r.rates_radps, *_field(i)))
    imu = dict(zip(names, (*map(u.mg, r.specific_force_mps2), *others), strict=True))
    return imu | {"temperature": u.int16(_temperature_c(i) * 100) or 1}  # 0: no thermometer


def _scaled_pressure(s: Snapshot) -> mav.MAVLink_message:
    return mav.MAVLink_scaled_pressure_message(
        time_boot_ms=u.ms(s.t_ns),
        press_abs=s.deferred.instruments.readings.pressure_pa / 100,
        press_diff=0.0,
        temperature=u.int16(_temperature_c(s.deferred.instruments) * 100),
    )


def _odometry(s: Snapshot) -> mav.MAVLink_message:
    r = rotation_matrix(tuple(map(float, s.belief.q_frd_to_ned)))  # type: ignore[arg-type]
    n, e, w = map(float, s.belief.vel_ned_mps)
    body = [r[i] * n + r[3 + i] * e + r[6 + i] * w for i in range(3)]
    stds = s.deferred.instruments.readings.stds
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


def _attitude_target(s: Snapshot) -> mav.MAVLink_message:
    i = s.deferred.instruments
    return u.sparse(
        mav.MAVLink_attitude_target_message,
        time_boot_ms=u.ms(s.t_ns),
        type_mask=0b111 if s.armed else 0b11000111,  # the rates are the attitude loop's own
        q=list(i.q_wanted),
        thrust=i.throttle,
    )


def _position_target(s: Snapshot) -> mav.MAVLink_position_target_local_ned_message:
    to = s.deferred.instruments.setpoint
    numbers = _NAN11 if to is None else (*to.p, *to.v, *to.a, to.yaw, to.yaw_rate)
    mask = _IGNORE_ALL if to is None else 0
    return mav.MAVLink_position_target_local_ned_message(
        u.ms(s.t_ns), mav.MAV_FRAME_LOCAL_NED, mask, *numbers
    )


def _position_target_global(s: Snapshot) -> mav.MAVLink_message:
    """The position setpoint as latitude, longitude and altitude."""
    local, place = _position_target(s), s.deferred.target
    lat, lon, alt = (0, 0, math.nan)
    if place is not None:
        lat, lon, alt = u.deg_e7(place.lat_deg), u.deg_e7(place.lon_deg), place.alt_msl_m
    rest = (getattr(local, name) for name in local.fieldnames[6:])  # what follows the position
    return mav.MAVLink_position_target_global_int_message(
        local.time_boot_ms, mav.MAV_FRAME_GLOBAL_INT, local.type_mask, lat, lon, alt, *rest
    )


def _servos(s: Snapshot) -> mav.MAVLink_message:
    pwm = [round(_PWM_LEAST + _PWM_SPAN * share) for share in s.deferred.instruments.motors]
    return mav.MAVLink_servo_output_raw_message(
        u.us(s.t_ns) % 2**32, 0, *(pwm + _UNUSED)[:8], *_UNUSED
    )


def _actuators(s: Snapshot) -> mav.MAVLink_message:
    motors = s.deferred.instruments.motors
    return mav.MAVLink_actuator_output_status_message(
        time_usec=u.us(s.t_ns),
        active=(1 << len(motors)) - 1,
        actuator=[*motors, *[0.0] * (32 - len(motors))],
    )


def _wind(s: Snapshot) -> mav.MAVLink_message:
    north, east, down = map(float, s.deferred.instruments.wind_ned_mps)
    return u.sparse(
        mav.MAVLink_wind_cov_message,
        time_usec=u.us(s.t_ns),
        wind_x=north,
        wind_y=east,
        wind_z=down,
        var_horiz=math.nan,
        var_vert=math.nan,
        wind_alt=s.position.alt_msl_m,
    )


def _vibration(s: Snapshot) -> mav.MAVLink_message:
    return mav.MAVLink_vibration_message(
        u.us(s.t_ns), *s.deferred.instruments.readings.vibration_mps2, 0, 0, 0
    )


def _estimator_status(s: Snapshot) -> mav.MAVLink_message:
    flags = mav.ESTIMATOR_ATTITUDE | mav.ESTIMATOR_VELOCITY_HORIZ | mav.ESTIMATOR_VELOCITY_VERT
    flags |= mav.ESTIMATOR_POS_HORIZ_REL | mav.ESTIMATOR_POS_VERT_ABS
    flags |= mav.ESTIMATOR_PRED_POS_HORIZ_REL
    if s.gnss is not None:
        flags |= mav.ESTIMATOR_POS_HORIZ_ABS | mav.ESTIMATOR_PRED_POS_HORIZ_ABS
    across, upright = _position_stds(s.deferred.instruments.readings.stds)
    ratio = s.deferred.innovation_ratios
    if max(ratio.get("gnss position", 0.0), ratio.get("gnss velocity", 0.0)) >= 1.0:
        flags |= mav.ESTIMATOR_GPS_GLITCH
    return u.sparse(
        mav.MAVLink_estimator_status_message,
        time_usec=u.us(s.t_ns),
        flags=flags,
        vel_ratio=ratio.get("gnss velocity", 0.0),
        pos_horiz_ratio=ratio.get("gnss position", 0.0),
        pos_vert_ratio=ratio.get("baro", 0.0),
        mag_ratio=ratio.get("heading", 0.0),
        pos_horiz_accuracy=across,
        pos_vert_accuracy=upright,
    )


def _position_stds(stds: Vector | None) -> tuple[float, float]:
    """Standard deviations of the estimate (m), horizontal and vertical; 0 where unknown."""
    return (0.0, 0.0) if stds is None else (math.hypot(stds[0], stds[1]), float(stds[2]))


def _orbit(s: Snapshot) -> mav.MAVLink_message | None:
    """ORBIT_EXECUTION_STATUS, which is sent only while an orbit is flown."""
    if s.deferred.orbit is None:
        return None
    radius, point = s.deferred.orbit
    return mav.MAVLink_orbit_execution_status_message(
        time_usec=u.us(s.t_ns),
        radius=radius,
        frame=mav.MAV_FRAME_GLOBAL_INT,
        x=u.deg_e7(point.lat_deg),
        y=u.deg_e7(point.lon_deg),
        z=point.alt_msl_m,
    )


INSTRUMENTS: Mapping[int, Callable[[Snapshot], mav.MAVLink_message | None]] = {
    mav.MAVLINK_MSG_ID_RAW_IMU: lambda s: mav.MAVLink_raw_imu_message(u.us(s.t_ns), **_imu(s)),
    mav.MAVLINK_MSG_ID_SCALED_IMU: lambda s: mav.MAVLink_scaled_imu_message(
        u.ms(s.t_ns), **_imu(s)
    ),
    mav.MAVLINK_MSG_ID_SCALED_PRESSURE: _scaled_pressure,
    mav.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: _servos,
    mav.MAVLINK_MSG_ID_ATTITUDE_TARGET: _attitude_target,
    mav.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: _position_target,
    mav.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: _position_target_global,
    mav.MAVLINK_MSG_ID_HIGHRES_IMU: _highres_imu,
    mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS: _estimator_status,
    mav.MAVLINK_MSG_ID_WIND_COV: _wind,
    mav.MAVLINK_MSG_ID_VIBRATION: _vibration,
    mav.MAVLINK_MSG_ID_ODOMETRY: _odometry,
    mav.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS: _orbit,
    mav.MAVLINK_MSG_ID_ACTUATOR_OUTPUT_STATUS: _actuators,
}
