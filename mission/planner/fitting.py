"""Plans along given waypoints that keep to what a round may take: metres, time, energy.

A flight is foreseen with all its corners.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mission.base.arrays import Floats
from mission.planner.evaluate import fit_budget, plan_along, success, without_late
from mission.planner.flyable import share_of
from mission.planner.problem import RoundPlan, RoundProblem

_FILLED = 1.05  # of a limit: a device that seems to take no more is tried
_CUTS = 6  # of a path that is too long
_FULL = 0.999  # of a limit, to which it is cut
_LEAST_RATE = 0.3  # of the whole path's share a metre: less at its end is a corner's doing


def serving_fewer(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> RoundPlan:
    """The plan without the devices whose sending takes it beyond the limits, least worth a second
    first; it may still not fit, if the path alone does not.

    `hold_s` is the hover at every stop (`stops_of`).
    """
    upload_s = problem.upload_s
    if problem.limits is None or upload_s is None:
        return plan
    whole = share_of(problem, plan, hold_s=hold_s)
    if whole <= 1.0:
        return plan
    steps, devices = np.nonzero(plan.schedule)
    at_altitude = problem.at(plan.altitude_m)
    worth = (success(at_altitude, plan.waypoints_m) * problem.importance)[steps, devices]

    def serving(chosen: Sequence[int]) -> RoundPlan:
        schedule = np.zeros_like(plan.schedule)
        schedule[steps[chosen], devices[chosen]] = True
        return without_late(problem, replace(plan, schedule=schedule), hold_s=hold_s)

    best = serving([])
    taken = share_of(problem, best, hold_s=hold_s)
    # What one of them takes, about: its stop's braking goes with the seconds of its hover.
    each = (whole - taken) * upload_s[devices] / max(float(upload_s[devices].sum()), 1e-9)
    order = np.argsort(-worth / np.maximum(each, 1e-9), kind="stable").tolist()
    chosen: list[int] = []
    for one in order:
        if taken + each[[*chosen, one]].sum() <= 1.0:
            chosen.append(one)
    while chosen and share_of(problem, serving(chosen), hold_s=hold_s) > 1.0:
        chosen.pop()
    for one in order:
        if one not in chosen and taken + each[[*chosen, one]].sum() <= _FILLED:
            more = serving([*chosen, one])
            if share_of(problem, more, hold_s=hold_s) <= 1.0:
                chosen.append(one)
    return serving(chosen)


def fitted(
    problem: RoundProblem, waypoints_m: Floats, *, above: float = -np.inf
) -> RoundPlan | None:
    """The plan along waypoints as far as its limits allow; None where it is worth no more than
    `above`, or where a few cuts do not find how far it may go.

    Where everywhere may be flown, a path that is too long is shrunk about its start. Among areas
    its end is cut off.
    """
    most_m = problem.most_m
    longer: tuple[float, float] | None = None  # metres of the path before, and its share
    for _ in range(_CUTS):
        within = replace(problem, path_budget_m=most_m)
        open_to_all = problem.airspace.is_open
        plan = plan_along(within, fit_budget(waypoints_m, most_m) if open_to_all else waypoints_m)
        if not plan.value > above:
            return None
        if problem.limits is None:
            return plan
        plan = serving_fewer(problem, plan)
        taken = share_of(problem, plan)
        if taken <= 1.0:
            return plan if plan.value > above else None
        # By the last two cuts: what the rest of the path takes, corners included.
        rate = taken / max(plan.path_m, 1e-9)
        if longer is not None and longer[0] > plan.path_m:
            rate = max((longer[1] - taken) / (longer[0] - plan.path_m), rate * _LEAST_RATE)
        longer = plan.path_m, taken
        most_m = max(0.0, plan.path_m - (taken - _FULL) / rate)
    return None


def standing(problem: RoundProblem) -> RoundPlan:
    """The plan that stays where it starts: it fits whatever may be taken."""
    plan = fitted(problem, np.tile(problem.start_m, (problem.steps, 1)))
    assert plan is not None
    return plan
