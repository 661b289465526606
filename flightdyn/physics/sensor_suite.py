"""The sensors of one aircraft together, read tick by tick on its clock."""

from collections.abc import Callable
from itertools import islice

from flightdyn.clock import SimClock
from flightdyn.config import SensorsConfig
from flightdyn.frames import Triple
from flightdyn.inertial import ImuSample
from flightdyn.physics.multirotor import Multirotor
from flightdyn.physics.sensors import Baro, BaroSample, Gnss, ImuErrors, Magnetometer, MagSample
from flightdyn.physics.wind import FT_M
from flightdyn.random import RandomStreams
from flightdyn.state import GnssFix


class SensorSuite:
    """IMU at every tick; receiver, barometer and magnetometer at intervals of their own."""

    def __init__(
        self, config: SensorsConfig, vehicle: Multirotor, clock: SimClock, streams: RandomStreams
    ) -> None:
        """Raises FlightInputError where an interval is no whole number of ticks."""
        self.config = config
        self._vehicle = vehicle
        self._clock = clock
        self.errors = ImuErrors(config.imu, streams, dt_s=clock.dt_s)
        self.receiver = Gnss(config.gnss, streams)
        self._baro = Baro(config.baro, streams)
        self._mag = Magnetometer(config.mag, streams)
        self._gnss_ticks = clock.ticks(config.gnss.interval_s, what="sensors.gnss.interval_s")
        self._baro_ticks = clock.ticks(config.baro.interval_s, what="sensors.baro.interval_s")
        self._mag_ticks = clock.ticks(config.mag.interval_s, what="sensors.mag.interval_s")
        self._errors = iter(self.errors)
        self.rates: Triple = (0.0, 0.0, 0.0)  # gyroscopes, as read last
        self.pressure: BaroSample | None = None  # as read last
        self.field: MagSample | None = None
        self.due = 0  # the tick from which `slow` has something to read

    def imu(self) -> ImuSample:
        """The IMU's sample of this tick: body rates (rad/s), specific force (m/s2), FRD.

        The force that JSBSim shows is that of the tick before: the rates of then go with it.
        `rates` are those of this very tick.
        """
        v = self._vehicle
        e = next(self._errors)
        p, q, r = self.rates
        self.rates = (v.rate_p() + e[0], v.rate_q() + e[1], v.rate_r() + e[2])
        return (
            p,
            q,
            r,
            v.accel_x_fps2() * FT_M + e[3],
            v.accel_y_fps2() * FT_M + e[4],
            v.accel_z_fps2() * FT_M + e[5],
        )

    def imu_while(
        self,
        run: Callable[[], object],
        ticks: int,
        *,
        keep: Callable[[ImuSample], object],
        feel: Callable[[float, float, float], object],
    ) -> None:
        """The IMU's samples of ticks that are run here, to `keep`; the rates of each to `feel`.

        What `imu` does, written out: nothing else is done at every tick.
        """
        v = self._vehicle
        rate_p, rate_q, rate_r = v.rate_p, v.rate_q, v.rate_r
        accel_x, accel_y, accel_z = v.accel_x_fps2, v.accel_y_fps2, v.accel_z_fps2
        p, q, r = self.rates
        for ep, eq, er, ex, ey, ez in islice(self._errors, ticks):
            run()
            keep((p, q, r, accel_x() * FT_M + ex, accel_y() * FT_M + ey, accel_z() * FT_M + ez))
            p, q, r = rate_p() + ep, rate_q() + eq, rate_r() + er
            feel(p, q, r)
        self.rates = (p, q, r)

    def slow(self) -> tuple[BaroSample | None, MagSample | None]:
        """Read what is due at this tick, and note when the next sensor is."""
        clock, tick, vehicle = self._clock, self._clock.tick, self._vehicle
        pressure = field = None
        if tick % self._gnss_ticks == 0:
            self.receiver.measure(clock.t_ns, vehicle.position_ned(), vehicle.velocity_ned())
        if tick % self._baro_ticks == 0:
            pressure = self.pressure = self._baro.measure(clock.t_ns, vehicle.pressure_pa())
        if tick % self._mag_ticks == 0:
            field = self.field = self._mag.measure(clock.t_ns, vehicle.attitude())
        self.due = min(
            (tick // n + 1) * n for n in (self._gnss_ticks, self._baro_ticks, self._mag_ticks)
        )
        return pressure, field

    def fix(self) -> GnssFix | None:
        """The receiver's solution that arrives by this tick, if one does."""
        return self.receiver.deliver(self._clock.t_ns)
