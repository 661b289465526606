"""Orders in, setpoints out: idle, hold, path, a target to go after, an attitude."""

import math
from collections.abc import Callable

from flightdyn.config import LimitsConfig
from flightdyn.errors import FlightInputError
from flightdyn.frames import Triple, yaw_of
from flightdyn.guidance.control import AttitudeOrder, Controller, Heading, Setpoint
from flightdyn.guidance.landing import LandDetector
from flightdyn.guidance.path import FlightPath, PathProgress
from flightdyn.guidance.path_plan import Corner, brake_and_go, plan_path
from flightdyn.guidance.pursuit import Target, pursue, wanted_velocity
from flightdyn.guidance.trajectory import Trajectory
from flightdyn.inertial import NavState

_LEASH_M = 0.6  # how far the reference that goes after a target may run ahead
_RISE_MPS = 0.3  # a target that asks for more climb than that lifts the aircraft off the ground
_PRESSED_LIFT = 0.9  # thrust over weight below which an attitude order means to come down
_LAG_FREE_M = 1.5  # lag along the path that the governor lets pass
_LAG_STOP_M = 6.0  # lag at which the reference waits
_YIELD_PER_S, _RECOVER_PER_S = 0.3, 0.3  # of the reference's rate, while saturated and not
_LEAST_ROOM = 0.2
_LIMITED_RATE = 0.9  # the reference's clock slower than that: the speed cannot be held
_STALL_S = 30.0  # the reference moves on by less than a second in so long: it is waited for in vain
_STOPPED_MPS = 0.3
_STOPPED_M = 0.5
_EARLY_S = 0.5  # before its blend a corner cannot be passed, whatever the position says
_LATE_S = 3.0  # after it, it is passed, however far off
_COURSE_MPS = 1.5  # slower than that the course says nothing about where to look


