"""The aircraft: physics, sensors, estimation, guidance and control, one tick at a time."""

import math

from flightdyn.config import AircraftConfig
from flightdyn.frames import Triple, frozen, yaw_of
from flightdyn.guidance.control import AttitudeOrder, attitude_along, outer_loop
from flightdyn.guidance.guidance import Guidance
from flightdyn.guidance.path import FlightPath, PathProgress
from flightdyn.guidance.pursuit import Target
from flightdyn.inertial import Earth
from flightdyn.instruments import Instruments
from flightdyn.native.library import Trace
from flightdyn.navigation.inertial_navigation import InertialNavigation
from flightdyn.navigation.source import TrueNavigation
from flightdyn.obstacles import Obstacles
from flightdyn.plant import Plant
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint, GnssFix, Innovation, Kinematics, Vector
from native.errors import InputError


def _triple(vector: Vector) -> Triple:
    return float(vector[0]), float(vector[1]), float(vector[2])


class Aircraft(Plant):
    """A multirotor flown on its own state estimate. At time zero: aligned, at rest, disarmed."""

    def __init__(
        self,
        config: AircraftConfig,
        *,
        home: GeodeticPoint,
        streams: RandomStreams,
        obstacles: Obstacles | None = None,
    ) -> None:
        super().__init__(config, home=home, streams=streams, obstacles=obstacles)
        # JSBSim's ground is at its sea level, and so is its gravity.
        earth = Earth.at(home.lat_deg, 0.0)
        inner = self.vehicle.inner_loops
        self.navigation: InertialNavigation | TrueNavigation
        if self.sensors is None:
            self.navigation = TrueNavigation(self, inner)
        else:
            self.navigation = InertialNavigation(self, self.sensors, inner, earth=earth)
        dt_s = config.guidance_interval_s
        self._guide = outer_loop(
            inner, self.vehicle.airframe, config.limits, dt_s=dt_s, gravity_mps2=earth.gravity_mps2
        )
        self._guidance = Guidance(
            self._guide, config.limits, dt_s=dt_s, yaw=yaw_of(self.navigation.state().q)
        )
        self.armed = False
        self._belief: Kinematics | None = None  # of this tick, once somebody has asked
        self.trace: Trace | None = None  # what is recorded of the control
        self.interest_ned_m: Vector | None = None  # what it heads towards, by `look_at`

    def step(self) -> None:
        """Run one tick: physics and sensors; every few of them filter, guidance and battery."""
        self.advance(1)

    def advance(self, most: int) -> int:
        """Run up to `most` ticks, fewer where there is something to do: a sensor or a correction is
        due, the ground is near, or the path's progress has changed.

        Returns how many.
        """
        navigation, guidance = self.navigation, self._guidance
        self._belief = None
        if self.low:
            most = 1
        elif guidance.pursuing:  # the reference is made anew for each guidance step
            most = min(most, self.to_guidance_step)
        most = min(most, self.due - self.clock.tick)
        ticks = navigation.fly(most, self._guide)
        self.advance_clock(ticks)
        if guidance.look():  # flown up to a guidance step, which is the one that tells
            return ticks
        if self.impact_mps is not None and self.armed:
            self.disarm()
        navigation.sense()
        to_guide = self.clock.tick % self.interval == 0
        if to_guide:
            navigation.update()
        if guidance.corner_near:
            here = navigation.state()
            guidance.pass_corners(here.p, here.v)
        if to_guide:
            guidance.step(navigation.carried, navigation.state)
        return ticks

    @property
    def to_guidance_step(self) -> int:
        """Ticks left until the next guidance step."""
        return self.interval - self.clock.tick % self.interval

    @property
    def belief(self) -> Kinematics:
        """Estimated position, velocity, attitude and rates of this tick."""
        if self._belief is None:
            self._belief = self.navigation.belief()
        return self._belief

    @property
    def gnss(self) -> GnssFix | None:
        """The latest solution of the GNSS receiver; None before the first."""
        return self.navigation.gnss

    def record(self, *, every: int, room: int) -> None:
        """Trace the control: a row each `every` guidance steps, `room` at most until taken."""
        step_ns = self.interval * self.dt_ns
        self.trace = Trace(self.vehicle.actuators, every=every, room=room, step_ns=step_ns)
        self._guide.record_into(self.trace)

    def innovations_after(self, t_ns: int) -> tuple[Innovation, ...]:
        """Return the estimator's innovations after an instant, the oldest first.

        Instants are the estimator's, which lies behind the clock by the receiver's delay. Only
        the newest few seconds are kept.
        """
        return self.navigation.innovations_after(t_ns)

    @property
    def on_ground(self) -> bool:
        """Whether the aircraft has landed, by the land detector; a wreck always has."""
        return bool(self._guide.memory.landed) or self.crashed

    @property
    def progress(self) -> PathProgress:
        """Progress along the path in force."""
        return self._guidance.progress

    @property
    def cmd_pos_ned_m(self) -> Vector | None:
        """Position setpoint of the guidance; None while it has none."""
        to = self._guidance.setpoint
        return None if to is None else frozen(to.p)

    @property
    def ready(self) -> bool:
        """Whether the estimate is good enough to be flown on."""
        return not self.why_not_ready

    @property
    def why_not_ready(self) -> str:
        """What keeps the aircraft from being ready; empty if nothing."""
        return "crashed" if self.crashed else self.navigation.why_not_ready()

    def arm(self) -> None:
        """Turn the motors on, idling until an order lifts the aircraft. A wreck stays disarmed."""
        if self.crashed:
            return
        self.armed = self._guide.memory.armed = True
        self.vehicle.arm(True)

    def disarm(self) -> None:
        """Turn the motors off, wherever the aircraft is."""
        self.armed = self._guide.memory.armed = False
        self.vehicle.arm(False)
        self._guidance.idle()

    def exchange_battery(self) -> None:
        """Put in a battery as charged as the first one was.

        Raises:
            InputError: the motors are on.
        """
        if self.armed:
            raise InputError("battery: can be exchanged on the ground only, motors off")
        super().exchange_battery()

    def idle(self) -> None:
        """Set no setpoint: armed motors turn without lift."""
        self._guidance.idle()

    def hold(self, pos_ned_m: Vector, yaw_rad: float) -> None:
        """Go to a position and stay there, heading `yaw_rad`."""
        self._guidance.hold(self.navigation.state(), _triple(pos_ned_m), yaw_rad)

    def follow(self, path: FlightPath) -> None:
        """Fly a path and hold its last point."""
        self._guidance.follow(self.navigation.state(), path)

    def pursue(self, target: Target) -> None:
        """Follow a target's setpoints until the next order; a new target may come at any time."""
        self._guidance.pursue(self.navigation.state(), target)

    def keep_attitude(self, order: AttitudeOrder) -> None:
        """Keep an attitude and a thrust until the next order."""
        self._guidance.attitude(order)

    def look_at(self, pos_ned_m: Vector | None) -> None:
        """Head towards a place on every path and hold from now on; None for the course again."""
        self.interest_ned_m = pos_ned_m
        self._guidance.look_at(None if pos_ned_m is None else _triple(pos_ned_m))

    def face(self, yaw_rad: float) -> None:
        """Head `yaw_rad` on the path in force from now on; NaN: along the course again."""
        self._guidance.face(yaw_rad)

    def instruments(self) -> Instruments:
        """Readings and actuator orders of the parts at this instant."""
        control, full = self._guide.memory, self.vehicle.airframe.rotor_max_thrust_n
        thrusts = self.vehicle.rotor_thrusts_n()
        return Instruments(
            readings=self.navigation.readings(),
            setpoint=self._guidance.setpoint,
            q_wanted=attitude_along(control.thrust, yaw=control.wanted_yaw),
            throttle=math.sqrt(control.collective) if self.armed else 0.0,
            # A rotor's thrust grows with the square of its speed.
            motors=tuple(math.sqrt(min(1.0, max(0.0, thrust / full))) for thrust in thrusts),
            wind_ned_mps=self.wind_ned_mps,
            true_force_mps2=self.vehicle.specific_force(),
        )
