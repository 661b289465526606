"""Plans that keep to where may be flown, by any planner that knows of nothing in the way.

What is best without areas is a bound for what can be had with them: its waypoints are free to be
anywhere, and the way between them is straight. That bound stays true. The plan is the best of the
planner's own for several budgets, led around, of paths that are grown device by device along the
real ways, and of paths at random; then the waypoints are moved as long as that helps. Where time or
energy is limited, each is cut where its own flight, around all corners, reaches the limit.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mission.base import polyline
from mission.base.airspace import OPEN, Airspace, cut
from mission.base.arrays import Floats
from mission.planner.certified import TABLED
from mission.planner.evaluate import success, success_bounds, worth_of
from mission.planner.fitting import at_best_altitude, drawn_together, fitted, improved, share
from mission.planner.problem import Planner, RoundPlan, RoundProblem

_SHARES = (0.9, 0.75, 0.55)  # of the budget, where the way around costs the rest
_TRIED = 2  # paths of either kind that are improved
_LED = 25  # of those drawn, for which ways are looked for
_DRAWN = 150  # paths at random: around areas there are many best ones nearby, and one best of all
_MOST_DEVICES = 40  # that a path is grown towards: the way between any two of them is needed
_FIRSTS = 8  # devices, each of which one path is grown from
_FREE_M = 20.0  # of a way that one more device takes: less counts as this
_FAR_M, _NEAR_M = (80.0, 30.0), (10.0, 3.0, 1.0)  # strides of all that are tried, of the best
_ROUNDS = 2  # over all waypoints with one stride, at most
_GAIN = 1e-6  # of the value: less is no improvement
_SHORTER_M = 0.5
_ROOM = 1.01  # of a limit: a path that is straighter may be as much longer
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
        problem = replace(problem, path_budget_m=problem.most_m)
        ideal = self.inner.plan(replace(problem, airspace=OPEN))
        best = self._around(problem.at(ideal.altitude_m), ideal)
        best = at_best_altitude(problem, best, ideal.altitude_m)
        assert problem.limits is None or share(problem, best) <= 1.0, "a plan breaks its limits"
        bound = ideal.upper_bound  # NaN stays, where none is proven
        # A way out of an area leads nearer to devices than anybody is allowed to be.
        if not np.isnan(bound) and problem.airspace.allows(problem.start_m[None])[0]:
            bound = min(bound, reach_bound(problem))
        assert not best.value > bound * (1.0 + TABLED), "a plan exceeds its proven bound"
        return replace(best, upper_bound=max(bound, best.value), nodes=ideal.nodes)

    def _around(self, problem: RoundProblem, ideal: RoundPlan) -> RoundPlan:
        """The best plan from one altitude, given the one without areas."""
        best = _along(problem, ideal.waypoints_m)
        if best.value >= ideal.value * (1.0 - _GAIN):
            return best
        others = [best, *(_along(problem, path) for path in self._paths(problem, ideal))]
        drawn = [_along(problem, path) for path in _drawn(problem)]
        tried = [*_best(others), *_best(drawn)]
        if problem.limits is None:
            coarse = [_moved(problem, other, _FAR_M) for other in tried]
            return _moved(problem, max(coarse, key=_value), _NEAR_M)
        coarse = [_moved(problem, _detoured(problem, other), _FAR_M) for other in tried]
        return improved(problem, max(coarse, key=_value))

    def _paths(self, problem: RoundProblem, ideal: RoundPlan) -> list[Floats]:
        """Paths (N, 2) that are grown, and the planner's own for fewer metres, without areas."""
        # Within limits the best path without areas shows how many metres may be flown.
        most_m = problem.path_budget_m if problem.limits is None else ideal.path_m
        free = replace(problem, airspace=OPEN, limits=None)
        shorter = [replace(free, path_budget_m=part * most_m) for part in _SHARES]
        return [
            *grown(replace(problem, path_budget_m=most_m)),
            *(self.inner.plan(one).waypoints_m for one in shorter),
        ]


def _along(problem: RoundProblem, waypoints_m: Floats) -> RoundPlan:
    """The plan along waypoints, made to fit."""
    return fitted(problem, waypoints_m) or drawn_together(problem, waypoints_m)


