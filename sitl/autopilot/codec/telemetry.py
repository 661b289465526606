"""Telemetry out: from a snapshot of the vehicle to pymavlink's objects."""

import math
from collections.abc import Callable, Mapping
from functools import cache

from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import euler_from_quaternion, quaternion_from_euler
from flightdyn.physics.air import altitude_m
from sitl.autopilot.codec import units as u
from sitl.autopilot.codec.instruments import INSTRUMENTS, Snapshot, airspeeds_mps

_UNKNOWN_U8, _UNKNOWN_U16 = 255, 65535
_UNKNOWN_HEIGHT_M = -10_000.0  # above terrain: anything below -1000
# Dilution of precision of satellites spread evenly over the sky from 10 degrees up, times the root
# of their number: that of the inverse of (lines of sight, clock)' (lines of sight, clock).
_HDOP, _VDOP, _LEAST_SATELLITES = 2.585, 4.192, 4
_ARMED_FLAG = mav.MAV_MODE_FLAG_SAFETY_ARMED
_STABILIZED = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mav.MAV_MODE_FLAG_STABILIZE_ENABLED
_AUTOMATIC = _STABILIZED | mav.MAV_MODE_FLAG_AUTO_ENABLED | mav.MAV_MODE_FLAG_GUIDED_ENABLED
_BY_STICKS = _STABILIZED | mav.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
# By PX4's main mode: automatic ones, offboard, and those flown by sticks.
_BASE_MODE = {4: _AUTOMATIC, 6: _STABILIZED}
_CAPABILITIES = (
    mav.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mav.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mav.MAV_PROTOCOL_CAPABILITY_FTP
    | mav.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | mav.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    | mav.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mav.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mav.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    | mav.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mav.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mav.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
)
_UID = int.from_bytes(b"aerofed")


def _euler(s: Snapshot) -> tuple[float, float, float]:
    w, x, y, z = (float(part) for part in s.belief.q_frd_to_ned)
    return euler_from_quaternion((w, x, y, z))


def _heartbeat(s: Snapshot) -> mav.MAVLink_message:
    return mav.MAVLink_heartbeat_message(
        mav.MAV_TYPE_QUADROTOR,
        mav.MAV_AUTOPILOT_PX4,
        _BASE_MODE.get(s.custom_mode >> 16 & 0xFF, _BY_STICKS) | (_ARMED_FLAG if s.armed else 0),
        s.custom_mode,
        s.system_state,
        3,
    )


def _sys_status(s: Snapshot) -> mav.MAVLink_message:
    return u.sparse(
        mav.MAVLink_sys_status_message,
        onboard_control_sensors_present=s.sensors_present,
        onboard_control_sensors_enabled=s.sensors_present,
        onboard_control_sensors_health=s.sensors_healthy,
        voltage_battery=u.mv(s.battery.voltage_v),
        current_battery=u.ca(s.battery.current_a),
        battery_remaining=u.percent(s.battery.remaining),
    )


def _system_time(s: Snapshot) -> mav.MAVLink_message:
    return mav.MAVLink_system_time_message(u.us(s.booted_ns + s.t_ns), u.ms(s.t_ns))


def _gps_raw(s: Snapshot) -> mav.MAVLink_message:
    fix, position = s.gnss, s.gnss_position
    if fix is None or position is None:
        return u.sparse(
            mav.MAVLink_gps_raw_int_message,
            time_usec=u.us(s.t_ns),
            fix_type=mav.GPS_FIX_TYPE_NO_FIX,
            satellites_visible=_UNKNOWN_U8,
            **dict.fromkeys(("eph", "epv", "vel", "cog"), _UNKNOWN_U16),
        )
    north, east = float(fix.vel_ned_mps[0]), float(fix.vel_ned_mps[1])
    return mav.MAVLink_gps_raw_int_message(
        time_usec=u.us(fix.t_ns),
        fix_type=mav.GPS_FIX_TYPE_3D_FIX,
        lat=u.deg_e7(position.lat_deg),
        lon=u.deg_e7(position.lon_deg),
        alt=u.mm(position.alt_msl_m),
        eph=_dilution(_HDOP, fix.satellites),
        epv=_dilution(_VDOP, fix.satellites),
        vel=u.ucm_s(math.hypot(north, east)),
        cog=u.cdeg(math.atan2(east, north)),
        satellites_visible=fix.satellites,
        alt_ellipsoid=0,  # not provided: there is no geoid that tells it from the other altitude
        h_acc=u.umm(fix.std_horizontal_m),
        v_acc=u.umm(fix.std_vertical_m),
        vel_acc=u.umm(fix.std_velocity_mps),
    )


