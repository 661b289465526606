"""Manoeuvres: actions of the aircraft that come to an end. Each starts when it is created.

`tick` runs after every guidance step, and after every physics tick where corners are passed; it is
all that flying costs the autopilot, so it is short. For a patient manoeuvre it may be skipped while
the progress of its path does not change.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from flightdyn.frames import wrap_pi, yaw_of
from flightdyn.guidance.path import FlightPath
from flightdyn.guidance.pursuit import Target
from flightdyn.state import Vector
from sitl.autopilot.flying.orbit import Orbit

_READY_TIMEOUT_S = 120.0
_TURN_TOLERANCE_RAD = math.radians(2.0)
_TURN_TIMEOUT_S = 30.0
_FALL_TIMEOUT_S = 120.0
_CLIMB_TOLERANCE_M = 2.0
_LANDING_SLACK_S = 120.0
_LANDING_PATIENCE = 4.0  # times the time that sinking at the landing speed would take
_BELOW_GROUND_M = 3.0  # where a landing aims: the estimate of the height may be off


class StuckError(Exception):
    """A manoeuvre that makes no progress any more; the message is its status text."""


class Manoeuvre(Protocol):
    """An action of the aircraft that comes to an end; its owner calls `tick` until then."""

    @property
    def patient(self) -> bool:
        """Whether `tick` may be skipped until the progress of its path changes."""
        return False

    @property
    def landing(self) -> bool:
        """Whether it sinks to the ground."""
        return False

    def tick(self) -> bool:
        """Advance it; return True once it is done. Raise StuckError if it never will be."""


class Timer:
    """A countdown in simulated time."""

    def __init__(self, aircraft: Aircraft, duration_s: float) -> None:
        self._aircraft = aircraft
        self._duration_ns = max(1, round(duration_s * 1e9))
        self.restart()

    def restart(self) -> None:
        """Start the countdown again."""
        self._until_ns = self._aircraft.t_ns + self._duration_ns

    @property
    def over(self) -> bool:
        """Whether the duration has passed."""
        return self._aircraft.t_ns >= self._until_ns


class Until(Manoeuvre):
    """Let simulated time pass until `happened()`, or for `most_s` at most."""

    def __init__(self, aircraft: Aircraft, happened: Callable[[], bool], most_s: float) -> None:
        self._happened = happened
        self._patience = Timer(aircraft, most_s)

    def tick(self) -> bool:
        return self._happened() or self._patience.over


def settle(aircraft: Aircraft) -> Manoeuvre:
    """Wait on the ground until the estimator is ready, for 120 s at most."""
    return Until(aircraft, lambda: aircraft.ready, _READY_TIMEOUT_S)


def pause(aircraft: Aircraft, duration_s: float) -> Manoeuvre:
    """Wait for some simulated time, with the present setpoint kept."""
    return Until(aircraft, lambda: False, duration_s)


def fall(aircraft: Aircraft) -> Manoeuvre:
    """Wait until the aircraft, motors off, lies on the ground, for 120 s at most."""
    return Until(aircraft, lambda: aircraft.on_ground, _FALL_TIMEOUT_S)


class Turn(Manoeuvre):
    """Turn on the spot by an angle, to within 2 degrees or for 30 s beyond its time at most. It
    looks at no place any more.

    At a rate (rad/s) the heading ordered moves with it; NaN: it is ordered at once, and the
    vehicle turns as fast as it does, the shorter way.
    """

    def __init__(
        self, aircraft: Aircraft, *, pos_ned_m: Vector, by_rad: float, rate_radps: float = math.nan
    ) -> None:
        self._aircraft, self._pos = aircraft, pos_ned_m
        self._from, self._by = yaw_of(aircraft.belief.q_frd_to_ned), by_rad
        self._rate, self._t_ns = math.copysign(rate_radps, by_rad), aircraft.t_ns
        self._lasts_s = by_rad / self._rate if rate_radps > 0.0 else 0.0
        self._patience = Timer(aircraft, self._lasts_s + _TURN_TIMEOUT_S)
        self._turning = self._lasts_s > 0.0
        aircraft.look_at(None)
        if not self._turning:
            aircraft.hold(pos_ned_m, self._from + by_rad)

    def tick(self) -> bool:
        if self._turning:
            return self._sweep((self._aircraft.t_ns - self._t_ns) * 1e-9)
        error = yaw_of(self._aircraft.belief.q_frd_to_ned) - self._from - self._by
        return abs(wrap_pi(error)) < _TURN_TOLERANCE_RAD or self._patience.over

    def _sweep(self, passed_s: float) -> bool:
        if passed_s < self._lasts_s:
            north, east, down = map(float, self._pos)
            yaw = wrap_pi(self._from + self._rate * passed_s)
            self._aircraft.pursue(Target((north, east, down), yaw=yaw, yaw_rate=self._rate))
        else:
            self._turning = False
            self._aircraft.hold(self._pos, wrap_pi(self._from + self._by))
        return False


class Follow(Manoeuvre):
    """Fly a path to its end; `passed(i)` is called in the tick in which point i is passed, of a
    point where the path begins in the next step."""

    def __init__(
        self, aircraft: Aircraft, path: FlightPath, passed: Callable[[int], None] | None = None
    ) -> None:
        self._passed = passed
        self._count = 0
        aircraft.follow(path)
        self._progress = aircraft.progress  # of this very path

    @property
    def patient(self) -> bool:
        return self._progress.passed == self._count

    def tick(self) -> bool:
        progress = self._progress
        if progress.passed != self._count:
            self._report(progress.passed)
        if progress.stalled:
            raise StuckError("the aircraft does not follow its path")
        return progress.finished

    def _report(self, passed: int) -> None:
        first, self._count = self._count, passed
        if self._passed is not None:
            for point in range(first, passed):
                self._passed(point)


class Climb(Follow):
    """Fly the path of a take-off; raise StuckError if it ends away from its height."""

    def tick(self) -> bool:
        done = super().tick()
        missed_m = self._progress.missed_m
        if done and missed_m > _CLIMB_TOLERANCE_M:
            raise StuckError(f"take-off ended {missed_m:.0f} m from its height")
        return done


class Brake(Manoeuvre):
    """Brake and hold where the aircraft comes to rest."""

    patient = True

    def __init__(self, aircraft: Aircraft, *, deceleration_mps2: float) -> None:
        self._aircraft = aircraft
        belief = aircraft.belief
        velocity = np.asarray(belief.vel_ned_mps)
        speed = float(np.linalg.norm(velocity))
        ahead = velocity * speed / (2.0 * deceleration_mps2)
        aircraft.hold(np.asarray(belief.pos_ned_m) + ahead, yaw_of(belief.q_frd_to_ned))

    def tick(self) -> bool:
        if self._aircraft.progress.stalled:
            raise StuckError("the aircraft does not stop")
        return self._aircraft.progress.finished


@dataclass(frozen=True, slots=True)
class LandingTerms:
    """How an aircraft lands: fast down to a height above the ground, slowly from there."""

    ground_down_m: float
    descent_mps: float
    landing_mps: float
    landing_height_m: float
    settle_s: float  # on the ground, after which it has landed


class _Landing(Manoeuvre):
    """A landing: done after a while on the ground, stuck after far more than its time."""

    landing = True

    def __init__(self, aircraft: Aircraft, terms: LandingTerms) -> None:
        self._aircraft = aircraft
        self._terms = terms
        self._settled = Timer(aircraft, terms.settle_s)
        height_m = max(0.0, terms.ground_down_m - float(aircraft.belief.pos_ned_m[2]))
        self._patience = Timer(
            aircraft, _LANDING_SLACK_S + _LANDING_PATIENCE * height_m / terms.landing_mps
        )

    def tick(self) -> bool:
        if not self._aircraft.on_ground:
            self._settled.restart()
        if self._patience.over:
            raise StuckError("the landing does not come to the ground")
        return self._settled.over

    def _sink(self, speed_mps: float, *, drifting: bool = False) -> None:
        yaw = yaw_of(self._aircraft.belief.q_frd_to_ned)
        down = (0.0, 0.0, speed_mps)
        self._aircraft.pursue(Target(vel=down, yaw=yaw, drifting=drifting))


class Descend(_Landing):
    """Land straight below `start_ned_m`, slowly at the end; done `settle_s` after touchdown."""

    def __init__(self, aircraft: Aircraft, terms: LandingTerms, *, start_ned_m: Vector) -> None:
        super().__init__(aircraft, terms)
        self._blind = False
        north, east, down = map(float, start_ned_m)
        slow = max(terms.ground_down_m - terms.landing_height_m, down)
        end = max(terms.ground_down_m, slow) + _BELOW_GROUND_M
        aircraft.follow(
            FlightPath(
                np.array([[north, east, down], [north, east, slow], [north, east, end]]),
                np.array([terms.descent_mps, terms.landing_mps]),
                np.array([1.0, 1.0, 1.0]),
            )
        )

    def tick(self) -> bool:
        if self._aircraft.progress.finished and not self._blind:
            # The ground is lower than believed: go on until it comes.
            self._blind = True
            self._sink(self._terms.landing_mps)
        return super().tick()


class DescendUnsure(_Landing):
    """Land without a position estimate: keep no place, only a ground speed of zero.

    The landing speed applies from higher up, because the barometer's height drifts, too.
    """

    def __init__(self, aircraft: Aircraft, terms: LandingTerms) -> None:
        super().__init__(aircraft, terms)
        self._slow = False
        self._sink(terms.descent_mps, drifting=True)

    def tick(self) -> bool:
        slow_down_m = self._terms.ground_down_m - self._terms.landing_height_m
        if not self._slow and float(self._aircraft.belief.pos_ned_m[2]) > slow_down_m:
            self._slow = True
            self._sink(self._terms.landing_mps, drifting=True)
        return super().tick()


class Piloted(Manoeuvre):
    """Let an external pilot fly: call `fly` every `every_s`; done `settle_s` after landing.

    Without `fly` the pilot gives its orders by itself.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        fly: Callable[[], None] | None = None,
        *,
        every_s: float = 0.1,
        settle_s: float,
    ) -> None:
        self._aircraft = aircraft
        self._fly = fly
        self._due = Timer(aircraft, every_s)
        self._settled = Timer(aircraft, settle_s)
        self._flown = False
        if fly is not None:
            fly()

    def tick(self) -> bool:
        if self._due.over:
            self._due.restart()
            if self._fly is not None:
                self._fly()
        if not self._aircraft.on_ground:
            self._flown = True
            self._settled.restart()
        return self._flown and self._settled.over


