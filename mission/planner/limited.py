"""Plans within limits of time and energy and around areas, by a planner that knows metres only.

What is best with as many metres as the limits allow without any corner, and with nothing in the
way, is a bound for what can be had: every flight that keeps to them is no longer. The plan is the
best of several paths, each cut to what its own flight may take and improved: by sequential
quadratic programs (`mission.planner.sqp`), and by detours to devices in place of the waypoint that
earns least.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mission.base import polyline
from mission.base.airspace import OPEN, Airspace, cut
from mission.base.arrays import Floats
from mission.planner.evaluate import (
    bounded,
    success,
    success_bounds,
    worth_of,
)
from mission.planner.fitting import fitted, standing
from mission.planner.flyable import foresee_round
from mission.planner.problem import Planner, RoundPlan, RoundProblem

if TYPE_CHECKING:  # which makes ready to search
    from mission.planner.certified import Goal

# Of the metres, where corners and ways around cost the rest; and where hovers do, too.
_SHARES = (1.0, 0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.6, 0.5, 0.4)
_UPLOAD_SHARES = (0.9, 0.75, 0.6, 0.45, 0.3)
_PRICES = (0.2, 0.4, 0.6)  # shares of the devices that are worth less a second
_ROUGH_TRIED, _TRIED, _ROUGH_STEPS = 8, 3, 8  # paths that are improved a little, and wholly
_MOST_DEVICES = 40  # that a path is grown towards: the way between any two of them is needed
_FIRSTS = 8  # devices, each of which one path is grown from
_FREE_M = 20.0  # of a way that one more device takes: less counts as this
_ROUNDS, _WORTH = 3, 5e-4  # of programs and detours; the gain for which there is another
_NEAR_M = 15.0  # waypoints of one turn
_ALIKE = 0.003  # of the value: plans that differ by less are taken for one
_LOOSE = "its bound leaves out part of the time that corners and ways around areas take"
_GAIN = 1e-6  # of the value: less is no improvement


@dataclass(frozen=True)
class LimitedPlanner:
    """A planner, and what makes its plans keep to areas, time and energy.

    `drawing` makes the paths that are begun with: the planner itself, or one that proves nothing.
    """

    inner: Planner
    drawing: Planner
    goal: "Goal | None" = None  # None: nothing is proven

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanError: what the planner itself raises.
            BoundError: the plan is worth more than the bound that the planner has proven.
        """
        if problem.airspace.is_open and problem.limits is None:
            return self.inner.plan(problem)
        problem = replace(problem, path_budget_m=problem.most_m, importance=servable(problem))
        ideal = self.inner.plan(_free(problem))
        bound = ideal.upper_bound  # NaN stays, where none is proven
        # A way out of an area leads nearer to devices than anybody is allowed to be.
        if not np.isnan(bound) and problem.airspace.allows(problem.start_m[None])[0]:
            bound = min(bound, reach_bound(problem))
        fixed = problem.at(ideal.altitude_m)
        best = fitted(fixed, ideal.waypoints_m)
        if best is None or best.value < ideal.value * (1.0 - _GAIN):
            tried = [standing(fixed), *([] if best is None else [best])]
            tried += [plan for path in self._paths(fixed) if (plan := fitted(fixed, path))]
            chosen = _best(tried, _ROUGH_TRIED)
            if self.goal is not None:
                from mission.planner.timed import timed_bound

                timed, relaxed = timed_bound(problem, chosen[0].value, self.goal)
                bound = min(bound, timed)
                chosen += [plan for path in relaxed if (plan := fitted(fixed, path))]
            best = _improved(fixed, chosen)
        if problem.altitudes_m is not None:
            higher = fitted(problem, best.waypoints_m, above=best.value)
            best = higher or replace(best, altitude_m=ideal.altitude_m)
        if problem.limits is not None:
            best = replace(best, foreseen=foresee_round(problem, best))
        best = bounded(problem, best, bound, ideal.nodes)
        if self.goal is None or best.gap <= self.goal.gap:
            return replace(best, ended="")
        return replace(best, ended=ideal.ended or _LOOSE)

    def _paths(self, problem: RoundProblem) -> list[Floats]:
        """Paths (N, 2) to begin with: of a planner that is given fewer metres, and grown ones."""
        free = _free(problem)
        paths: list[Floats] = []
        for importance, shares in _weighed(problem):
            for part in shares:
                most_m = part * problem.path_budget_m
                shorter = replace(free, importance=importance, path_budget_m=most_m)
                paths.append(self.drawing.plan(shorter).waypoints_m)
                if problem.ready_in_s is not None:  # who was first may be last
                    paths.append(np.vstack((paths[-1][:1], paths[-1][:0:-1])))
        if not problem.airspace.is_open:
            paths += grown(problem)
        return paths


