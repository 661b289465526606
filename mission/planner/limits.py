"""What limits a round. Each limit is one object, which answers all that is asked of one.

A new limit is a class here, in `LIMITS` and as a field of `RoundLimits`, and `round_KEY` in the
table `mission` (and `total_KEY`, where a run has a budget of it). Problem files then have its
`KEY`, plan files what each flight takes of it. What nobody counts of a flight yet gets a place in
`Foreseen` and, in C, in the table of `native/planner.h`, filled by `count_flight`.
"""
# ruff: noqa: ARG002 - a kind need not know all that another asks for.

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Self

import numpy as np

from flightdyn.foresight import SETTLING_S
from flightdyn.native.library import Structure
from mission.base.arrays import Floats, given_alone
from mission.planner.performance import Foreseen, Performance

WITHIN_ROUNDING = 1.0 + 1e-9
_LEGS_M = np.linspace(0.0, 200.0, 401)  # whose joules are compared with those of a stop
_FAR_M = 1e4
_BRAKES_M = np.linspace(0.0, 100.0, 101)
_COUNTED = [field.name for field in fields(Foreseen)][1:]  # as C has them


@dataclass(frozen=True)
class PathAllowance:
    """A limit in metres of path: the whole, and what hovers, stops, turns take."""

    whole: float
    hover: Floats  # (K,) while each device sends
    stop: tuple[float, float]  # at least, and from a leg of another length on, as many more
    # The same of time, where the limit is of something else; (K,) of time that are left from a
    # device's turn on, its hover included.
    sends: Floats
    turn: tuple[float, float]
    after: Floats


@dataclass(frozen=True)
class Limit:
    """At most so much of something in a round; base class of all kinds."""

    name: ClassVar[str]  # of the field of `RoundLimits`, and of plans' files
    key: ClassVar[str]
    unit: ClassVar[str]
    digits: ClassVar[int]  # of what a flight takes, for people
    counted: ClassVar[Mapping[str, float]]  # so much of each field of `Foreseen`
    budget: ClassVar[str] = ""  # that a run has of it: its name in `Amount`
    needs_power: ClassVar[bool] = False  # of the aircraft, which nobody knows of external ones

    most: float
    performance: Performance

    @classmethod
    def of(cls, amounts: Mapping[str, float]) -> float:
        """How much it counts of such amounts."""
        return math.fsum(weight * amounts.get(name, 0.0) for name, weight in cls.counted.items())

    def taken(self, flight: Foreseen) -> float:
        """How much a flight takes of it."""
        return self.of(vars(flight))

    def hover(self, seconds: float) -> float:
        """How much a hover takes that has begun."""
        joules = self.performance.hover_j(seconds)
        return self.of({"duration_s": seconds, "energy_j": joules, "hovered_s": seconds})

    def excess(self, flight: Foreseen) -> str:
        """By how much a flight breaks it, in words; empty where it keeps to it."""
        if (taken := self.taken(flight)) <= self.most * WITHIN_ROUNDING:
            return ""
        said = f"{taken:.{self.digits}f} {self.unit}"
        return f"the flight takes {said}, allowed are {self.most:g}"

    # Bounds: where a kind says none, that of the others is valid.

    def least(self, length_m: float) -> float:
        """Return a lower bound on what a path of `length_m` takes."""
        return 0.0

    def longest_m(self, legs: float) -> float:
        """Return an upper bound (m) on the length of a path of up to `legs` straight legs."""
        return math.inf

    @property
    def longest_s(self) -> float:
        """Upper bound (s) on how long a flight lasts."""
        return math.inf

    def allowance(
        self, upload_s: Floats, time: PathAllowance, *, legs: float, hovers: bool
    ) -> PathAllowance | None:
        """Return it in metres of a path of up to `legs` straight legs, for the bound of rounds in
        which devices send for `upload_s` (K,), all of them if it `hovers`, and given what the
        round's time allows; None: that says enough."""
        return None


class Deadline(Limit):
    """Seconds from rest to rest."""

    name, key, unit, digits = "duration_s", "deadline_s", "s", 2
    counted: ClassVar = {"duration_s": 1.0}
    budget = "seconds"

    def least(self, length_m: float) -> float:
        return self.performance.least_s(length_m)

    def longest_m(self, legs: float) -> float:
        return self.performance.longest_m(self.most)

    @property
    def longest_s(self) -> float:
        return self.most


