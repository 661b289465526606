"""The aircraft without an autopilot: physics, sensors, battery, ground, wind and faults.

Whoever flies it steps it tick by tick, reads its sensors and drives its motors: our own
autopilot (`flightdyn.aircraft`), or a firmware through one of the bridges of `sitl.firmware`.
"""

import math
from collections.abc import Callable

from flightdyn.clock import SimClock
from flightdyn.config import AircraftConfig
from flightdyn.faults import Fault
from flightdyn.frames import LocalFrame, Triple, frozen
from flightdyn.obstacles import Obstacles
from flightdyn.physics.air import gust_ned
from flightdyn.physics.fault_state import FaultState
from flightdyn.physics.multirotor import Multirotor
from flightdyn.physics.power import Battery
from flightdyn.physics.sensors import SensorSuite
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint, Kinematics, Vector

_SLOW = 5  # guidance intervals between looks at battery, ground and faults


class Plant:
    """A simulated multirotor; at time zero on the ground at home, at rest, motors off."""

    def __init__(
        self,
        config: AircraftConfig,
        *,
        home: GeodeticPoint,
        streams: RandomStreams,
        obstacles: Obstacles | None = None,
    ) -> None:
        """Raises InputError where an interval of `config` is no whole number of ticks."""
        self.config = config
        self.frame = LocalFrame(home)
        self.clock = clock = SimClock(config.physics_hz)
        self.interval = clock.ticks(config.guidance_interval_s, what="guidance_interval_s")
        self.vehicle = Multirotor(
            self.frame,
            config.wind,
            dt_s=clock.dt_s,
            seed=streams.seed("wind"),
            heading_rad=config.heading_deg * math.pi / 180,
        )
        perfect = config.sensors.kind == "perfect"
        self.sensors = sensors = (
            None if perfect else SensorSuite(config.sensors, self.vehicle, clock, streams)
        )
        self.faults = FaultState(
            config.faults,
            self.vehicle,
            clock,
            receiver=None if sensors is None else sensors.receiver,
            imu=None if sensors is None else sensors.imu,
        )
        self._battery = Battery(config.battery)
        self.battery = self._battery.state()  # voltage, current, charge
        self._obstacles = obstacles
        self._gusty = bool(config.wind.gusts or config.faults)
        self._watch_ground(near=True)
        self._slow = _SLOW * self.interval  # ticks
        self.due = self._after(clock.tick)  # the tick of the next look around
        self.impact_mps: float | None = None  # with which it crashed
        self.hit = ""  # what

    def _after(self, tick: int) -> int:
        every = self.interval if self._gusty else self._slow
        return (tick // every + 1) * every

    def step(self) -> None:
        """Run one tick of physics; every few of them update gusts, battery, ground and faults.

        Raises:
            ModelDivergedError: the physics has left the numbers.
        """
        self.run()
        self.advance_clock(1)

    def advance_clock(self, ticks: int) -> None:
        """Count ticks that were run, up to `due` at most; then update gusts, battery, ground and
        faults, if due. Raises ModelDivergedError where the physics has left the numbers."""
        self.clock.tick += ticks
        if self.clock.tick >= self.due:
            self._update_surroundings()

    def _watch_ground(self, *, near: bool) -> None:
        """Check for ground contact at every tick, or not at all."""
        self.low = near  # it may be touched before the next look
        self.run: Callable[[], bool] = self._feel_ground if near else self.vehicle.run

    def _feel_ground(self) -> bool:
        """Run a tick near the ground; wreck the aircraft at an impact beyond what its legs take."""
        self.vehicle.run()
        speed = self.vehicle.impact_mps()
        if speed > self.vehicle.airframe.impact_limit_mps:
            self.wreck(speed, "the ground")
        return True

    def wreck(self, speed_mps: float, hit: str) -> None:
        """Wreck the aircraft, which has struck something at a speed."""
        self.impact_mps, self.hit = speed_mps, hit
        self.vehicle.arm(False)
        self.vehicle.wreck()
        self._watch_ground(near=False)

    def _feel(self, obstacles: Obstacles) -> None:
        """Wreck the aircraft if it is inside an obstacle (up to two metres deep at 20 m/s)."""
        here = self.truth
        north, east, down = here.pos_ned_m.tolist()
        if obstacles.contain(north, east, -down):
            self.wreck(math.dist(here.vel_ned_mps, (0.0, 0.0, 0.0)), "a building")

    def _update_surroundings(self) -> None:
        """Update the gusts, and every few times battery, ground and faults."""
        if self._gusty:
            gust = gust_ned(self.config.wind.gusts, self.clock.t_ns * 1e-9)
            burst = self.faults.burst_ned_mps
            self.vehicle.set_gust((gust[0] + burst[0], gust[1] + burst[1], gust[2] + burst[2]))
        self.due = self._after(self.clock.tick)
        if self.clock.tick % self._slow == 0:
            volts = self._battery.draw(
                self.vehicle.electrical_power_w(), _SLOW * self.config.guidance_interval_s
            )
            self.battery = self._battery.state()
            self.vehicle.set_battery_voltage(volts)
            self._watch_ground(near=self.vehicle.watch_ground() and not self.crashed)
            if self._obstacles is not None and not self.crashed:
                self._feel(self._obstacles)
            self.faults.update()

    @property
    def dt_ns(self) -> int:
        """Length of a tick."""
        return self.clock.dt_ns

    @property
    def t_ns(self) -> int:
        """Simulated time."""
        return self.clock.t_ns

    @property
    def truth(self) -> Kinematics:
        """True position, velocity, attitude and rates of this tick."""
        return self.vehicle.kinematics(self.clock.t_ns)

    @property
    def pos_ned_m(self) -> Triple:
        """True position of this tick alone."""
        return self.vehicle.position_ned()

    @property
    def vel_ned_mps(self) -> Triple:
        """True velocity of this tick alone."""
        return self.vehicle.velocity_ned()

    @property
    def wind_ned_mps(self) -> Vector:
        """Velocity of the air around the aircraft, gusts and turbulence included."""
        return frozen(self.vehicle.wind_ned())

    @property
    def crashed(self) -> bool:
        """Whether it has struck an obstacle, or the ground too fast: a wreck, at rest for good."""
        return self.impact_mps is not None

    def inject(self, fault: Fault) -> None:
        """Put a fault in force now, for its duration. Raises FaultError without such a part."""
        self.faults.begin(fault)
        self._gusty = True
        self.due = self._after(self.clock.tick)

    def exchange_battery(self) -> None:
        """Put in a battery as charged as the first one was."""
        self._battery = Battery(self.config.battery)
        self.battery = self._battery.state()
        self.vehicle.set_battery_voltage(self._battery.voltage_v)
