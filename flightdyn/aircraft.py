"""The aircraft: physics, sensors, estimation, guidance and control, one tick at a time."""

import math

from flightdyn.battery import Battery
from flightdyn.clock import SimClock
from flightdyn.config import AircraftConfig
from flightdyn.control import Controller
from flightdyn.errors import FlightInputError
from flightdyn.fault_state import FaultState
from flightdyn.faults import Fault
from flightdyn.frames import LocalFrame, Triple, frozen, yaw_of
from flightdyn.guidance import Guidance
from flightdyn.inertial import Earth
from flightdyn.inertial_navigation import InertialNavigation
from flightdyn.inner_loops import InnerLoops
from flightdyn.multirotor import Multirotor
from flightdyn.navigation import Navigation, TrueNavigation
from flightdyn.path import FlightPath, PathProgress
from flightdyn.random import RandomStreams
from flightdyn.state import (
    BatteryState,
    GeodeticPoint,
    GnssFix,
    Innovation,
    Kinematics,
    Vector,
)
from flightdyn.wind import gust_ned

_SLOW = 5  # guidance steps between looks at battery and ground


def _triple(vector: Vector) -> Triple:
    return float(vector[0]), float(vector[1]), float(vector[2])


class Aircraft:
    """A multirotor on its own belief of where it is. Time zero: aligned, at rest, disarmed."""

    def __init__(
        self, config: AircraftConfig, *, home: GeodeticPoint, streams: RandomStreams
    ) -> None:
        self.config = config
        self.frame = LocalFrame(home)
        perfect = config.sensors.kind == "perfect"
        clock = SimClock(config.physics_hz)
        interval = clock.ticks(config.guidance_interval_s, what="guidance_interval_s")
        if not perfect:
            clock.tick = -clock.ticks(config.sensors.alignment_s, what="sensors.alignment_s")
        self._clock = clock
        self.dt_ns = clock.dt_ns
        self._interval = interval
        heading = config.heading_deg * math.pi / 180
        self.vehicle = Multirotor(
            self.frame,
            config.wind,
            dt_s=clock.dt_s,
            seed=streams.seed("wind"),
            heading_rad=heading,
        )
        # JSBSim's ground is at its sea level, and so is its gravity.
        earth = Earth.at(home.lat_deg, 0.0)
        inner = InnerLoops(self.vehicle, dt_s=clock.dt_s)
        self.navigation: Navigation
        receiver, imu = None, None
        if perfect:
            self.navigation = TrueNavigation(self.vehicle, inner, clock)
        else:
            self.navigation = inertial = InertialNavigation(
                config.sensors,
                self.vehicle,
                inner,
                clock,
                streams,
                earth=earth,
                guidance_ticks=interval,
            )
            receiver, imu = inertial.receiver, inertial.imu
        self._faults = FaultState(config.faults, self.vehicle, receiver=receiver, imu=imu)
        self._nav = self.navigation.state()
        dt_s = config.guidance_interval_s
        self.controller = Controller(
            inner, self.vehicle.airframe, config.limits, dt_s=dt_s, gravity_mps2=earth.gravity_mps2
        )
        self._guidance = Guidance(
            self.controller, config.limits, dt_s=dt_s, yaw=yaw_of(self._nav.q)
        )
        self._battery = Battery(config.battery)
        self._gusty = bool(config.wind.gusts or config.faults)
        self._run = self.vehicle.run
        self._near = False
        self._low = True  # so near the ground that it may be touched before the next look
        self._slow = 0
        self.armed = False
        self.impact_mps: float | None = None  # with which it crashed

    def step(self) -> None:
        """One tick: physics and sensors; every few of them filter, guidance and battery."""
        self._run()
        clock = self._clock
        clock.tick += 1
        if self._low:
            self._feel_ground()
        self.navigation.tick()
        if clock.tick % self._interval == 0:
            self._guide()
        elif self._near:
            self._guidance.pass_corners(self.navigation.position(), self._nav.v)

    def _feel_ground(self) -> None:
        """A wreck from the tick on at which the ground is met faster than the legs can take."""
        speed = self.vehicle.impact_mps()
        if speed > self.vehicle.airframe.impact_limit_mps:
            self.impact_mps = speed
            self.disarm()
            self.vehicle.wreck()
            self._run = self.vehicle.run
            self._low = False

    def _guide(self) -> None:
        self.vehicle.check()
        nav = self._nav = self.navigation.update()
        guidance = self._guidance
        if self._near:
            guidance.pass_corners(nav.p, nav.v)
        guidance.step(nav, self.navigation.specific_force)
        self._near = guidance.corner_near(nav)
        if self._gusty:
            self._blow()
        self._slow += 1
        if self._slow == _SLOW:
            self._slow = 0
            self._housekeep()

    def _blow(self) -> None:
        """Gusts and bursts of this instant."""
        gust = gust_ned(self.config.wind.gusts, self._clock.t_ns * 1e-9)
        burst = self._faults.burst_ned_mps
        self.vehicle.set_gust((gust[0] + burst[0], gust[1] + burst[1], gust[2] + burst[2]))

    def _housekeep(self) -> None:
        """What does not need the guidance's rate."""
        volts = self._battery.draw(
            self.vehicle.electrical_power_w(), _SLOW * self.config.guidance_interval_s
        )
        self.vehicle.set_battery_voltage(volts)
        self._low = self.vehicle.watch_ground() and not self.crashed
        self._faults.update(self._clock.t_ns)

    @property
    def t_ns(self) -> int:
        """Simulated time."""
        return self._clock.t_ns

    @property
    def truth(self) -> Kinematics:
        """Where the aircraft is."""
        return self.vehicle.kinematics(self._clock.t_ns)

    @property
    def belief(self) -> Kinematics:
        """Where it believes it is."""
        return self.navigation.belief()

    @property
    def gnss(self) -> GnssFix | None:
        """The last solution delivered."""
        return self.navigation.gnss

    def innovations_after(self, t_ns: int) -> tuple[Innovation, ...]:
        """What the estimator was given after an instant, against what it expected; oldest first.

        Instants are the estimator's, which lies behind the clock by the receiver's delay. Only
        the newest few seconds are kept.
        """
        return self.navigation.innovations_after(t_ns)

    @property
    def wind_ned_mps(self) -> Vector:
        """Velocity of the air around the aircraft, gusts and turbulence included."""
        return frozen(self.vehicle.wind_ned())

    @property
    def battery(self) -> BatteryState:
        """Voltage, current, charge."""
        return self._battery.state()

    @property
    def on_ground(self) -> bool:
        """What the land detector believes; of a wreck there is no doubt."""
        return self._guidance.landed or self.crashed

    @property
    def crashed(self) -> bool:
        """Whether the ground was hit faster than the legs can take: a wreck, at rest for good."""
        return self.impact_mps is not None

    @property
    def progress(self) -> PathProgress:
        """How far the path in force has been flown."""
        return self._guidance.progress

    @property
    def cmd_pos_ned_m(self) -> Vector | None:
        """Where the guidance wants to be; None while it holds nothing."""
        point = self._guidance.command
        return None if point is None else frozen(point)

    @property
    def ready(self) -> bool:
        """Whether the estimate may be flown on."""
        return not self.why_not_ready

    @property
    def why_not_ready(self) -> str:
        """What keeps the aircraft from being ready; empty if nothing."""
        return "crashed" if self.crashed else self.navigation.why_not_ready()

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The faults in force."""
        return self._faults.active

    def inject(self, fault: Fault) -> None:
        """Put a fault in force now, for its duration. Raises FaultError where there is no such
        part to fail.
        """
        self._faults.begin(fault, self._clock.t_ns)
        self._gusty = True

    def end(self, fault: Fault) -> None:
        """End one fault in force, and no other; nothing happens where it is not in force."""
        self._faults.end(fault)

    def arm(self) -> None:
        """Motors on, idling until an order lifts the aircraft. A wreck stays what it is."""
        if self.crashed:
            return
        self.armed = self._guidance.armed = True
        self.vehicle.arm(True)

    def disarm(self) -> None:
        """Motors off, wherever the aircraft is."""
        self.armed = self._guidance.armed = False
        self.vehicle.arm(False)
        self._guidance.idle()

    def exchange_battery(self) -> None:
        """Put in a fresh battery.

        Raises:
            FlightInputError: the motors are on.
        """
        if self.armed:
            raise FlightInputError("battery: can be exchanged on the ground only, motors off")
        self._battery.exchange()
        self.vehicle.set_battery_voltage(self._battery.voltage_v)

    def idle(self) -> None:
        """No order: motors turn without lift when armed."""
        self._guidance.idle()

    def hold(self, pos_ned_m: Vector, yaw_rad: float) -> None:
        """Go to a position and stay there, heading `yaw_rad`."""
        self._guidance.hold(self._nav, _triple(pos_ned_m), yaw_rad)

    def velocity(self, vel_ned_mps: Vector, yaw_rad: float) -> None:
        """Fly at a velocity over ground, heading `yaw_rad`."""
        self._guidance.velocity(self._nav, _triple(vel_ned_mps), yaw_rad)

    def follow(self, path: FlightPath) -> None:
        """Fly a path and hold its last point."""
        self._guidance.follow(self._nav, path)
