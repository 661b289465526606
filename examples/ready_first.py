"""Weigh devices by whether they will be ready: nobody is flown to who still trains.

A device counts its data share, times the rounds since it was last heard, times the part of the
round that is left once it is ready. A twentieth is left to everybody: where nobody counted, the
round would not be flown, no time would pass, and nobody would become ready.

    aerofed run --set mission.strategy=examples.ready_first:make 'communities.0.compute_s=[5, 60]'
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerofed import Planner, RoundInfo, RoundProblem, Sortie, StrategyContext

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ReadyFirst:
    """The configured planner, on weights by age and readiness."""

    planner: Planner
    round_s: float  # how long a round flies
    fairness: bool = False
    approach_m: Floats | None = None

    def importance(self, info: RoundInfo) -> Floats:
        """Data share times age times the part of the round in which the device is ready."""
        left = np.clip(1.0 - info.ready_in_s / self.round_s, 0.05, 1.0)
        return info.p * info.age_rounds * left

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """The best path and schedule for these weights."""
        return Sortie(self.planner.plan(problem))


def make(context: StrategyContext) -> ReadyFirst:
    """What `mission.strategy` names."""
    mission = context.mission
    return ReadyFirst(context.planner, mission.path_budget_m / mission.speed_mps)
