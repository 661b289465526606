"""The paper's planner: a greedy walk, then schedule and path in alternation, on q_tilde.

q_tilde is the logistic surrogate of the average PER.
"""

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fl.radio.channel import fit_logistic, smooth_per
from mission.base.arrays import Bools, Floats
from mission.base.errors import SolverError
from mission.planner.evaluate import distances, finish, fit_budget, plan_without_moving
from mission.planner.native.library import assign
from mission.planner.paper.path_step import PathProgram, path_program
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
    problem: RoundProblem, start: Floats, *, program: PathProgram
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
