"""A strategy that also asks devices which cannot be ready: whom the planner leaves out is late."""

from dataclasses import dataclass, replace

import numpy as np

from aerofed import Planner, RoundInfo, RoundProblem, Sortie, StrategyContext


@dataclass(frozen=True)
class Gamble:
    """The configured planner's path, and the slowest device on top, at its first step."""

    planner: Planner
    fairness: bool = False
    approach_m: None = None

    def importance(self, info: RoundInfo) -> np.ndarray:
        return info.p * info.age_rounds

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:  # noqa: ARG002
        plan = self.planner.plan(problem)
        if problem.ready_in_s is not None and plan.schedule[0, 0].sum() < problem.per_step:
            left_out_s = np.where(plan.schedule.any(axis=(0, 1)), 0.0, problem.ready_in_s)
            if left_out_s.any():
                schedule = plan.schedule.copy()
                schedule[0, 0, left_out_s.argmax()] = True
                plan = replace(plan, schedule=schedule)
        return Sortie(plan)


def make(context: StrategyContext) -> Gamble:
    return Gamble(context.planner)
