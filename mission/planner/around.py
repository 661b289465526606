"""Plans that keep to where may be flown, by any planner that knows of nothing in the way.

What is best without areas is a bound for what can be had with them: its waypoints are free to be
anywhere, and the way between them is straight. That bound stays true. The plan is the best of the
planner's own for several budgets, led around; then its waypoints are moved as long as that helps.
"""

from dataclasses import dataclass, replace

import numpy as np

from fl.radio.channel import average_per
from mission.base import polyline
from mission.base.airspace import OPEN
from mission.planner.evaluate import finish, success
from mission.planner.problem import Floats, Planner, RoundPlan, RoundProblem
from mission.planner.schedule import assign

_SHARES = (0.9, 0.75, 0.55)  # of the budget, where the way around costs the rest
_STRIDES_M = (80.0, 30.0, 10.0, 3.0, 1.0)
_ROUNDS = 3  # over all waypoints with one stride, at most
_GAIN = 1e-6  # of the value: less is no improvement
_SHORTER_M = 0.5
_TURNS = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
_RAYS = np.column_stack((np.cos(_TURNS), np.sin(_TURNS)))


@dataclass(frozen=True)
class AroundPlanner:
    """A planner, and what leads its paths around areas and keeps them within a fence."""

    inner: Planner

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanError: what the planner itself raises.
        """
        if problem.airspace.is_open:
            return self.inner.plan(problem)
        bare = replace(problem, airspace=OPEN)
        ideal = self.inner.plan(bare)
        best = finish(problem, ideal.waypoints_m)
        if best.value < ideal.value * (1.0 - _GAIN):
            for share in _SHARES:
                shorter = replace(bare, path_budget_m=share * problem.path_budget_m)
                other = finish(problem, self.inner.plan(shorter).waypoints_m)
                best = max(best, other, key=_value)
            best = _moved(problem, best)
        bound = min(ideal.upper_bound, reach_bound(problem))  # NaN stays, where none is proven
        bound = ideal.upper_bound if np.isnan(ideal.upper_bound) else bound
        return replace(best, upper_bound=max(bound, best.value), nodes=ideal.nodes)


def reach_bound(problem: RoundProblem) -> float:
    """What the devices are worth from as near as may be flown: no plan is worth more."""
    devices = problem.devices_m
    from_start = np.hypot(*(devices - problem.start_m).T)
    near_m = np.maximum(problem.airspace.away(devices), from_start - problem.path_budget_m)
    # The start may be nearer than anybody is allowed to be.
    near_m = np.maximum(0.0, np.minimum(near_m, from_start))
    worth = np.sort(problem.importance * (1.0 - average_per(problem.channel, near_m)))[::-1]
    return float(worth[: problem.steps * problem.per_step].sum())


def _value(plan: RoundPlan) -> float:
    return plan.value


def _moved(problem: RoundProblem, plan: RoundPlan) -> RoundPlan:
    """The plan after every move of one waypoint that makes it worth more, or as much and shorter.

    A search by shrinking strides (Hooke and Jeeves, 1961): the way around has corners, where it
    has no gradient.
    """
    for stride_m in _STRIDES_M:
        for _ in range(_ROUNDS):
            before = plan
            for n in range(1, problem.steps):
                plan = _best_move(problem, plan, n, stride_m)
            if plan is before:
                break
    return plan


def _best_move(problem: RoundProblem, plan: RoundPlan, n: int, stride_m: float) -> RoundPlan:
    places = plan.waypoints_m[n] + stride_m * _RAYS
    for place in places[problem.airspace.free(places)]:
        waypoints = plan.waypoints_m.copy()
        waypoints[n] = place
        if _no_better(problem, plan, waypoints):
            continue
        other = finish(problem, waypoints)
        gain = other.value - plan.value
        shorter = gain > -_GAIN * plan.value and other.path_m < plan.path_m - _SHORTER_M
        if gain > _GAIN * plan.value or shorter:
            plan = other
    return plan


def _no_better(problem: RoundProblem, plan: RoundPlan, waypoints_m: Floats) -> bool:
    """Whether waypoints cannot beat a plan, even where the way between them is straight."""
    worth = success(problem, waypoints_m) * problem.importance
    value = float(worth[assign(worth, np.ones(len(problem.importance)), problem.per_step)].sum())
    if value > plan.value * (1.0 + _GAIN):
        return False
    longer = polyline.length(waypoints_m) >= plan.path_m - _SHORTER_M
    return longer or value < plan.value * (1.0 - _GAIN)
