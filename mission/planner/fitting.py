"""Plans that fit limits of time and energy: along given waypoints, drawn together, improved.

A flight is foreseen with all its corners.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mission.base.arrays import Floats
from mission.planner.evaluate import objective, plan_along, success, worth_of
from mission.planner.flyable import foresee_round
from mission.planner.problem import RoundPlan, RoundProblem

_CUTS = 6  # of a path that is too long
_FULL = 0.998  # of a limit, to which it is cut
_LEAST_RATE = 0.3  # of the whole path's share a metre: less at its end is a corner's doing
_SHRUNK = 12  # halvings of how much a path is drawn together
_CHANGES, _STRIDE_M, _LEAST_STRIDE_M = 600, 30.0, 3.0  # small ones of the best; how small
_ONE, _ALL_FROM = 0.5, 0.8  # of the changes, summed up: one waypoint, all from one on


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


def made(problem: RoundProblem, waypoints_m: Floats) -> RoundPlan:
    """The plan along waypoints that serves as many as its limits allow; it may still not fit."""
    return foreseen(problem, serving_fewer(problem, plan_along(problem, waypoints_m)))


def fitted(
    problem: RoundProblem,
    waypoints_m: Floats,
    *,
    wanted: Callable[[RoundPlan], bool] = lambda _: True,
) -> RoundPlan | None:
    """The plan along waypoints as far as its limits allow.

    None where that is not wanted, where a few cuts do not find how far it may go, or where it does
    not fit and everywhere may be flown: `plan_along` cuts no path there.
    """
    longer: tuple[float, float] | None = None  # metres of the path before, and its share
    for _ in range(_CUTS):
        plan = plan_along(problem, waypoints_m)
        if not wanted(plan):
            return None
        if problem.limits is None:
            return plan
        plan = foreseen(problem, serving_fewer(problem, plan))
        taken = share(problem, plan)
        if taken <= 1.0:
            return plan if wanted(plan) else None
        if problem.airspace.is_open:
            return None
        # By the last two cuts: what the rest of the path takes, corners included.
        rate = taken / plan.path_m
        if longer is not None:
            rate = max((longer[1] - taken) / (longer[0] - plan.path_m), rate * _LEAST_RATE)
        longer = plan.path_m, taken
        cut_m = (taken - _FULL) / rate
        problem = replace(problem, path_budget_m=max(0.0, plan.path_m - cut_m))
    return None


def at_best_altitude(problem: RoundProblem, plan: RoundPlan, altitude_m: float | None) -> RoundPlan:
    """A plan from one altitude, or the same path from another that is worth more."""
    if problem.altitudes_m is None:
        return plan
    higher = fitted(problem, plan.waypoints_m, wanted=lambda other: other.value > plan.value)
    return higher or replace(plan, altitude_m=altitude_m)


def foreseen(problem: RoundProblem, plan: RoundPlan) -> RoundPlan:
    """The plan with what its flight takes."""
    return replace(plan, foreseen=foresee_round(problem, plan))


def share(problem: RoundProblem, plan: RoundPlan) -> float:
    """How much of the tighter limit the flight of a plan takes that was foreseen."""
    assert problem.limits is not None
    assert plan.foreseen is not None
    return problem.limits.share(plan.foreseen)


def drawn_together(problem: RoundProblem, waypoints_m: Floats) -> RoundPlan:
    """The plan along waypoints drawn towards the start as far as it takes for its flight to fit."""
    start, fitting, too_long = problem.start_m, 0.0, 1.0
    best = made(problem, np.broadcast_to(start, waypoints_m.shape))
    for _ in range(_SHRUNK):
        scale = (fitting + too_long) / 2.0
        drawn = made(problem, start + scale * (waypoints_m - start))
        if share(problem, drawn) <= 1.0:
            fitting, best = scale, drawn
        else:
            too_long = scale
    return best


def improved(problem: RoundProblem, plan: RoundPlan) -> RoundPlan:
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
        other = plan_along(problem, waypoints)
        if other.value > plan.value and other.path_m <= problem.path_budget_m:
            other = foreseen(problem, serving_fewer(problem, other))
            better = other.value > plan.value and share(problem, other) <= 1.0
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