def _dilution(of_one: float, satellites: int) -> int:
    """Hundredths of a dilution of precision, unknown but of a number that gives a fix."""
    known = _LEAST_SATELLITES <= satellites < _UNKNOWN_U8
    return round(100 * of_one / math.sqrt(satellites)) if known else _UNKNOWN_U16


def _attitude(s: Snapshot) -> mav.MAVLink_message:
    roll, pitch, yaw = _euler(s)
    return mav.MAVLink_attitude_message(
        u.ms(s.t_ns), roll, pitch, yaw, *map(float, s.belief.omega_frd_radps)
    )


def _attitude_quaternion(s: Snapshot) -> mav.MAVLink_message:
    w, x, y, z = map(float, s.belief.q_frd_to_ned)
    p, q, r = map(float, s.belief.omega_frd_radps)
    return mav.MAVLink_attitude_quaternion_message(u.ms(s.t_ns), w, x, y, z, p, q, r)


def _local_position(s: Snapshot) -> mav.MAVLink_message:
    return mav.MAVLink_local_position_ned_message(
        u.ms(s.t_ns), *map(float, s.belief.pos_ned_m), *map(float, s.belief.vel_ned_mps)
    )


def _global_position(s: Snapshot) -> mav.MAVLink_message:
    _, _, yaw = _euler(s)
    vx, vy, vz = map(float, s.belief.vel_ned_mps)
    return mav.MAVLink_global_position_int_message(
        time_boot_ms=u.ms(s.t_ns),
        lat=u.deg_e7(s.position.lat_deg),
        lon=u.deg_e7(s.position.lon_deg),
        alt=u.mm(s.position.alt_msl_m),
        relative_alt=u.mm(s.position.alt_msl_m - s.home.alt_msl_m),
        vx=u.cm_s(vx),
        vy=u.cm_s(vy),
        vz=u.cm_s(vz),
        hdg=u.cdeg(yaw),
    )


def _vfr_hud(s: Snapshot) -> mav.MAVLink_message:
    _, _, yaw = _euler(s)
    vx, vy, vz = map(float, s.belief.vel_ned_mps)
    return mav.MAVLink_vfr_hud_message(
        airspeed=airspeeds_mps(s, s.belief)[1],
        groundspeed=math.hypot(vx, vy),
        heading=round(math.degrees(yaw)) % 360,
        throttle=u.percent(s.deferred.instruments.throttle),
        alt=s.position.alt_msl_m,
        climb=-vz,
    )


def _altitude(s: Snapshot) -> mav.MAVLink_message:
    return mav.MAVLink_altitude_message(
        time_usec=u.us(s.t_ns),
        altitude_monotonic=altitude_m(s.deferred.instruments.readings.pressure_pa),
        altitude_amsl=s.position.alt_msl_m,
        altitude_local=s.belief.alt_rel_m,
        altitude_relative=s.position.alt_msl_m - s.home.alt_msl_m,
        altitude_terrain=_UNKNOWN_HEIGHT_M,
        bottom_clearance=-1.0,  # unknown
    )


def _home(s: Snapshot) -> mav.MAVLink_message:
    north, east, down = map(float, s.home_ned_m)
    return mav.MAVLink_home_position_message(
        latitude=u.deg_e7(s.home.lat_deg),
        longitude=u.deg_e7(s.home.lon_deg),
        altitude=u.mm(s.home.alt_msl_m),
        x=north,
        y=east,
        z=down,
        q=list(quaternion_from_euler(0.0, 0.0, s.home_yaw_rad)),  # the ground is level
        approach_x=north,  # straight down
        approach_y=east,
        approach_z=down,
        time_usec=u.us(s.t_ns),
    )


def _origin(s: Snapshot) -> mav.MAVLink_message:
    return mav.MAVLink_gps_global_origin_message(
        latitude=u.deg_e7(s.origin.lat_deg),
        longitude=u.deg_e7(s.origin.lon_deg),
        altitude=u.mm(s.origin.alt_msl_m),
        time_usec=u.us(s.t_ns),
    )


