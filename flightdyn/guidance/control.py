"""The outer loop: where the reference wants to be against where the aircraft believes it is.

Position P and velocity PI give an acceleration; the reference's acceleration is fed forward, led by
the lag of the attitude loop. What the air does is measured, not modelled: the accelerometers' x and
y axes feel no thrust, so what they show is drag and wind; the z axis shows what the ordered thrust
is worth (battery, air density, inflow).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from flightdyn.config import LimitsConfig
from flightdyn.frames import Quaternion, Triple, rotation_matrix, wrap_pi, yaw_of
from flightdyn.guidance.attitude import attitude_error, limit_thrust
from flightdyn.guidance.inner_loops import InnerLoops
from flightdyn.inertial import NavState
from flightdyn.physics.airframe.parameters import Airframe

_LEAST_LIFT = 0.2  # thrust over weight below which the rotors turn nothing: on the ground


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains of the outer loop, chosen by step responses of this airframe."""

    position: float = 1.6  # 1/s
    velocity: float = 4.5  # 1/s
    integral: float = 2.5  # 1/s2
    integral_limit: float = 6.0  # m/s2
    lead_s: float = 0.16  # lag of the attitude loop, led by the acceleration fed forward
    drag_lag_s: float = 0.10  # of the measured drag
    drag_limit: float = 12.0  # m/s2; more is a collision
    thrust_lag_s: float = 0.25  # of the thrust effectiveness
    motor_lag_s: float = 0.06  # from ordered to measured thrust
    most_thrust: float = 0.9  # share of the full thrust that the outer loop may ask for


class Setpoint(NamedTuple):
    """What the outer loop is to follow."""

    p: Triple
    v: Triple
    a: Triple  # already led
    yaw: float
    yaw_rate: float


@dataclass(frozen=True, slots=True)
class AttitudeOrder:
    """An attitude to keep; without one, body rates. Thrust, or the speed of the climb with it."""

    q_frd_to_ned: Quaternion | None
    rates_radps: Triple = (0.0, 0.0, 0.0)  # fed forward, or to be kept
    collective: float | None = None  # thrust of the rotors, 1 = full; None: by `climb_mps`
    climb_mps: float = 0.0


