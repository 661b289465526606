"""FedBuff: stale updates wait in a buffer, and move the model when it is full.

Nguyen et al.: Federated Learning with Buffered Asynchronous Aggregation, AISTATS 2022 (arXiv
2106.06639). A device trains from the model that it got when it was last heard, tau versions old by
now; its step weighs 1 / sqrt(1 + tau). Every BUFFER arrivals their mean moves the model.

    aerofed run --set learning.algorithm=examples.fedbuff:make
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerofed import LearningConfig, Update

Floats = NDArray[np.float32]
State = dict[str, Floats]
BUFFER = 4  # K of the paper


@dataclass(frozen=True)
class FedBuff:
    """The state: what each device holds and its version, the buffer, and how full it is."""

    momentum: float
    server_rate: float
    mu: float = 0.0

    def init(self, model: Floats, devices: int) -> State:
        state = {"held": np.tile(model, (devices, 1)), "born": np.zeros(devices)}
        return state | {"version": np.zeros(1), "buffer": 0.0 * model, "filled": np.zeros(1)}

    def correction(self, state: State, device: int) -> Floats | None:
        return None

    def start(self, state: State, model: Floats, device: int) -> Floats:
        """Stale participation: not the newest model, but the one that the device holds."""
        return state["held"][device]

    def apply(self, state: State, model: Floats, updates: Sequence[Update]) -> tuple[Floats, State]:
        after = {key: value.copy() for key, value in state.items()}
        for update in updates:
            age = after["version"][0] - state["born"][update.device]
            after["buffer"] += (update.model - state["held"][update.device]) / np.sqrt(1.0 + age)
            after["filled"] += 1.0
            if after["filled"][0] == BUFFER:
                model = model + self.server_rate * after["buffer"] / BUFFER
                after["version"] += 1.0
                after["buffer"][:] = after["filled"][:] = 0.0
        heard = [update.device for update in updates]  # they take the newest model down
        after["held"][heard], after["born"][heard] = model, after["version"][0]
        return model, after


def make(learning: LearningConfig) -> FedBuff:
    """What `learning.algorithm` names."""
    return FedBuff(learning.momentum, learning.server_learning_rate or 1.0)
