"""Another objective: serve the devices whose updates are oldest (age of information).

The paper weighs a device by the fairness of its community. Here its weight is its data share
times the rounds since its last update arrived, so that no device is forgotten for long:

    aerofed run quickstart --set mission.strategy=examples.staleness:make
    aerofed sweep quickstart --strategies cov,examples.staleness:make
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerofed import Planner, RoundInfo, RoundProblem, Sortie, StrategyContext

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Staleness:
    """The configured planner, on weights by age of information."""

    planner: Planner
    fairness: bool = False
    approach_m: Floats | None = None  # begin the first round above home

    def importance(self, info: RoundInfo) -> Floats:
        """Data share times age in rounds."""
        return info.p * info.age_rounds

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """The best path and schedule for these weights."""
        return Sortie(self.planner.plan(problem))


def make(context: StrategyContext) -> Staleness:
    """What `mission.strategy` names."""
    return Staleness(context.planner)
