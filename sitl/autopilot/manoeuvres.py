"""Things the aircraft does until they are done. Each starts when it is made.

`tick` runs after every physics tick; it is all that flying costs the autopilot, so it is short.
"""

import math
from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from flightdyn.aircraft import Aircraft
from flightdyn.frames import wrap_pi, yaw_of
from flightdyn.path import FlightPath
from flightdyn.state import Vector

_READY_TIMEOUT_S = 120.0
_TURN_TOLERANCE_RAD = math.radians(2.0)
_TURN_TIMEOUT_S = 30.0
_FALL_TIMEOUT_S = 120.0
_BELOW_GROUND_M = 3.0  # where a landing aims: the estimate of the height may be off


class Manoeuvre(Protocol):
    """One thing to do."""

    def tick(self) -> bool:
        """Look after it; True once it is done."""


def ticks(aircraft: Aircraft, duration_s: float) -> int:
    """Physics ticks in a duration, at least one."""
    return max(1, round(duration_s * 1e9 / aircraft.dt_ns))


class Settle:
    """Stand until the estimator has found itself."""

    def __init__(self, aircraft: Aircraft) -> None:
        self._aircraft = aircraft
        self._left = ticks(aircraft, _READY_TIMEOUT_S)

    def tick(self) -> bool:
        self._left -= 1
        return self._aircraft.ready or self._left <= 0


class Follow:
    """Fly a path to its end; `passed(i)` is called on the tick point i is passed."""

    def __init__(
        self, aircraft: Aircraft, path: FlightPath, passed: Callable[[int], None] | None = None
    ) -> None:
        self._passed = passed
        self._count = 0
        self._points = len(path.points_ned_m)
        aircraft.follow(path)
        self._progress = aircraft.progress  # of this very path

    def tick(self) -> bool:
        progress = self._progress
        if progress.passed != self._count:
            self._report(progress.passed)
        return progress.finished

    def _report(self, passed: int) -> None:
        first, self._count = self._count, passed
        if self._passed is not None:
            for point in range(first, passed):
                self._passed(point)


class Stop:
    """Brake and hold where the aircraft comes to rest."""

    def __init__(self, aircraft: Aircraft, *, deceleration_mps2: float) -> None:
        self._aircraft = aircraft
        belief = aircraft.belief
        velocity = np.asarray(belief.vel_ned_mps)
        speed = float(np.linalg.norm(velocity))
        ahead = velocity * speed / (2.0 * deceleration_mps2)
        aircraft.hold(np.asarray(belief.pos_ned_m) + ahead, yaw_of(belief.q_frd_to_ned))

    def tick(self) -> bool:
        return self._aircraft.progress.finished


class Turn:
    """Turn on the spot to a heading."""

    def __init__(self, aircraft: Aircraft, *, pos_ned_m: Vector, yaw_rad: float) -> None:
        self._aircraft = aircraft
        self._yaw_rad = yaw_rad
        self._left = ticks(aircraft, _TURN_TIMEOUT_S)
        aircraft.hold(pos_ned_m, yaw_rad)

    def tick(self) -> bool:
        self._left -= 1
        error = wrap_pi(yaw_of(self._aircraft.belief.q_frd_to_ned) - self._yaw_rad)
        return abs(error) < _TURN_TOLERANCE_RAD or self._left <= 0


class Pause:
    """Let simulated time pass."""

    def __init__(self, aircraft: Aircraft, duration_s: float) -> None:
        self._left = ticks(aircraft, duration_s)

    def tick(self) -> bool:
        self._left -= 1
        return self._left <= 0


class Descend:
    """Sink until on the ground, slowly at the end; done when it has stood there for a while."""

    def __init__(
        self,
        aircraft: Aircraft,
        *,
        start_ned_m: Vector,
        ground_down_m: float,
        descent_mps: float,
        landing_mps: float,
        landing_height_m: float,
        settle_s: float,
    ) -> None:
        self._aircraft = aircraft
        self._landing_mps = landing_mps
        self._settle_ticks = ticks(aircraft, settle_s)
        self._on_ground = 0
        self._blind = False
        north, east, down = map(float, start_ned_m)
        slow = max(ground_down_m - landing_height_m, down)
        end = max(ground_down_m, slow) + _BELOW_GROUND_M
        aircraft.follow(
            FlightPath(
                np.array([[north, east, down], [north, east, slow], [north, east, end]]),
                np.array([descent_mps, landing_mps]),
                np.array([1.0, 1.0, 1.0]),
            )
        )

    def tick(self) -> bool:
        aircraft = self._aircraft
        self._on_ground = self._on_ground + 1 if aircraft.on_ground else 0
        if aircraft.progress.finished and not self._blind:
            # The ground is lower than believed: go on until it comes.
            self._blind = True
            aircraft.velocity(
                np.array([0.0, 0.0, self._landing_mps]), yaw_of(aircraft.belief.q_frd_to_ned)
            )
        return self._on_ground >= self._settle_ticks


class Fall:
    """Nobody flies the aircraft any more; done when it lies still."""

    def __init__(self, aircraft: Aircraft) -> None:
        self._aircraft = aircraft
        self._left = ticks(aircraft, _FALL_TIMEOUT_S)

    def tick(self) -> bool:
        self._left -= 1
        return self._aircraft.on_ground or self._left <= 0


class Piloted:
    """Somebody else flies: `fly` is called now and then; done when it has landed and stood a while.

    Without `fly` the orders come by themselves.
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
        self._every = self._left = ticks(aircraft, every_s)
        self._settle_ticks = ticks(aircraft, settle_s)
        self._on_ground = 0
        self._flown = False
        if fly is not None:
            fly()

    def tick(self) -> bool:
        self._left -= 1
        if self._left == 0:
            self._left = self._every
            if self._fly is not None:
                self._fly()
        if not self._aircraft.on_ground:
            self._flown, self._on_ground = True, 0
            return False
        self._on_ground += 1
        return self._flown and self._on_ground >= self._settle_ticks


class Sequence:
    """Manoeuvres one after another; each is made when the one before is done."""

    def __init__(self, parts: Iterator[Manoeuvre]) -> None:
        self._parts = parts
        self._current = next(parts, None)

    def tick(self) -> bool:
        if self._current is not None and self._current.tick():
            self._current = next(self._parts, None)
        return self._current is None
