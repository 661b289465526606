"""A strategy of Flower as the algorithm here: FedAdam, FedYogi, Krum, your own, ...

Flower's strategy aggregates what the radio let through. The UAV decides whom a round serves, so
the strategy's sampling of clients is not used; devices train as they always do here, with `mu` in
the place of FedProx's proximal_mu. A model is one flat array. What a strategy keeps from round to
round (moments, momentum) goes into the checkpoint, so that a run can be resumed.

    pip install '.[flower]'    # in the clone
    aerofed run --set learning.algorithm=examples.flower:make
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from flwr.common import Code, FitRes, Parameters, Status, ndarrays_to_parameters
from flwr.common import parameters_to_ndarrays as ndarrays
from flwr.server.strategy import FedAdam, Strategy
from numpy.typing import NDArray

from aerofed import LearningConfig, Update

Floats = NDArray[np.float32]
State = dict[str, Floats]


@dataclass(frozen=True)
class FlowerAlgorithm:
    """Makes the strategy anew each round: at the model, with what it has kept."""

    build: Callable[[Parameters], Strategy]
    momentum: float
    mu: float = 0.0

    def init(self, model: Floats, devices: int) -> State:
        return {"rounds": np.zeros(1, np.float32)}

    def correction(self, state: State, device: int) -> Floats | None:
        return None

    def apply(self, state: State, model: Floats, updates: Sequence[Update]) -> tuple[Any, State]:
        strategy, number = self.build(ndarrays_to_parameters([model])), int(state["rounds"][0]) + 1
        vars(strategy).update({k: [v.copy()] for k, v in state.items() if k != "rounds"})
        sent = [FitRes(Status(Code.OK, ""), ndarrays_to_parameters([u.model]),
                       round(1e9 * u.p), {}) for u in updates]  # fmt: skip
        found, _ = strategy.aggregate_fit(number, [(None, item) for item in sent], [])
        lists = {k: v for k, v in vars(strategy).items() if isinstance(v, list) and v}
        lists.pop("current_weights", None)  # the model once more
        kept = {k: v[0] for k, v in lists.items() if isinstance(v[0], np.ndarray)}
        after = model if found is None else ndarrays(found)[0]
        return after, {**kept, "rounds": np.array([number])}


def make(learning: LearningConfig) -> FlowerAlgorithm:
    """What `learning.algorithm` names: put your strategy in the place of FedAdam."""
    rate = learning.server_learning_rate or 0.01
    return FlowerAlgorithm(lambda at: FedAdam(initial_parameters=at, eta=rate), learning.momentum)
