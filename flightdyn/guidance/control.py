"""The outer loop's gains and orders. The loop itself is `native/control.h`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from flightdyn.config import LimitsConfig
from flightdyn.frames import Quaternion, Triple, quaternion_from_euler
from flightdyn.native.library import Guide
from flightdyn.native.ticks import Inner
from flightdyn.physics.airframe.parameters import Airframe

# Of the outer loop, chosen by step responses of this airframe; by the names of C's `Gains`.
_GAINS = {
    "position": 1.6,  # 1/s
    "velocity": 4.5,  # 1/s
    "integral": 2.5,  # 1/s2
    "integral_limit": 6.0,  # m/s2
    "lead": 0.16,  # s of lag of the attitude loop, led by the acceleration fed forward
    "drag_lag": 0.10,  # s of lag of the measured drag
    "drag_limit": 12.0,  # m/s2; more is a collision
    "thrust_lag": 0.15,  # s of lag of its effectiveness: a flare changes it by a third in 0.5 s
    "motor_lag": 0.06,  # s from ordered to measured thrust
    "most_thrust": 0.9,  # share of the full thrust that the outer loop may ask for
}


class Setpoint(NamedTuple):
    """Position, velocity, acceleration, yaw and yaw rate setpoint of the outer loop."""

    p: Triple
    v: Triple
    a: Triple  # already led
    yaw: float
    yaw_rate: float


@dataclass(frozen=True, slots=True)
class AttitudeOrder:
    """Setpoint of attitude, or of body rates alone, with thrust or speed of climb."""

    q_frd_to_ned: Quaternion | None
    rates_radps: Triple = (0.0, 0.0, 0.0)  # fed forward, or to be kept
    collective: float | None = None  # thrust of the rotors, 1 = full; None: by `climb_mps`
    climb_mps: float = 0.0


def attitude_along(thrust: Sequence[float], *, yaw: float) -> Quaternion:
    """The attitude whose thrust points along `thrust` (NED), and whose nose to `yaw` (rad)."""
    size = math.sqrt(thrust[0] ** 2 + thrust[1] ** 2 + thrust[2] ** 2)
    n, e, d = -thrust[0] / size, -thrust[1] / size, -thrust[2] / size  # body z axis
    c, s = math.cos(yaw), math.sin(yaw)
    # The body z axis in a frame that is turned by yaw alone tells pitch, then roll.
    ahead, right = c * n + s * e, c * e - s * n
    pitch = math.atan2(ahead, d)
    roll = math.atan2(-right, math.hypot(ahead, d))
    return quaternion_from_euler(roll, pitch, yaw)


def outer_loop(
    inner: Inner, airframe: Airframe, limits: LimitsConfig, *, dt_s: float, gravity_mps2: float
) -> Guide:
    """Make guidance and outer loop in C, run every `dt_s`, whose orders go to `inner`."""
    full = 4 * airframe.rotor_max_thrust_n / airframe.mass_kg  # m/s2 at collective 1
    slope = math.tan(math.radians(limits.tilt_deg))
    guide = Guide({
        "dt": dt_s, "gravity": gravity_mps2, "full": full, "slope": slope,
        "idle": airframe.idle_collective, **_GAINS,
        "yaw_rate": math.radians(limits.yaw_rate_degps),
    }, inner)  # fmt: skip
    guide.memory.effectiveness = 1.0
    guide.memory.thrust[2] = -1.0
    return guide
