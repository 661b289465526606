"""One round of learning as a run records it."""

import math

import numpy as np
from numpy.typing import NDArray

from fl.errors import DivergedError
from fl.federation import rounds as learning
from mission.base.errors import TrainingError
from mission.log.records import Learnt

Bools = NDArray[np.bool_]


def learn(
    federation: learning.Federation,
    state: learning.FederationState,
    *,
    scheduled: Bools,
    delivered: Bools,
    workers: int,
) -> tuple[learning.FederationState, Learnt]:
    """Train those whose update is delivered; `scheduled` and `delivered` are (K,).

    Raises:
        TrainingError: the training diverged; names round, community and device.
    """
    try:
        state, learnt = learning.play_round(
            federation, state, scheduled=scheduled, delivered=delivered, workers=workers
        )
    except DivergedError as error:
        raise TrainingError(f"learning diverged: {error}") from None
    return state, recorded(federation, learnt)


def recorded(federation: learning.Federation, learnt: learning.RoundLearning) -> Learnt:
    """What a round taught, as the tables and the log hold it."""
    return Learnt(
        learnt.accuracy,
        learnt.cov,
        {
            name: _mean(learnt.local_loss[federation.members(index)])
            for index, name in enumerate(federation.names)
        },
        learnt.device_accuracy.tolist(),
        learnt.received_accuracy.tolist(),
        learnt.local_loss.tolist(),
    )


def _mean(loss: NDArray[np.float64]) -> float:
    """Over the devices that were trained; NaN where none was."""
    trained = loss[np.isfinite(loss)]
    return float(trained.mean()) if trained.size else math.nan
