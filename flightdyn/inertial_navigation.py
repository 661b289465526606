"""Sensors and filter as the source of what the aircraft flies on."""

import math

from flightdyn.clock import SimClock
from flightdyn.config import SensorsConfig
from flightdyn.error_model import Alignment
from flightdyn.errors import FlightInputError
from flightdyn.estimator import Estimator
from flightdyn.frames import Triple, frozen
from flightdyn.inertial import Earth, ImuSample, NavState, integrate, propagate
from flightdyn.inner_loops import InnerLoops
from flightdyn.multirotor import Multirotor
from flightdyn.random import RandomStreams
from flightdyn.sensors import Baro, Gnss, ImuErrors, Magnetometer
from flightdyn.state import GnssFix, Innovation, Kinematics
from flightdyn.wind import FT_M

FILTER_STEP_S = 0.1
_GNSS_LOST_NS = 1_500_000_000


class InertialNavigation:
    """Sensors, sampled tick by tick, and the filter that they feed."""

    def __init__(
        self,
        config: SensorsConfig,
        vehicle: Multirotor,
        inner: InnerLoops,
        clock: SimClock,
        streams: RandomStreams,
        *,
        earth: Earth,
        guidance_ticks: int,
    ) -> None:
        """Aligned at rest: the clock is run from before zero up to zero."""
        self._config = config
        self._vehicle = vehicle
        self._inner = inner
        self._clock = clock
        self.imu = ImuErrors(config.imu, streams, dt_s=clock.dt_s)
        self.receiver = Gnss(config.gnss, streams)
        self.baro = Baro(config.baro, streams)
        self.mag = Magnetometer(config.mag, streams)
        self._gnss_ticks = clock.ticks(config.gnss.interval_s, what="sensors.gnss.interval_s")
        self._baro_ticks = clock.ticks(config.baro.interval_s, what="sensors.baro.interval_s")
        self._mag_ticks = clock.ticks(config.mag.interval_s, what="sensors.mag.interval_s")
        self._errors = iter(self.imu)
        if (
            clock.ticks(FILTER_STEP_S, what="physics_hz does not fit: a filter step")
            % guidance_ticks
        ):
            raise FlightInputError(
                f"guidance_interval_s does not go into the filter step of {FILTER_STEP_S:g} s"
            )
        if self._mag_ticks % clock.ticks(FILTER_STEP_S, what="filter step"):
            raise FlightInputError(
                f"sensors.mag.interval_s = {config.mag.interval_s:g} is not a whole number of "
                f"filter steps of {FILTER_STEP_S:g} s"
            )
        self._samples: list[ImuSample] = []
        self._rates: Triple = (0.0, 0.0, 0.0)  # gyroscopes, as sampled last
        self._gyro_bias: Triple = (0.0, 0.0, 0.0)
        self.gnss: GnssFix | None = None
        self.specific_force: Triple = (0.0, 0.0, -earth.gravity_mps2)
        self._earth = earth
        self._due = 0
        self.estimator = self._align()

    def _align(self) -> Estimator:
        clock = self._clock
        count = clock.ticks(self._config.alignment_s, what="sensors.alignment_s")
        sums = [0.0] * 10
        pressures = fields = 0
        for _ in range(count):
            self._vehicle.run()
            clock.advance()
            self._sample_imu()
            for i, value in enumerate(self._samples.pop()):
                sums[i] += value / count
            if clock.tick % self._gnss_ticks == 0:
                self._measure_gnss()
            fix = self.receiver.deliver(clock.t_ns)
            if fix is not None:
                self.gnss = fix
            if clock.tick % self._baro_ticks == 0:
                sums[9] += self.baro.measure(clock.t_ns, self._vehicle.pressure_pa()).pressure_pa
                pressures += 1
            if clock.tick % self._mag_ticks == 0:
                sample = self.mag.measure(clock.t_ns, self._vehicle.attitude())
                for i, value in enumerate(sample.field_frd_gauss):
                    sums[6 + i] += value
                fields += 1
        if self.gnss is None:
            raise FlightInputError("the alignment is too short for a GNSS solution")
        align = Alignment(
            rates=(sums[0], sums[1], sums[2]),
            specific_force=(sums[3], sums[4], sums[5]),
            field_frd_gauss=(sums[6] / fields, sums[7] / fields, sums[8] / fields),
            pressure_pa=sums[9] / pressures,
            duration_s=self._config.alignment_s,
        )
        self._gyro_bias = align.rates
        return Estimator(
            self._config,
            align=align,
            fix=self.gnss,
            t_ns=clock.t_ns,
            earth=self._earth,
            step_s=FILTER_STEP_S,
        )

    def _sample_imu(self) -> Triple:
        """Store the IMU's sample of this tick; returns its body rates."""
        v = self._vehicle
        e = next(self._errors)
        p, q, r = v.rate_p() + e[0], v.rate_q() + e[1], v.rate_r() + e[2]
        lp, lq, lr = self._rates
        # The force that JSBSim shows is that of the tick before: the rates of then go with it.
        self._samples.append(
            (
                lp,
                lq,
                lr,
                v.accel_x_fps2() * FT_M + e[3],
                v.accel_y_fps2() * FT_M + e[4],
                v.accel_z_fps2() * FT_M + e[5],
            )
        )
        self._rates = rates = (p, q, r)
        return rates

    def _measure_gnss(self) -> None:
        v = self._vehicle
        self.receiver.measure(self._clock.t_ns, v.position_ned(), v.velocity_ned())

    def tick(self) -> None:
        """Sample the sensors that are due; believed body rates to the inner loops."""
        p, q, r = self._sample_imu()
        bp, bq, br = self._gyro_bias
        self._inner.feed(p - bp, q - bq, r - br)
        if self._clock.tick >= self._due:
            self._measure()

    def _measure(self) -> None:
        """Sample what is due now, and note when the next sensor is."""
        clock, tick = self._clock, self._clock.tick
        if tick % self._gnss_ticks == 0:
            self._measure_gnss()
        if tick % self._baro_ticks == 0:
            pressure = self._vehicle.pressure_pa()
            self.estimator.observe_baro(self.baro.measure(clock.t_ns, pressure))
        if tick % self._mag_ticks == 0:
            attitude = self._vehicle.attitude()
            self.estimator.observe_mag(self.mag.measure(clock.t_ns, attitude))
        self._due = min(
            (tick // n + 1) * n for n in (self._gnss_ticks, self._baro_ticks, self._mag_ticks)
        )

    def update(self) -> NavState:
        """Bring the filter up to this tick."""
        t_ns = self._clock.t_ns
        fix = self.receiver.deliver(t_ns)
        if fix is not None:
            self.gnss = fix
        step = integrate(self._samples, t_ns, dt_s=self._clock.dt_s)
        self._samples.clear()
        estimator = self.estimator
        estimator.step(step, fix)
        biases = estimator.biases
        self._gyro_bias = biases.gyro
        k, (x, y, z), b = 1 / step.dt_s, step.velocity, biases.accel
        self.specific_force = (x * k - b[0], y * k - b[1], z * k - b[2])
        return estimator.now

    def state(self) -> NavState:
        """Believed state of this tick."""
        if not self._samples:
            return self.estimator.now
        step = integrate(self._samples, self._clock.t_ns, dt_s=self._clock.dt_s)
        b = self.estimator.biases
        return propagate(
            self.estimator.now, step, gyro_bias=b.gyro, accel_bias=b.accel, earth=self._earth
        )[0]

    def position(self) -> Triple:
        """Believed position of this tick (m, NED)."""
        return self.state().p

    def belief(self) -> Kinematics:
        """Believed state of this tick."""
        here = self.state()
        return Kinematics(
            t_ns=self._clock.t_ns,
            pos_ned_m=frozen(here.p),
            vel_ned_mps=frozen(here.v),
            q_frd_to_ned=frozen(here.q),
            omega_frd_radps=frozen(self._believed_rates()),
        )

    def innovations_after(self, t_ns: int) -> tuple[Innovation, ...]:
        """What the filter was given after an instant, against what it expected."""
        return self.estimator.innovations_after(t_ns)

    def _believed_rates(self) -> Triple:
        (p, q, r), b = self._rates, self._gyro_bias
        return (p - b[0], q - b[1], r - b[2])

    def why_not_ready(self) -> str:
        """Empty once the filter may be flown on."""
        estimator = self.estimator
        # The receiver's positions count where they are believed.
        if self._clock.t_ns - estimator.fused_ns["gnss position"] >= _GNSS_LOST_NS:
            return "no GNSS"
        if float(max(estimator.std(slice(0, 2)))) > 5.0:
            return "position uncertain"
        if float(max(estimator.std(slice(6, 8)))) > math.radians(5):
            return "attitude uncertain"
        if float(estimator.std(slice(8, 9))[0]) > math.radians(15):
            return "heading uncertain"
        return ""
