"""FedNova: updates normalised by the work behind them, so that long training weighs no more.

Wang, Liu, Liang, Joshi, Poor: Tackling the Objective Inconsistency Problem in Heterogeneous
Federated Optimization, NeurIPS 2020 (arXiv 2007.07481), for local SGD with momentum rho, where
tau steps accumulate |a|_1 = [tau - rho (1 - rho^tau) / (1 - rho)] / (1 - rho):

    theta' = theta + (sum p_k |a_k|_1) sum p_k (theta_k - theta) / |a_k|_1, p_k over the arrivals

    aerofed run --set learning.algorithm=examples.fednova:make
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aerofed import LearningConfig, Update

Vector = NDArray[np.float32]
State = Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class FedNova:
    """Keeps no state; devices train as in FedAvg."""

    momentum: float
    mu: float = 0.0

    def init(self, model: Vector, devices: int) -> State:
        return {}

    def correction(self, state: State, device: int) -> Vector | None:
        return None

    def apply(
        self, state: State, model: Vector, updates: Sequence[Update]
    ) -> tuple[NDArray[Any], State]:
        """Partial participation: shares count among those that arrived."""
        p = np.array([update.p for update in updates]) / sum(update.p for update in updates)
        work = np.array([self.work(update.steps) for update in updates])
        moves = np.stack([update.model.astype(np.float64) - model for update in updates])
        return model + (p @ work) * ((p / work) @ moves), state

    def work(self, steps: int) -> float:
        """|a|_1 of so many steps: `steps` without momentum."""
        rho = self.momentum
        return (steps - rho * (1.0 - rho**steps) / (1.0 - rho)) / (1.0 - rho)


def make(learning: LearningConfig) -> FedNova:
    """What `learning.algorithm` names."""
    return FedNova(learning.momentum)
