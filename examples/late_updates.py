"""Stale updates weigh less: FedProx for devices that send what they made of an older model.

With learning.late = "stale" a device that still trains when the aircraft comes goes on, and sends
in a later round. What arrives is its step from the model that it began with, tau rounds old; it
counts 1 / sqrt(1 + tau) of a new one, as in FedBuff (Nguyen et al., AISTATS 2022, arXiv
2106.06639). Where nobody is late this is FedProx.

    aerofed run --set learning.algorithm=examples.late_updates:make learning.late=stale \
        'communities.0.compute_s=[5, 120]'
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerofed import LearningConfig, Update

Floats = NDArray[np.float32]
State = dict[str, Floats]


@dataclass(frozen=True)
class LateUpdates:
    """Keeps no state: an update tells what it began with, and how old that is."""

    momentum: float
    mu: float

    def init(self, model: Floats, devices: int) -> State:
        return {}

    def correction(self, state: State, device: int) -> Floats | None:
        return None

    def apply(self, state: State, model: Floats, updates: Sequence[Update]) -> tuple[Floats, State]:
        step = np.zeros(model.size)
        for update in updates:
            weight = update.p / np.sqrt(1.0 + update.staleness)
            step += weight * (update.model.astype(np.float64) - update.start)
        return (model + step / sum(update.p for update in updates)).astype(np.float32), state


def make(learning: LearningConfig) -> LateUpdates:
    """What `learning.algorithm` names."""
    return LateUpdates(learning.momentum, learning.mu)
