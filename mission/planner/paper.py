"""The paper's planner: a greedy walk, then schedule and path in alternation, on q_tilde.

q_tilde is the logistic surrogate of the average PER. A path step is one convex program, compiled
once and reused (the home of cvxpy). With the schedule fixed, device k is served at one step n(k).
Around the present path the program maximises a concave lower bound of sum_k w_k (1 - q_tilde_k):

    1 - 1 / (1 + S),   S = exp(b1 theta + b2) >= its tangent in theta,
    theta = arctan(H / r) >= its tangent in r,   r >= |v[n(k)] - u_k|  (the exact cone).

Both tangents lie below, since exp is convex and arctan(H / r) is convex in r > 0: each solution
is at least as good, in q_tilde, as the path it started from. The printed version replaces the
cone by its tangent, which makes r smaller than the distance and loses that property.
"""

import logging
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import cvxpy as cp
import numpy as np

from fl.radio.channel import LogisticFit, fit_logistic, smooth_per
from mission.base.arrays import Bools, Floats
from mission.base.errors import SolverError
from mission.planner.evaluate import distances, finish, fit_budget, plan_without_moving
from mission.planner.native.library import assign
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem

logger = logging.getLogger(__name__)

RISE = 1e-4  # a relative rise of the q_tilde objective under this ends an ascent
MAX_PATH_STEPS = 15  # convex programs in one path step
MAX_ALTERNATIONS = 15
# What a step of the walk is rated by: worth per metre^power. 0 is the paper's walk; the others
# are the further starts of the alternation.
METRE_POWERS = (0.0, 0.5, 1.0)

logistic = lru_cache(maxsize=64)(fit_logistic)  # of a channel, made once


