"""The sensors of one aircraft together, read tick by tick on its clock."""

from flightdyn.clock import SimClock
from flightdyn.config import SensorsConfig
from flightdyn.native.ticks import Imu
from flightdyn.physics.multirotor import Multirotor
from flightdyn.physics.sensors import Baro, BaroSample, Gnss, ImuErrors, Magnetometer, MagSample
from flightdyn.random import RandomStreams
from flightdyn.state import GnssFix


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
        self._baro_ticks = clock.ticks(config.baro.interval_s, what="sensors.baro.interval_s")
        self._mag_ticks = clock.ticks(config.mag.interval_s, what="sensors.mag.interval_s")
        self.pressure: BaroSample | None = None  # as read last
        self.field: MagSample | None = None
        self.due = 0  # the tick from which `slow` has something to read

    def slow(self) -> tuple[BaroSample | None, MagSample | None]:
        """Read the sensors due now; return barometer and magnetometer samples, None if not due."""
        clock, tick, vehicle = self._clock, self._clock.tick, self._vehicle
        pressure = field = None
        if tick % self._gnss_ticks == 0:
            self.receiver.measure(clock.t_ns, vehicle.position_ned(), vehicle.velocity_ned())
        if tick % self._baro_ticks == 0:
            pressure = self.pressure = self._baro.measure(clock.t_ns, vehicle.pressure_pa())
        if tick % self._mag_ticks == 0:
            field = self.field = self._mag.measure(clock.t_ns, vehicle.attitude())
        gnss, baro, mag = self._gnss_ticks, self._baro_ticks, self._mag_ticks
        self.due = tick + min(gnss - tick % gnss, baro - tick % baro, mag - tick % mag)
        return pressure, field

    def fix(self) -> GnssFix | None:
        """Return the GNSS solution that has arrived by this tick, or None."""
        return self.receiver.deliver(self._clock.t_ns)