class Energy(Limit):
    """Joules of the battery."""

    name, key, unit, digits = "energy_j", "energy_j", "J", 0
    counted: ClassVar = {"energy_j": 1.0}
    budget = "joules"
    needs_power = True

    def least(self, length_m: float) -> float:
        return self.performance.least_j(length_m)

    def longest_m(self, legs: float) -> float:
        return self.performance.farthest_m(self.most, legs)

    @property
    def longest_s(self) -> float:
        return self.most / self.performance.least_w

    def allowance(
        self, upload_s: Floats, time: PathAllowance, *, legs: float, hovers: bool
    ) -> PathAllowance:
        performance = self.performance
        # What all of the legs may spare is had at once, so that each of them takes it all.
        none = 0.0 if math.isfinite(legs) else math.inf
        least_j = partial(performance.least_j, legs=none)
        spared_j = least_j(_FAR_M) - performance.least_j(_FAR_M, legs)
        per_m = performance.cheapest_j(none)
        sooner_j = performance.hover_j(SETTLING_S - performance.stopping_s)
        beyond = (np.array([least_j(leg) for leg in _LEGS_M]) - sooner_j) / per_m - _LEGS_M
        least = np.array([(beyond - _braking(brake))[1:].min() for brake in _BRAKES_M])
        best = int(np.where(least >= 0.0, least + _BRAKES_M, -1.0).argmax())  # beyond a long leg
        stop = (float(least[best]), float(_BRAKES_M[best])) if hovers else time.stop
        hover = upload_s * performance.hover_j(1.0) / per_m
        return replace(time, whole=(self.most + spared_j) / per_m, hover=hover, stop=stop)


LIMITS: tuple[type[Limit], ...] = (Deadline, Energy)


@dataclass(frozen=True)
class RoundLimits:
    """A round's limits, with the performance that predicts what it takes; infinity: none."""

    performance: Performance
    duration_s: float = math.inf
    energy_j: float = math.inf

    __getstate__ = given_alone

    @cached_property
    def each(self) -> tuple[Limit, ...]:
        """The limits that there are."""
        given = [(kind, getattr(self, kind.name)) for kind in LIMITS]
        return tuple(kind(most, self.performance) for kind, most in given if most < math.inf)

    @cached_property
    def flying(self) -> Structure:
        """C structure of performance and limits."""
        return self.performance.flying(
            [(at.most, [at.counted.get(name, 0.0) for name in _COUNTED]) for at in self.each]
        )

    def less(self, amounts: Mapping[str, float]) -> Self:
        """The limits of what is left after such amounts, by the fields of `Foreseen`."""
        left: dict[str, Any] = {at.name: at.most - at.of(amounts) for at in self.each}
        return replace(self, **left)

    def longest_m(self, legs: float = math.inf) -> float:
        """Return an upper bound (m) on the length of a path within limits, of up to `legs` legs."""
        return min((limit.longest_m(legs) for limit in self.each), default=math.inf)

    @property
    def longest_s(self) -> float:
        """Upper bound (s) on how long a flight within limits lasts."""
        return min((limit.longest_s for limit in self.each), default=math.inf)

    def share(self, foreseen: Foreseen) -> float:
        """How much of the tightest limit a flight takes; more than 1 does not fit."""
        # Limits above 0: a round that may take nothing is not begun.
        return max((limit.taken(foreseen) / limit.most for limit in self.each), default=0.0)

    def fits(self, foreseen: Foreseen) -> bool:
        """Whether a flight keeps to the limits."""
        return self.share(foreseen) <= WITHIN_ROUNDING

    def excess(self, foreseen: Foreseen) -> str:
        """By how much a flight breaks a limit, in words; empty where it keeps to all."""
        return next((words for at in self.each if (words := at.excess(foreseen))), "")


def _braking(brake_m: float) -> Floats:
    """Metres of starting and braking beyond each of `_LEGS_M`, as `native/rewards.h` has them."""
    return np.where(brake_m > _LEGS_M, 2.0 * np.sqrt(_LEGS_M * brake_m) - _LEGS_M, brake_m)
