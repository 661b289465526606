"""Plans along given waypoints that keep to what a round may take: metres, time, energy.

A flight is foreseen with all its corners, in C (`native/stops.h`).
"""

from dataclasses import replace

import numpy as np

from mission.base.arrays import Floats
from mission.planner.evaluate import fit_budget, plan_along, planned
from mission.planner.problem import RoundPlan, RoundProblem


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
    problem: RoundProblem, waypoints_m: Floats, *, above: float = -np.inf
) -> RoundPlan | None:
    """Return the plan along waypoints (N, 2), shortened to keep to the limits; None where it is
    worth no more than `above`, or where a few cuts find no length that fits.

    In open airspace a path that is too long is shrunk about its start. Among areas its end is cut
    off. An open altitude is the best one of the path without limits.
    """
    if problem.altitudes_m is not None:
        within = (
            fit_budget(waypoints_m, problem.most_m) if problem.airspace.is_open else waypoints_m
        )
        altitude_m = plan_along(problem, within).altitude_m
        plan = fitted(problem.at(altitude_m), waypoints_m, above=above)
        return plan and plan.with_own(altitude_m=altitude_m)
    found = problem.as_judged.fitted(
        waypoints_m, problem.most_m, above=above, limited=problem.limits is not None
    )
    return None if found is None else planned(problem, found)


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
