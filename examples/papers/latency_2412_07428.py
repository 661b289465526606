"""Rounds that are over soon: the trajectory of least latency, and a ring as its baseline.

Xuhui Zhang, Wenchao Liu, Jinke Ren, Huijun Xing, Gui Gui, Yanyan Shen, Shuguang Cui: Latency
Minimization for UAV-Enabled Federated Learning: Trajectory Design and Resource Allocation, 2024
(arXiv 2412.07428). The paper minimises the latency of training over bandwidth, computing
frequencies, transmit power and the UAV's trajectory, where convergence says how many rounds are
needed.

What is here, written from its abstract; the full text was not at hand:
- the trajectory: the shortest round, flown at the configured speed, that reaches `SHARE` of what
  the longest one would be worth, by the planner's objective (importance of those who arrive);
- the number of rounds: those of the configuration; SHARE trades longer rounds for fewer;
- a ring (`make_ring`): a fixed circle around the centre of the area, an arc of L_max a round, in
  which the path knows nothing of the devices. It is our baseline; the paper's were not at hand.

What is not: bandwidth, frequencies and power, which the radio and the clock of a round do not have
here (a packet takes no time, and training happens while time stands still); so the published gain
("up to 15.29 %" of latency) is no figure that this can reproduce.

    aerofed sweep configs/quickstart.toml --strategies \
        cov,examples.papers.latency_2412_07428:make,examples.papers.latency_2412_07428:make_ring
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerofed import Planner, RoundProblem, Sortie, StrategyContext, finish, fit_budget

Floats = NDArray[np.float64]

SHARE = 0.9  # of what the longest round would be worth
HALVINGS = 6  # of the path budget: to 2 % of it
RADIUS = 0.3  # of the ring, as a fraction of the area's shorter side


@dataclass(frozen=True)
class LeastLatency:
    """The shortest plan that is worth enough."""

    planner: Planner
    fairness: bool = True
    approach_m: Floats | None = None

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """Halve the budget between too short and long enough."""
        best = self.planner.plan(problem)
        target = SHARE * best.value
        low_m, high_m = 0.0, best.path_m
        for _ in range(HALVINGS):
            middle_m = 0.5 * (low_m + high_m)
            plan = self.planner.plan(problem.with_own(path_budget_m=middle_m))
            if plan.value >= target:
                best, high_m = plan, middle_m
            else:
                low_m = middle_m
        return Sortie(best)


@dataclass(frozen=True)
class Ring:
    """A circle at constant speed; whoever is best heard from its steps is served."""

    centre_m: Floats
    radius_m: float
    length_m: float  # of the arc that a round flies
    fairness: bool = True

    @property
    def approach_m(self) -> Floats:
        """East of the centre."""
        return self.centre_m + np.array([self.radius_m, 0.0])

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """The next arc, its steps spread evenly over it."""
        length_m = min(self.length_m, problem.path_budget_m)
        along_m = round_index * self.length_m + np.linspace(0.0, length_m, problem.steps)
        angle = along_m / self.radius_m
        path = self.centre_m + self.radius_m * np.column_stack((np.cos(angle), np.sin(angle)))
        path[0] = problem.start_m  # on the ring but for the error of flight
        return Sortie(finish(problem, fit_budget(path, problem.path_budget_m)))


def make(context: StrategyContext) -> LeastLatency:
    """What `mission.strategy` names."""
    return LeastLatency(context.planner)


def make_ring(context: StrategyContext) -> Ring:
    """The baseline."""
    size_m = np.array(context.area.size_m)
    return Ring(0.5 * size_m, RADIUS * float(size_m.min()), context.mission.path_budget_m)
