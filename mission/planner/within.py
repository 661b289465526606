"""Plans whose flights keep to limits of time and energy, by any planner that knows metres only.

What is best with as many metres as could be flown within the limits without any corner is a bound
for what can be had within them: every flight that keeps to them is no longer. That bound stays
true. The plan is the best of the planner's own for fewer and fewer metres whose flight fits, as it
is foreseen with its corners; in between, paths that are a little too long are drawn together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mission.base.arrays import Floats
from mission.planner.around import worth_of
from mission.planner.certified import TABLED
from mission.planner.evaluate import finish, objective, success
from mission.planner.flyable import foresee_round
from mission.planner.problem import Planner, RoundPlan, RoundProblem

_TRIED = 8  # budgets of metres
_ENOUGH = 0.995  # of the limit: a flight that takes as much leaves nothing to try
_NARROW_M = 2.0  # between budgets: closer ones are not told apart
_SHRUNK = 12  # halvings of how much a path is drawn together
_CHANGES, _STRIDE_M, _LEAST_STRIDE_M = 600, 30.0, 3.0  # small ones of the best; how small
_ONE, _ALL_FROM = 0.5, 0.8  # of the changes, summed up: one waypoint, all from one on


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
        most_m = min(problem.path_budget_m, problem.limits.longest_m)
        free = replace(problem, limits=None, path_budget_m=most_m)
        ideal = self.inner.plan(free)
        within = replace(problem, path_budget_m=most_m)
        ideal = _foreseen(within, ideal)
        if _share(within, ideal) <= 1.0:
            return ideal
        best = _improved(within, self._best(within, free, ideal))
        assert _share(within, best) <= 1.0, "a plan breaks its limits"
        bound = ideal.upper_bound  # NaN stays, where none is proven
        assert not best.value > bound * (1.0 + TABLED), "a plan exceeds its proven bound"
        return replace(best, upper_bound=max(bound, best.value), nodes=ideal.nodes)

    def _best(self, problem: RoundProblem, free: RoundProblem, ideal: RoundPlan) -> RoundPlan:
        """The plan worth most whose flight fits."""
        assert problem.limits is not None
        best = _made(problem, np.tile(problem.start_m, (problem.steps, 1)))
        low_m, high_m, found = 0.0, problem.path_budget_m, ideal
        for _ in range(_TRIED):
            share = _share(problem, found)
            drawn = found if share <= 1.0 else _drawn_together(problem, found)
            best = max(best, drawn, key=_value)
            if share > 1.0:
                fewer = _foreseen(problem, serving_fewer(problem, found))
                best = max(best, fewer, key=_value) if _share(problem, fewer) <= 1.0 else best
            if _ENOUGH <= share <= 1.0:
                break
            if share <= 1.0:
                low_m = max(low_m, found.path_m)
            else:
                high_m = min(high_m, found.path_m)
            if high_m - low_m < _NARROW_M:
                break
            # A flight's metres take their share of the limit, corners about the same of any.
            guess_m = found.path_m / share
            if not low_m < guess_m < high_m:
                guess_m = (low_m + high_m) / 2.0
            found = _foreseen(problem, self.inner.plan(replace(free, path_budget_m=guess_m)))
        return best


def serving_fewer(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> RoundPlan:
    """The plan without the devices whose sending takes it beyond the limits, least worth a second
    first; it may still not fit, if the path alone does not.

    `hold_s` is the hover at every stop (`stops_of`).
    """
    limits, upload_s = problem.limits, problem.upload_s
    if limits is None or upload_s is None or _fits(problem, plan, hold_s):
        return plan
    steps, devices = np.nonzero(plan.schedule)
    at_altitude = problem.at(plan.altitude_m)
    worth = (success(at_altitude, plan.waypoints_m) * problem.importance)[steps, devices]
    order = np.argsort(-worth / np.maximum(upload_s[devices], 1e-9), kind="stable").tolist()

    def serving(chosen: Sequence[int]) -> RoundPlan:
        schedule = np.zeros_like(plan.schedule)
        schedule[steps[chosen], devices[chosen]] = True
        schedule.flags.writeable = False
        value = objective(at_altitude, plan.waypoints_m, schedule)
        return replace(plan, schedule=schedule, value=value)

    fitting, too_many = 0, len(order)
    while too_many - fitting > 1:
        middle = (fitting + too_many) // 2
        if _fits(problem, serving(order[:middle]), hold_s):
            fitting = middle
        else:
            too_many = middle
    chosen = order[:fitting]
    foreseen = foresee_round(problem, serving(chosen), hold_s=hold_s)
    for one in order[too_many:]:
        hover_s = float(upload_s[devices[one]])
        left_s, left_j = (
            limits.duration_s - foreseen.duration_s,
            limits.energy_j - foreseen.energy_j,
        )
        if hover_s > left_s or limits.performance.hover_j(hover_s) > left_j:
            continue
        other = foresee_round(problem, serving([*chosen, one]), hold_s=hold_s)
        if limits.share(other) <= 1.0:
            chosen, foreseen = [*chosen, one], other
    return serving(chosen)


def _fits(problem: RoundProblem, plan: RoundPlan, hold_s: float) -> bool:
    assert problem.limits is not None
    return problem.limits.share(foresee_round(problem, plan, hold_s=hold_s)) <= 1.0


def _made(problem: RoundProblem, waypoints_m: Floats) -> RoundPlan:
    """The plan along waypoints that serves as many as its limits allow."""
    return _foreseen(problem, serving_fewer(problem, finish(problem, waypoints_m)))


def _foreseen(problem: RoundProblem, plan: RoundPlan) -> RoundPlan:
    return replace(plan, foreseen=foresee_round(problem, plan))


def _share(problem: RoundProblem, plan: RoundPlan) -> float:
    assert problem.limits is not None
    assert plan.foreseen is not None
    return problem.limits.share(plan.foreseen)


def _drawn_together(problem: RoundProblem, plan: RoundPlan) -> RoundPlan:
    """The plan, drawn towards the start as far as it takes for its flight to fit."""
    fitting, too_long = 0.0, 1.0
    best = _scaled(problem, plan, fitting)
    for _ in range(_SHRUNK):
        scale = (fitting + too_long) / 2.0
        drawn = _scaled(problem, plan, scale)
        if _share(problem, drawn) <= 1.0:
            fitting, best = scale, drawn
        else:
            too_long = scale
    return best


def _scaled(problem: RoundProblem, plan: RoundPlan, scale: float) -> RoundPlan:
    start = problem.start_m
    return _made(problem, start + scale * (plan.waypoints_m - start))


def _improved(problem: RoundProblem, plan: RoundPlan) -> RoundPlan:
    """The plan after many small changes, of which those stay that are worth more and still fit.

    One waypoint moves, or all from one on, or one gives up its corner: what a planner of metres
    does not see is that a corner costs time. The same changes are tried every time.
    """
    if plan.value <= 0.0 or problem.steps < 2:
        return plan
    rng = np.random.Generator(np.random.PCG64(0))
    for turn in range(_CHANGES):
        stride_m = _STRIDE_M * (1.0 - turn / _CHANGES) + _LEAST_STRIDE_M
        waypoints = _changed(plan.waypoints_m, rng, stride_m)
        if worth_of(problem.at(plan.altitude_m), waypoints) <= plan.value:
            continue
        other = finish(problem, waypoints)
        if other.value > plan.value and other.path_m <= problem.path_budget_m:
            other = _foreseen(problem, serving_fewer(problem, other))
            better = other.value > plan.value and _share(problem, other) <= 1.0
            plan = other if better else plan
    return plan


def _changed(waypoints_m: Floats, rng: np.random.Generator, stride_m: float) -> Floats:
    """Waypoints (N, 2) with one of the changes; the first stays."""
    changed, last = waypoints_m.copy(), len(waypoints_m) - 1
    n, kind, move = rng.integers(1, last + 1), rng.random(), rng.normal(0.0, stride_m, 2)
    if kind < _ONE:
        changed[n] += move
    elif kind < _ALL_FROM:
        changed[n:] += move
    else:
        changed[n] = changed[n - 1] if n == last else (changed[n - 1] + changed[n + 1]) / 2.0
    return changed


def _value(plan: RoundPlan) -> float:
    return plan.value
