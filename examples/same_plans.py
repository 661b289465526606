"""Rounds that are planned alike whoever flies them: for comparing autopilots, not learning.

Usually a round's plan depends on what was learnt, on who was heard and on where the aircraft came
to rest. Here the weights are drawn by round, and each plan goes on from the planned end of the
one before; only its first point is where the aircraft already is.

    aerofed run --set mission.strategy=examples.same_plans:make
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mission.api import Planner, RoundInfo, RoundProblem, Sortie, StrategyContext, finish

Floats = NDArray[np.float64]

SHORTER_M = 20.0  # than L_max: room for the way from where the aircraft is to the planned start


@dataclass
class SamePlans:
    """The configured planner, on weights and starts that no flight has changed."""

    planner: Planner
    fairness: bool = False
    approach_m: Floats | None = None
    _ends_m: list[Floats] = field(default_factory=list)  # planned, by round

    def importance(self, info: RoundInfo) -> Floats:
        """Data share times a factor from 1 to 3 drawn by round and device."""
        return info.p * np.random.default_rng(info.round).uniform(1.0, 3.0, len(info.p))

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """Plan from where the plan before ended, and fly it from where the aircraft is."""
        start_m = self._ends_m[-1] if round_index else problem.start_m
        budget_m = problem.path_budget_m - SHORTER_M
        plan = self.planner.plan(replace(problem, start_m=start_m, path_budget_m=budget_m))
        self._ends_m.append(plan.waypoints_m[-1])
        waypoints_m = plan.waypoints_m.copy()
        waypoints_m[0] = problem.start_m
        return Sortie(finish(problem, waypoints_m))


def make(context: StrategyContext) -> SamePlans:
    """What `mission.strategy` names."""
    return SamePlans(context.planner)
