"""The best altitude of a round: planners for problems that leave it open within limits.

What a device earns at a distance r depends on the altitude h smoothly, so that between two
altitudes a < b it lies little above the chord: f_h <= l f_a + (1 - l) f_b + e for h = l a +
(1 - l) b, with the e(r) of `mission.planner.reward.excess`. Sums keep such an inequality: no path
from any altitude in between is worth more than the better of the best path for f_a + e and the
best one for f_b + e. Both are found as at a fixed altitude, with a bound. e falls with the square
of b - a; a plain envelope, the most of f over all altitudes in between, only with b - a.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from mission.planner.certified import Case, CertifiedPlanner, case_of, in_usual_size, search
from mission.planner.evaluate import bounded, finish, fit_budget, plan_along, plan_without_moving
from mission.planner.native.library import Found, Goal
from mission.planner.plan import Planner, RoundPlan
from mission.planner.problem import RoundProblem

FIRST_PARTS = 4  # that the limits are split into at first
LEAST_NODES = 20  # that a part counts for: its tables have to be made
NARROWEST_M = 0.5
PROMISING = 0.98  # of the best value: a path that is worth looking for its own best altitude
LEFT_SHARE = 0.5  # of the gap: where e leaves less of it, a part is split
WORTH_SHARE = 0.9  # the same, where a search has ended short of the gap
MOST_SEARCHES = 2
SAMPLED = 9  # altitudes that a planner without a bound is asked at


@dataclass(frozen=True)
class CertifiedAltitudes:
    """Certified planner that also optimises the altitude, with a bound over all that are open."""

    inner: CertifiedPlanner
    searches: int = MOST_SEARCHES  # times as many nodes as `inner` are looked into in all

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
        proof = _Proof(problem, self.inner.goal, self.searches * self.inner.goal.max_nodes)
        bound = proof.lower()
        made = bounded(problem, proof.best, bound, proof.nodes)
        return replace(made, ended=proof.ended if made.gap > self.inner.goal.gap else "")


@dataclass(frozen=True)
class SampledAltitudes:
    """A planner for one altitude, asked at several: the best of these plans, without a bound."""

    inner: Planner

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanError: what the planner itself raises.
        """
        if problem.altitudes_m is None:
            return self.inner.plan(problem)

        def planned(altitude_m: float | None) -> RoundPlan:
            return finish(problem, self.inner.plan(problem.at(altitude_m)).waypoints_m)

        tried = map(planned, np.linspace(*problem.altitudes_m, SAMPLED).tolist())
        best = max(tried, key=lambda plan: plan.value)
        return max(best, planned(best.altitude_m), key=lambda plan: plan.value)


@dataclass
class _Part:
    """An interval of altitudes with an upper bound on the value of its plans."""

    ends_m: tuple[float, float]
    bound: float


@dataclass
class _Proof:
    """Branch and bound over intervals of altitude, with the best plan found so far (incumbent)."""

    problem: RoundProblem
    goal: Goal
    most_nodes: int
    best: RoundPlan = field(init=False)
    nodes: int = 0
    ended: str = ""  # of the last search that has proven less than was asked for
    _spent: int = 0  # in nodes
    _parts: list[_Part] = field(init=False)

    def __post_init__(self) -> None:
        problem = self.problem
        assert problem.altitudes_m is not None
        self.best = finish(problem, np.tile(problem.start_m, (problem.steps, 1)))
        marks = np.linspace(*problem.altitudes_m, FIRST_PARTS + 1).tolist()
        self._parts = []
        for ends_m in pairwise(marks):
            found = [case.explored() for case in self._cases(ends_m)]
            for altitude_m, one in zip(ends_m, found, strict=True):
                self._offer(altitude_m, one)
            self._parts.append(_Part(ends_m, max(one.bound for one in found)))

    @property
    def enough(self) -> float:
        """Bound that meets the gap asked for."""
        return self.best.value / (1.0 - self.goal.gap)

    def lower(self) -> float:
        """Return the upper bound over all altitudes, lowered until goal or nodes are reached."""
        while True:
            worst = max(self._parts, key=lambda part: part.bound)
            if (
                not self.best.value > 0.0  # nothing to measure a gap by
                or worst.bound <= self.enough
                or self._spent >= self.most_nodes
                or not self._improve(worst)
            ):
                return worst.bound

    def _improve(self, part: _Part) -> bool:
        """Lower the bound of a part, or split it; whether anything could be done."""
        bounds, least = [], 1.0
        self._spent += LEAST_NODES
        splits = part.ends_m[1] - part.ends_m[0] > NARROWEST_M
        for altitude_m, case in zip(part.ends_m, self._cases(part.ends_m), strict=True):
            begun = case.along(np.ascontiguousarray(self.best.waypoints_m - self.problem.start_m))
            known = replace(begun, value=max(begun.value, self.best.value))
            gap = 1.0 - known.value / self.enough
            if splits and gap < LEFT_SHARE * self.goal.gap:
                return self._split(part)
            if not gap > 0.0:
                return False
            found = search(case, known, Goal(gap, self.goal.max_nodes))
            self.nodes += found.nodes
            self._spent += found.nodes
            self.ended = found.ended or self.ended
            self._offer(altitude_m, found)
            bounds.append(found.bound)
            least = min(least, gap)
        before, part.bound = part.bound, min(part.bound, max(bounds))
        if part.bound <= self.enough:
            return True
        nearly = part.bound <= self.enough * (1.0 + self.goal.gap)
        lowered = part.bound < before  # else what is left is the altitudes' own
        if splits and (nearly or not lowered or least < WORTH_SHARE * self.goal.gap):
            return self._split(part)
        return lowered

    def _cases(self, ends_m: tuple[float, float]) -> list[Case]:
        """Return search inputs at both ends of an interval, f raised towards the other end."""
        return [
            case_of(self.problem.at(altitude_m), towards_m=(other_m,))
            for altitude_m, other_m in (ends_m, ends_m[::-1])
        ]

    def _offer(self, altitude_m: float, found: Found) -> None:
        """Keep the best plan so far, where a path makes a better one."""
        way = self.problem.start_m + found.way
        waypoints = fit_budget(way, self.problem.path_budget_m)
        value = plan_along(self.problem.at(altitude_m), waypoints).value
        if value > PROMISING * self.best.value:
            plan = plan_along(self.problem, waypoints)
            self.best = max(self.best, plan, key=lambda plan: plan.value)

    def _split(self, part: _Part) -> bool:
        low_m, high_m = part.ends_m
        middle_m = (low_m + high_m) / 2.0
        at = self._parts.index(part)
        halves = ((low_m, middle_m), (middle_m, high_m))
        self._parts[at : at + 1] = [_Part(ends_m, part.bound) for ends_m in halves]
        return True
