"""A strategy for several aircraft: the configured planner plans one after another, each for the
devices that those before leave."""

from dataclasses import dataclass, replace

import numpy as np

from aerofed import Planner, RoundPlan, RoundProblem, Sortie, StrategyContext


@dataclass(frozen=True)
class InTurn:
    planner: Planner
    fairness: bool = True
    approach_m: None = None

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:  # noqa: ARG002
        plans = []
        for aircraft in range(len(problem.starts)):
            plan = self.planner.plan(problem.alone(aircraft))
            plans.append(plan)
            left = ~plan.schedule.any(axis=(0, 1))
            problem = replace(problem, importance=np.where(left, problem.importance, 0.0))
        return Sortie(plans[0] if len(plans) == 1 else RoundPlan.together(plans))


def make(context: StrategyContext) -> InTurn:
    return InTurn(context.planner)
