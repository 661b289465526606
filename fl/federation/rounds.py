"""The rounds of a federation: a state and one pure function per round.

Rounds count from 1. theta_j is the global model after round j, theta_0 the initial one, so
theta_{m-1} is what comes down in round m.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fl.errors import DivergedError
from fl.federation import fairness as fair
from fl.federation.algorithms import AlgorithmState, Update
from fl.federation.community import Community, Federation, build
from fl.training.local import LocalResult, LocalSettings, LocalTask, Vector, in_parallel

__all__ = [
    "Community",
    "Federation",
    "FederationState",
    "RoundLearning",
    "accuracy",
    "build",
    "first_importance",
    "importance",
    "init",
    "play_round",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.int64]
Array = TypeVar("Array", bound=NDArray[np.generic])


@dataclass(frozen=True, eq=False)
class FederationState:
    """All that changes from round to round."""

    rounds: int  # played so far
    models: tuple[Vector, ...]  # theta of each community
    algorithm: tuple[AlgorithmState, ...]
    eps_history: Floats  # (<= l, K) eps_k of the last models that came down or will, newest last
    eps_received: Floats  # (K,) last eps_k that reached the UAV; NaN: none yet
    cov: Floats  # (C,) psi
    missed: Bools  # (K,) not scheduled, or update lost, in the last round
    correct: tuple[Indices, ...]  # validation images each model gets right, (classes,)


@dataclass(frozen=True, eq=False)
class RoundLearning:
    """What one round taught."""

    round: int
    accuracy: dict[str, float]  # on the whole validation set, after the round
    cov: dict[str, float]  # psi in force for the next round
    device_accuracy: Floats  # (K,) eps_k(theta) of the new models on each device's own labels
    local_loss: Floats  # (K,) mean training loss; NaN where nothing was trained


def init(federation: Federation) -> FederationState:
    """The state before the first round: initial models, psi_c = 1, every device missed."""
    models = []
    for community in federation.communities:
        model = community.network.initial(federation.stream(f"fl/{community.name}/model"))
        model.setflags(write=False)
        models.append(model)
    devices = federation.p.size
    correct = [_correct(c, m) for c, m in zip(federation.communities, models, strict=True)]
    return FederationState(
        rounds=0,
        models=tuple(models),
        algorithm=tuple(
            federation.algorithm.init(model, len(community.shares))
            for community, model in zip(federation.communities, models, strict=True)
        ),
        eps_history=_frozen(_device_accuracy(federation, correct)[np.newaxis]),
        eps_received=_frozen(np.full(devices, np.nan)),
        cov=_frozen(np.full(len(federation.communities), fair.INITIAL_COV)),
        missed=_frozen(np.ones(devices, dtype=np.bool_)),
        correct=tuple(correct),
    )


def first_importance(federation: Federation) -> Floats:
    """delta (K,) for the first round, with or without fairness; no model is needed for it."""
    devices = federation.p.size
    return _importance(federation, np.full(devices, fair.INITIAL_COV), np.ones(devices, np.bool_))


def importance(federation: Federation, state: FederationState, *, fairness: bool) -> Floats:
    """delta (K,) for the next round; without `fairness` psi counts as 1 (No-CoV)."""
    cov = state.cov[federation.community_of] if fairness else np.ones(federation.p.size)
    return _importance(federation, cov, state.missed)


def _importance(federation: Federation, cov: Floats, missed: Bools) -> Floats:
    return fair.importance(
        federation.p,
        cov,
        missed,
        boost=federation.learning.importance_boost,
        floor=federation.learning.cov_floor,
    )


def play_round(
    federation: Federation,
    state: FederationState,
    *,
    scheduled: Bools,
    delivered: Bools,
    workers: int = 1,
) -> tuple[FederationState, RoundLearning]:
    """One communication round, given who was scheduled and whose update arrives, both (K,).

    Only devices whose update arrives are trained: nobody would ever see the others', and every
    device draws from its own stream, so the result is the same. Up to `workers` devices train at
    a time, one thread each, with the same result for any number; on a GPU a community's train
    together, the same within rounding whoever they are. Raises `DivergedError` naming round,
    community and device.
    """
    if scheduled.shape != federation.p.shape or delivered.shape != federation.p.shape:
        raise ValueError(f"scheduled and delivered must be of shape {federation.p.shape}")
    if np.any(delivered & ~scheduled):
        raise ValueError("a device that was not scheduled cannot deliver")
    number = state.rounds + 1
    period = federation.learning.cov_period_rounds
    # A device sends eps_k = mean over j = m-l .. m-1 of eps_k(theta_j) along with its update.
    sent = fair.windowed_accuracy(state.eps_history)
    eps_received = np.where(delivered, sent, state.eps_received)
    workers = workers if all(c.network.parallel for c in federation.communities) else 1
    parts: list[tuple[int, list[int]]] = []  # a community, and devices that it trains in one call
    for index, community in enumerate(federation.communities):
        arrived = np.flatnonzero(delivered[federation.members(index)]).tolist()
        if community.network.parallel:
            parts += [(index, [device]) for device in arrived]
        elif arrived:
            parts.append((index, arrived))
    results = in_parallel(
        [partial(_train, federation, state, index, devices) for index, devices in parts],
        workers=workers,
    )
    trained: list[dict[int, LocalResult]] = [{} for _ in federation.communities]
    for (index, devices), result in zip(parts, results, strict=True):
        trained[index].update(zip(devices, result, strict=True))
    lessons = in_parallel(
        [partial(_learn, federation, state, *each) for each in enumerate(trained)],
        workers=workers,
    )
    correct = [lesson.correct for lesson in lessons]
    losses = np.concatenate([lesson.losses for lesson in lessons])
    cov = state.cov.copy()
    if number % period == 0:
        for index, community in enumerate(federation.communities):
            cov[index] = fair.coefficient_of_variation(
                community.p,
                eps_received[federation.members(index)],
                unheard=federation.learning.cov_unheard,
            )
    eps = _device_accuracy(federation, correct)
    after = FederationState(
        rounds=number,
        models=tuple(lesson.model for lesson in lessons),
        algorithm=tuple(lesson.algorithm for lesson in lessons),
        eps_history=_frozen(np.vstack([state.eps_history, eps])[-period:]),
        eps_received=_frozen(eps_received),
        cov=_frozen(cov),
        missed=_frozen(~delivered),
        correct=tuple(correct),
    )
    learnt = RoundLearning(
        round=number,
        accuracy=accuracy(federation, after),
        cov=dict(zip(federation.names, map(float, cov), strict=True)),
        device_accuracy=_frozen(eps),
        local_loss=_frozen(losses),
    )
    return after, learnt


def accuracy(federation: Federation, state: FederationState) -> dict[str, float]:
    """Accuracy of each community's model on its whole validation set."""
    return {
        community.name: float(right.sum() / community.validation_counts.sum())
        for community, right in zip(federation.communities, state.correct, strict=True)
    }