class Circle(Manoeuvre):
    """Fly an orbit from its point at `phase_rad` on; done after its turns."""

    def __init__(self, aircraft: Aircraft, orbit: Orbit, *, phase_rad: float) -> None:
        self._aircraft = aircraft
        self._orbit = orbit
        self._phase = self._start = phase_rad
        self._heading = yaw_of(aircraft.belief.q_frd_to_ned)
        self._t_ns = aircraft.t_ns

    def tick(self) -> bool:
        passed_s = (self._aircraft.t_ns - self._t_ns) * 1e-9
        self._t_ns = self._aircraft.t_ns
        self._phase += self._orbit.speed_mps / self._orbit.radius_m * passed_s
        if abs(self._phase - self._start) >= self._orbit.turns * math.tau:
            yaw = yaw_of(self._aircraft.belief.q_frd_to_ned)
            self._aircraft.hold(self._orbit.point(self._phase), yaw)
            return True
        self._aircraft.pursue(self._target())
        return False

    def _target(self) -> Target:
        orbit = self._orbit
        c, s = math.cos(self._phase), math.sin(self._phase)
        north, east, down = map(float, orbit.point(self._phase))
        v, inwards = orbit.speed_mps, orbit.speed_mps**2 / orbit.radius_m
        return Target(
            pos=(north, east, down),
            vel=(-v * s, v * c, 0.0),
            acc=(-inwards * c, -inwards * s, 0.0),
            yaw=self._yaw(),
        )

    def _yaw(self) -> float:
        if (place := self._aircraft.interest_ned_m) is not None:
            north, east, _ = place - np.asarray(self._aircraft.belief.pos_ned_m)
            return math.atan2(east, north)
        if not math.isnan(self._orbit.heading_rad):
            return self._orbit.heading_rad
        match self._orbit.yaw:
            case mav.ORBIT_YAW_BEHAVIOUR_HOLD_FRONT_TO_CIRCLE_CENTER:
                return self._phase + math.pi
            case mav.ORBIT_YAW_BEHAVIOUR_HOLD_INITIAL_HEADING:
                return self._heading
            case mav.ORBIT_YAW_BEHAVIOUR_HOLD_FRONT_TANGENT_TO_CIRCLE:
                return self._phase + math.copysign(math.pi / 2, self._orbit.speed_mps)
            case _:
                return math.nan


class Sequence(Manoeuvre):
    """Manoeuvres one after another; each is made when the one before is done."""

    def __init__(self, parts: Iterator[Manoeuvre]) -> None:
        self._parts = parts
        self._current = next(parts, None)

    @property
    def patient(self) -> bool:
        return self._current is None or self._current.patient

    @property
    def landing(self) -> bool:
        return self._current is not None and self._current.landing

    def tick(self) -> bool:
        if self._current is not None and self._current.tick():
            self._current = next(self._parts, None)
        return self._current is None
