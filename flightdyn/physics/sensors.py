"""Sensor models: true states and random streams in, measurements out; and those of an aircraft
together, read tick by tick on its clock.

Each sensor draws from its own named stream, in blocks that do not depend on the flight, so that
a sensor's noise is a function of the seed alone. Between blocks all is plain floats: at these
sizes numpy's calls cost more than the arithmetic.
"""

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from flightdyn.clock import SimClock
from flightdyn.config import BaroConfig, GnssConfig, ImuConfig, MagConfig, SensorsConfig
from flightdyn.frames import Quaternion, Triple, frozen, rotation_matrix
from flightdyn.native.ticks import Imu
from flightdyn.physics.multirotor import Multirotor
from flightdyn.random import RandomStreams
from flightdyn.state import GnssFix, Vector

_BLOCK = 64  # samples of a sensor that are drawn at a time


def _draws(rng: np.random.Generator, count: int) -> Iterator[list[float]]:
    """Yield lists of `count` standard normal numbers."""
    while True:
        yield from rng.standard_normal((_BLOCK, count)).tolist()


class ImuErrors:
    """Errors of the IMU in body rates (rad/s) and specific force (m/s2), tick by tick.

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

    def draw(self) -> Vector:
        """Return the errors (n, 6) of the next second of ticks: three of rates, three of force."""
        white, bias = self._rng.standard_normal((2, self._block, 6))
        bias *= self._walk
        np.add.accumulate(bias, out=bias)
        bias += self.bias
        self.bias = bias[-1].copy()
        white *= self._white
        white += bias
        drawn: Vector = white
        return drawn


class _GaussMarkov:
    """First-order Gauss-Markov error of one axis, sampled at a fixed interval."""

    def __init__(
        self, std: float, correlation_s: float, interval_s: float, rng: np.random.Generator
    ) -> None:
        self._keep = math.exp(-interval_s / correlation_s)
        self._kick = std * math.sqrt(1 - self._keep**2)
        self.value = float(rng.standard_normal()) * std

    def step(self, draw: float) -> float:
        self.value = self._keep * self.value + self._kick * draw
        return self.value


class Gnss:
    """Satellite receiver. Solutions are made at their epoch and delivered after the delay."""

    def __init__(self, config: GnssConfig, streams: RandomStreams) -> None:
        self._config = config
        rng = streams.generator("sensor/gnss")
        self._north, self._east, self._down = (
            _GaussMarkov(std, config.correlation_s, config.interval_s, rng)
            for std in (config.std_horizontal_m, config.std_horizontal_m, config.std_vertical_m)
        )
        self._draws = _draws(rng, 9)
        self._delay_ns = round(config.delay_s * 1e9)
        self._stds = (
            math.hypot(config.std_horizontal_m, config.white_m),
            math.hypot(config.std_vertical_m, config.white_m),
            config.std_vel_horizontal_mps,
        )
        self._pending: deque[GnssFix] = deque()
        self.due_ns: float = math.inf  # when the next solution arrives
        self.on = True
        self.jump_ned_m: Triple = (0.0, 0.0, 0.0)
        # Of the last solution, jumps included.
        self.error_ned_m: Triple = (0.0, 0.0, 0.0)
        self.velocity_error_ned_mps: Triple = (0.0, 0.0, 0.0)

    def measure(self, t_ns: int, pos_ned_m: Triple, vel_ned_mps: Triple) -> None:
        """Make the solution of epoch `t_ns`, none while off; the noise is drawn either way."""
        config = self._config
        slow_n, slow_e, slow_d, *white, un, ue, ud = next(self._draws)
        (jn, je, jd), k = self.jump_ned_m, config.white_m
        self.error_ned_m = en, ee, ed = (
            self._north.step(slow_n) + white[0] * k + jn,
            self._east.step(slow_e) + white[1] * k + je,
            self._down.step(slow_d) + white[2] * k + jd,
        )
        level, upright = config.std_vel_horizontal_mps, config.std_vel_vertical_mps
        self.velocity_error_ned_mps = fn, fe, fd = un * level, ue * level, ud * upright
        if not self.on:
            return
        (n, e, d), (vn, ve, vd) = pos_ned_m, vel_ned_mps
        numbers = frozen((n + en, e + ee, d + ed, vn + fn, ve + fe, vd + fd))
        self._pending.append(
            GnssFix(t_ns, numbers[:3], numbers[3:], *self._stds, config.satellites)
        )
        self.due_ns = self._pending[0].t_ns + self._delay_ns

    def deliver(self, t_ns: int) -> GnssFix | None:
        """Return the solution that has arrived by `t_ns`, or None."""
        if t_ns < self.due_ns:
            return None
        fix, waiting = self._pending.popleft(), self._pending
        self.due_ns = waiting[0].t_ns + self._delay_ns if waiting else math.inf
        return fix


class BaroSample(NamedTuple):
    """Static pressure at one instant."""

    t_ns: int
    pressure_pa: float


class Baro:
    """Barometer: static pressure with white noise and slow drift."""

    def __init__(self, config: BaroConfig, streams: RandomStreams) -> None:
        self._white = config.white_pa
        rng = streams.generator("sensor/baro")
        self._drift = _GaussMarkov(
            config.drift_pa, config.drift_correlation_s, config.interval_s, rng
        )
        self._draws = _draws(rng, 2)

    def measure(self, t_ns: int, pressure_pa: float) -> BaroSample:
        """The sample at `t_ns` in air of the given pressure."""
        slow, white = next(self._draws)
        return BaroSample(t_ns, pressure_pa + self._drift.step(slow) + self._white * white)


class MagSample(NamedTuple):
    """Magnetic field in body axes at one instant."""

    t_ns: int
    field_frd_gauss: Triple


class Magnetometer:
    """Magnetometer: field in body axes, with white noise and the offset that calibration left."""

    def __init__(self, config: MagConfig, streams: RandomStreams) -> None:
        self._config = config
        rng = streams.generator("sensor/mag")
        self._offset = [draw * config.hard_iron_gauss for draw in rng.standard_normal(3).tolist()]
        self._draws = _draws(rng, 3)

    def measure(self, t_ns: int, q_frd_to_ned: Quaternion) -> MagSample:
        """The sample at `t_ns` of an aircraft with the given attitude."""
        c = self._config
        n, e, d = c.field_north_gauss, c.field_east_gauss, c.field_down_gauss
        r = rotation_matrix(q_frd_to_ned)
        (x, y, z), (u, v, w), white = self._offset, next(self._draws), c.white_gauss
        return MagSample(
            t_ns,
            (
                r[0] * n + r[3] * e + r[6] * d + x + white * u,
                r[1] * n + r[4] * e + r[7] * d + y + white * v,
                r[2] * n + r[5] * e + r[8] * d + z + white * w,
            ),
        )


class SensorSuite:
    """IMU at every tick; receiver, barometer and magnetometer at intervals of their own."""

    def __init__(
        self, config: SensorsConfig, vehicle: Multirotor, clock: SimClock, streams: RandomStreams
    ) -> None:
        """Raises InputError where an interval is no whole number of ticks."""
        self.config = config
        self._vehicle = vehicle
        self._clock = clock
        # The force that JSBSim shows is that of the tick before: a sample holds the rates of then.
        self.imu = Imu(vehicle.imu, ImuErrors(config.imu, streams, dt_s=clock.dt_s).draw)
        self.receiver = Gnss(config.gnss, streams)
        self._baro = Baro(config.baro, streams)
        self._mag = Magnetometer(config.mag, streams)
        self._gnss_ticks = clock.ticks(config.gnss.interval_s, what="sensors.gnss.interval_s")
        self.baro_ticks = clock.ticks(config.baro.interval_s, what="sensors.baro.interval_s")
        self._mag_ticks = clock.ticks(config.mag.interval_s, what="sensors.mag.interval_s")
        self.pressure: BaroSample | None = None  # as read last
        self.field: MagSample | None = None
        self.due = 0  # the tick from which `slow` has something to read

    def slow(self, *, baro: bool = True) -> tuple[BaroSample | None, MagSample | None]:
        """Read the sensors due now; return barometer and magnetometer samples, None if not due.

        Without `baro`, that one is left to `feel_pressure`.
        """
        clock, tick, vehicle = self._clock, self._clock.tick, self._vehicle
        pressure = field = None
        due = [self._gnss_ticks, self._mag_ticks]
        if tick % self._gnss_ticks == 0:
            self.receiver.measure(clock.t_ns, vehicle.position_ned(), vehicle.velocity_ned())
        if baro:
            due.append(self.baro_ticks)
            if tick % self.baro_ticks == 0:
                pressure = self.feel_pressure(clock.t_ns, vehicle.pressure_pa())
        if tick % self._mag_ticks == 0:
            field = self.field = self._mag.measure(clock.t_ns, vehicle.attitude())
        self.due = tick + min(every - tick % every for every in due)
        return pressure, field

    def feel_pressure(self, t_ns: int, pressure_pa: float) -> BaroSample:
        """Read the barometer in air of the given pressure, at the tick at which that is due."""
        self.pressure = self._baro.measure(t_ns, pressure_pa)
        return self.pressure

    def fix(self) -> GnssFix | None:
        """Return the GNSS solution that has arrived by this tick, or None."""
        return self.receiver.deliver(self._clock.t_ns)