class Controller:
    """Outer loop with its memory."""

    def __init__(
        self,
        inner: InnerLoops,
        airframe: Airframe,
        limits: LimitsConfig,
        *,
        dt_s: float,
        gravity_mps2: float,
        gains: Gains | None = None,
    ) -> None:
        self._inner = inner
        self._airframe = airframe
        self._slope = math.tan(math.radians(limits.tilt_deg))
        self._dt = dt_s
        self._g = self.gravity_mps2 = gravity_mps2
        self._gains = gains or Gains()
        self._full = 4 * airframe.rotor_max_thrust_n / airframe.mass_kg  # m/s2 at collective 1
        self.lead_s = self._gains.lead_s
        self.wanted_thrust: Triple = (0.0, 0.0, -1.0)  # over mass, NED: what is leaned to
        self.wanted_yaw = 0.0
        self.collective = 0.0  # ordered last
        self.saturated = False
        self.lift = 0.0  # thrust ordered over weight
        self.effectiveness = 1.0  # measured thrust over ordered thrust
        self.reset()

    def reset(self) -> None:
        """Forget what was learnt in the air; for the ground."""
        self._integral = (0.0, 0.0, 0.0)
        self._drag = (0.0, 0.0)
        self._lagged = 0.0
        self.effectiveness = 1.0
        self.saturated = False
        self.lift = 0.0
        self.wanted_thrust = (0.0, 0.0, -1.0)

    def idle(self, *, armed: bool) -> None:
        """Motors turning without lift (armed), attitude left alone."""
        zero = (0.0, 0.0, 0.0)
        self.reset()
        self.collective = self._airframe.idle_collective if armed else 0.0
        self._inner.command(zero, zero, self.collective)

    def fly(self, nav: NavState, force: Triple, *, to: Setpoint, flying: bool) -> None:
        """One step; `force` is the measured specific force (body).

        Where it may stand on the ground (not `flying`) the aircraft stays level and learns nothing.
        """
        k, dt = self._gains, self._dt
        r = rotation_matrix(nav.q)
        share = dt / k.drag_lag_s
        dx, dy = self._drag
        if flying:
            dx, dy = dx + share * (force[0] - dx), dy + share * (force[1] - dy)
            most = k.drag_limit
            dx, dy = min(most, max(-most, dx)), min(most, max(-most, dy))
            self._drag = (dx, dy)
            if self._lagged > 0.05:
                self._measure_thrust(force)
        drag = (r[0] * dx + r[1] * dy, r[3] * dx + r[4] * dy, r[6] * dx + r[7] * dy)
        kp, kv, ki = k.position, k.velocity, k.integral * dt
        learning = flying and not self.saturated
        (px, py, pz), (vx, vy, vz), (ax, ay, az) = to.p, to.v, to.a
        (x, y, z), (u, v, w) = nav.p, nav.v
        sx = vx + kp * (px - x) - u
        sy = vy + kp * (py - y) - v
        sz = vz + kp * (pz - z) - w
        ix, iy, iz = self._integral
        if learning:
            most = k.integral_limit
            ix = min(most, max(-most, ix + ki * sx))
            iy = min(most, max(-most, iy + ki * sy))
            iz = min(most, max(-most, iz + ki * sz))
            self._integral = (ix, iy, iz)
        wanted = (
            ax + kv * sx + ix - drag[0] if flying else 0.0,
            ay + kv * sy + iy - drag[1] if flying else 0.0,
            az + kv * sz + iz - drag[2] - self._g,
        )
        full = self._full * self.effectiveness
        thrust, self.saturated = limit_thrust(
            wanted,
            slope=self._slope,
            least=0.25 * self._g,
            most=k.most_thrust * full,
        )
        along = -(thrust[0] * r[2] + thrust[1] * r[5] + thrust[2] * r[8])
        collective = min(k.most_thrust, max(0.02, along / full))
        self._lagged += dt / k.motor_lag_s * (collective - self._lagged)
        self.lift = collective * full / self._g
        error = attitude_error(r, thrust, heading=math.atan2(r[3], r[0]), wanted_heading=to.yaw)
        self.wanted_thrust, self.wanted_yaw, self.collective = thrust, to.yaw, collective
        rate = to.yaw_rate
        self._inner.command(error, (r[6] * rate, r[7] * rate, r[8] * rate), collective)

    def keep_attitude(
        self, nav: NavState, force: Triple, order: AttitudeOrder, *, flying: bool
    ) -> None:
        """One step of an attitude order: no position, no velocity but that of a climb."""
        r = rotation_matrix(nav.q)
        full = self._full * self.effectiveness
        collective = order.collective
        if collective is None:
            collective = self._climb(nav, order.climb_mps, upright=r[8], learning=flying) / full
        collective = min(self._gains.most_thrust, max(self._airframe.idle_collective, collective))
        if flying and self._lagged > 0.05:
            self._measure_thrust(force)
        self._lagged += self._dt / self._gains.motor_lag_s * (collective - self._lagged)
        self.lift = collective * full / self._g
        error = (0.0, 0.0, 0.0)
        if order.q_frd_to_ned is not None and self.lift > _LEAST_LIFT:
            w = rotation_matrix(order.q_frd_to_ned)
            self.wanted_thrust = (-w[2], -w[5], -w[8])
            self.wanted_yaw = yaw_of(order.q_frd_to_ned)
            heading = math.atan2(r[3], r[0])
            error = attitude_error(
                r, self.wanted_thrust, heading=heading, wanted_heading=self.wanted_yaw
            )
        self.collective = collective
        rates = order.rates_radps if self.lift > _LEAST_LIFT else error
        self._inner.command(error, rates, collective)

    def _climb(self, nav: NavState, climb_mps: float, *, upright: float, learning: bool) -> float:
        """Thrust over mass (m/s2) that keeps the climb, whatever the lean."""
        k = self._gains
        gap = -climb_mps - nav.v[2]
        ix, iy, iz = self._integral
        if learning:
            iz += k.integral * self._dt * gap
            iz = min(k.integral_limit, max(-k.integral_limit, iz))
            self._integral = (ix, iy, iz)
        return (self._g - k.velocity * gap - iz) / max(upright, 0.5)

    def _measure_thrust(self, force: Triple) -> None:
        """What the ordered thrust is worth, by the accelerometer."""
        ratio = min(2.0, max(0.3, -force[2] / (self._full * self._lagged)))
        self.effectiveness += self._dt / self._gains.thrust_lag_s * (ratio - self.effectiveness)


class Heading:
    """The heading wanted, turned towards an order at a limited rate."""

    def __init__(self, yaw: float, limits: LimitsConfig, *, dt_s: float) -> None:
        self.yaw = yaw
        self.rate = 0.0
        self._most = math.radians(limits.yaw_rate_degps)
        self._dt = dt_s

    def turn(self, order: float, *, feed: float = 0.0) -> None:
        """One step towards `order` (rad), which itself turns at the rate `feed` (rad/s)."""
        gap = wrap_pi(order - self.yaw)
        # Eased in and out, so that the rate fed forward does not jump.
        rate = min(self._most, max(-self._most, feed + 2.0 * gap))
        most = 4 * self._most * self._dt
        self.rate = min(self.rate + most, max(self.rate - most, rate))
        self.yaw = wrap_pi(self.yaw + self.rate * self._dt)
