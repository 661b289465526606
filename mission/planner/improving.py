"""Plans that keep to what a round may take (metres, time, energy), and better ones near them.

A flight is foreseen with all its corners, in C (`native/stops.h`). Better ones are found by random
changes: threshold accepting (`native/variation.h`).
"""

from dataclasses import replace

import numpy as np

from mission.base.arrays import Floats
from mission.planner.evaluate import fit_budget, plan_along, planned
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem


def serving_fewer(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> RoundPlan:
    """Drop scheduled devices, least reward per second of upload first, until the plan keeps to its
    limits; it may still not fit, if the path alone does not.

    `hold_s` is the hover in seconds at every stop (`stops_of`).
    """
    if problem.limits is None or problem.upload_s is None:
        return plan
    fewer = problem.at(plan.altitude_m).judged_with(hold_s=hold_s).serving_fewer(plan.as_candidate)
    return replace(plan, schedule=fewer.schedule[None], value=fewer.value)


def fitted(
    problem: RoundProblem, waypoints_m: Floats, *, above: float = -np.inf, wait_s: float = 0.0
) -> RoundPlan | None:
    """Return the plan along waypoints (N, 2) after a hover of `wait_s` at the start, shortened to
    keep to the limits; None where it is worth no more than `above`, or where a few cuts find no
    length that fits.

    In open airspace a path that is too long is shrunk about its start. Among areas its end is cut
    off. An open altitude is the best one of the path without limits.
    """
    if problem.altitudes_m is not None:
        within = (
            fit_budget(waypoints_m, problem.most_m) if problem.airspace.is_open else waypoints_m
        )
        altitude_m = plan_along(problem, within).altitude_m
        plan = fitted(problem.at(altitude_m), waypoints_m, above=above, wait_s=wait_s)
        return plan and plan.with_own(altitude_m=altitude_m)
    candidate = problem.as_judged.fitted(
        waypoints_m, problem.most_m, above=above, limited=problem.limits is not None, wait_s=wait_s
    )
    return None if candidate is None else planned(problem, candidate)


def varied(
    problem: RoundProblem,
    plan: RoundPlan,
    changes: int,
    *,
    tolerance: float = 0.0,
    seed: int = 0,
    price: Floats | None = None,
) -> RoundPlan:
    """Improve a plan by local search (threshold accepting) with `changes` random moves: shift a
    waypoint, put it near a device or elsewhere in the order, reverse a stretch. A move may lose up
    to a share `tolerance` of the value, which falls to 0 in the end. Where serving each device
    has a `price` (K,), it is part of the values of both plans."""
    problem, limited = problem.at(plan.altitude_m), problem.limits is not None
    judged = problem.as_judged if price is None else problem.judged_with(price=price)
    found = judged.varied(
        plan.as_candidate, problem.most_m, changes, tolerance=tolerance, seed=seed, limited=limited
    )
    return planned(problem, found).with_own(altitude_m=plan.altitude_m)


def standing(problem: RoundProblem) -> RoundPlan:
    """Return the plan that stays at the start, which any limits allow."""
    plan = fitted(problem, np.tile(problem.start_m, (problem.steps, 1)))
    assert plan is not None
    return plan


_CHANGES, _USUAL = 40_000, 120  # that are tried at random, for so many devices times steps
_FEWEST, _PAIRS = 200, 250  # of them; of outlines and vertices, whose ways take as long as a look
# How many plans are improved, by which share of the changes, and what they may lose on the way.
_STAGES = ((30, 0.2, 0.02), (4, 1.0, 0.01), (1, 2.0, 0.01), (1, 1.0, 0.0))
# The same where hovers and readiness are both timed: a small change costs a device its turn.
_RUGGED = ((30, 0.4, 0.05), (10, 1.6, 0.05), (4, 3.2, 0.05), (1, 6.0, 0.02), (1, 4.0, 0.0))
_ON_GRID = 0.5
_SERVED = 6  # devices that are as much work to leave out, one by one, as a look
_ALIKE = 0.003  # of the value: plans that differ by less are taken for one


def improved(problem: RoundProblem, plans: list[RoundPlan], enough: float) -> RoundPlan:
    """Return the best plan of a staged local search: all `plans` briefly, the best of those longer,
    until one is worth `enough`; an open altitude is chosen anew for each of the best."""
    changes, some = changes_for(problem), plans
    timed = problem.upload_s is not None and problem.ready_in_s is not None
    for stage, (most, share, tolerance) in enumerate(_RUGGED if timed else _STAGES):
        if max(map(_value, some)) >= enough:
            break
        some = [
            varied(problem, plan, int(share * changes), tolerance=tolerance, seed=seed)
            for seed, plan in enumerate(_best(some, most))
        ]
        if problem.altitudes_m is not None and stage > 0:
            some = [fitted(problem, plan.waypoints_m, above=plan.value) or plan for plan in some]
    return max(some, key=_value)


def changes_for(problem: RoundProblem) -> int:
    """Return how many random changes to try: fewer where evaluating one takes longer."""
    work, devices = 1.0, len(problem.devices_m)
    limits = () if problem.limits is None else problem.limits.each
    if problem.ready_in_s is not None:
        work += 2
    if any("energy_j" in limit.counted for limit in limits):
        work += 1
    if not problem.airspace.is_open:
        ways = 1 + problem.airspace.outlines.pairs // _PAIRS
        work += (1 if problem.limits is None else 4) * ways
    if problem.upload_s is not None:
        work += 3
        if limits:
            work += devices / _SERVED
    if problem.per_grid is not None:  # many summits, and a look is short
        work *= _ON_GRID
    size = max(1.0, problem.steps * devices / _USUAL)
    return max(_FEWEST, int(_CHANGES / (work * size**0.25)))


def _value(plan: RoundPlan) -> float:
    return plan.value


def _best(plans: list[RoundPlan], most: int) -> list[RoundPlan]:
    """Best plans first, at most so many, without those of nearly equal value."""
    some: list[RoundPlan] = []
    for plan in sorted(plans, key=_value, reverse=True):
        if not some or some[-1].value > plan.value * (1.0 + _ALIKE):
            some.append(plan)
    return some[:most]
