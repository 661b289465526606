"""A strategy for several aircraft: each plans for what those before it leave."""

from dataclasses import dataclass, replace

import numpy as np

from aerofed import Planner, RoundPlan, RoundProblem, Sortie, StrategyContext


@dataclass(frozen=True)
class OneAfterAnother:
    """Plans of the configured planner, one aircraft at a time."""

    planner: Planner
    fairness: bool = True
    approach_m: None = None

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:  # noqa: ARG002
        """Plan each aircraft in the order of its table."""
        plans = []
        for aircraft in range(len(problem.starts)):
            plans.append(self.planner.plan(problem.alone(aircraft)))
            left = ~plans[-1].schedule.any(axis=(0, 1))
            problem = replace(problem, importance=np.where(left, problem.importance, 0.0))
        return Sortie(plans[0] if len(plans) == 1 else RoundPlan.together(plans))


def make(context: StrategyContext) -> OneAfterAnother:
    """The strategy with the configured planner."""
    return OneAfterAnother(context.planner)
