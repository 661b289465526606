"""Inertial navigation without a filter: summing IMU ticks, and carrying a state forward.

Coning and sculling terms: P. Savage, Strapdown Inertial Navigation Integration Algorithm Design
(J. Guidance 21, 1998), with the rate taken constant over a tick. Plain floats: at these sizes
numpy's calls cost more than the arithmetic.
"""

from collections.abc import Sequence
from typing import NamedTuple

from flightdyn.frames import Quaternion, Triple, rotation_quaternion

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


def integrate(samples: Sequence[ImuSample], t_ns: int, dt_s: float) -> ImuIncrement:
    """Sum ticks of `dt_s` that end at `t_ns`; biases are taken off later, by who knows them."""
    ax = ay = az = vx = vy = vz = 0.0
    half = dt_s / 2
    for p, q, r, fx, fy, fz in samples:
        dx, dy, dz = p * half, q * half, r * half  # half of the tick's rotation
        # Velocity is gained in the axes that the body has turned to by the middle of the tick.
        hx, hy, hz = ax + dx, ay + dy, az + dz
        vx += fx + hy * fz - hz * fy
        vy += fy + hz * fx - hx * fz
        vz += fz + hx * fy - hy * fx
        ax, ay, az = (
            hx + dx + (ay * dz - az * dy),
            hy + dy + (az * dx - ax * dz),
            hz + dz + (ax * dy - ay * dx),
        )
    return ImuIncrement(t_ns, len(samples) * dt_s, (ax, ay, az), (vx * dt_s, vy * dt_s, vz * dt_s))


def propagate(
    state: NavState,
    step: ImuIncrement,
    gyro_bias: Triple,
    accel_bias: Triple,
    gravity_mps2: float,
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
    un, ue, ud = vn + gn, ve + ge, vd + gd + gravity_mps2 * dt
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
