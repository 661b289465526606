"""Plans within limits of time and energy and around areas, by a planner that knows metres only.

The bound is that of a relaxed problem: no areas, and as many metres as the limits allow without any
corner, since no flight within them is longer. The plan is the best of several paths, each shortened
until its own flight fits and improved by random changes (`native/variation.h`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mission.base.arrays import Floats
from mission.planner.certified import in_usual_size
from mission.planner.evaluate import bounded, success_bounds
from mission.planner.flyable import foresee_round
from mission.planner.improving import fitted, improved, standing
from mission.planner.native.library import Goal
from mission.planner.plan import Planner, RoundPlan
from mission.planner.problem import RoundProblem
from mission.planner.timed import timed_bound

# Of the metres, where corners and ways around cost the rest; and where hovers do, too.
_SHARES = (1.0, 0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.6, 0.5, 0.4)
_UPLOAD_SHARES = (0.9, 0.75, 0.6, 0.45, 0.3)
_PRICES = (0.2, 0.4, 0.6)  # shares of the devices that are worth less a second
_LOOSE = "its bound leaves out part of the time that corners and ways around areas take"
_FEW = 20  # devices, for all of whose altitudes a proof can be waited for
_GAIN = 1e-6  # of the value: less is no improvement


@dataclass(frozen=True)
class LimitedPlanner:
    """Planner that makes the plans of `inner`, which knows metres only, keep to areas and limits.

    `drawing` makes the initial paths: the planner itself, or one that proves nothing. `brief`,
    which searches few nodes, replaces `inner` where the altitude is open for many devices.
    """

    inner: Planner
    drawing: Planner
    goal: Goal | None = None  # None: nothing is proven
    brief: Planner | None = None

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanError: what the planner itself raises.
            BoundError: the plan is worth more than the bound that the planner has proven.
        """
        if problem.airspace.is_open and problem.limits is None:
            return self.inner.plan(problem)
        problem = replace(
            problem.with_own(path_budget_m=problem.most_m), importance=servable(problem)
        )
        if (plan := in_usual_size(self, problem)) is not None:
            return plan
        # With uploads the search that counts them proves more: a brief one does before.
        large = len(problem.devices_m) > _FEW or problem.upload_s is not None
        large = large and problem.altitudes_m is not None
        inner = self.brief if self.brief is not None and large else self.inner
        ideal = inner.plan(problem.unlimited)
        best, bound = self._within(problem, ideal)
        if problem.limits is not None:
            best = best.with_own(foreseen=foresee_round(problem, best))
        best = bounded(problem, best, bound, ideal.nodes)
        if self.goal is None or best.gap <= self.goal.gap:
            return replace(best, ended="")
        return replace(best, ended=ideal.ended or _LOOSE)

    def _within(self, problem: RoundProblem, ideal: RoundPlan) -> tuple[RoundPlan, float]:
        """Return the best plan within limits, begun from `ideal`, and its bound (NaN: none)."""
        bound = ideal.upper_bound  # NaN stays, where none is proven
        if not np.isnan(bound):
            bound = min(bound, reach_bound([problem]))
        fixed = problem.at(ideal.altitude_m)
        best = fitted(problem, ideal.waypoints_m)
        if best is None or best.value < ideal.value * (1.0 - _GAIN):
            tried = [standing(fixed), *([] if best is None else [best])]
            tried += [plan for path in self._paths(fixed) if (plan := fitted(fixed, path))]
            enough = bound * (1.0 - self.goal.gap) if self.goal else math.inf
            at_m = ideal.altitude_m
            tried = [plan.with_own(altitude_m=plan.altitude_m or at_m) for plan in tried]
            best = improved(problem, tried, enough)
            if self.goal is not None:
                bound = min(bound, timed_bound(problem, best.value, self.goal))
        return best, bound

    def _paths(self, problem: RoundProblem) -> list[Floats]:
        """Return initial paths (N, 2) of `drawing`, for the cases of `_weighed`."""
        free = problem.unlimited
        paths: list[Floats] = []
        for importance, shares in _weighed(problem):
            for part in shares:
                shorter = replace(
                    free.with_own(path_budget_m=part * problem.path_budget_m), importance=importance
                )
                paths.append(self.drawing.plan(shorter).waypoints_m)
                if problem.ready_in_s is not None:  # who was first may be last
                    paths.append(np.vstack((paths[-1][:1], paths[-1][:0:-1])))
        return paths


def _weighed(problem: RoundProblem) -> list[tuple[Floats, Sequence[float]]]:
    """Return pairs of importance (K,) and shares of the metres to draw paths with; where time or
    energy is limited, also importance less a price on each device's upload time."""
    if problem.limits is None or problem.upload_s is None:
        return [(problem.importance, _SHARES)]
    rates = problem.importance / np.maximum(problem.upload_s, 1e-9)
    priced = [problem.importance - np.quantile(rates, q) * problem.upload_s for q in _PRICES]
    return [(np.maximum(0.0, left), _UPLOAD_SHARES) for left in (problem.importance, *priced)]


def servable(problem: RoundProblem) -> Floats:
    """(K,) importance, with 0 for devices that are not ready before the longest round ends or whose
    upload alone breaks a limit."""
    limits, served = problem.limits, np.ones(len(problem.devices_m), dtype=bool)
    if limits is not None and problem.ready_in_s is not None:
        served &= problem.ready_in_s <= problem.longest_s
    if limits is not None and problem.upload_s is not None:
        for limit in limits.each:
            served &= problem.upload_s * limit.hover(1.0) <= limit.most
    return np.where(served, problem.importance, 0.0)


def near_of(problem: RoundProblem) -> Floats:
    """(K,) metres from each device to the nearest place in reach that is allowed."""
    devices = problem.devices_m
    from_start = np.hypot(*(devices - problem.start_m).T)
    away = problem.airspace.away(devices)
    # A way out of an area leads nearer to devices than anybody is allowed to be.
    if not problem.airspace.allows(problem.start_m[None])[0]:
        away = np.zeros(len(devices))
    near_m = np.maximum(away, from_start - problem.path_budget_m)
    # The start may be nearer than anybody is allowed to be.
    return np.asarray(np.maximum(0.0, np.minimum(near_m, from_start)))


def reach_bound(alone: Sequence[RoundProblem]) -> float:
    """Return an upper bound on plans of aircraft with a problem each: each device served from the
    nearest place that is allowed any of them."""
    chances = [success_bounds(each, near_of(each)).max(axis=0) for each in alone]
    worth = np.sort(alone[0].importance * np.max(chances, axis=0))[::-1]
    return float(worth[: len(alone) * alone[0].steps * alone[0].per_step].sum())