def _weighed(problem: RoundProblem) -> list[tuple[Floats, Sequence[float]]]:
    """The importance that paths are drawn by, and for which shares of the metres: less a price of
    the seconds that each device sends for, where these are limited."""
    if problem.limits is None or problem.upload_s is None:
        return [(problem.importance, _SHARES)]
    rates = problem.importance / np.maximum(problem.upload_s, 1e-9)
    priced = [problem.importance - np.quantile(rates, q) * problem.upload_s for q in _PRICES]
    return [(np.maximum(0.0, left), _UPLOAD_SHARES) for left in (problem.importance, *priced)]


def _free(problem: RoundProblem) -> RoundProblem:
    """The problem without areas, limits and devices that have to get ready."""
    return replace(problem, airspace=OPEN, limits=None, ready_in_s=None)


def servable(problem: RoundProblem) -> Floats:
    """(K,) the importance, without devices that are not ready before the longest round ends."""
    if problem.limits is None or problem.ready_in_s is None:
        return problem.importance
    return np.where(problem.ready_in_s <= problem.longest_s, problem.importance, 0.0)


def _improved(problem: RoundProblem, plans: list[RoundPlan]) -> RoundPlan:
    """The best that can be made of plans: all improved a little, the best of those wholly."""
    from mission.planner.sqp import ascended

    rough = [ascended(problem, plan, _ROUGH_STEPS) for plan in plans]
    return max((improved(problem, plan) for plan in _best(rough, _TRIED)), key=_value)


def _value(plan: RoundPlan) -> float:
    return plan.value


def _best(plans: list[RoundPlan], most: int) -> list[RoundPlan]:
    """Best plans first, at most so many, without those of nearly equal value."""
    some: list[RoundPlan] = []
    for plan in sorted(plans, key=_value, reverse=True):
        if not some or some[-1].value > plan.value * (1.0 + _ALIKE):
            some.append(plan)
    return some[:most]


def reach_bound(problem: RoundProblem) -> float:
    """What the devices are worth from as near as may be flown: no plan is worth more."""
    devices = problem.devices_m
    from_start = np.hypot(*(devices - problem.start_m).T)
    near_m = np.maximum(problem.airspace.away(devices), from_start - problem.path_budget_m)
    # The start may be nearer than anybody is allowed to be.
    near_m = np.maximum(0.0, np.minimum(near_m, from_start))
    worth = np.sort(problem.importance * success_bounds(problem, near_m).max(axis=0))[::-1]
    return float(worth[: problem.steps * problem.per_step].sum())


def improved(problem: RoundProblem, plan: RoundPlan) -> RoundPlan:
    """The plan after programs and detours by turns, as long as that helps."""
    from mission.planner.sqp import ascended

    for _ in range(_ROUNDS):
        before = plan
        plan = detoured(problem, ascended(problem, plan))
        if problem.limits is not None and (snapped := fitted(problem, _snapped(plan.waypoints_m))):
            plan = max(plan, ascended(problem, snapped), key=_value)
        if plan.value <= before.value * (1.0 + _WORTH):
            break
    return plan


def _snapped(waypoints_m: Floats) -> Floats:
    """The waypoints (N, 2), each where the one before is, if that is near: a turn between two of
    them is slow, however small it is."""
    moved = waypoints_m.copy()
    for n in range(1, len(moved)):
        if np.hypot(*(moved[n] - moved[n - 1])) < _NEAR_M:
            moved[n] = moved[n - 1]
    return moved


def detoured(problem: RoundProblem, plan: RoundPlan) -> RoundPlan:
    """The plan after every detour that makes it worth more: to a device, or to where the path comes
    nearest to it."""
    if problem.steps < 2:
        return plan
    devices = np.flatnonzero(problem.importance > 0.0)
    places = problem.airspace.moved(problem.devices_m[devices])
    for place in places:
        near = _nearest(plan.route_m, place)
        for target in (place, (place + near) / 2.0, near):
            waypoints = _by_way_of(problem, plan, target)
            if worth_of(problem, waypoints) > plan.value * (1.0 + _GAIN):
                plan = fitted(problem, waypoints, above=plan.value * (1.0 + _GAIN)) or plan
    return plan


