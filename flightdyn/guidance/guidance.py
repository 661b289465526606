"""Orders in, setpoints out: idle, hold, path, a target to go after, an attitude."""

import math
from collections.abc import Callable, Iterable

from flightdyn.config import LimitsConfig
from flightdyn.frames import Triple
from flightdyn.guidance.control import AttitudeOrder, Setpoint
from flightdyn.guidance.path import FlightPath, PathProgress, Trajectory, brake_and_go, plan_path
from flightdyn.guidance.pursuit import Target, pursue, wanted_velocity
from flightdyn.inertial import NavState
from flightdyn.native.library import (
    ATTITUDE,
    FINISHED,
    LIMITED,
    NEAR,
    NOTHING,
    STALLED,
    TARGET,
    TRACK,
    Guide,
    Strapdown,
    Structure,
)
from native.errors import InputError

_LEASH_M = 0.6  # how far the reference that goes after a target may run ahead
_RISE_MPS = 0.3  # a target that asks for more climb than that lifts the aircraft off the ground
_LAG_STOP_M = 6.0  # farther from the reference than that a new one begins where the aircraft is
_EARLY_S = 0.5  # before its blend a corner cannot be passed, whatever the position says
_LATE_S = 3.0  # after it, it is passed, however far off


class Guidance:
    """Guidance: carries out the order in force, and notes how far it has come.

    Trajectories are tracked in C (`flightdyn/native/guidance.h`), in the memory of `guide`.
    """

    def __init__(self, guide: Guide, limits: LimitsConfig, *, dt_s: float, yaw: float) -> None:
        self._guide = guide
        self._memory = memory = guide.memory
        memory.yaw = memory.yaw_order = yaw
        memory.landed = memory.contact = memory.touching = True
        self._limits = limits
        self._dt = dt_s
        self._corners: list[Structure] = []  # `Vertex` of C
        self._next = 0
        memory.soon = math.inf
        self.corner_near = False  # it may be passed before the next guidance step
        self._target = Target()
        self._known = 0  # of what is noted of the trajectory
        self.progress = PathProgress()

    @property
    def setpoint(self) -> Setpoint | None:
        """Setpoint of the outer loop; None while idle or under an attitude order."""
        m = self._memory
        if not m.pointed:
            return None
        return Setpoint(_triple(m.p), _triple(m.v), _triple(m.a), m.yaw, m.yaw_rate)

    def look_at(self, place: Triple | None) -> None:
        """Head towards a place (NED) on the way; None: along the course."""
        self._memory.interested = place is not None
        self._memory.interest[:] = place or (0.0, 0.0, 0.0)

    def face(self, yaw: float) -> None:
        """Head `yaw` (rad) on the path in force from now on; NaN: along the course."""
        self._memory.course = math.isnan(yaw)
        if not math.isnan(yaw):
            self._memory.yaw_order = yaw

    def idle(self) -> None:
        """Set no setpoint: armed motors turn without lift."""
        self._memory.mode = NOTHING
        self._memory.pointed = False
        self._guide.track(None)
        self._forget_corners()

    def hold(self, nav: NavState, pos: Triple, yaw: float) -> None:
        """Go to `pos` (NED, m) and stay, heading `yaw` (rad); InputError if not finite."""
        if not all(map(math.isfinite, (*pos, yaw))):
            raise InputError(f"hold {(*pos, yaw)}: finite numbers are needed")
        p, v = self._start(nav)
        self._begin(brake_and_go(p, v, goal=pos, limits=self._limits), yaw, course=False)

    def follow(self, nav: NavState, path: FlightPath) -> None:
        """Fly `path` and stay at its end."""
        _, v = self._start(nav)
        trajectory, corners = plan_path(path, self._limits, start_vel=v)
        self._begin(trajectory, self._memory.yaw, course=True)
        self._memory.path = True
        self._memory.too_fast = bool(path.speeds_mps.max() > self._limits.speed_mps)
        self._corners, self._next = corners, 1
        self._look_ahead()
        self.progress.passed = corners[0].passed

    def _begin(self, trajectory: Trajectory, yaw: float, *, course: bool) -> None:
        m = self._memory
        self._guide.track(trajectory.pieces)
        m.mode = TRACK
        m.t = trajectory.start_s
        m.rate = m.smooth_rate = m.room = 1.0
        m.over = m.waited = m.went = m.missed = 0.0
        m.finished = m.stalled = m.path = m.too_fast = False
        m.yaw_order = yaw
        m.course = course
        self._forget_corners()

    def _forget_corners(self) -> None:
        """Forget the path that was flown; its `progress` stays as it was for whoever has it."""
        self._corners, self._memory.soon, self._memory.noted = [], math.inf, 0
        self._known, self.corner_near = 0, False
        self.progress = PathProgress()

    def pursue(self, nav: NavState, target: Target) -> None:
        """Follow a target's setpoints; it may be replaced at any time."""
        m = self._memory
        if m.mode != TARGET:
            p, v = self._start(nav)
            self.idle()
            m.p[:], m.v[:], m.a[:] = p, v, (0.0, 0.0, 0.0)
            m.mode, m.pointed = TARGET, True
        self._target = target

    def attitude(self, order: AttitudeOrder) -> None:
        """Keep an attitude or body rates, with thrust or climb, until the next order."""
        m = self._memory
        if m.mode != ATTITUDE:
            self.idle()
            m.mode = ATTITUDE
        m.oriented = order.q_frd_to_ned is not None
        m.q[:] = order.q_frd_to_ned or (1.0, 0.0, 0.0, 0.0)
        m.rates[:] = order.rates_radps
        m.thrust_order = math.nan if order.collective is None else order.collective
        m.climb = order.climb_mps

    def _start(self, nav: NavState) -> tuple[Triple, Triple]:
        """Return where and how fast a new reference begins: as the old one, if it is near."""
        point = self.setpoint
        if point is None or math.dist(point.p, nav.p) > _LAG_STOP_M:
            return nav.p, nav.v
        return point.p, point.v

    def step(self, carried: Strapdown, state: Callable[[], NavState]) -> None:
        """Run one guidance step from the state `carried`; `state` gives it to a pursuit."""
        m = self._memory
        pursuing = self.pursuing
        if pursuing and m.armed:
            self._after_target(state())
        self._guide.step(carried)
        if pursuing:
            m.mode = TARGET
        self.look()

    @property
    def pursuing(self) -> bool:
        """Whether a moving target is being followed."""
        return bool(self._memory.mode == TARGET)

    def look(self) -> bool:
        """Copy C's event flags into `progress`; return whether they have changed."""
        flags = self._memory.noted
        if flags == self._known:
            return False
        self._known = flags
        self.corner_near = bool(flags & NEAR)
        progress = self.progress
        progress.speed_limited = bool(flags & LIMITED)
        progress.stalled = progress.stalled or bool(flags & STALLED)
        if flags & FINISHED and not progress.finished:
            progress.finished = True
            progress.missed_m = self._memory.missed
            if self._corners:
                progress.passed = self._corners[-1].passed
                self._next = len(self._corners)
                self._look_ahead()
        return True

    def _look_ahead(self) -> None:
        """Set the next corner, and when it may be passed at the earliest."""
        m = self._memory
        m.soon = math.inf
        if self._next < len(self._corners) - 1:
            corner = self._corners[self._next]
            m.soon = corner.t - corner.half - _EARLY_S
            m.late = corner.t + corner.half + _LATE_S
            m.corner[:], m.normal[:] = corner.p, corner.normal

    def pass_corners(self, pos: Triple, vel: Triple) -> None:
        """Count the corners whose planes of closest approach the position has crossed."""
        while self._guide.passed(pos, vel):
            self.progress.passed = self._corners[self._next].passed
            self._next += 1
            self._look_ahead()

    def _after_target(self, nav: NavState) -> None:
        """Move the reference after the target by a step, at most a leash from the aircraft."""
        m, to = self._memory, self._target
        if m.landed and wanted_velocity(nav.p, nav.v, to, self._limits)[2] > -_RISE_MPS:
            m.mode = NOTHING  # nothing that leads up: it stays on the ground
            return
        p, v = (_triple(m.p), _triple(m.v)) if m.pointed else (nav.p, nav.v)
        p, v, m.a[:] = pursue(p, v, to, limits=self._limits, dt_s=self._dt)
        m.v[:] = v
        m.p[:] = [nav.p[i] + min(_LEASH_M, max(-_LEASH_M, p[i] - nav.p[i])) for i in range(3)]
        if to.drifting:
            m.p[:2] = nav.p[:2]
        m.spin = 0.0 if math.isnan(to.yaw_rate) else to.yaw_rate
        m.yaw_order = m.yaw if math.isnan(to.yaw) else to.yaw


def _triple(values: Iterable[float]) -> Triple:
    x, y, z = values
    return x, y, z
