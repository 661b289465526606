"""Participation by age: devices volunteer by themselves, with a probability that grows with age.

Alireza Javani, Zhiying Wang: Balancing Client Participation in Federated Learning Using AoI, 2025
(arXiv 2505.05099). Each client decides by the rounds since it was last selected, so that the number
of rounds between two selections, X, varies little, "with minimal central oversight". For n clients
of whom k a round take part E[X] = n/k, and Var[X] is least where X is the whole number below or
above n/k.

What is here, written from its abstract; the full text was not at hand:
- that policy: nobody volunteers under the lower of the two ages, everybody at the upper one, and at
  the lower one with the probability that makes the mean n/k; with it Var[X] = f (1 - f), f the
  fraction of n/k, against (n/k)^2 - n/k where k are drawn at random each round (both derived here,
  and held by the test);
- the trajectory: the configured planner flies for the volunteers, weighted by their data.

What is not: the convergence proof, and the accuracies that the abstract tells ("improves
convergence ... by 7.5 % and up to 20 %" over FedAvg's selection). There a volunteer is heard; here
the radio may lose it. It then stays old, and volunteers again.

    aerofed run --set mission.strategy=examples.papers.markov_age_2505_05099:make
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerofed import Planner, RoundInfo, RoundProblem, Sortie, StrategyContext

Floats = NDArray[np.float64]


def chance(age: NDArray[np.int64], mean: float) -> Floats:
    """Probability (K,) of volunteering at an age in rounds, where a mean number is wanted between.

    X = floor(mean) with probability 1 - f and floor(mean) + 1 with f, the fraction of `mean`.
    """
    lower = math.floor(mean)
    return np.where(age > lower, 1.0, np.where(age == lower, 1.0 - (mean - lower), 0.0))


@dataclass(frozen=True)
class MarkovAge:
    """The configured planner, flying for those who volunteer."""

    planner: Planner
    most: int  # devices that a round can serve
    seed: int
    fairness: bool = False
    approach_m: Floats | None = None

    def importance(self, info: RoundInfo) -> Floats:
        """The data share of those who volunteer, 0 of the others.

        Before the first round ages are spread evenly, as they are in the long run.
        """
        mean = max(1.0, len(info.p) / self.most)
        age = np.where(info.last_heard > 0, info.age_rounds, self._first_age(info, mean))
        drawn = np.random.default_rng((self.seed, info.round)).random(len(age))
        return info.p * (drawn < chance(age, mean))

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """The best path for the volunteers."""
        return Sortie(self.planner.plan(problem))

    def _first_age(self, info: RoundInfo, mean: float) -> NDArray[np.int64]:
        spread = np.random.default_rng((self.seed, 0)).permutation(len(info.p))
        return info.round + (spread * math.ceil(mean)) // len(info.p)


def make(context: StrategyContext) -> MarkovAge:
    """What `mission.strategy` names: at most half of what the slots of a round could serve."""
    mission = context.mission
    most = max(1, mission.steps * mission.devices_per_step // 2)
    return MarkovAge(context.planner, min(most, len(context.devices_m) // 2), context.seed)
