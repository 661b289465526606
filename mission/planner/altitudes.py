"""The best altitude of a round: planners for problems that leave it open within limits.

What a device earns at a distance r depends on the altitude h smoothly, so that between two
altitudes a < b it lies little above the chord: f_h <= l f_a + (1 - l) f_b + e for h = l a +
(1 - l) b, with the e(r) of `mission.planner.reward.excess`. Sums keep such an inequality: no path
from any altitude in between is worth more than the better of the best path for f_a + e and the
best one for f_b + e. Both are found as at a fixed altitude, with a bound. e falls with the square
of b - a; a plain envelope, the most of f over all altitudes in between, only with b - a.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from mission.planner.certified import (
    TABLED,
    Case,
    CertifiedPlanner,
    Goal,
    case_of,
    in_usual_size,
    search,
)
from mission.planner.evaluate import (
    climbed,
    finish,
    fit_budget,
    plan_without_moving,
    scheduled,
)
from mission.planner.native.library import MOST_DEVICES, Found
from mission.planner.problem import RoundPlan, RoundProblem
from mission.planner.reward import Altitudes

FIRST_PARTS = 4  # that the limits are split into at first
LEAST_NODES = 20  # that a search counts for: its tables have to be made
ROUGH_NODES = 1000  # for parts that may be split yet
NARROWEST_M = 0.5
ALIKE = 1.0 + 1e-9  # widths that differ by rounding
PROMISING = 0.98  # of the best value: a path that is worth looking for its own best altitude
LEFT_SHARE = 0.5  # of the gap: where e leaves less of it, a part is split
WORTH_SHARE = 0.9  # the same, where a search has ended short of the gap
MOST_SEARCHES = 2  # times `max_nodes` are looked into for all altitudes together
MOST_BOUNDS = 6  # of altitudes, for more than MOST_DEVICES


@dataclass(frozen=True)
class CertifiedAltitudes:
    """The planner with a certificate, for all altitudes within the limits at once."""

    inner: CertifiedPlanner

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanInputError: the problem makes no sense.
        """
        if problem.altitudes_m is None:
            return self.inner.plan(problem)
        if (at_rest := plan_without_moving(problem)) is not None:
            return at_rest
        if (plan := in_usual_size(self, problem)) is not None:
            return plan
        proof = _Proof(problem, self.inner.goal)
        bound = proof.lower()
        assert proof.best.value <= bound * (1.0 + TABLED), (proof.best.value, bound)
        return replace(proof.best, upper_bound=max(bound, proof.best.value), nodes=proof.nodes)


@dataclass
class _Part:
    """The altitudes from one to another, and what no path from any of them is worth more than."""

    ends_m: tuple[float, float]
    bounds: list[float]  # with f of either end, raised

    @property
    def bound(self) -> float:
        return max(self.bounds)

    @property
    def width_m(self) -> float:
        return self.ends_m[1] - self.ends_m[0]


@dataclass
class _Trial:
    """The search at one altitude, with f raised on the way to others."""

    case: Case
    spent: int = 0  # on the last search, in nodes
    found: Found | None = None  # by it, where it was better than all before


