"""Inertial navigation without a filter: summing IMU ticks, and carrying a state forward.

Coning and sculling terms: P. Savage, Strapdown Inertial Navigation Integration Algorithm Design
(J. Guidance 21, 1998), with the rate taken constant over a tick.
"""

from dataclasses import dataclass

from flightdyn.frames import (
    Quaternion,
    Triple,
    quaternion_multiply,
    rotation_matrix,
    rotation_quaternion,
)


@dataclass(frozen=True, slots=True)
class ImuIncrement:
    """IMU ticks summed over `dt_s`: rotation (rad) and velocity gained (m/s) in body axes."""

    t_ns: int  # end of the interval
    dt_s: float
    angle: Triple
    velocity: Triple


@dataclass(frozen=True, slots=True)
class NavState:
    """Position (m) and velocity (m/s) in NED, attitude body to NED, at `t_ns`."""

    t_ns: int
    p: Triple
    v: Triple
    q: Quaternion


def propagate(
    state: NavState,
    step: ImuIncrement,
    gyro_bias: Triple,
    accel_bias: Triple,
    gravity_mps2: float,
) -> tuple[NavState, Triple]:
    """The state one increment later, and the velocity (NED) gained without gravity."""
    dt = step.dt_s
    ax, ay, az = step.angle
    ax, ay, az = ax - gyro_bias[0] * dt, ay - gyro_bias[1] * dt, az - gyro_bias[2] * dt
    bx, by, bz = step.velocity
    bx, by, bz = bx - accel_bias[0] * dt, by - accel_bias[1] * dt, bz - accel_bias[2] * dt
    r = rotation_matrix(state.q)
    gn = r[0] * bx + r[1] * by + r[2] * bz
    ge = r[3] * bx + r[4] * by + r[5] * bz
    gd = r[6] * bx + r[7] * by + r[8] * bz
    p, v = state.p, state.v
    vn, ve, vd = v[0] + gn, v[1] + ge, v[2] + gd + gravity_mps2 * dt
    half = dt / 2
    w, x, y, z = quaternion_multiply(state.q, rotation_quaternion(ax, ay, az))
    k = 1.5 - 0.5 * (w * w + x * x + y * y + z * z)  # back to unit length, first order
    return (
        NavState(
            step.t_ns,
            (p[0] + (v[0] + vn) * half, p[1] + (v[1] + ve) * half, p[2] + (v[2] + vd) * half),
            (vn, ve, vd),
            (w * k, x * k, y * k, z * k),
        ),
        (gn, ge, gd),
    )


class Preintegrator:
    """Sums IMU ticks into increments; biases are taken off later, by who knows them."""

    __slots__ = ("_ax", "_ay", "_az", "_dt", "_vx", "_vy", "_vz", "ticks")

    def __init__(self, dt_s: float) -> None:
        self._dt = dt_s
        self._clear()

    def _clear(self) -> None:
        self._ax = self._ay = self._az = self._vx = self._vy = self._vz = 0.0
        self.ticks = 0

    def add(self, p: float, q: float, r: float, fx: float, fy: float, fz: float) -> None:
        """One tick of body rates (rad/s) and specific force (m/s2)."""
        dt = self._dt
        dx, dy, dz = p * dt, q * dt, r * dt
        ux, uy, uz = fx * dt, fy * dt, fz * dt
        ax, ay, az = self._ax, self._ay, self._az
        # Velocity is gained in the axes that the body has turned to by the middle of the tick.
        hx, hy, hz = ax + dx / 2, ay + dy / 2, az + dz / 2
        self._vx += ux + hy * uz - hz * uy
        self._vy += uy + hz * ux - hx * uz
        self._vz += uz + hx * uy - hy * ux
        self._ax = ax + dx + (ay * dz - az * dy) / 2
        self._ay = ay + dy + (az * dx - ax * dz) / 2
        self._az = az + dz + (ax * dy - ay * dx) / 2
        self.ticks += 1

    def pending(self, t_ns: int) -> ImuIncrement:
        """What has been summed since the last `take`."""
        return ImuIncrement(
            t_ns,
            self.ticks * self._dt,
            (self._ax, self._ay, self._az),
            (self._vx, self._vy, self._vz),
        )

    def take(self, t_ns: int) -> ImuIncrement:
        """The increment that ends now; the next one begins."""
        increment = self.pending(t_ns)
        self._clear()
        return increment