@dataclass(frozen=True)
class PaperPlanner:
    """The alternation with the exact cone r >= |v - u|: three starts, best true iterate kept.

    `literal` is the alternation as printed, for study: r linearised, one start, the last iterate.
    The linearised r is a relaxation: the ascent is not monotone and may end far below its start.

    No bound is proven: `upper_bound` is NaN where anything had to be decided.
    """

    literal: bool = False

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanInputError: the problem makes no sense.
        """
        if (at_rest := plan_without_moving(problem)) is not None:
            return at_rest
        exact = not self.literal
        program = path_program(problem.steps, len(problem.devices_m), exact_cone=exact)
        smooth = _smooth_success(problem)
        if self.literal:
            start = greedy_walk(problem, smooth)
            *_, (path, _, _) = ascend(problem, start, program=program)
            return finish(problem, path)
        best = finish(problem, np.tile(problem.start_m, (problem.steps, 1)))
        for power in METRE_POWERS:
            start = greedy_walk(problem, smooth, metre_power=power)
            for path, _, _ in ascend(problem, start, program=program):
                candidate = finish(problem, path)
                if candidate.value > best.value:
                    best = candidate
        return best


def ascend(
    problem: RoundProblem, start: Floats, *, program: "PathProgram"
) -> Iterator[tuple[Floats, Bools, float]]:
    """The iterates of the alternation: path (N, 2), schedule (N, K), objective in q_tilde.

    The first is `start` with its schedule. Ends when an alternation no longer raises the
    objective, or when the solver gives up.
    """
    fit = logistic(problem.channel)
    smooth = _smooth_success(problem)

    def rate(path: Floats, schedule: Bools) -> float:
        return float((smooth(distances(problem, path)) * problem.importance)[schedule].sum())

    path = start
    schedule = assign(smooth(distances(problem, path)), problem.importance, problem.per_step)
    value = rate(path, schedule)
    yield path, schedule, value
    for _ in range(MAX_ALTERNATIONS):
        before = value
        for _ in range(MAX_PATH_STEPS):
            inner = value
            try:
                path = program.solve(problem, fit, path, schedule)
            except SolverError as error:
                logger.warning("path step given up: %s", error)
                return
            path = fit_budget(path, problem.path_budget_m)
            value = rate(path, schedule)
            yield path, schedule, value
            if value <= inner * (1.0 + RISE):
                break
        schedule = assign(smooth(distances(problem, path)), problem.importance, problem.per_step)
        value = rate(path, schedule)
        yield path, schedule, value
        if value <= before * (1.0 + RISE):
            return


def _smooth_success(problem: RoundProblem) -> Callable[[Floats], Floats]:
    fit = logistic(problem.channel)
    return lambda r: 1.0 - smooth_per(fit, problem.channel, r)


def greedy_walk(
    problem: RoundProblem, success: Callable[[Floats], Floats], *, metre_power: float = 0.0
) -> Floats:
    """(N, 2) waypoints from v_I over devices, each step going where most is to be won.

    The edge into node j is worth the best total of success x delta over at most K_bar devices
    not served yet; they count as served once the walk has been there. The walk ends when no
    step is left, no node is in reach or none is worth anything; what is left of the N steps
    stays at the last position.

    Args:
        problem: the round.
        success: probability of success as a function of horizontal distance in metres.
        metre_power: 0 rates a step by its worth, 1 by its worth per metre.
    """
    devices = problem.devices_m
    between = np.hypot(*(devices[:, None, :] - devices[None, :, :]).transpose(2, 0, 1))
    worth = success(between) * problem.importance  # (node, device)
    served = np.zeros(len(devices), dtype=np.bool_)
    waypoints = np.tile(problem.start_m, (problem.steps, 1))
    position, budget = problem.start_m, problem.path_budget_m
    take = min(problem.per_step, len(devices))
    for n in range(1, problem.steps):
        open_worth = np.where(served, 0.0, worth)
        best = np.sort(open_worth, axis=1)[:, len(devices) - take :].sum(axis=1)
        metres = np.hypot(*(devices - position).T)
        rating = np.where(metres <= budget, best / np.maximum(metres, 1.0) ** metre_power, -1.0)
        node = int(np.argmax(rating))
        if rating[node] <= 0.0:
            waypoints[n:] = position
            break
        served[np.argsort(-open_worth[node], kind="stable")[:take]] = True
        position, budget = devices[node], budget - metres[node]
        waypoints[n] = position
    return waypoints


# Beyond +-8 in the exponent q_tilde is within 3.4e-4 of 0 or 1. Taking the tangent at the limit
# instead keeps it a lower bound and the program well scaled.
EXPONENT_LIMIT = 8.0


class PathProgram:
    """Convex program (CVXPY) of a path step for one size (N, K); the rest are its parameters.

    Raises:
        cvxpy.error.DPPError: the program is not disciplined in its parameters, so that every
            solve would compile it anew.
    """

    def __init__(self, steps: int, devices: int, *, exact_cone: bool) -> None:
        self._exact_cone = exact_cone
        self._path = cp.Variable((steps, 2))
        distance = cp.Variable(devices, nonneg=True)
        plus_one = cp.Variable(devices)  # 1 + S
        loss = cp.Variable(devices)  # 1 / (1 + S)
        self._serves = cp.Parameter((devices, steps))
        self._serves_device = cp.Parameter((devices, 2))
        self._weight = cp.Parameter(devices, nonneg=True)
        self._intercept = cp.Parameter(devices)
        self._slope = cp.Parameter(devices, nonneg=True)
        self._start = cp.Parameter(2)
        self._budget = cp.Parameter(nonneg=True)
        offset = self._serves @ self._path - self._serves_device
        constraints = [
            self._path[0] == self._start,
            cp.sum(cp.norm(self._path[1:] - self._path[:-1], axis=1)) <= self._budget,
            plus_one <= self._intercept - cp.multiply(self._slope, distance),
            loss >= cp.inv_pos(plus_one),
        ]
        if exact_cone:
            constraints.append(distance >= cp.norm(offset, axis=1))
        else:
            self._direction_serves = [cp.Parameter((devices, steps)) for _ in range(2)]
            self._direction_device = cp.Parameter(devices)
            along = sum(self._direction_serves[i] @ self._path[:, i] for i in range(2))
            constraints.append(distance >= along - self._direction_device)
        self._problem = cp.Problem(cp.Minimize(self._weight @ loss), constraints)
        if not self._problem.is_dcp(dpp=True):
            raise cp.error.DPPError("the path program is not disciplined in its parameters")

    def solve(
        self, problem: RoundProblem, fit: LogisticFit, waypoints_m: Floats, schedule: Bools
    ) -> Floats:
        """(N, 2) the best path of the program built around `waypoints_m`.

        Raises:
            SolverError: no solution.
        """
        step_of = schedule.argmax(axis=0)
        serves = np.zeros((len(problem.devices_m), problem.steps))
        serves[np.arange(len(step_of)), step_of] = 1.0
        offset = waypoints_m[step_of] - problem.devices_m
        around = np.hypot(offset[:, 0], offset[:, 1])
        self._serves.value = serves
        self._serves_device.value = problem.devices_m
        weight = np.where(schedule.any(axis=0), problem.importance, 0.0)
        self._weight.value = weight / max(float(weight.max(initial=0.0)), 1e-300)
        self._intercept.value, self._slope.value = tangent(
            fit, around, height_m=problem.channel.altitude_m
        )
        self._start.value = problem.start_m
        self._budget.value = problem.path_budget_m
        if not self._exact_cone:
            # Right overhead the printed gradient is undefined; 0 leaves r free there.
            direction = offset / np.where(around > 0.0, around, 1.0)[:, None]
            for i in range(2):
                self._direction_serves[i].value = serves * direction[:, i, None]
            self._direction_device.value = (direction * problem.devices_m).sum(axis=1)
        with warnings.catch_warnings():
            # "Solution may be inaccurate": the caller evaluates every path by itself.
            warnings.simplefilter("ignore", UserWarning)
            try:
                # A warm solver keeps the scaling of the data it met first, and the plan would
                # depend on what was planned before.
                self._problem.solve(solver=cp.CLARABEL, enforce_dpp=True, warm_start=False)
            except cp.error.SolverError as error:
                raise SolverError("clarabel", str(error)) from error
        if self._problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
            raise SolverError("clarabel", self._problem.status)
        path = np.array(self._path.value)
        path[0] = problem.start_m
        return path


path_program = lru_cache(maxsize=16)(PathProgram)  # of a size, for all rounds and planners


def tangent(fit: LogisticFit, around_m: Floats, *, height_m: float) -> tuple[Floats, Floats]:
    """(intercept, slope) of the lower bound 1 + S >= intercept - slope r, for each distance."""
    b1 = max(fit.b1_per_rad, 1e-9)
    theta = np.arctan2(height_m, around_m)
    theta_at = np.clip(theta, (-EXPONENT_LIMIT - fit.b2) / b1, (EXPONENT_LIMIT - fit.b2) / b1)
    s = np.exp(b1 * theta_at + fit.b2)
    # theta >= theta - H / (H^2 + around^2) (r - around)
    falls = height_m / (height_m**2 + around_m**2)
    slope = s * b1 * falls
    return 1.0 + s * (1.0 + b1 * (theta - theta_at)) + slope * around_m, slope