def _battery(s: Snapshot) -> mav.MAVLink_message:
    return mav.MAVLink_battery_status_message(
        id=0,
        battery_function=mav.MAV_BATTERY_FUNCTION_ALL,
        type=mav.MAV_BATTERY_TYPE_LIPO,
        temperature=2**15 - 1,  # unknown
        voltages=[u.mv(s.battery.voltage_v)] + [_UNKNOWN_U16] * 9,
        current_battery=u.ca(s.battery.current_a),
        current_consumed=u.clamped(s.battery.consumed_mah, 0, 2**31 - 1),
        energy_consumed=-1,  # unknown
        battery_remaining=u.percent(s.battery.remaining),
        charge_state=s.charge_state,
    )


@cache
def _software_version() -> int:
    """The installed version of Aerofed as MAVLink writes it: a byte each for its three numbers."""
    from importlib.metadata import version  # takes a sixth of `aerofed --help`

    major, minor, patch = (int(number) for number in version("aerofed").split(".")[:3])
    return major << 24 | minor << 16 | patch << 8 | mav.FIRMWARE_VERSION_TYPE_DEV


def _version(_: Snapshot) -> mav.MAVLink_message:
    return u.sparse(
        mav.MAVLink_autopilot_version_message,
        capabilities=_CAPABILITIES,
        flight_sw_version=_software_version(),
        uid=_UID,
    )


def _flight_information(s: Snapshot) -> mav.MAVLink_message:
    return mav.MAVLink_flight_information_message(
        time_boot_ms=u.ms(s.t_ns),
        arming_time_utc=u.us(s.armed_t_ns),
        takeoff_time_utc=u.us(s.took_off_t_ns),
        flight_uuid=s.flights,
        landing_time=u.ms(s.landed_t_ns),
    )


def _ground_truth(s: Snapshot) -> mav.MAVLink_message:
    vx, vy, vz = map(float, s.truth.vel_ned_mps)
    rollspeed, pitchspeed, yawspeed = map(float, s.truth.omega_frd_radps)
    true_mps, indicated_mps = airspeeds_mps(s, s.truth)
    xacc, yacc, zacc = map(u.mg, s.deferred.instruments.true_force_mps2)
    return mav.MAVLink_hil_state_quaternion_message(
        time_usec=u.us(s.t_ns),
        attitude_quaternion=[float(part) for part in s.truth.q_frd_to_ned],
        rollspeed=rollspeed,
        pitchspeed=pitchspeed,
        yawspeed=yawspeed,
        lat=u.deg_e7(s.true_position.lat_deg),
        lon=u.deg_e7(s.true_position.lon_deg),
        alt=u.mm(s.true_position.alt_msl_m),
        vx=u.cm_s(vx),
        vy=u.cm_s(vy),
        vz=u.cm_s(vz),
        ind_airspeed=u.ucm_s(indicated_mps),
        true_airspeed=u.ucm_s(true_mps),
        xacc=xacc,
        yacc=yacc,
        zacc=zacc,
    )


# By the message's number; one that has nothing to say is not sent.
TELEMETRY: Mapping[int, Callable[[Snapshot], mav.MAVLink_message | None]] = {
    mav.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    mav.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    mav.MAVLINK_MSG_ID_SYSTEM_TIME: _system_time,
    mav.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_raw,
    mav.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    mav.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: _attitude_quaternion,
    mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position,
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _global_position,
    mav.MAVLINK_MSG_ID_VFR_HUD: _vfr_hud,
    mav.MAVLINK_MSG_ID_ALTITUDE: _altitude,
    mav.MAVLINK_MSG_ID_HOME_POSITION: _home,
    mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: _origin,
    mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: lambda s: mav.MAVLink_extended_sys_state_message(
        mav.MAV_VTOL_STATE_UNDEFINED, s.landed_state
    ),
    mav.MAVLINK_MSG_ID_BATTERY_STATUS: _battery,
    mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _version,
    mav.MAVLINK_MSG_ID_FLIGHT_INFORMATION: _flight_information,
    mav.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: _ground_truth,
    mav.MAVLINK_MSG_ID_MISSION_CURRENT: lambda s: s.mission,
    **INSTRUMENTS,
}
