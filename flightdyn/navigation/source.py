"""True states in place of an estimate, for an autopilot that is handed the truth.

It stands in for `InertialNavigation`, with all that an aircraft asks of that one: `fly` hands body
rates to the inner loops after each tick of the physics; `state` is what the guidance flies on.
"""

import numpy as np

from flightdyn.frames import frozen
from flightdyn.inertial import NavState
from flightdyn.instruments import Readings
from flightdyn.native.library import NEAR, Guide, Increments, Loop, Strapdown
from flightdyn.native.ticks import AXES, Imu, Inner
from flightdyn.plant import Plant
from flightdyn.state import GnssFix, Innovation, Kinematics


class TrueNavigation:
    """Navigation by the true state (`sensors.kind = "perfect"`), to test the control alone."""

    def __init__(self, plant: Plant, inner: Inner) -> None:
        self._plant = plant
        self._vehicle = plant.vehicle
        self._clock = plant.clock
        self._fix_ticks = plant.clock.ticks(0.2, what="interval of exact fixes")
        self.gnss: GnssFix | None = None
        # State and mean specific force of the last guidance interval.
        self.carried = Strapdown((0.0, 0.0, 0.0), most=1)
        imu = Imu(plant.vehicle.imu, lambda: np.zeros((1000, AXES)))
        self._loop = Loop(imu, inner, self.carried, interval=plant.interval, dt_s=plant.clock.dt_s)
        self._unused = Increments(1)
        self._due = 0  # the tick of the next fix
        self.sense()

    def fly(self, most: int, guide: Guide) -> int:
        """Run ticks of physics with true rates, up to a guidance step or fix; return how many."""
        tick, interval = self._clock.tick, self._loop.interval
        ticks = min(most, interval - tick % interval, self._due - tick)
        if guide.memory.noted & NEAR:  # corners are passed by the true state
            ticks = 1
        self._unused.drop(self._unused.count)
        return self._loop.fly(self._plant.run, ticks, self._unused, guide)

    def sense(self) -> None:
        """Take an exact GNSS fix, when it is due."""
        if self._clock.tick < self._due:
            return
        v = self._vehicle
        self._due += self._fix_ticks
        self.gnss = GnssFix(
            t_ns=self._clock.t_ns,
            pos_ned_m=frozen(v.position_ned()),
            vel_ned_mps=frozen(v.velocity_ned()),
            std_horizontal_m=0.01,
            std_vertical_m=0.01,
            std_velocity_mps=0.01,
            satellites=20,
        )

    def update(self) -> None:
        """Set the state that guidance flies on to the true one."""
        v = self._vehicle
        self.carried.place(v.position_ned(), v.velocity_ned(), v.attitude())
        self.carried.set_force(v.specific_force())

    def state(self) -> NavState:
        """True state of this tick."""
        v = self._vehicle
        return NavState(self._clock.t_ns, v.position_ned(), v.velocity_ned(), v.attitude())

    def belief(self) -> Kinematics:
        """True position, velocity, attitude and body rates of this tick."""
        return self._vehicle.kinematics(self._clock.t_ns)

    def innovations_after(self, _t_ns: int) -> tuple[Innovation, ...]:
        """Return (): there is no filter."""
        return ()

    def readings(self) -> Readings:
        """True values in place of sensor readings."""
        v = self._vehicle
        return Readings(v.rates(), v.specific_force(), v.pressure_pa(), None, (0.0, 0.0, 0.0), None)

    def why_not_ready(self) -> str:
        """Return "": always ready."""
        return ""
