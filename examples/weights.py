"""Other weights than the paper's: who should be served, by age, by weakness, by more or less CoV.

The paper's is data share, CoV psi of the community, lambda if missed. The planner stays the same:

    aerofed sweep apart --set mission.flight=none --strategies cov,examples.weights:sqrt_cov
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerofed import Planner, RoundInfo, RoundProblem, Sortie, StrategyContext

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Weighed:
    """The configured planner on one's own importance."""

    planner: Planner
    importance: Callable[[RoundInfo], Floats]
    fairness: bool = True  # the CoV is worked out
    approach_m: Floats | None = None

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        return Sortie(self.planner.plan(problem))


def _strategy(weight: Callable[[RoundInfo], Floats]) -> Callable[[StrategyContext], Weighed]:
    return lambda context: Weighed(context.planner, weight)


def _missed(info: RoundInfo) -> Floats:
    return np.where(info.age_rounds > 1, 1.5, 1.0)  # lambda, of a device that missed a round


def _weakness(info: RoundInfo) -> Floats:
    return 1.0 - np.nan_to_num(info.accuracy)  # (K,) 1 of a device that was never heard


def _mean_weakness(info: RoundInfo) -> Floats:
    weak, of = info.p * _weakness(info), info.community_of
    return (np.bincount(of, weak) / np.bincount(of, info.p))[of]


def _worst_weakness(info: RoundInfo) -> Floats:
    return np.array([_weakness(info)[info.community_of == c].max() for c in info.community_of])


age = _strategy(lambda info: info.p * info.age_rounds)
age_cov = _strategy(lambda info: info.p * info.cov * info.age_rounds)
sqrt_cov = _strategy(lambda info: info.p * np.sqrt(info.cov) * _missed(info))
cov_squared = _strategy(lambda info: info.p * info.cov**2 * _missed(info))
weak_device = _strategy(lambda info: info.p * _weakness(info) * _missed(info))
weak_task = _strategy(lambda info: info.p * _mean_weakness(info) * _missed(info))
worst_device = _strategy(lambda info: info.p * _worst_weakness(info) * _missed(info))
