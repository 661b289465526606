"""How the aircraft flies, as far as plans depend on it, and what a round may take at most."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from flightdyn.config import LimitsConfig
from flightdyn.foresight import (
    SETTLING_S,
    foresee,
    least_duration,
    least_energy,
    longest_within,
)
from flightdyn.guidance.path import FlightPath
from flightdyn.guidance.path_plan import passing_times
from flightdyn.physics.power import power_w
from mission.base import polyline
from mission.base.arrays import Floats

_Value = TypeVar("_Value")

WITHIN_ROUNDING = 1.0 + 1e-9
_ASTRAY_M = 0.15  # from where it holds to where it believes to be: a hover there begins with that
_ROUNDED = 1.01  # times: watts between samples of a table
_REMEMBERED = 20_000  # runs
_LONGEST_M, _ENERGY_STEP_M = 20_000.0, 0.5  # of a round's path; how finely its energy is tabled


@dataclass(frozen=True)
class Foreseen:
    """What a flight will take, before it is flown: from rest to rest, in the steady wind."""

    arrived_s: Floats  # (S,) at each of its stops
    duration_s: float
    energy_j: float  # electrical, of the simulated aircraft


@dataclass(frozen=True)
class Performance:
    """How fast, how sharply and at what power is flown."""

    speed_mps: float
    widest_m: float  # acceptance radius at most: less where a plan bears less
    # What the guidance keeps to; None: always at its speed, as where nothing is flown.
    guidance: LimitsConfig | None
    density: float = 1.0  # of the air, over that at sea level
    wind_mps: tuple[float, float] = (0.0, 0.0)  # the air's velocity, east and north
    pace: float = 1.0  # times as long as the guidance's own: of vehicles that fly otherwise

    def foresee(self, points_m: Floats, hold_s: Sequence[float], radius_m: float) -> Foreseen:
        """The flight through stops (S, 2) that hovers for (S,) seconds at each."""
        arrived_s, duration_s = self.timing(points_m, hold_s, radius_m)
        energy_j = 0.0
        for points, _, hover_s in self._runs(points_m, hold_s):
            moved_j = self._remembered(self._energy_j, points, radius_m)
            energy_j += moved_j + self._hover_w * hover_s
        return Foreseen(np.array(arrived_s), duration_s, energy_j)

    def timing(
        self, points_m: Floats, hold_s: Sequence[float], radius_m: float
    ) -> tuple[list[float], float]:
        """When each stop is reached, and the flight's seconds: `foresee` without its energy, which
        takes most of the work."""
        arrived_s, now_s = [0.0], 0.0
        for points, stops, hover_s in self._runs(points_m, hold_s):
            passed_s, moved_s = self._remembered(self._passed_s, points, radius_m)
            arrived_s += [now_s + at_s for at_s in passed_s[1 : stops + 1]]
            now_s += moved_s + hover_s
        return arrived_s, now_s

    def _runs(
        self, points_m: Floats, hold_s: Sequence[float]
    ) -> Iterator[tuple[Floats, int, float]]:
        """The path's parts, each from one hover to the next, how many stops are reached on them,
        and the seconds of the hover at their end: where nobody hovers, nobody stops."""
        first, final = 0, len(points_m) - 1
        for last in [at for at in range(final + 1) if hold_s[at] > 0.0 or at == final > 0]:
            points = points_m[first : last + 1]
            if first == last and self.guidance is not None:
                points = points[[0, 0]] + [[0.0, 0.0], [_ASTRAY_M, 0.0]]
            yield points, last - first, hold_s[last]
            first = last

    def foresee_hover(self, hover_s: float) -> Foreseen:
        """A hover on the spot."""
        return self.foresee(np.zeros((1, 2)), [hover_s], self.widest_m)

    def longest_m(self, duration_s: float) -> float:
        """Metres that no path of a duration exceeds, whatever its corners."""
        if self.guidance is None:
            return duration_s * self.speed_mps
        if math.isinf(duration_s):
            return math.inf
        return longest_within(
            duration_s / self.pace, speed_mps=self.speed_mps, limits=self.guidance
        )

    def least_s(self, length_m: float) -> float:
        """Seconds that no path of a length is flown in less."""
        if self.guidance is None:
            return length_m / self.speed_mps
        least_s = least_duration(length_m, speed_mps=self.speed_mps, limits=self.guidance)
        return least_s * self.pace

    def farthest_m(self, energy_j: float, legs: float = math.inf) -> float:
        """Metres that no path of an energy exceeds, of so many straights at most, whatever its
        corners; infinity if very many."""
        if math.isinf(energy_j):
            return math.inf
        if self.guidance is None:
            return energy_j / self._cruise_w * self.speed_mps
        lengths, joules = self._energy_table(legs)
        beyond = int(np.searchsorted(joules, energy_j, side="right"))
        return float(lengths[beyond]) if beyond < len(lengths) else math.inf

    def least_j(self, length_m: float, legs: float = math.inf) -> float:
        """Joules that no path of a length takes less, of so many straights at most."""
        if self.guidance is None:
            return self._cruise_w * length_m / self.speed_mps
        lengths, joules = self._energy_table(legs)
        # The longer the path, the cheaper its fastest metre, until the speed is reached: within
        # the table, at any acceleration that is allowed. From there on all cost the same.
        further_m = max(0.0, length_m - lengths[-1])
        return float(np.interp(length_m, lengths, joules) + further_m * self.cheapest_j(legs))

    @property
    def fastest_mps(self) -> float:
        """Metres a second that no path makes more of, once under way."""
        if self.guidance is None:
            return self.speed_mps
        return min(self.speed_mps, self.guidance.speed_mps) / self.pace

    @property
    def stop_m(self) -> tuple[float, float]:
        """Metres that could be flown while stopping and starting anew: at least, and as many more
        from a leg of that length on, on which the full speed is reached."""
        if self.guidance is None:
            return 0.0, 0.0
        speed_mps = self.fastest_mps * self.pace
        fixed_m = speed_mps * (self.guidance.smoothing_s + SETTLING_S)
        return fixed_m, speed_mps**2 / self.guidance.acceleration_mps2

    def cheapest_j(self, legs: float = math.inf) -> float:
        """Joules that no metre takes less, of a path of so many straights at most."""
        if self.guidance is None:
            return self._cruise_w / self.speed_mps
        lengths, joules = self._energy_table(legs)
        return float((joules[-1] - joules[-2]) / (lengths[-1] - lengths[-2]))

    @property
    def least_w(self) -> float:
        """Watts that nothing flown takes less."""
        return float(power_w(np.linspace(0.0, 40.0, 401), density=self.density).min()) / _ROUNDED

    def hover_j(self, duration_s: float) -> float:
        """Joules of a hover."""
        return self._hover_w * duration_s

    def _passed_s(self, points_m: Floats, radius_m: float) -> tuple[list[float], float]:
        """When each point of a run is passed, and how long it takes."""
        if self.guidance is None:
            passed_s = (polyline.along(points_m) / self.speed_mps).tolist()
            return passed_s, passed_s[-1]
        passed_s = passing_times(self._path(points_m, radius_m), self.guidance)
        return [at_s * self.pace for at_s in passed_s], (passed_s[-1] + SETTLING_S) * self.pace

    def _energy_j(self, points_m: Floats, radius_m: float) -> float:
        """Joules of a run."""
        if self.guidance is None:
            return self._cruise_w * polyline.length(points_m) / self.speed_mps
        path, wind = self._path(points_m, radius_m), (*self.wind_mps, 0.0)
        leg = foresee(path, self.guidance, density=self.density, wind_mps=wind)
        longer_s = leg.duration_s * (self.pace - 1.0)
        return leg.energy_j + max(0.0, longer_s) * self._hover_w

    def _remembered(
        self, of_run: Callable[[Floats, float], _Value], points_m: Floats, radius_m: float
    ) -> _Value:
        """What is asked of a run, which a planner does again and again: from path to path most of
        them are alike."""
        key = of_run.__name__, points_m.tobytes(), radius_m
        if key not in self._runs_known:
            if len(self._runs_known) >= _REMEMBERED:
                self._runs_known.clear()
            self._runs_known[key] = of_run(points_m, radius_m)
        known: _Value = self._runs_known[key]
        return known

    @cached_property
    def _runs_known(self) -> dict[tuple[str, bytes, float], Any]:
        return {}

    def _path(self, points_m: Floats, radius_m: float) -> FlightPath:
        count = len(points_m)
        return FlightPath(
            np.column_stack((points_m, np.zeros(count))),
            np.full(count - 1, self.speed_mps),
            np.full(count, radius_m),
        )

    @cached_property
    def _hover_w(self) -> float:
        return self._level_w(math.hypot(*self.wind_mps))

    @cached_property
    def _cruise_w(self) -> float:
        return self._level_w(self.speed_mps)

    def _level_w(self, speed_mps: float) -> float:
        return float(power_w(np.array([speed_mps]), density=self.density)[0])

    def _energy_table(self, legs: float) -> tuple[Floats, Floats]:
        if legs in self._energy_tables:
            return self._energy_tables[legs]
        assert self.guidance is not None
        lengths = np.arange(0.0, _LONGEST_M + _ENERGY_STEP_M, _ENERGY_STEP_M)
        joules = least_energy(
            lengths,
            legs=legs,
            speed_mps=self.speed_mps,
            limits=self.guidance,
            cut_m=self.guidance.corner_cut * self.widest_m,
            density=self.density,
            wind_mps=math.hypot(*self.wind_mps),
        )
        self._energy_tables[legs] = lengths, joules
        return lengths, joules

    @cached_property
    def _energy_tables(self) -> dict[float, tuple[Floats, Floats]]:
        return {}


@dataclass(frozen=True)
class RoundLimits:
    """What a round may take at most, beside metres."""

    performance: Performance
    duration_s: float = math.inf
    energy_j: float = math.inf

    def longest_m(self, legs: float = math.inf) -> float:
        """Metres that no path within the limits exceeds, of so many straights at most."""
        farthest_m = self.performance.farthest_m(self.energy_j, legs)
        return min(self.performance.longest_m(self.duration_s), farthest_m)

    def share(self, foreseen: Foreseen) -> float:
        """How much of the tighter limit a flight takes; more than 1 does not fit."""
        # Limits above 0: a round that may take nothing is not begun.
        return max(foreseen.duration_s / self.duration_s, foreseen.energy_j / self.energy_j)

    def fits(self, foreseen: Foreseen) -> bool:
        """Whether a flight keeps to the limits."""
        return self.share(foreseen) <= WITHIN_ROUNDING

    def excess(self, foreseen: Foreseen) -> str:
        """By how much a flight breaks a limit, in words; empty where it keeps to both."""
        if self.fits(foreseen):
            return ""
        if foreseen.duration_s > self.duration_s * WITHIN_ROUNDING:
            return f"the flight takes {foreseen.duration_s:.2f} s, allowed are {self.duration_s:g}"
        return f"the flight takes {foreseen.energy_j:.0f} J, allowed are {self.energy_j:g}"