@dataclass
class _Proof:
    """Bounds of all altitudes, lowered part by part, and the best plan met with on the way."""

    problem: RoundProblem
    goal: Goal
    best: RoundPlan = field(init=False)
    nodes: int = 0
    _spent: int = 0  # in nodes
    _parts: list[_Part] = field(init=False)
    _trials: dict[tuple[float, Altitudes], _Trial] = field(default_factory=dict)

    def __post_init__(self) -> None:
        problem = self.problem
        assert problem.altitudes_m is not None
        self.best = finish(problem, np.tile(problem.start_m, (problem.steps, 1)))
        marks = np.linspace(*problem.altitudes_m, FIRST_PARTS + 1).tolist()
        self._parts = [_Part(ends, [np.inf, np.inf]) for ends in pairwise(marks)]
        for altitude_m in marks:
            sides = self._open_sides(altitude_m, np.inf)
            found = self._trial(altitude_m, sides).case.explored()
            self._offer(altitude_m, found)
            _lower(sides, found.bound)

    @property
    def _least_nodes(self) -> int:
        """What a search costs at least; beyond MOST_DEVICES it looks into no nodes."""
        many = len(self.problem.importance) > MOST_DEVICES
        return max(1, self._most_nodes // MOST_BOUNDS if many else LEAST_NODES)

    @property
    def _most_nodes(self) -> int:
        return MOST_SEARCHES * self.goal.max_nodes

    @property
    def enough(self) -> float:
        """A bound that reaches the goal."""
        return self.best.value / (1.0 - self.goal.gap)

    def lower(self) -> float:
        """The bound of all altitudes, as low as goal and nodes allow."""
        while True:
            worst = max(self._parts, key=lambda part: part.bound)
            if not self.best.value > 0.0:  # nothing to measure a gap by
                return worst.bound
            if (
                worst.bound <= self.enough
                or self._spent >= self._most_nodes
                or not self._improve(worst)
            ):
                return worst.bound

    def _improve(self, part: _Part) -> bool:
        """Lower the bound of a part, or split it; whether anything could be done."""
        altitude_m = part.ends_m[int(part.bounds[1] > part.bounds[0])]
        sides = self._open_sides(altitude_m, part.width_m)
        trial = self._trial(altitude_m, sides)
        begun = self._begun(trial)
        known = replace(begun, value=max(begun.value, self.best.value))
        gap, splits = 1.0 - known.value / self.enough, part.width_m > NARROWEST_M
        if splits and gap < LEFT_SHARE * self.goal.gap:
            self._split(part)
            return True
        raised = (begun.value - self._offer(altitude_m, begun)) / self.best.value
        rough = splits and raised > (1.0 - LEFT_SHARE) * self.goal.gap
        most_nodes = ROUGH_NODES if rough else self.goal.max_nodes
        if trial.spent >= most_nodes or not gap > 0.0:
            helps = splits and (rough or gap < WORTH_SHARE * self.goal.gap)
            if helps:
                self._split(part)
            return helps
        found = search(trial.case, known, Goal(gap, most_nodes))
        self.nodes += found.nodes
        trial.spent = max(found.nodes, self._least_nodes)
        ended = not rough and found.bound > self.enough
        self._spent += trial.spent
        if found.value > known.value:
            self._offer(altitude_m, found)
            trial.found = replace(found, nodes=0)
        elif ended:  # it would end the same again
            trial.spent = self.goal.max_nodes
        _lower(sides, found.bound)
        if rough and part.bound > self.enough:
            self._split(part)
        return True

    def _begun(self, trial: _Trial) -> Found:
        """The best path for a search to begin with."""
        way = np.ascontiguousarray(self.best.waypoints_m - self.problem.start_m)
        found = trial.case.along(way)
        if trial.found is not None and trial.found.value > found.value:
            return trial.found
        return found

    def _open_sides(self, altitude_m: float, width_m: float) -> list[tuple[_Part, int]]:
        """The parts up to a width that end at an altitude and are open there, and at which end."""
        return [
            (part, end)
            for part in self._parts
            for end in (0, 1)
            if part.ends_m[end] == altitude_m
            and part.bounds[end] > self.enough
            and part.width_m <= width_m * ALIKE
        ]

    def _trial(self, altitude_m: float, sides: Sequence[tuple[_Part, int]]) -> _Trial:
        towards_m = tuple(part.ends_m[1 - end] for part, end in sides)
        key = altitude_m, towards_m
        if key not in self._trials:
            self._trials[key] = _Trial(case_of(self.problem.at(altitude_m), towards_m=towards_m))
        return self._trials[key]

    def _offer(self, altitude_m: float, found: Found) -> float:
        """What a path is worth from an altitude; the best plan so far, where it is one."""
        way = self.problem.start_m + found.way
        waypoints = fit_budget(way, self.problem.path_budget_m)
        _, value = scheduled(self.problem.at(altitude_m), waypoints)
        if value > PROMISING * self.best.value:
            schedule, higher, best_m = climbed(self.problem, waypoints, altitude_m)
            if higher > self.best.value:
                self.best = RoundPlan(waypoints, schedule, higher, altitude_m=best_m)
        return value

    def _split(self, part: _Part) -> None:
        low_m, high_m = part.ends_m
        middle_m = (low_m + high_m) / 2.0
        at = self._parts.index(part)
        halves = ((low_m, middle_m), (middle_m, high_m))
        self._parts[at : at + 1] = [_Part(ends_m, [part.bound] * 2) for ends_m in halves]


def _lower(sides: Sequence[tuple[_Part, int]], bound: float) -> None:
    for part, end in sides:
        part.bounds[end] = min(part.bounds[end], bound)
