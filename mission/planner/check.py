"""Whether a plan keeps every constraint of its problem."""

import numpy as np

from mission.base.errors import InfeasiblePlanError
from mission.planner.apart import layered_by, too_near
from mission.planner.evaluate import LENGTH_TOLERANCE_M, in_time, objective
from mission.planner.flyable import foresee_round
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem

VALUE_TOLERANCE = 1e-9  # relative


def check_plan(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> None:
    """Verify every constraint of a plan, and the value and bound it claims, from scratch: what
    each aircraft flies and serves, that no device is served twice over all of them, and that they
    keep apart at all times of their flights as foreseen.

    Each hovers `hold_s` at every stop (`stops_of`).

    Raises:
        InfeasiblePlanError: names the constraint and by how much it is broken.
    """
    count = len(problem.starts)
    shape = (count, problem.steps, len(problem.devices_m))
    if len(plan.paths) != count or plan.schedule.shape != shape:
        raise InfeasiblePlanError(
            f"{len(plan.paths)} paths and a schedule {plan.schedule.shape}: must be {count} and "
            f"{shape}"
        )
    real, spare_m = 0.0, layered_by(problem)
    for aircraft in range(count):
        try:
            real += _worth(problem.alone(aircraft), plan.alone(aircraft), hold_s, spare_m)
        except InfeasiblePlanError as error:
            if count == 1:
                raise
            raise InfeasiblePlanError(f"{problem.name_of(aircraft)}: {error}") from None
    times = plan.schedule.sum(axis=(0, 1))
    if times.max(initial=0) > 1:
        raise InfeasiblePlanError(
            f"device {times.argmax()} is scheduled {times.max()} times: at most once"
        )
    if (near := too_near(problem, plan, hold_s=hold_s)) is not None:
        raise InfeasiblePlanError(f"{near.words}: separation_m is {problem.separation_m:g}")
    least = 1e-12 * min(1.0, float(problem.importance.sum()))
    if not np.isclose(real, plan.value, rtol=VALUE_TOLERANCE, atol=least):
        raise InfeasiblePlanError(f"the plan claims a value of {plan.value}, it has {real}")
    if plan.upper_bound < real * (1.0 - VALUE_TOLERANCE):  # NaN: none is claimed
        raise InfeasiblePlanError(
            f"the plan claims that none is worth more than {plan.upper_bound}, and is worth {real}"
        )


def _worth(problem: RoundProblem, plan: RoundPlan, hold_s: float, spare_m: float) -> float:
    """Verify what one aircraft flies and serves, up to `spare_m` beside a fixed altitude; return
    what that is worth."""
    if plan.waypoints_m.shape != (problem.steps, 2):
        raise InfeasiblePlanError(
            f"waypoints {plan.waypoints_m.shape}: must be ({problem.steps}, 2)"
        )
    if not 0.0 <= plan.path.wait_s < np.inf:
        raise InfeasiblePlanError(f"a wait of {plan.path.wait_s} s: must be 0 or more")
    if not np.isfinite(plan.waypoints_m).all():
        raise InfeasiblePlanError("waypoints hold values that are not finite")
    away = float(np.hypot(*(plan.waypoints_m[0] - problem.start_m)))
    if away > LENGTH_TOLERANCE_M:
        raise InfeasiblePlanError(f"the first waypoint lies {away:.4f} m from the start")
    if plan.via_m and len(plan.via_m) != problem.steps - 1:
        raise InfeasiblePlanError(
            f"corners between {len(plan.via_m)} pairs of waypoints: must be {problem.steps - 1}"
        )
    over = plan.path_m - problem.path_budget_m
    if over > LENGTH_TOLERANCE_M:
        raise InfeasiblePlanError(f"the path is {over:.4f} m longer than its budget")
    _check_airspace(problem, plan)
    if problem.limits is not None:
        excess = problem.limits.excess(foresee_round(problem, plan, hold_s=hold_s))
        if excess:
            raise InfeasiblePlanError(excess)
        # Waypoints that are flown as one take no time, but what is proven counts their metres.
        over = plan.path_m - problem.limits.longest_m(problem.legs)
        if over > LENGTH_TOLERANCE_M:
            raise InfeasiblePlanError(f"the path is {over:.4f} m longer than its limits allow")
    busiest = int(plan.schedule.sum(axis=2).max(initial=0))
    if busiest > problem.per_step:
        raise InfeasiblePlanError(f"{busiest} devices in one step: at most {problem.per_step}")
    in_turn = plan.schedule & in_time(problem, plan, hold_s=hold_s)
    flown = problem.at(_checked_altitude(problem, plan, spare_m))
    return objective(flown, plan.waypoints_m, in_turn[0])


def _checked_altitude(problem: RoundProblem, plan: RoundPlan, spare_m: float) -> float | None:
    if problem.altitudes_m is None:
        fixed_m, height_m = problem.channel.altitude_m, plan.altitude_m
        if height_m is not None and not (abs(height_m - fixed_m) <= spare_m and height_m > 0.0):
            layers = f", and layers up to {spare_m:g} m from it" if spare_m else ""
            raise InfeasiblePlanError(
                f"an altitude of {height_m:g} m: the problem has one of {fixed_m:g} m{layers}"
            )
        return height_m
    low_m, high_m = problem.altitudes_m
    if plan.altitude_m is None:
        raise InfeasiblePlanError(
            f"the plan names no altitude: altitude_m must be from {low_m:g} to {high_m:g} m "
            "(mission.planner.evaluate.finish chooses one for given waypoints)"
        )
    if not low_m <= plan.altitude_m <= high_m:
        raise InfeasiblePlanError(
            f"an altitude of {plan.altitude_m:g} m: must be from {low_m:g} to {high_m:g} m"
        )
    return plan.altitude_m


def _check_airspace(problem: RoundProblem, plan: RoundPlan) -> None:
    space, route = problem.airspace, plan.route_m
    free = space.free(route)
    # From a start that is not free it must first get out; only out of an area across an outline.
    first = int(free.argmax()) if free.any() else len(route) - 1
    wrong = ~space.clear(route[:-1], route[1:])
    wrong[:first] = space.crosses(route[:first], route[1 : first + 1]) & space.outside(
        route[:first]
    )
    crossed = np.flatnonzero(wrong)
    if len(crossed):
        a, b = route[crossed[0]], route[crossed[0] + 1]
        raise InfeasiblePlanError(
            f"the leg from ({a[0]:.1f}, {a[1]:.1f}) to ({b[0]:.1f}, {b[1]:.1f}) leads nearer than "
            f"{space.margin_m:g} m to an area that must not be flown, or to the fence"
        )
