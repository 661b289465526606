"""Reference that follows a target which may change at every step.

The speed towards a position is proportional to the distance when close, and leaves room to brake
at a constant deceleration when far (the "square-root controller" of position loops); the target's
own velocity and acceleration are fed forward, so that a target that moves is met without lag.
"""

import math
from typing import NamedTuple

from flightdyn.config import LimitsConfig
from flightdyn.frames import Triple

_APPROACH_PER_S = 1.2  # of speed towards a position, per distance
_GATHER_PER_S = 4.0  # of acceleration towards a velocity, per difference
_BRAKING = 0.5  # share of the greatest acceleration that the approach counts on

OPEN: Triple = (math.nan, math.nan, math.nan)


class Target(NamedTuple):
    """Position, velocity and acceleration setpoints of a target (NED, SI units); NaN is left open.

    A component with a position goes there, its velocity and acceleration being fed forward; one
    without is flown by velocity, one without either by acceleration, one without anything rests.
    Without `yaw` the heading turns at `yaw_rate`, without both it stays.
    """

    pos: Triple = OPEN
    vel: Triple = OPEN
    acc: Triple = OPEN
    yaw: float = math.nan
    yaw_rate: float = math.nan
    speed_mps: float = math.inf  # at most, horizontally
    climb_mps: float = math.inf
    descent_mps: float = math.inf
    drifting: bool = False  # no place is kept across, only the velocity: the belief of it jumps


def wanted_velocity(p: Triple, v: Triple, to: Target, limits: LimitsConfig) -> Triple:
    """Return the velocity (m/s, NED) at which a point at `p`, moving at `v`, follows the target."""
    x, y, z = (_gap(to.pos[i], p[i]) for i in range(3))
    across = math.hypot(x, y)
    pull = _approach(across, limits.acceleration_mps2) / across if across > 0 else 0.0
    vx = _feed(to, 0, v[0]) + pull * x
    vy = _feed(to, 1, v[1]) + pull * y
    vz = _feed(to, 2, v[2]) + math.copysign(_approach(abs(z), limits.vertical_acceleration_mps2), z)
    speed, most = math.hypot(vx, vy), min(to.speed_mps, limits.speed_mps)
    if speed > most:
        vx, vy = vx * most / speed, vy * most / speed
    down, up = min(to.descent_mps, limits.descent_mps), min(to.climb_mps, limits.climb_mps)
    return vx, vy, min(down, max(-up, vz))


def pursue(
    p: Triple, v: Triple, to: Target, *, limits: LimitsConfig, dt_s: float
) -> tuple[Triple, Triple, Triple]:
    """Return position, velocity, acceleration of the reference a step after it was at `p`, `v`."""
    wanted = wanted_velocity(p, v, to, limits)
    a = [
        _GATHER_PER_S * (wanted[i] - v[i])
        + (0.0 if _free(to, i) else _or_zero(to.acc[i]))  # a free one has it in its velocity
        for i in range(3)
    ]
    across, most = math.hypot(a[0], a[1]), limits.acceleration_mps2
    if across > most:
        a[0], a[1] = a[0] * most / across, a[1] * most / across
    steep = limits.vertical_acceleration_mps2
    a[2] = min(steep, max(-steep, a[2]))
    u = (v[0] + a[0] * dt_s, v[1] + a[1] * dt_s, v[2] + a[2] * dt_s)
    q = (p[0] + u[0] * dt_s, p[1] + u[1] * dt_s, p[2] + u[2] * dt_s)
    return q, u, (a[0], a[1], a[2])


def _approach(distance: float, acceleration: float) -> float:
    """Speed (m/s) allowed at a distance from the stopping point."""
    braking = _BRAKING * acceleration
    near = braking / _APPROACH_PER_S**2
    if distance <= near:
        return _APPROACH_PER_S * distance
    return math.sqrt(2 * braking * (distance - near / 2))


def _free(to: Target, i: int) -> bool:
    """Whether a component is flown by acceleration alone."""
    return math.isnan(to.pos[i]) and math.isnan(to.vel[i]) and not math.isnan(to.acc[i])


def _feed(to: Target, i: int, v: float) -> float:
    """Velocity (m/s) of one component that is fed forward: what the target itself asks for."""
    return v + to.acc[i] / _GATHER_PER_S if _free(to, i) else _or_zero(to.vel[i])


def _gap(wanted: float, there: float) -> float:
    return 0.0 if math.isnan(wanted) else wanted - there


def _or_zero(value: float) -> float:
    return 0.0 if math.isnan(value) else value
