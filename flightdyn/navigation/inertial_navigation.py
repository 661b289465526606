"""Navigation by the filter and the sensors that feed it: the state that the aircraft flies on."""

import math

import numpy as np

from flightdyn.frames import Triple
from flightdyn.inertial import Earth, NavState
from flightdyn.instruments import Readings
from flightdyn.native.library import Guide, Loop, Probe
from flightdyn.native.ticks import Inner
from flightdyn.navigation.error_model import Alignment
from flightdyn.navigation.estimator import Estimator
from flightdyn.navigation.measurements import Biases
from flightdyn.physics.sensors import SensorSuite
from flightdyn.plant import Plant
from flightdyn.state import GnssFix, Innovation, Kinematics
from native.errors import InputError

FILTER_STEP_S = 0.1
_GNSS_LOST_NS = 1_500_000_000
# Parts of the filter's error state, and the standard deviations that take-off requires.
_HORIZONTAL, _TILT, _HEADING = slice(0, 2), slice(6, 8), slice(8, 9)
_POSITION_STD_M, _TILT_STD_RAD, _HEADING_STD_RAD = 5.0, math.radians(5), math.radians(15)


class InertialNavigation:
    """The filter, and the sensors that feed it, sampled tick by tick."""

    def __init__(self, plant: Plant, sensors: SensorSuite, inner: Inner, *, earth: Earth) -> None:
        """Align at rest: run the clock from before zero up to zero."""
        self.sensors = sensors
        self._config = config = sensors.config
        self._plant = plant
        self._inner = inner
        self._clock = clock = plant.clock
        filter_ticks = clock.ticks(FILTER_STEP_S, what="physics_hz does not fit: a filter step")
        if filter_ticks % plant.interval:
            raise InputError(
                f"guidance_interval_s does not go into the filter step of {FILTER_STEP_S:g} s"
            )
        if clock.ticks(config.mag.interval_s, what="sensors.mag.interval_s") % filter_ticks:
            raise InputError(
                f"sensors.mag.interval_s = {config.mag.interval_s:g} is not a whole number of "
                f"filter steps of {FILTER_STEP_S:g} s"
            )
        self._dt_s = clock.dt_s
        self._step_ns = plant.interval * clock.dt_ns
        self._increments = filter_ticks // plant.interval
        self.gnss: GnssFix | None = None
        self._earth = earth
        self.estimator = self._align()
        self._corrected: Biases | None = None  # by which the inner loops are
        self.carried = self.estimator.to_now
        self.carried.set_force((0.0, 0.0, -earth.gravity_mps2))
        self._barometer = Probe(plant.vehicle.static, every=sensors.baro_ticks)
        self._loop = Loop(
            sensors.imu, inner, self.carried, interval=plant.interval, dt_s=self._dt_s,
            ahead=self.estimator.between, probe=self._barometer,
        )  # fmt: skip

    def _align(self) -> Estimator:
        clock, sensors = self._clock, self.sensors
        count = clock.ticks(self._config.alignment_s, what="sensors.alignment_s")
        clock.tick = -count
        sums = [0.0] * 10
        pressures = fields = 0
        for _ in range(count):
            self._plant.vehicle.run()
            clock.tick += 1
            for i, value in enumerate(sensors.imu.sample()):
                sums[i] += value / count
            pressure, field = sensors.slow()
            if pressure is not None:
                sums[9] += pressure.pressure_pa
                pressures += 1
            if field is not None:
                for i, value in enumerate(field.field_frd_gauss):
                    sums[6 + i] += value
                fields += 1
            self.gnss = sensors.fix() or self.gnss
        if self.gnss is None:
            raise InputError("the alignment is too short for a GNSS solution")
        align = Alignment(
            rates=(sums[0], sums[1], sums[2]),
            specific_force=(sums[3], sums[4], sums[5]),
            field_frd_gauss=(sums[6] / fields, sums[7] / fields, sums[8] / fields),
            pressure_pa=sums[9] / pressures,
            duration_s=self._config.alignment_s,
        )
        self._inner.correct(align.rates)
        return Estimator(
            self._config,
            align=align,
            fix=self.gnss,
            t_ns=clock.t_ns,
            earth=self._earth,
            step_s=FILTER_STEP_S,
            increments=self._increments,
        )

    def fly(self, most: int, guide: Guide) -> int:
        """Run up to `most` ticks of physics and the guidance steps between them, until a correction
        or receiver or magnetometer is due, a corner is passed, or `guide` notes an event. Returns
        how many."""
        sensors, estimator, loop, tick = self.sensors, self.estimator, self._loop, self._clock.tick
        due_ns = min(estimator.due_ns, sensors.receiver.due_ns)
        steps = math.ceil(due_ns / self._step_ns)  # it is looked for at guidance steps
        ticks = min(most, sensors.due - tick, steps * loop.interval - tick)
        flown = loop.fly(self._plant.run, ticks, estimator.increments, guide)
        for pressure_pa in self._barometer.take():
            tick += sensors.baro_ticks - tick % sensors.baro_ticks
            sample = sensors.feel_pressure(tick * self._clock.dt_ns, pressure_pa)
            estimator.measurements.baro.append(sample)
        return flown

    def sense(self) -> None:
        """Read receiver and magnetometer, if they are due."""
        if self._clock.tick < self.sensors.due:
            return
        _, field = self.sensors.slow(baro=False)
        if field is not None:
            self.estimator.measurements.mag.append(field)

    def update(self) -> None:
        """Bring the filter up to this guidance step; hand the gyroscope bias to the inner loops."""
        fix = self.sensors.fix()
        if fix is not None:
            self.gnss = fix
        estimator = self.estimator
        estimator.update(self._clock.t_ns, fix)
        if estimator.biases is not self._corrected:
            self._corrected = estimator.biases
            self._inner.correct(self._corrected.gyro)

    def state(self) -> NavState:
        """Estimated position, velocity and attitude of this tick."""
        loop, t_ns = self._loop, self._clock.t_ns
        if not loop.count:
            return NavState.of(t_ns, self.carried)
        return self.estimator.ahead(loop.taken, t_ns, dt_s=self._dt_s)

    def belief(self) -> Kinematics:
        """Estimated position, velocity, attitude and body rates of this tick."""
        rates = self._believed_rates()
        if not self._loop.count:
            return Kinematics.of(self._clock.t_ns, *self.carried.numbers, *rates)
        t_ns, p, v, q = self.state()
        return Kinematics.of(t_ns, *p, *v, *q, *rates)

    def innovations_after(self, t_ns: int) -> tuple[Innovation, ...]:
        """Return the filter's innovations after an instant, the oldest first."""
        return self.estimator.innovations_after(t_ns)

    def readings(self) -> Readings:
        """Return the IMU's reading at this tick, and the other sensors' last ones."""
        sensors, b = self.sensors, self.estimator.biases
        samples = self._loop.taken
        x, y, z = samples[-3:] or self.carried.force
        bx, by, bz = b.accel if samples else (0.0, 0.0, 0.0)
        assert sensors.pressure is not None  # aligned by it
        return Readings(
            self._believed_rates(),
            (x - bx, y - by, z - bz),
            sensors.pressure.pressure_pa,
            None if sensors.field is None else sensors.field.field_frd_gauss,
            self._vibration(),
            self.estimator.std(slice(0, 9)),
        )

    def _vibration(self) -> Triple:
        x, y, z = np.reshape(self._loop.samples, (-1, 6))[:, 3:].std(axis=0).tolist()
        return x, y, z

    def _believed_rates(self) -> Triple:
        (p, q, r), b = self.sensors.imu.rates, self.estimator.biases.gyro
        return (p - b[0], q - b[1], r - b[2])

    def why_not_ready(self) -> str:
        """Why the estimate is not good enough to fly on; empty if it is."""
        estimator = self.estimator
        # The receiver's positions count where they are believed.
        if self._clock.t_ns - estimator.fused_ns["gnss position"] >= _GNSS_LOST_NS:
            return "no GNSS"
        if float(max(estimator.std(_HORIZONTAL))) > _POSITION_STD_M:
            return "position uncertain"
        if float(max(estimator.std(_TILT))) > _TILT_STD_RAD:
            return "attitude uncertain"
        if float(max(estimator.std(_HEADING))) > _HEADING_STD_RAD:
            return "heading uncertain"
        return ""
