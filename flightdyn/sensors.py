"""Sensor models: the truth and random streams in, what the autopilot is given out.

Each sensor draws from its own named stream, in blocks that do not depend on the flight, so that
a sensor's noise is a function of the seed alone.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flightdyn.config import BaroConfig, GnssConfig, ImuConfig, MagConfig
from flightdyn.frames import Quaternion, Triple, frozen, rotation_matrix
from flightdyn.random import RandomStreams
from flightdyn.state import GnssFix, Vector


class ImuErrors:
    """What the IMU adds to body rates (rad/s) and specific force (m/s2), tick by tick.

    White noise of the given density sampled at the tick rate, and a bias that starts at a
    turn-on value and walks at random.
    """

    def __init__(self, config: ImuConfig, streams: RandomStreams, *, dt_s: float) -> None:
        self._config = config
        self._rng = streams.generator("sensor/imu")
        turn_on = [config.gyro_turn_on_radps] * 3 + [config.accel_turn_on_mps2] * 3
        # (6,) gyroscope, accelerometer: at the end of the block drawn last
        self.bias: Vector = self._rng.standard_normal(6) * turn_on
        density = [config.gyro_noise_density] * 3 + [config.accel_noise_density] * 3
        walk = [config.gyro_random_walk] * 3 + [config.accel_random_walk] * 3
        self._white = np.array(density) / math.sqrt(dt_s)
        self._walk = np.array(walk) * math.sqrt(dt_s)
        self._block = max(1, round(1.0 / dt_s))
        self.fault: list[float] | None = None  # six constants added on top

    def __iter__(self) -> Iterator[list[float]]:
        """The errors tick by tick: three of rates, three of specific force."""
        while True:
            noise = self._rng.standard_normal((2, self._block, 6))
            bias = self.bias + np.cumsum(noise[1] * self._walk, axis=0)
            self.bias = bias[-1]
            for row in (bias + noise[0] * self._white).tolist():
                if self.fault is None:
                    yield row
                else:
                    yield [a + b for a, b in zip(row, self.fault, strict=True)]


class _GaussMarkov:
    """First-order Gauss-Markov error of n axes, sampled at a fixed interval."""

    def __init__(
        self, std: Vector, correlation_s: float, interval_s: float, rng: np.random.Generator
    ) -> None:
        self._keep = math.exp(-interval_s / correlation_s)
        self._kick = std * math.sqrt(1 - self._keep**2)
        self.value = rng.standard_normal(len(std)) * std

    def step(self, draw: Vector) -> Vector:
        self.value = self._keep * self.value + self._kick * draw
        return self.value


class Gnss:
    """Satellite receiver. Solutions are made at their epoch and delivered after the delay."""

    def __init__(self, config: GnssConfig, streams: RandomStreams) -> None:
        self._config = config
        self._rng = streams.generator("sensor/gnss")
        std = np.array([config.std_horizontal_m] * 2 + [config.std_vertical_m])
        self._position = _GaussMarkov(std, config.correlation_s, config.interval_s, self._rng)
        self._velocity_std = np.array(
            [config.std_vel_horizontal_mps] * 2 + [config.std_vel_vertical_mps]
        )
        self._delay_ns = round(config.delay_s * 1e9)
        self._pending: deque[GnssFix] = deque()
        self.on = True
        self.jump_ned_m: Triple = (0.0, 0.0, 0.0)
        self.error_ned_m: Vector = np.zeros(3)  # of the last solution, jumps included

    def measure(self, t_ns: int, pos_ned_m: Triple, vel_ned_mps: Triple) -> None:
        """Make the solution of epoch `t_ns`. The noise goes on where the receiver is off."""
        draw = self._rng.standard_normal(9)
        slow = self._position.step(draw[:3])
        self.error_ned_m = slow + draw[3:6] * self._config.white_m + np.array(self.jump_ned_m)
        velocity = np.array(vel_ned_mps) + draw[6:] * self._velocity_std
        if not self.on:
            return
        config = self._config
        self._pending.append(
            GnssFix(
                t_ns=t_ns,
                pos_ned_m=frozen(np.array(pos_ned_m) + self.error_ned_m),
                vel_ned_mps=frozen(velocity),
                std_horizontal_m=math.hypot(config.std_horizontal_m, config.white_m),
                std_vertical_m=math.hypot(config.std_vertical_m, config.white_m),
                std_velocity_mps=config.std_vel_horizontal_mps,
                satellites=config.satellites,
            )
        )

    def deliver(self, t_ns: int) -> GnssFix | None:
        """The solution that arrives by `t_ns`, if one does."""
        if self._pending and self._pending[0].t_ns + self._delay_ns <= t_ns:
            return self._pending.popleft()
        return None


@dataclass(frozen=True, slots=True)
class BaroSample:
    """Static pressure at one instant."""

    t_ns: int
    pressure_pa: float


class Baro:
    """Static pressure with white noise and slow drift."""

    def __init__(self, config: BaroConfig, streams: RandomStreams) -> None:
        self._white = config.white_pa
        self._rng = streams.generator("sensor/baro")
        std = np.array([config.drift_pa])
        self._drift = _GaussMarkov(std, config.drift_correlation_s, config.interval_s, self._rng)

    def measure(self, t_ns: int, pressure_pa: float) -> BaroSample:
        """The sample at `t_ns` in air of the given pressure."""
        draw = self._rng.standard_normal(2)
        drift = float(self._drift.step(draw[:1])[0])
        return BaroSample(t_ns, pressure_pa + drift + self._white * float(draw[1]))


@dataclass(frozen=True, slots=True)
class MagSample:
    """Magnetic field in body axes at one instant."""

    t_ns: int
    field_frd_gauss: Triple


class Magnetometer:
    """Magnetic field with white noise and the offset that calibration left."""

    def __init__(self, config: MagConfig, streams: RandomStreams) -> None:
        self._config = config
        self._rng = streams.generator("sensor/mag")
        self._offset = self._rng.standard_normal(3) * config.hard_iron_gauss

    def measure(self, t_ns: int, q_frd_to_ned: Quaternion) -> MagSample:
        """The sample at `t_ns` of an aircraft with the given attitude."""
        c = self._config
        n, e, d = c.field_north_gauss, c.field_east_gauss, c.field_down_gauss
        r = rotation_matrix(q_frd_to_ned)
        error = self._offset + c.white_gauss * self._rng.standard_normal(3)
        x, y, z = error.tolist()
        return MagSample(
            t_ns,
            (
                r[0] * n + r[3] * e + r[6] * d + x,
                r[1] * n + r[4] * e + r[7] * d + y,
                r[2] * n + r[5] * e + r[8] * d + z,
            ),
        )
