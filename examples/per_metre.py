"""A weight per metre: the paper's importance over the way that it takes to come to a device.

Where a run ends with its metres, whoever is near leaves more of them for other rounds:

    aerofed sweep apart --set mission.flight=none --strategies cov,examples.per_metre:per_metre
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from aerofed import Planner, RoundProblem, Sortie, StrategyContext, finish


@dataclass(frozen=True)
class PerMetre:
    """Plans with importance halved for who is one leg away from where the round begins."""

    planner: Planner
    fairness: bool = True
    approach_m: NDArray[np.float64] | None = None

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """The path that the planner finds for these weights, whoever is served along it."""
        away_m = np.hypot(*(problem.devices_m - problem.start_m).T)
        leg_m = problem.path_budget_m / problem.steps
        weighed = replace(problem, importance=problem.importance / (1.0 + away_m / leg_m))
        return Sortie(finish(problem, self.planner.plan(weighed).waypoints_m))


def per_metre(context: StrategyContext) -> PerMetre:
    """The strategy."""
    return PerMetre(context.planner)
