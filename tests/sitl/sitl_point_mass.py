"""A point mass with the aircraft's interface: exact, quick, without noise.

The protocol tests fly it, so that they do not depend on physics and cost almost nothing.
"""

import math
from functools import cache

import numpy as np

from flightdyn.config import LimitsConfig
from flightdyn.faults import Fault
from flightdyn.frames import LocalFrame, quaternion_from_euler
from flightdyn.guidance.control import AttitudeOrder
from flightdyn.guidance.path import FlightPath, PathProgress
from flightdyn.guidance.pursuit import Target, wanted_velocity
from flightdyn.instruments import Instruments, Readings
from flightdyn.state import BatteryState, GeodeticPoint, GnssFix, Innovation, Kinematics, Vector

_LIMITS = LimitsConfig()


@cache
def _level(yaw_rad: float) -> Vector:
    """The attitude, level."""
    return np.array(quaternion_from_euler(0.0, 0.0, yaw_rad))


class Faults:
    """Those of a point mass, which do nothing to it."""

    def __init__(self, of: "PointMass") -> None:
        self._of = of
        self.active: tuple[Fault, ...] = ()
        self.news: list[tuple[int, str]] = []

    def happened(self, _what: str | int) -> None:
        """Nothing is configured to fail."""

    def end(self, fault: Fault) -> None:
        self.active = tuple(other for other in self.active if other != fault)
        self.news.append((self._of.t_ns, f"Fault ends: {fault.kind}"))


class PointMass:
    """Moves along straight lines at the ordered speed, starting and stopping at once."""

    def __init__(self, home: GeodeticPoint, *, rate_hz: int = 50, ready_after_s: float = 0.2):
        self.dt_ns = 1_000_000_000 // rate_hz
        self.t_ns = 0
        self.frame = LocalFrame(home)
        self.armed = False
        self.crashed = False
        self.impact_mps: float | None = None
        self.hit = "the ground"
        self.progress = PathProgress()
        self.battery = BatteryState(16.0, 0.0, 0.0, 1.0)
        self.gnss: GnssFix | None = None
        self.gnss_works = True
        self.cmd_pos_ned_m: Vector | None = None
        self.wind_ned_mps = np.zeros(3)
        self.faults = Faults(self)
        self.trace = None
        self.paths: list[FlightPath] = []
        self._ready_ns = int(ready_after_s * 1e9)
        self.pos_ned_m = np.zeros(3)
        self.vel_ned_mps = np.zeros(3)
        self.yaw_rad = 0.0
        self._path: FlightPath | None = None
        self.target: Target | None = None
        self.attitude: AttitudeOrder | None = None
        self.interest_ned_m: Vector | None = None

    @property
    def ready(self) -> bool:
        return self.t_ns >= self._ready_ns

    @property
    def why_not_ready(self) -> str:
        return "" if self.ready else "aligning"

    @property
    def on_ground(self) -> bool:
        return bool(self.pos_ned_m[2] >= 0.0)

    @property
    def belief(self) -> Kinematics:
        return Kinematics(
            self.t_ns,
            self.pos_ned_m.copy(),
            self.vel_ned_mps.copy(),
            _level(self.yaw_rad),
            np.zeros(3),
        )

    truth = belief

    def innovations_after(self, _t_ns: int, /) -> tuple[Innovation, ...]:
        return ()

    def inject(self, fault: Fault) -> None:
        self.faults.active += (fault,)
        self.faults.news.append((self.t_ns, f"Fault begins: {fault.kind}"))

    def arm(self) -> None:
        self.armed = True

    def disarm(self) -> None:
        self.armed = False
        self._path = self.cmd_pos_ned_m = self.target = self.attitude = None
        self.progress = PathProgress()

    def idle(self) -> None:
        self._path = self.cmd_pos_ned_m = self.target = None

    def hold(self, pos_ned_m: Vector, yaw_rad: float) -> None:
        self.follow(FlightPath(np.array([self.pos_ned_m, pos_ned_m]), np.array([5.0]), np.ones(2)))
        self.yaw_rad = math.remainder(yaw_rad, math.tau)

    def pursue(self, target: Target) -> None:
        self.idle()
        self.target = target
        if not math.isnan(target.yaw):
            self.yaw_rad = math.remainder(target.yaw, math.tau)

    def keep_attitude(self, order: AttitudeOrder) -> None:
        self.idle()
        self.attitude = order

    def look_at(self, pos_ned_m: Vector | None) -> None:
        self.interest_ned_m = pos_ned_m

    def face(self, yaw_rad: float) -> None:
        if not math.isnan(yaw_rad):
            self.yaw_rad = math.remainder(yaw_rad, math.tau)

    def follow(self, path: FlightPath) -> None:
        self.idle()
        self.paths.append(path)
        self._path = path
        self.progress = PathProgress(passed=1)

    def instruments(self) -> Instruments:
        still = (0.0, 0.0, 0.0)
        readings = Readings(still, (0.0, 0.0, -9.81), 95_000.0, (0.2, 0.0, 0.4), still, None)
        level, force, zero = (1.0, 0.0, 0.0, 0.0), readings.specific_force_mps2, np.zeros(3)
        return Instruments(readings, None, level, 0.0, (0.0,) * 4, zero, force)

    def advance(self, most: int) -> int:
        assert most >= 1
        self.step()
        return 1

    to_guidance_step = 1

    def step(self) -> None:
        self.t_ns += self.dt_ns
        if self.gnss_works and self.t_ns % 200_000_000 == 0:
            self.gnss = GnssFix(
                self.t_ns, self.pos_ned_m.copy(), self.vel_ned_mps.copy(), 0.7, 1.2, 0.1, 12
            )
        before, step_s = self.pos_ned_m, self.dt_ns * 1e-9
        if self.armed:
            self._move(step_s)
        elif before[2] < 0:
            self.pos_ned_m = before + np.array((0.0, 0.0, 5.0 * step_s))
        if self.pos_ned_m[2] > 0.0:
            self.pos_ned_m = np.array([*self.pos_ned_m[:2], 0.0])
        moved = self.pos_ned_m is not before
        self.vel_ned_mps = (self.pos_ned_m - before) / step_s if moved else np.zeros(3)

    def _move(self, left_s: float) -> None:
        if self.target is not None:
            here = (float(self.pos_ned_m[0]), float(self.pos_ned_m[1]), float(self.pos_ned_m[2]))
            wanted = wanted_velocity(here, (0.0, 0.0, 0.0), self.target, _LIMITS)
            self.pos_ned_m = self.pos_ned_m + np.array(wanted) * left_s
        path, progress = self._path, self.progress
        while path is not None and not progress.finished and left_s > 0:
            goal = path.points_ned_m[progress.passed]
            self.cmd_pos_ned_m = np.array(goal)
            way = goal - self.pos_ned_m
            distance = math.hypot(*way.tolist())
            reach = float(path.speeds_mps[progress.passed - 1]) * left_s
            if distance > reach:
                self.pos_ned_m = self.pos_ned_m + way * (reach / distance)
                return
            self.pos_ned_m = np.array(goal)
            left_s *= 1.0 - distance / reach
            progress.passed += 1
            progress.finished = progress.passed == len(path.points_ned_m)
