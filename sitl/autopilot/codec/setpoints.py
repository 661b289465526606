"""Setpoints in: from pymavlink's objects to our values."""

import math
from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import Triple
from sitl.autopilot.codec.message import MavlinkMessage
from sitl.autopilot.codec.units import from_deg_e7
from sitl.autopilot.values import setpoints as s

# Bits of the type masks of positions and attitudes that say what to ignore.
_POSITION, _VELOCITY, _ACCELERATION = 0, 3, 6
_FORCE, _YAW, _YAW_RATE = 1 << 9, 1 << 10, 1 << 11
_NO_THRUST, _NO_ATTITUDE = 1 << 6, 1 << 7


def _masked(mask: int, first_bit: int, values: Sequence[float]) -> Triple:
    x, y, z = (math.nan if mask >> (first_bit + i) & 1 else value for i, value in enumerate(values))
    return x, y, z


def _target(msg: MavlinkMessage, place: Sequence[float]) -> s.PositionTarget:
    mask = msg.type_mask
    return s.PositionTarget(
        frame=msg.coordinate_frame,
        place=_masked(mask, _POSITION, place),
        vel_mps=_masked(mask, _VELOCITY, (msg.vx, msg.vy, msg.vz)),
        acc_mps2=_masked(mask, _ACCELERATION, (msg.afx, msg.afy, msg.afz)),
        yaw_rad=math.nan if mask & _YAW else msg.yaw,
        yaw_rate_radps=math.nan if mask & _YAW_RATE else msg.yaw_rate,
        force=bool(mask & _FORCE),
    )


def _local(msg: MavlinkMessage) -> s.PositionTarget:
    return _target(msg, (msg.x, msg.y, msg.z))


def _global(msg: MavlinkMessage) -> s.PositionTarget:
    return _target(msg, (from_deg_e7(msg.lat_int), from_deg_e7(msg.lon_int), msg.alt))


def _attitude(msg: MavlinkMessage) -> s.AttitudeTarget:
    mask = msg.type_mask
    w, x, y, z = msg.q
    rates = (msg.body_roll_rate, msg.body_pitch_rate, msg.body_yaw_rate)
    return s.AttitudeTarget(
        q_frd_to_ned=None if mask & _NO_ATTITUDE else (w, x, y, z),
        rates_radps=_masked(mask, 0, rates),
        thrust=math.nan if mask & _NO_THRUST else msg.thrust,
    )


def _stick(value: int) -> float:
    """Thousandths; what is out of range (32767: no such axis) is a stick in the middle."""
    return value / 1000 if abs(value) <= 1000 else 0.0


def _sticks(msg: MavlinkMessage) -> s.ManualControl:
    # The throttle from 0 to 1000, as PX4 takes it.
    throttle = msg.z / 500 - 1 if 0 <= msg.z <= 1000 else 0.0
    return s.ManualControl(_stick(msg.x), _stick(msg.y), throttle, _stick(msg.r))


def _channels(msg: MavlinkMessage) -> s.RcOverride:
    return s.RcOverride(tuple(getattr(msg, f"chan{i}_raw") for i in range(1, 9)))


def _follow(msg: MavlinkMessage) -> s.FollowTarget:
    vx, vy, vz = msg.vel
    lat, lon = from_deg_e7(msg.lat), from_deg_e7(msg.lon)
    return s.FollowTarget(lat, lon, msg.alt, (vx, vy, vz))


SETPOINT_DECODERS: dict[int, Callable[[MavlinkMessage], s.Streamed]] = {
    mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: _local,
    mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT: _global,
    mav.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET: _attitude,
    mav.MAVLINK_MSG_ID_MANUAL_CONTROL: _sticks,
    mav.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: _channels,
    mav.MAVLINK_MSG_ID_FOLLOW_TARGET: _follow,
}
