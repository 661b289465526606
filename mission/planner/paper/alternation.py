"""The paper's planner: schedule and path in alternation, on the logistic surrogate q_tilde."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fl.radio.channel import fit_logistic, smooth_per
from mission.base.arrays import Bools, Floats
from mission.planner.errors import SolverError
from mission.planner.evaluate import distances, finish, fit_budget, plan_without_moving
from mission.planner.native.library import assign
from mission.planner.paper.initial_path import METRE_POWERS, greedy_walk
from mission.planner.paper.path_step import PathProgram, path_program
from mission.planner.problem import RoundPlan, RoundProblem

logger = logging.getLogger(__name__)

RISE = 1e-4  # a relative rise of the q_tilde objective under this ends an ascent
MAX_PATH_STEPS = 15  # convex programs in one path step
MAX_ALTERNATIONS = 15

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