class Guidance:
    """The order in force and how far it has been carried out."""

    def __init__(
        self, controller: Controller, limits: LimitsConfig, *, dt_s: float, yaw: float
    ) -> None:
        self._controller = controller
        self._limits = limits
        self._dt = dt_s
        self._heading = Heading(yaw, limits, dt_s=dt_s)
        self._yaw_order = yaw
        self._land = LandDetector(dt_s=dt_s)
        self._mode: Callable[[NavState], Setpoint | None] | None = None
        self._trajectory: Trajectory | None = None
        self._t = 0.0  # on the trajectory's clock
        self._rate = 1.0  # of the trajectory's clock
        self._smooth_rate = 1.0
        self._room = 1.0  # what saturation leaves of it
        self._along: Triple = (0.0, 0.0, 0.0)
        self._corners: list[Corner] = []
        self._next = 0
        self._over_s = 0.0
        self._waited_s = self._went_s = 0.0
        self._too_fast = False  # a speed ordered is beyond the limits
        self._target = Target()
        self._attitude: AttitudeOrder | None = None
        self.interest: Triple | None = None  # a place to look at on the way; None: the course
        self._course_follows = False
        self._point: Setpoint | None = None
        self.progress = PathProgress()
        self.armed = False

    @property
    def landed(self) -> bool:
        """Whether the aircraft stands on the ground, as far as the belief tells."""
        return self._land.landed

    @property
    def command(self) -> Triple | None:
        """Where the aircraft is wanted; None while no order holds it anywhere."""
        return None if self._point is None else self._point.p

    @property
    def setpoint(self) -> Setpoint | None:
        """What the controller is to follow; None while it is told nothing, or an attitude."""
        return self._point

    def idle(self) -> None:
        """Motors turn without lift when armed."""
        self._mode = None
        self._point = None
        self._trajectory = None
        self._attitude = None

    def hold(self, nav: NavState, pos: Triple, yaw: float) -> None:
        """Go to `pos` and stay."""
        _finite("hold", (*pos, yaw))
        p, v = self._start(nav)
        self._trajectory = brake_and_go(p, v, goal=pos, limits=self._limits)
        self._begin(yaw, course=False)
        self._corners = []

    def follow(self, nav: NavState, path: FlightPath) -> None:
        """Fly `path` and stay at its end."""
        _, v = self._start(nav)
        self._trajectory, self._corners = plan_path(path, self._limits, start_vel=v)
        self._begin(self._heading.yaw, course=True)
        self._next = 1
        self._too_fast = bool(path.speeds_mps.max() > self._limits.speed_mps)
        self.progress.passed = self._corners[0].count

    def _begin(self, yaw: float, *, course: bool) -> None:
        assert self._trajectory is not None
        self._mode = self._track
        self._attitude = None
        self._t = self._trajectory.start_s
        self._rate = self._smooth_rate = self._room = 1.0
        self._over_s = self._waited_s = self._went_s = 0.0
        self._yaw_order = yaw
        self._course_follows = course
        self.progress = PathProgress()

    def velocity(self, nav: NavState, vel: Triple, yaw: float) -> None:
        """Fly at `vel` (NED over ground), keeping to the line that it draws."""
        _finite("velocity", (*vel, yaw))
        self.pursue(nav, Target(vel=vel, yaw=yaw))

    def pursue(self, nav: NavState, target: Target) -> None:
        """Go after a target, which may be another one at any time."""
        if self._mode != self._after_target:
            p, v = self._start(nav)
            self._point = Setpoint(p, v, (0.0, 0.0, 0.0), self._heading.yaw, 0.0)
            self._mode = self._after_target
            self._trajectory = None
            self._attitude = None
            self._corners = []
            self.progress = PathProgress()
        self._target = target

    def attitude(self, order: AttitudeOrder) -> None:
        """Keep an attitude; where that leads is left to whoever orders it."""
        if self._attitude is None:
            self.idle()
            self._corners = []
            self.progress = PathProgress()
        self._attitude = order

    def _start(self, nav: NavState) -> tuple[Triple, Triple]:
        """Where a new reference begins: at the old one, so that nothing jumps."""
        if self._point is None or math.dist(self._point.p, nav.p) > _LAG_STOP_M:
            return nav.p, nav.v
        return self._point.p, self._point.v

    def step(self, nav: NavState, force: Triple) -> None:
        """One guidance step."""
        if not self.armed:
            # What the aircraft stands on may have been turned: no heading to come back to.
            self._heading.yaw = self._yaw_order = yaw_of(nav.q)
            self._heading.rate = 0.0
        point = self._mode(nav) if self._mode and self.armed else None
        self._point = point
        descend_mps = 0.0 if point is None else point.v[2]
        if point is None and self._attitude is not None and self.armed:
            self._controller.keep_attitude(nav, force, self._attitude, flying=not self._land.landed)
            self._heading.yaw = self._yaw_order = yaw_of(nav.q)
            descend_mps = 1.0 if self._controller.lift < _PRESSED_LIFT else 0.0
        elif point is None:
            self._controller.idle(armed=self.armed)
        else:
            flying = not self._land.touching
            if self._land.contact and point.v[2] > 0:
                self._controller.idle(armed=True)
            else:
                self._controller.fly(nav, force, to=point, flying=flying)
        self._land.update(
            armed=self.armed,
            descend_mps=descend_mps,
            sink_mps=nav.v[2],
            lift=self._controller.lift,
            knock_mps2=-force[2] - self._controller.lift * self._controller.gravity_mps2,
        )

    def _track(self, nav: NavState) -> Setpoint:
        trajectory = self._trajectory
        assert trajectory is not None
        rate = self._governor(nav)
        step = self._dt * rate
        self._t = min(self._t + step, trajectory.end_s + 1.0)
        self._watch_progress(step)
        p, v, a = trajectory.at(self._t, lead_s=self._controller.lead_s * rate)
        self._along = v
        if rate != 1.0 or self._rate != 1.0:
            # Slowing the clock decelerates the reference along its own course.
            slope, square = (rate - self._rate) / self._dt, rate * rate
            a = (
                a[0] * square + v[0] * slope,
                a[1] * square + v[1] * slope,
                a[2] * square + v[2] * slope,
            )
            v = (v[0] * rate, v[1] * rate, v[2] * rate)
            self._rate = rate
        if self._course_follows and math.hypot(v[0], v[1]) > _COURSE_MPS:
            self._yaw_order = math.atan2(v[1], v[0])
        if self.interest is not None:
            self._yaw_order = math.atan2(self.interest[1] - p[1], self.interest[0] - p[0])
        self._heading.turn(self._yaw_order)
        self._finish(nav)
        return Setpoint(p, v, a, self._heading.yaw, self._heading.rate)

    def _watch_progress(self, step: float) -> None:
        """A reference that waits for half a minute waits for good."""
        self._waited_s += self._dt
        self._went_s += step
        if self._went_s >= 1.0 or self.progress.finished:
            self._waited_s = self._went_s = 0.0
        elif self._waited_s >= _STALL_S:
            self.progress.stalled = True

    def _governor(self, nav: NavState) -> float:
        """Rate of the reference's clock: it waits for an aircraft that cannot keep up."""
        target = 1.0
        ux, uy, uz = self._along
        square = ux * ux + uy * uy + uz * uz
        if square > 0.25 and self._point is not None:
            (px, py, pz), (x, y, z) = self._point.p, nav.p
            ahead = (px - x) * ux + (py - y) * uy + (pz - z) * uz
            lag = ahead / math.sqrt(square)
            if lag > _LAG_FREE_M:
                target = max(0.0, 1 - (lag - _LAG_FREE_M) / (_LAG_STOP_M - _LAG_FREE_M))
        # At the limit of lean or thrust nothing is left to keep to the line with: slower, before
        # the lag shows.
        pace = -_YIELD_PER_S if self._controller.saturated else _RECOVER_PER_S
        self._room = min(1.0, max(_LEAST_ROOM, self._room + pace * self._dt))
        target = min(target, self._room)
        self._smooth_rate += self._dt / 1.5 * (target - self._smooth_rate)
        slow = self._too_fast or self._smooth_rate < _LIMITED_RATE
        self.progress.speed_limited = slow and bool(self._corners) and not self.progress.finished
        most = 0.5 * self._dt  # the clock itself may not jump
        return min(self._rate + most, max(self._rate - 2 * most, target))

    def _finish(self, nav: NavState) -> None:
        trajectory = self._trajectory
        assert trajectory is not None
        if self._t < trajectory.end_s or self.progress.finished:
            return
        self._over_s += self._dt
        p = trajectory.at(self._t).p
        off = math.dist(p, nav.p)
        speed = math.sqrt(nav.v[0] ** 2 + nav.v[1] ** 2 + nav.v[2] ** 2)
        if (off < _STOPPED_M and speed < _STOPPED_MPS) or self._over_s > 10.0:
            self.progress.finished = True
            self.progress.missed_m = off
            self.progress.speed_limited = False
            if self._corners:
                self.progress.passed = self._corners[-1].count
                self._next = len(self._corners)

    def corner_near(self, nav: NavState) -> bool:
        """Whether the next corner may be passed before the guidance's next step."""
        if self._next >= len(self._corners) - 1:
            return False
        corner = self._corners[self._next]
        if self._t < corner.t_s - corner.half_s - _EARLY_S - self._dt:
            return False
        if corner.normal is None:
            return True
        (x, y, z), (cx, cy, cz), (nx, ny, nz) = nav.p, corner.point, corner.normal
        beyond = (x - cx) * nx + (y - cy) * ny + (z - cz) * nz
        vx, vy, vz = nav.v
        return beyond + 2 * self._dt * (abs(vx) + abs(vy) + abs(vz)) + 0.2 > 0

    def pass_corners(self, pos: Triple, vel: Triple) -> None:
        """Count the corner whose plane of closest approach the position has crossed."""
        while self._next < len(self._corners) - 1:
            corner = self._corners[self._next]
            if self._t < corner.t_s - corner.half_s - _EARLY_S:
                return
            n = corner.normal or vel
            beyond = sum((pos[i] - corner.point[i]) * n[i] for i in range(3))
            if beyond < 0 and self._t < corner.t_s + corner.half_s + _LATE_S:
                return
            self.progress.passed = corner.count
            self._next += 1

    def _after_target(self, nav: NavState) -> Setpoint | None:
        """Reference that goes after the target and draws the aircraft along."""
        to = self._target
        if self._land.landed and wanted_velocity(nav.p, nav.v, to, self._limits)[2] > -_RISE_MPS:
            return None  # nothing that leads up: it stays on the ground
        last = self._point or Setpoint(nav.p, nav.v, (0.0, 0.0, 0.0), 0.0, 0.0)
        p, v, a = pursue(last.p, last.v, to, limits=self._limits, dt_s=self._dt)
        x, y, z = (nav.p[i] + min(_LEASH_M, max(-_LEASH_M, p[i] - nav.p[i])) for i in range(3))
        spin = 0.0 if math.isnan(to.yaw_rate) else to.yaw_rate
        self._heading.turn(self._heading.yaw if math.isnan(to.yaw) else to.yaw, feed=spin)
        self._yaw_order = self._heading.yaw
        return Setpoint((x, y, z), v, a, self._heading.yaw, self._heading.rate)


def _finite(order: str, values: tuple[float, ...]) -> None:
    if not all(math.isfinite(value) for value in values):
        raise FlightInputError(f"{order} {values}: finite numbers are needed")
