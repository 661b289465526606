"""Plans whose flights keep to limits of time and energy, by any planner that knows metres only.

What is best with as many metres as could be flown within the limits without any corner is a bound
for what can be had within them: every flight that keeps to them is no longer. That bound stays
true. The plan is the best of the planner's own for fewer and fewer metres whose flight fits, as it
is foreseen with its corners; in between, paths that are a little too long are drawn together.
"""

from dataclasses import dataclass, replace

import numpy as np

from mission.planner.certified import TABLED
from mission.planner.fitting import (
    at_best_altitude,
    drawn_together,
    foreseen,
    improved,
    made,
    serving_fewer,
    share,
)
from mission.planner.problem import Planner, RoundPlan, RoundProblem

_TRIED = 8  # budgets of metres
_ENOUGH = 0.995  # of the limit: a flight that takes as much leaves nothing to try
_NARROW_M = 2.0  # between budgets: closer ones are not told apart


@dataclass(frozen=True)
class WithinPlanner:
    """A planner, and what keeps its plans within limits of time and energy."""

    inner: Planner

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanError: what the planner itself raises.
        """
        if problem.limits is None:
            return self.inner.plan(problem)
        problem = replace(problem, path_budget_m=problem.most_m)
        ideal = foreseen(problem, self.inner.plan(replace(problem, limits=None)))
        if share(problem, ideal) <= 1.0:
            return ideal
        fixed = problem.at(ideal.altitude_m)
        best = improved(fixed, self._best(fixed, ideal))
        best = at_best_altitude(problem, best, ideal.altitude_m)
        assert share(problem, best) <= 1.0, "a plan breaks its limits"
        bound = ideal.upper_bound  # NaN stays, where none is proven
        assert not best.value > bound * (1.0 + TABLED), "a plan exceeds its proven bound"
        return replace(best, upper_bound=max(bound, best.value), nodes=ideal.nodes)

    def _best(self, problem: RoundProblem, ideal: RoundPlan) -> RoundPlan:
        """The plan worth most whose flight fits, from one altitude."""
        best = made(problem, np.tile(problem.start_m, (problem.steps, 1)))
        low_m, high_m, found = 0.0, problem.path_budget_m, ideal
        for _ in range(_TRIED):
            taken = share(problem, found)
            drawn = found if taken <= 1.0 else drawn_together(problem, found.waypoints_m)
            best = max(best, drawn, key=_value)
            if taken > 1.0:
                fewer = foreseen(problem, serving_fewer(problem, found))
                best = max(best, fewer, key=_value) if share(problem, fewer) <= 1.0 else best
            if _ENOUGH <= taken <= 1.0:
                break
            if taken <= 1.0:
                low_m = max(low_m, found.path_m)
            else:
                high_m = min(high_m, found.path_m)
            if high_m - low_m < _NARROW_M:
                break
            # A flight's metres take their share of the limit, corners about the same of any.
            guess_m = found.path_m / taken
            if not low_m < guess_m < high_m:
                guess_m = (low_m + high_m) / 2.0
            shorter = replace(problem, limits=None, path_budget_m=guess_m)
            found = foreseen(problem, self.inner.plan(shorter))
        return best


def _value(plan: RoundPlan) -> float:
    return plan.value
