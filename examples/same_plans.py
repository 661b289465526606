"""Rounds that are planned alike whoever flies them: for comparing autopilots, not learning.

Usually a round's plan depends on what was learnt, on who was heard and on where the aircraft came
to rest. Here the weights are drawn by round, the first plan begins above home, and each goes on
from the planned end of the one before; only its first point is where the aircraft already is.

    aerofed run --set mission.strategy=examples.same_plans:make
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from aerofed import Planner, RoundInfo, RoundProblem, Sortie, StrategyContext, finish

Floats = NDArray[np.float64]

SHORTER_M = 20.0  # than L_max: room for the way from where the aircraft is to the planned start


@dataclass(frozen=True)
class SamePlans:
    """The configured planner, on weights and starts that no flight has changed."""

    planner: Planner
    home_m: Floats
    fairness: bool = False
    approach_m: Floats | None = None

    def importance(self, info: RoundInfo) -> Floats:
        """Data share times a factor from 1 to 3 drawn by round and device."""
        return info.p * _factors(info.round, len(info.p))

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """Plan from where the plan before ended, and fly it from where the aircraft is."""
        p = problem.importance / _factors(round_index + 1, len(problem.importance))
        budget_m, waypoints_m = problem.path_budget_m - SHORTER_M, self.home_m[None]
        # A resumed run asks for later rounds alone: those before are planned again.
        for number in range(1, round_index + 2):
            weights = p * _factors(number, len(p))
            moved = problem.with_own(start_m=waypoints_m[-1], path_budget_m=budget_m)
            same = replace(moved, importance=weights)
            waypoints_m = self.planner.plan(same).waypoints_m
        return Sortie(finish(problem, np.vstack((problem.start_m, waypoints_m[1:]))))


def _factors(number: int, devices: int) -> Floats:
    return np.random.default_rng(number).uniform(1.0, 3.0, devices)


def make(context: StrategyContext) -> SamePlans:
    """What `mission.strategy` names."""
    return SamePlans(context.planner, np.array(context.area.home_m))