@dataclass(frozen=True, eq=False)
class CommunityUpdate:
    """What a round made of one community."""

    model: Vector
    algorithm: AlgorithmState
    losses: Floats  # (K_c,)
    correct: Indices  # (classes,)


def _train(
    federation: Federation, state: FederationState, index: int, devices: Sequence[int]
) -> list[LocalResult]:
    """Local training of devices, which count within their community."""
    community, learning = federation.communities[index], federation.learning
    algorithm, number = federation.algorithm, state.rounds + 1
    results = community.network.train(
        community.dataset.train,
        state.models[index],
        [
            LocalTask(
                samples=community.shares[device],
                rng=federation.stream(f"fl/{community.name}/device{device}/round{number}"),
                correction=algorithm.correction(state.algorithm[index], device),
            )
            for device in devices
        ],
        scaling=community.scaling,
        settings=LocalSettings(
            learning_rate=learning.learning_rate,
            momentum=algorithm.momentum,
            mu=algorithm.mu,
            batch_size=learning.batch_size,
            epochs=learning.local_epochs,
        ),
    )
    for device, result in zip(devices, results, strict=True):
        if not (np.isfinite(result.loss) and np.all(np.isfinite(result.model))):
            raise DivergedError(number, community.name, device, result.loss)
    return results


def _learn(
    federation: Federation, state: FederationState, index: int, trained: dict[int, LocalResult]
) -> CommunityUpdate:
    """Aggregate what arrived from one community's devices, and measure."""
    community = federation.communities[index]
    model, algorithm_state = state.models[index], state.algorithm[index]
    losses = np.full(len(community.shares), np.nan)
    updates = []
    for device, result in trained.items():
        losses[device] = result.loss
        updates.append(Update(device, float(community.p[device]), result.model, result.steps))
    if not updates:
        return CommunityUpdate(model, algorithm_state, losses, state.correct[index])
    model, algorithm_state = federation.algorithm.apply(algorithm_state, model, updates)
    return CommunityUpdate(model, algorithm_state, losses, _correct(community, model))


def _correct(community: Community, model: Vector) -> Indices:
    return _frozen(
        community.network.correct_per_class(
            community.dataset.validation, model, scaling=community.scaling
        )
    )


def _device_accuracy(federation: Federation, correct: Sequence[Indices]) -> Floats:
    return np.concatenate(
        [
            fair.device_accuracy(right, community.validation_counts, community.counts > 0)
            for community, right in zip(federation.communities, correct, strict=True)
        ]
    )


def _frozen(array: Array) -> Array:
    array.setflags(write=False)
    return array
