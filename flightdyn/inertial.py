"""Inertial navigation without a filter: summing IMU ticks, and carrying a state forward.

Coning and rotation terms: P. Savage, Strapdown Inertial Navigation Integration Algorithm Design
(J. Guidance 21, 1998). A sample holds until the next one is taken, and its force acts in the axes
of its own instant, which is how the physics advances attitude and velocity too: with exact sensors
the two agree. Plain floats: at these sizes numpy's calls cost more than the arithmetic.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from flightdyn.frames import Quaternion, Triple, normal_gravity, rotation_quaternion

_EARTH_RADPS = 7.292115e-5
EARTH_RADIUS_M = 6.371e6

ImuSample = tuple[float, float, float, float, float, float]  # rates rad/s, specific force m/s2


class ImuIncrement(NamedTuple):
    """IMU ticks summed over `dt_s`: rotation (rad) and velocity gained (m/s) in body axes."""

    t_ns: int  # end of the interval
    dt_s: float
    angle: Triple
    velocity: Triple


class NavState(NamedTuple):
    """Position (m) and velocity (m/s) in NED, attitude body to NED, at `t_ns`."""

    t_ns: int
    p: Triple
    v: Triple
    q: Quaternion


class Earth(NamedTuple):
    """Gravity, and the Earth's rotation where the aircraft flies, NED.

    The rotation turns paths over ground (Coriolis: 2 mm/s2 at 20 m/s). Gyroscopes are taken to
    turn with the Earth: its 15 deg an hour drown in their bias.
    """

    gravity_mps2: float
    rate_north_radps: float
    rate_down_radps: float

    @classmethod
    def at(cls, lat_deg: float, alt_m: float) -> "Earth":
        """The Earth at a place."""
        lat = math.radians(lat_deg)
        return cls(
            normal_gravity(lat_deg, alt_m),
            _EARTH_RADPS * math.cos(lat),
            -_EARTH_RADPS * math.sin(lat),
        )


def integrate(samples: Sequence[ImuSample], t_ns: int, *, dt_s: float) -> ImuIncrement:
    """Sum samples, each held for `dt_s`, up to `t_ns`; biases are left in."""
    ax = ay = az = vx = vy = vz = 0.0
    half = dt_s / 2
    for p, q, r, fx, fy, fz in samples:
        vx += fx + ay * fz - az * fy
        vy += fy + az * fx - ax * fz
        vz += fz + ax * fy - ay * fx
        dx, dy, dz = p * half, q * half, r * half
        ax, ay, az = (
            ax + 2 * dx + (ay * dz - az * dy),
            ay + 2 * dy + (az * dx - ax * dz),
            az + 2 * dz + (ax * dy - ay * dx),
        )
    return ImuIncrement(t_ns, len(samples) * dt_s, (ax, ay, az), (vx * dt_s, vy * dt_s, vz * dt_s))


def propagate(
    state: NavState,
    step: ImuIncrement,
    *,
    gyro_bias: Triple,
    accel_bias: Triple,
    earth: Earth,
) -> tuple[NavState, Triple]:
    """The state one increment later, and the velocity (NED) gained without gravity."""
    t_ns, dt, (ax, ay, az), (bx, by, bz) = step
    gx, gy, gz = gyro_bias
    rw, rx, ry, rz = rotation_quaternion(ax - gx * dt, ay - gy * dt, az - gz * dt)
    gx, gy, gz = accel_bias
    bx, by, bz = bx - gx * dt, by - gy * dt, bz - gz * dt
    _, (pn, pe, pd), (vn, ve, vd), (w, x, y, z) = state
    # The gained velocity turned by the attitude: v + 2 w (q x v) + 2 q x (q x v).
    cx, cy, cz = y * bz - z * by, z * bx - x * bz, x * by - y * bx
    gn = bx + 2 * (w * cx + y * cz - z * cy)
    ge = by + 2 * (w * cy + z * cx - x * cz)
    gd = bz + 2 * (w * cz + x * cy - y * cx)
    g, an, ad = earth
    an, ad = 2 * an * dt, 2 * ad * dt
    un = vn + gn + ad * ve
    ue = ve + ge - ad * vn + an * vd
    ud = vd + gd - an * ve + g * dt
    qw = w * rw - x * rx - y * ry - z * rz
    qx = w * rx + x * rw + y * rz - z * ry
    qy = w * ry - x * rz + y * rw + z * rx
    qz = w * rz + x * ry - y * rx + z * rw
    k = 1.5 - 0.5 * (qw * qw + qx * qx + qy * qy + qz * qz)  # back to unit length, first order
    half = dt / 2
    return (
        NavState(
            t_ns,
            (pn + (vn + un) * half, pe + (ve + ue) * half, pd + (vd + ud) * half),
            (un, ue, ud),
            (qw * k, qx * k, qy * k, qz * k),
        ),
        (gn, ge, gd),
    )
