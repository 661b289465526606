"""The aircraft: physics, sensors, estimation, guidance and control, one tick at a time."""

from flightdyn.battery import Battery
from flightdyn.clock import SimClock
from flightdyn.config import AircraftConfig
from flightdyn.control import Controller
from flightdyn.frames import LocalFrame, Triple, frozen, yaw_of
from flightdyn.guidance import Guidance
from flightdyn.inertial import Earth
from flightdyn.inner_loops import InnerLoops
from flightdyn.multirotor import Multirotor
from flightdyn.navigation import InertialNavigation, Navigation, TrueNavigation
from flightdyn.path import FlightPath, PathProgress
from flightdyn.random import RandomStreams
from flightdyn.state import BatteryState, GeodeticPoint, GnssFix, Kinematics, Vector
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
        heading = config.heading_deg * 3.141592653589793 / 180
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
        if perfect:
            self.navigation = TrueNavigation(self.vehicle, inner, clock)
        else:
            self.navigation = InertialNavigation(
                config.sensors, self.vehicle, inner, clock, streams, earth=earth
            )
        self._nav = self.navigation.state()
        dt_s = config.guidance_interval_s
        self.controller = Controller(
            inner, self.vehicle.airframe, config.limits, dt_s=dt_s, gravity_mps2=earth.gravity_mps2
        )
        self._guidance = Guidance(
            self.controller, config.limits, dt_s=dt_s, yaw=yaw_of(self._nav.q)
        )
        self._battery = Battery(config.battery)
        self._gusts = config.wind.gusts
        self._run = self.vehicle.run
        self._near = False
        self._slow = 0
        self.armed = False

    def step(self) -> None:
        """One tick: physics and sensors; every few of them filter, guidance and battery."""
        self._run()
        clock = self._clock
        clock.tick += 1
        self.navigation.tick()
        if clock.tick % self._interval == 0:
            self._guide()
        elif self._near:
            self._guidance.pass_corners(self.navigation.position(), self._nav.v)

    def _guide(self) -> None:
        nav = self._nav = self.navigation.update()
        guidance = self._guidance
        if self._near:
            guidance.pass_corners(nav.p, nav.v)
        guidance.step(nav, self.navigation.specific_force)
        self._near = guidance.corner_near(nav)
        if self._gusts:
            self.vehicle.set_gust(gust_ned(self._gusts, self._clock.t_ns * 1e-9))
        self._slow += 1
        if self._slow == _SLOW:
            self._slow = 0
            self._housekeep()

    def _housekeep(self) -> None:
        """What does not need the guidance's rate."""
        volts = self._battery.draw(
            self.vehicle.electrical_power_w(), _SLOW * self.config.guidance_interval_s
        )
        self.vehicle.set_battery_voltage(volts)
        self.vehicle.watch_ground()

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

    @property
    def battery(self) -> BatteryState:
        """Voltage, current, charge."""
        return self._battery.state()

    @property
    def on_ground(self) -> bool:
        """What the land detector believes."""
        return self._guidance.landed

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
        return self.navigation.why_not_ready()

    def arm(self) -> None:
        """Motors on, idling until an order lifts the aircraft."""
        self.armed = self._guidance.armed = True
        self.vehicle.arm(True)

    def disarm(self) -> None:
        """Motors off, wherever the aircraft is."""
        self.armed = self._guidance.armed = False
        self.vehicle.arm(False)
        self._guidance.idle()

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
