"""Where the autopilot's knowledge comes from, and the truth itself as one such source.

Which source is used is chosen once, when the aircraft is made. After each tick of the physics
`tick` hands body rates to the inner loops; `state` is what the guidance flies on.
"""

from typing import Protocol

from flightdyn.clock import SimClock
from flightdyn.frames import Triple, frozen
from flightdyn.guidance.inner_loops import InnerLoops
from flightdyn.inertial import NavState
from flightdyn.instruments import Readings
from flightdyn.physics.multirotor import Multirotor
from flightdyn.state import GnssFix, Innovation, Kinematics


class Navigation(Protocol):
    """What the aircraft flies on."""

    gnss: GnssFix | None
    specific_force: Triple  # mean over the last guidance interval, biases taken off

    def tick(self) -> None: ...

    def update(self) -> NavState: ...

    def state(self) -> NavState: ...

    def position(self) -> Triple: ...

    def belief(self) -> Kinematics: ...

    def innovations_after(self, t_ns: int, /) -> tuple[Innovation, ...]: ...

    def readings(self) -> Readings: ...

    def why_not_ready(self) -> str: ...


class TrueNavigation:
    """The autopilot is handed the truth: for tests of the control alone."""

    def __init__(self, vehicle: Multirotor, inner: InnerLoops, clock: SimClock) -> None:
        self._vehicle = vehicle
        self._inner = inner
        self._clock = clock
        self._fix_ticks = clock.ticks(0.2, what="interval of exact fixes")
        self.gnss: GnssFix | None = None
        self.specific_force: Triple = (0.0, 0.0, 0.0)
        self._fix()

    def tick(self) -> None:
        """True body rates to the inner loops."""
        v = self._vehicle
        self._inner.feed(v.rate_p(), v.rate_q(), v.rate_r())
        if self._clock.tick % self._fix_ticks == 0:
            self._fix()

    def _fix(self) -> None:
        v = self._vehicle
        self.gnss = GnssFix(
            t_ns=self._clock.t_ns,
            pos_ned_m=frozen(v.position_ned()),
            vel_ned_mps=frozen(v.velocity_ned()),
            std_horizontal_m=0.01,
            std_vertical_m=0.01,
            std_velocity_mps=0.01,
            satellites=20,
        )

    def update(self) -> NavState:
        """The truth."""
        v = self._vehicle
        self.specific_force = v.specific_force()
        return self.state()

    def state(self) -> NavState:
        """The truth."""
        v = self._vehicle
        return NavState(self._clock.t_ns, v.position_ned(), v.velocity_ned(), v.attitude())

    def position(self) -> Triple:
        """Position of this tick (m, NED)."""
        return self._vehicle.position_ned()

    def belief(self) -> Kinematics:
        """The truth."""
        return self._vehicle.kinematics(self._clock.t_ns)

    def innovations_after(self, _t_ns: int) -> tuple[Innovation, ...]:
        """None: nothing is estimated."""
        return ()

    def readings(self) -> Readings:
        """The truth."""
        v = self._vehicle
        rates = (v.rate_p(), v.rate_q(), v.rate_r())
        return Readings(rates, v.specific_force(), v.pressure_pa(), None, (0.0, 0.0, 0.0), None)

    def why_not_ready(self) -> str:
        """Always ready."""
        return ""