def _nearest(route_m: Floats, place_m: Floats) -> Floats:
    """The point of a route that is nearest to a place."""
    legs = np.diff(route_m, axis=0)
    square = np.maximum((legs**2).sum(axis=1), 1e-9)
    share = np.clip(((place_m - route_m[:-1]) * legs).sum(axis=1) / square, 0.0, 1.0)
    feet = route_m[:-1] + share[:, None] * legs
    return np.asarray(feet[np.hypot(*(feet - place_m).T).argmin()])


def _by_way_of(problem: RoundProblem, plan: RoundPlan, place_m: Floats) -> Floats:
    """The plan's waypoints (N, 2) with a place between the two from which it is nearest, instead of
    the waypoint that earns least."""
    earned = (plan.schedule * success(problem, plan.waypoints_m) * problem.importance).sum(axis=1)
    left = np.delete(plan.waypoints_m, 1 + earned[1:].argmin(), axis=0)
    far = np.hypot(*(left - place_m).T)
    longer = far + np.append(far[1:] - polyline.legs(left), 0.0)
    return np.insert(left, longer.argmin() + 1, place_m, axis=0)


def grown(problem: RoundProblem) -> list[Floats]:
    """Paths (N, 2) near devices, one more at a time: the one that gives most a metre.

    A path for each device that it may begin with. What is left of the steps is spread along the
    way.
    """
    space = problem.airspace
    most = np.argsort(-problem.importance, kind="stable")[:_MOST_DEVICES]
    places = np.vstack((problem.start_m, space.moved(problem.devices_m[most])))
    far = _ways_m(space, places)
    firsts = [i for i in range(1, len(places)) if far[0, i] <= problem.path_budget_m][:_FIRSTS]
    return [
        _filled(problem, places[_tour(problem, places, far, first)])
        for first in firsts
        if problem.steps > 1
    ]


def _tour(problem: RoundProblem, places: Floats, far: Floats, first: int) -> list[int]:
    """The places of a path that is grown from the start and a first device."""
    tour, left_m = [0, first], problem.path_budget_m - float(far[0, first])
    value = worth_of(problem, places[tour])
    while len(tour) < problem.steps:
        chosen: tuple[float, int, int, float, float] | None = None
        for index in range(1, len(places)):
            if index in tour:
                continue
            before, extra_m = _cheapest(far, tour, index)
            if extra_m > left_m:
                continue
            worth = worth_of(problem, places[[*tour, index]])
            rate = (worth - value) / max(extra_m, _FREE_M)
            if worth > value and (chosen is None or rate > chosen[0]):
                chosen = (rate, index, before, extra_m, worth)
        if chosen is None:
            break
        _, index, before, extra_m, value = chosen
        tour.insert(before, index)
        left_m -= extra_m
    return tour


def _ways_m(space: Airspace, places_m: Floats) -> Floats:
    """(P, P) lengths of the shortest ways; infinity where there is none."""
    far = np.zeros((len(places_m), len(places_m)))
    for i, j in zip(*np.triu_indices(len(places_m), 1), strict=True):
        try:
            far[i, j] = far[j, i] = space.way_and_length(places_m[i], places_m[j])[1]
        except ValueError:
            far[i, j] = far[j, i] = np.inf
    return far


def _cheapest(far: Floats, tour: list[int], index: int) -> tuple[int, float]:
    """Where in a tour one more place costs least, and how many metres."""
    ends = np.array(tour)
    extra = far[ends, index].copy()
    extra[:-1] += far[index, ends[1:]] - far[ends[:-1], ends[1:]]
    best = int(extra.argmin())
    return best + 1, float(extra[best])


def _filled(problem: RoundProblem, waypoints_m: Floats) -> Floats:
    """(N, 2): while there are too few, one more in the middle of the longest leg."""
    while len(waypoints_m) < problem.steps:
        if len(waypoints_m) == 1:
            return np.repeat(waypoints_m, problem.steps, axis=0)
        ways = [problem.airspace.way_and_length(a, b) for a, b in pairwise(waypoints_m)]
        longest = int(np.argmax([way_m for _, way_m in ways]))
        way, way_m = ways[longest]
        middle = cut(way, way_m / 2.0)[-1]
        waypoints_m = np.insert(waypoints_m, longest + 1, middle, axis=0)
    return waypoints_m
