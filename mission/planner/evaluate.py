"""The true objective of a plan, and the checks of a problem.

Everything here uses the exact average PER, so that plans of all methods are comparable.
"""

import math
from dataclasses import replace
from itertools import pairwise
from numbers import Integral, Real

import numpy as np
from numpy.typing import ArrayLike

from fl.radio.channel import Channel, average_per
from mission.base.arrays import Bools, Floats, Ints
from mission.base.errors import PlanInputError
from mission.base.explain import shown
from mission.planner.native.library import HOPE
from mission.planner.native.rounds import CandidatePlan
from mission.planner.plan import BoundError, PlannedPath, RoundPlan, as_waypoints
from mission.planner.problem import MOST_COUNT, RoundProblem, Start

ALTITUDES = 17  # that are looked at together
FINE_STEP_M = 0.5  # of altitudes, where the path is a point
ALTITUDE_STEP_M, ALTITUDE_DIGITS = 0.1, 1
# Success at a distance is tabled to this share (`mission.planner.reward`).
TABLED = 1e-4
LENGTH_TOLERANCE_M = 1e-3  # of a plan's length, and of where it starts
_MOST_IMPORTANCE = 1e307  # in all, so that no sum and no bound of it overflows


def distances(problem: RoundProblem, waypoints_m: Floats) -> Floats:
    """(N, K) horizontal distances |u_k - v[n]| in metres."""
    offset = waypoints_m[:, None, :] - problem.devices_m[None, :, :]
    return np.asarray(np.hypot(offset[..., 0], offset[..., 1]), dtype=np.float64)


def success(problem: RoundProblem, waypoints_m: Floats) -> Floats:
    """(N, K) probabilities 1 - q_bar_k[n] at the given (N, 2) waypoints."""
    shape = len(waypoints_m), len(problem.devices_m)
    steps, devices = (at.ravel() for at in np.indices(shape))
    return 1.0 - _per(problem, devices, waypoints_m[steps]).reshape(shape)


def _per(problem: RoundProblem, devices: Ints, places_m: Floats) -> Floats:
    heights_m = np.full(len(places_m), problem.channel.altitude_m)
    return np.asarray(problem.radio.per(devices, np.column_stack((places_m, heights_m))))


def objective(problem: RoundProblem, waypoints_m: Floats, schedule: Bools) -> float:
    """sum_n sum_k omega_k[n] (1 - q_bar_k[n]) delta_k."""
    steps, devices = np.nonzero(schedule)
    per = _per(problem, devices, waypoints_m[steps])
    return float(((1.0 - per) * problem.importance[devices]).sum())


