"""Flights of plans: acceptance radius of the corners, and predicted time and energy.

An aircraft that does not stop rounds its corners, and passes the device below one at a distance.
Where the packet error rate rises from the first metre on, that costs more than the time it saves.
"""

import numpy as np

from mission.planner.performance import Foreseen
from mission.planner.problem import RoundPlan, RoundProblem
from mission.planner.stops import stops_of


def acceptance_radius(problem: RoundProblem, plan: RoundPlan, widest_m: float) -> float:
    """The widest acceptance radius in metres, up to `widest_m`, that costs the plan 1 % at most.

    Where none does, the narrowest. Corners around areas are cut by half of the margin at most.
    """
    round_ = problem.at(plan.altitude_m).judged_with(widest_m=widest_m)
    return round_.judged(plan.as_candidate).radius_m


def foresee_round(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> Foreseen:
    """Predict times and energy of a plan's flight; needs limits; `hold_s` as in `stops_of`."""
    limits = problem.at(plan.altitude_m).limits
    assert limits is not None
    performance = limits.performance
    stops = stops_of(plan, hold_s=hold_s, upload_s=problem.upload_s)
    return performance.foresee(
        np.array([stop.xy_m for stop in stops]),
        [stop.hold_s for stop in stops],
        acceptance_radius(problem, plan, performance.widest_m),
    )


def share_of(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> float:
    """How much of the tighter limit the flight of a plan takes; more than 1 does not fit."""
    if problem.limits is None:
        return 0.0
    return problem.at(plan.altitude_m).judged_with(hold_s=hold_s).judged(plan.as_candidate).share
