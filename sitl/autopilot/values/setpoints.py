"""What pilots outside the vehicle stream to it: setpoints, sticks, a target to follow.

SI units and degrees; NaN is left open. NED is the local frame, which begins where the vehicle did.
"""

from dataclasses import dataclass

from flightdyn.frames import Quaternion, Triple


@dataclass(frozen=True, slots=True)
class PositionTarget:
    """SET_POSITION_TARGET_LOCAL_NED or SET_POSITION_TARGET_GLOBAL_INT.

    `place` is north, east, down (m), or latitude, longitude (deg) and altitude (m) in global
    frames. Velocity and acceleration are NED, or forward, right, down in body frames.
    """

    frame: int
    place: Triple
    vel_mps: Triple
    acc_mps2: Triple
    yaw_rad: float
    yaw_rate_radps: float
    force: bool  # `acc_mps2` is a force


@dataclass(frozen=True, slots=True)
class AttitudeTarget:
    """SET_ATTITUDE_TARGET; the quaternion turns FRD into NED, None where it is to be ignored."""

    q_frd_to_ned: Quaternion | None
    rates_radps: Triple
    thrust: float  # 0..1


@dataclass(frozen=True, slots=True)
class ManualControl:
    """MANUAL_CONTROL: sticks from -1 to 1, the throttle as well (0: in the middle)."""

    pitch: float
    roll: float
    throttle: float
    yaw: float


@dataclass(frozen=True, slots=True)
class RcOverride:
    """RC_CHANNELS_OVERRIDE: pulse widths in us of the channels from 1 on; 0 lets go of a channel,
    65535 leaves it as it is.
    """

    channels_us: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class FollowTarget:
    """FOLLOW_TARGET: where somebody is and how he moves (NED)."""

    lat_deg: float
    lon_deg: float
    alt_msl_m: float
    vel_mps: Triple


Streamed = PositionTarget | AttitudeTarget | ManualControl | RcOverride | FollowTarget
