"""A strategy for several aircraft: the devices are divided first, then each plans for its own."""

from dataclasses import dataclass, replace

import numpy as np

from aerofed import Planner, RoundPlan, RoundProblem, Sortie, StrategyContext
from mission.planner.fleet.team import partitions


@dataclass(frozen=True)
class Partition:
    """Plans of the configured planner for the best of the divisions by sectors and clusters."""

    planner: Planner
    fairness: bool = True
    approach_m: None = None

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:  # noqa: ARG002
        """Plan every division, and keep the one whose plans are worth most together."""
        worth = np.asarray(problem.importance, dtype=np.float64)
        starts_m = np.array([start.start_m for start in problem.starts])
        tried = []
        for part in partitions(problem.devices_m, worth, starts_m):
            own = [
                replace(problem, importance=np.where(part == a, worth, 0.0)).alone(a)
                for a in range(len(problem.starts))
            ]
            tried.append(RoundPlan.together([self.planner.plan(each) for each in own]))
        return Sortie(max(tried, key=lambda plan: plan.value))


def make(context: StrategyContext) -> Partition:
    """The strategy with the configured planner."""
    return Partition(context.planner)