def reach_bound(problem: RoundProblem) -> float:
    """What the devices are worth from as near as may be flown: no plan is worth more."""
    devices = problem.devices_m
    from_start = np.hypot(*(devices - problem.start_m).T)
    near_m = np.maximum(problem.airspace.away(devices), from_start - problem.path_budget_m)
    # The start may be nearer than anybody is allowed to be.
    near_m = np.maximum(0.0, np.minimum(near_m, from_start))
    worth = np.sort(problem.importance * success_bounds(problem, near_m).max(axis=0))[::-1]
    return float(worth[: problem.steps * problem.per_step].sum())


def _best(plans: list[RoundPlan]) -> list[RoundPlan]:
    return sorted(plans, key=_value, reverse=True)[:_TRIED]


def _drawn(problem: RoundProblem) -> Floats:
    """(_LED, N, 2) the best of waypoints at random among the devices, the same ones every time."""
    every = np.vstack((problem.devices_m, problem.start_m))
    rng = np.random.Generator(np.random.PCG64(0))
    paths = rng.uniform(every.min(axis=0), every.max(axis=0), (_DRAWN, problem.steps, 2))
    paths[:, 0] = problem.start_m
    worth = [-worth_of(problem, path) for path in paths]
    return np.asarray(paths[np.argsort(worth, kind="stable")[:_LED]])


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


def _value(plan: RoundPlan) -> float:
    return plan.value


def _moved(problem: RoundProblem, plan: RoundPlan, strides_m: tuple[float, ...]) -> RoundPlan:
    """The plan after every move of one waypoint that makes it worth more, or as much and shorter.

    A search by shrinking strides (Hooke and Jeeves, 1961): the way around has corners, where it
    has no gradient.
    """
    for stride_m in strides_m:
        for _ in range(_ROUNDS):
            before = plan
            for n in range(1, problem.steps):
                plan = _best_move(problem, plan, n, stride_m)
            if plan is before:
                break
    return plan


def _detoured(problem: RoundProblem, plan: RoundPlan) -> RoundPlan:
    """The plan after every detour to a device that makes it worth more."""
    places = problem.airspace.moved(problem.devices_m)
    for _ in range(_ROUNDS):
        before = plan
        for place in places:
            plan = _better(problem, plan, _by_way_of(problem, plan, place)) or plan
        if plan is before:
            break
    return plan


def _by_way_of(problem: RoundProblem, plan: RoundPlan, place_m: Floats) -> Floats:
    """The plan's waypoints (N, 2) with a place between the two from which it is nearest, instead of
    the waypoint that earns least."""
    earned = (plan.schedule * success(problem, plan.waypoints_m) * problem.importance).sum(axis=1)
    left = np.delete(plan.waypoints_m, 1 + earned[1:].argmin(), axis=0)
    far = np.hypot(*(left - place_m).T)
    longer = far + np.append(far[1:] - polyline.legs(left), 0.0)
    return np.insert(left, longer.argmin() + 1, place_m, axis=0)


def _best_move(problem: RoundProblem, plan: RoundPlan, n: int, stride_m: float) -> RoundPlan:
    places = plan.waypoints_m[n] + stride_m * _RAYS
    for place in places[problem.airspace.free(places)]:
        waypoints = plan.waypoints_m.copy()
        waypoints[n] = place
        if _no_better(problem, plan, waypoints):
            continue
        plan = _better(problem, plan, waypoints) or plan
    return plan


def _better(problem: RoundProblem, plan: RoundPlan, waypoints_m: Floats) -> RoundPlan | None:
    """The plan along other waypoints, where it is worth more, or as much and shorter."""

    def wanted(other: RoundPlan) -> bool:
        gain = other.value - plan.value
        shorter = gain > -_GAIN * plan.value and other.path_m < plan.path_m - _SHORTER_M
        return gain > _GAIN * plan.value or shorter

    if problem.limits is not None:  # what is too long anyway need not be foreseen
        left = _ROOM - share(problem, plan)
        most_m = min(problem.path_budget_m, plan.path_m + left * problem.path_budget_m)
        problem = replace(problem, path_budget_m=most_m)
    return fitted(problem, waypoints_m, wanted=wanted)


def _no_better(problem: RoundProblem, plan: RoundPlan, waypoints_m: Floats) -> bool:
    """Whether waypoints cannot beat a plan, even where the way between them is straight."""
    value = worth_of(problem, waypoints_m)
    if value > plan.value * (1.0 + _GAIN):
        return False
    longer = polyline.length(waypoints_m) >= plan.path_m - _SHORTER_M
    return longer or value < plan.value * (1.0 - _GAIN)