def in_time(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> Bools:
    """(A, N, K) whether each device has an update to send at the earliest start of each step."""
    ready_in_s = problem.ready_in_s
    if ready_in_s is None:
        return np.ones(plan.schedule.shape, dtype=np.bool_)
    begins_s = [
        problem.alone(a).judged_with(hold_s=hold_s).judged(plan.alone(a).as_candidate).begins_s
        for a in range(len(plan.paths))
    ]
    return np.asarray(np.array(begins_s)[..., None] >= ready_in_s)


def path_length(waypoints_m: Floats) -> float:
    """Length in metres of the polyline through (N, 2) waypoints."""
    step = np.diff(waypoints_m, axis=0)
    return float(np.hypot(step[:, 0], step[:, 1]).sum())


def fit_budget(waypoints_m: ArrayLike, path_budget_m: float) -> Floats:
    """The waypoints, shrunk about the first one if the path is longer than the budget.

    Raises:
        PlanInputError: the waypoints are no array (N, 2) of finite numbers, or the budget is no
            number of 0 or more.
    """
    waypoints = as_waypoints(waypoints_m)
    _check_finite("waypoints_m", waypoints)
    if not (isinstance(path_budget_m, Real) and path_budget_m >= 0.0):
        raise PlanInputError(
            f"path_budget_m = {shown(path_budget_m)}: must be a number of metres, 0 or more"
        )
    length = path_length(waypoints)
    if length <= path_budget_m:
        return waypoints
    start = waypoints[0]
    # One part in 1e12 keeps rounding from putting the path over the budget again.
    return np.asarray(start + (waypoints - start) * (path_budget_m / length * (1.0 - 1e-12)))


def finish(
    problem: RoundProblem,
    waypoints_m: ArrayLike,
    *,
    upper_bound: float = float("nan"),
    nodes: int = 0,
    hold_s: float = 0.0,
) -> RoundPlan:
    """Return the plan along given waypoints, with its optimal schedule and true objective, at the
    best altitude it finds where `problem.altitudes_m` leaves a choice.

    Among areas, waypoints are moved to allowed places and the path leads around; what exceeds
    the budget is cut off. `hold_s` is the hover in seconds at every stop (`stops_of`), in which
    devices get ready.

    Raises:
        PlanInputError: as `check_problem`; or the waypoints are no array (steps, 2) of finite
            numbers, begin elsewhere than at the problem's start, or are a longer path than its
            budget (see `fit_budget`).
    """
    check_problem(problem)
    given = as_waypoints(waypoints_m, problem.steps)
    _check_finite("waypoints_m", given)
    _check_path(problem, given)
    plan = plan_along(problem, given, hold_s=hold_s)
    return replace(plan, upper_bound=upper_bound, nodes=nodes)


def plan_along(problem: RoundProblem, waypoints_m: Floats, *, hold_s: float = 0.0) -> RoundPlan:
    """Return the plan of `finish` along waypoints (N, 2), without its checks; no bound."""
    if problem.altitudes_m is None:
        return scheduled(problem, waypoints_m, hold_s=hold_s)
    # As many altitudes over all of them, then about the best one, ever nearer to it.
    low_m, high_m = problem.altitudes_m
    best_m, reach_m = (low_m + high_m) / 2.0, (high_m - low_m) / 2.0
    tried = dict[float, RoundPlan]()
    while reach_m > ALTITUDE_STEP_M or not tried:
        around = np.linspace(best_m - reach_m, best_m + reach_m, ALTITUDES)
        for height_m in np.clip(np.round(around, ALTITUDE_DIGITS), low_m, high_m).tolist():
            if height_m not in tried:
                tried[height_m] = scheduled(problem.at(height_m), waypoints_m, hold_s=hold_s)
        best_m = max(tried, key=lambda height_m: tried[height_m].value)
        reach_m /= (ALTITUDES - 1) / 2.0
    return tried[best_m].with_own(altitude_m=best_m)


def _check_finite(name: str, values: Floats) -> None:
    for at in np.argwhere(~np.isfinite(values)).tolist():
        where = "".join(f"[{i}]" for i in at)
        raise PlanInputError(f"{name}{where} = {values[tuple(at)]}: must be a finite number")


def _check_path(problem: RoundProblem, waypoints_m: Floats) -> None:
    """Refuse waypoints away from the start or, in open airspace, a path beyond its budget."""
    away_m = float(np.hypot(*(waypoints_m[0] - problem.start_m)))
    if away_m > LENGTH_TOLERANCE_M:
        raise PlanInputError(
            f"waypoints_m[0] = {waypoints_m[0].tolist()}: lies {away_m:.4g} m from the problem's "
            f"start_m, {problem.start_m.tolist()}, where it must be"
        )
    length_m, most_m = path_length(waypoints_m), problem.path_budget_m
    # Among areas the path is cut where the budget ends.
    if problem.airspace.is_open and length_m > most_m + LENGTH_TOLERANCE_M:
        raise PlanInputError(
            f"waypoints_m: the path is {length_m:.6g} m long, path_budget_m is {most_m:g}; "
            "fit_budget(waypoints_m, problem.path_budget_m) shrinks it"
        )


def bounded(problem: RoundProblem, plan: RoundPlan, bound: float, nodes: int) -> RoundPlan:
    """Return the plan with `bound` as upper bound, or its own value if up to `TABLED` above that.

    Raises:
        BoundError: it exceeds the bound by more.
    """
    if plan.value > bound * (1.0 + TABLED):  # not where no bound is proven: NaN
        raise BoundError(problem, plan, bound)
    if not plan.value and _nobody_in_reach(problem):
        bound = 0.0
    return replace(plan, upper_bound=max(bound, plan.value), nodes=nodes)


def _nobody_in_reach(problem: RoundProblem) -> bool:
    """Whether nobody is heard as often as it takes to be asked from any place in reach: there is
    nothing to collect."""
    if problem.ready_in_s is not None and problem.upload_s is not None:
        return False  # while one without hope sends, others get ready
    worth = problem.importance > 0.0
    for one in map(problem.alone, range(len(problem.starts))):
        away_m = np.hypot(*(one.devices_m - one.start_m).T)
        chances = success_bounds(one, np.maximum(away_m - one.most_m, 0.0))
        if not (chances[:, worth] < HOPE).all():
            return False
    return True


def scheduled(problem: RoundProblem, waypoints_m: Floats, *, hold_s: float = 0.0) -> RoundPlan:
    """Return the plan along waypoints (N, 2) at the channel's altitude, with the best schedule.

    No device is waited for except by hovers. Among areas the path is cut where the budget ends."""
    round_ = problem.judged_with(hold_s=hold_s) if hold_s else problem.as_judged
    metres = math.inf if problem.airspace.is_open else problem.path_budget_m
    candidate = round_.fitted(waypoints_m, metres, above=-math.inf, limited=False)
    assert candidate is not None
    return planned(problem, candidate)


def planned(problem: RoundProblem, candidate: CandidatePlan) -> RoundPlan:
    """Convert a plan of the C library to a `RoundPlan`; makes its arrays read-only."""
    route, at, schedule, value, wait_s = candidate
    for array in (route, schedule):
        array.flags.writeable = False
    if problem.airspace.is_open:
        return RoundPlan((PlannedPath(route, wait_s=wait_s),), schedule[None], value)
    via = tuple(route[before + 1 : here] for before, here in pairwise(at.tolist()))
    return RoundPlan((PlannedPath(route[at], via, wait_s=wait_s),), schedule[None], value)


def plan_without_moving(problem: RoundProblem) -> RoundPlan | None:
    """Return the optimal plan of a problem in which moving gains nothing, else None.

    That is one step, no path budget, no device, or no importance: all steps are served from the
    start. Raises as `check_problem`.
    """
    check_problem(problem)
    if (
        problem.steps > 1
        and problem.path_budget_m > 0.0
        and problem.importance.size > 0
        and problem.importance.max() > 0.0
    ):
        return None
    plan = plan_along(problem, np.tile(problem.start_m, (problem.steps, 1)))
    return bounded(problem, plan, max(plan.value, _bound_at_rest(problem)), 0)


def success_bounds(problem: RoundProblem, far_m: Floats) -> Floats:
    """(H, K) upper bounds on success 1 - q_bar at distances `far_m` (K,) in metres.

    Each row is for a part of the open altitudes: between samples f lies above their chord by
    |f''| h^2 / 8 at most, twice that for safety. With a PER grid it is the best in reach.
    """
    if problem.per_grid is not None:  # from wherever a path leads
        return problem.per_grid.best_within(problem.start_m, problem.path_budget_m)[None]
    if problem.altitudes_m is None:
        return 1.0 - average_per(problem.channel, far_m)[None]
    low_m, high_m = problem.altitudes_m
    heights = np.linspace(low_m, high_m, 2 + math.ceil((high_m - low_m) / FINE_STEP_M))
    f = 1.0 - average_per(problem.channel, far_m[None], height_m=heights[:, None])
    return np.asarray(f + np.abs(np.diff(f, 2, axis=0)).max(axis=0) / 4.0)


def _bound_at_rest(problem: RoundProblem) -> float:
    """Return an upper bound on the value of serving from the start, whoever is without
    hope included, at any open altitude."""
    if problem.altitudes_m is None:
        bounds = success(problem, problem.start_m[None])
    else:
        bounds = success_bounds(problem, np.hypot(*(problem.devices_m - problem.start_m).T))
    most = bounds * problem.importance
    places = problem.steps * problem.per_step
    return float(np.sort(most, axis=1)[:, ::-1][:, :places].sum(axis=1).max())


def check_problem(problem: RoundProblem) -> None:
    """Refuse a problem that makes no sense.

    Raises:
        PlanInputError: wrong types or shapes, NaN or infinity, negative importance or budget, no
            step.
    """
    if not isinstance(problem, RoundProblem):
        raise PlanInputError(
            f"problem = {shown(problem)}: must be a RoundProblem, such as first_problem() gives"
        )
    is_channel = isinstance(problem.channel, Channel)
    _must(is_channel, "channel", problem.channel, 'a Channel, such as aerofed.channel("urban")')
    for name, count in (("steps", problem.steps), ("per_step", problem.per_step)):
        _must(isinstance(count, Integral), name, count, "a whole number of 1 or more")
    devices = problem.devices_m
    if devices.ndim != 2 or devices.shape[1] != 2:
        raise PlanInputError(
            f"devices has shape {devices.shape}: must be (K, 2), x and y in metres"
        )
    names = ("importance", "upload_s", "ready_in_s")
    given = {name: values for name in names if (values := getattr(problem, name)) is not None}
    for name, values in given.items():
        if values.shape != (len(devices),):
            raise PlanInputError(
                f"{name} has shape {values.shape}: must be ({len(devices)},), one value a device"
            )
    for name, values in (("devices", devices), *given.items()):
        _check_finite(name, values)
    for name, values in given.items():
        for k in np.flatnonzero(values < 0.0).tolist():
            raise PlanInputError(f"{name}[{k}] = {values[k]}: must be 0 or more")
    for number, start in enumerate(problem.starts):
        _check_start(start, f"starts[{number}]." if len(problem.starts) > 1 else "")
        if problem.ready_in_s is not None and start.limits is None:
            raise PlanInputError(
                "ready_in_s needs limits, whose performance says how fast is flown"
            )
        if problem.separation_m and start.limits is None:
            raise PlanInputError(
                "separation_m needs limits of each, whose performance says how fast is flown"
            )
    for name, unit in (("separation_m", "metres"), ("late_s", "seconds")):
        value = getattr(problem, name)
        right = isinstance(value, Real) and 0.0 <= float(value) < math.inf
        _must(right, name, value, f"a number of {unit}, 0 or more")
    for name, count in (("steps", problem.steps), ("per_step", problem.per_step)):
        if not 1 <= count <= MOST_COUNT:
            raise PlanInputError(
                f"{name} = {count}: must be a whole number of 1 or more, {MOST_COUNT} at most"
            )
    with np.errstate(over="ignore"):
        total = float(problem.importance.sum())
    if total > _MOST_IMPORTANCE:
        raise PlanInputError(f"importance sums to {total:g}: {_MOST_IMPORTANCE:g} at most")


def _check_start(start: Start, of: str) -> None:
    """Refuse the start of an aircraft, whose fields are named after `of`."""
    most_m, heights = start.path_budget_m, start.altitudes_m
    _must(isinstance(most_m, Real), f"{of}path_budget_m", most_m, "a number of metres")
    listed = heights if isinstance(heights, tuple | list) else ()
    two = heights is None or [isinstance(height, Real) for height in listed] == [True, True]
    words = "two heights in metres, the lower first, or None"
    _must(two, f"{of}altitudes_m", heights, words)
    height = start.altitude_m
    one = height is None or (isinstance(height, Real) and heights is None and height > 0.0)
    words = "a height in metres above 0, or None; and None where altitudes_m are given"
    _must(one, f"{of}altitude_m", height, words)
    if start.start_m.shape != (2,):
        raise PlanInputError(f"{of}start has shape {start.start_m.shape}: must be (2,), x and y")
    for name, values in (
        ("start", start.start_m),
        ("path_budget_m", np.asarray(most_m)),
        ("altitudes_m", np.asarray(heights or (height or 1.0,))),
    ):
        _check_finite(f"{of}{name}", values)
    if heights is not None and not 0.0 < heights[0] < heights[1]:
        raise PlanInputError(
            f"{of}altitudes_m = {list(heights)}: must be two heights above 0, the lower first"
        )
    if most_m < 0.0:
        raise PlanInputError(f"{of}path_budget_m = {most_m}: must be 0 or more")


def _must(right: bool, name: str, value: object, words: str) -> None:
    if not right:
        raise PlanInputError(f"{name} = {shown(value)}: must be {words}")
