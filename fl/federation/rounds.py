"""The rounds of a federation: a state and one pure function per round.

Rounds count from 1. theta_j is the global model after round j, theta_0 the initial one, so
theta_{m-1} is what comes down in round m: the paper's theta_m, which it numbers by that round.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fl.arrays import Bools, Floats, Ints, Vector, frozen
from fl.data.dataset import Split
from fl.federation import fairness as fair
from fl.federation.algorithms import AlgorithmState, Update, mean_step
from fl.federation.community import Community, Federation, build
from fl.federation.state import FederationState, Pending, parts_of
from fl.federation.updates import trained
from fl.training.local import in_parallel

__all__ = [
    "Community",
    "Federation",
    "FederationState",
    "Participation",
    "RoundLearning",
    "accuracy",
    "build",
    "first_importance",
    "importance",
    "init",
    "play_round",
    "untrained",
]


@dataclass(frozen=True, eq=False)
class Participation:
    """Who takes part in a round, each (K,)."""

    scheduled: Bools
    delivered: Bools  # whose update arrives
    begun: Ints | None = None  # round whose model each has trained from; None: this one's
    kept: Bools | None = None  # who may send in a later round what they are at; trained too


@dataclass(frozen=True, eq=False)
class RoundLearning:
    """What one round taught."""

    accuracy: dict[str, float]  # by community, on the images to report on, after the round
    cov: dict[str, float]  # psi in force for the next round
    loss: dict[str, float]  # mean over the devices that were trained; NaN where none was
    device_accuracy: Floats  # (K,) eps_k(theta) of the new models, on each device's validation set
    received_accuracy: Floats  # (K,) the last eps_k that reached the UAV; NaN: none yet
    device_loss: Floats  # (K,) mean training loss; NaN where nothing was trained


def init(federation: Federation) -> FederationState:
    """The state before the first round: initial models, psi_c = 1, every device missed."""
    models, buffers = [], []
    for community in federation.communities:
        rng = federation.stream(f"fl/{community.name}/model")
        models.append(model := frozen(community.network.initial(rng)))
        keepers = len(community.shares) if community.own_buffers else 0
        buffers.append(frozen(np.tile(parts_of(community, model)[1], (keepers, 1))))
    devices = federation.p.size
    measured = [
        _measured(*each) for each in zip(federation.communities, models, buffers, strict=True)
    ]
    correct = [each.validation for each in measured]
    return FederationState(
        rounds=0,
        models=tuple(models),
        algorithm=tuple(
            federation.algorithm.init(parts_of(community, model)[0], len(community.shares))
            for community, model in zip(federation.communities, models, strict=True)
        ),
        eps_history=frozen(_device_accuracy(federation, correct)[np.newaxis]),
        eps_received=frozen(np.full(devices, np.nan)),
        cov=frozen(np.full(len(federation.communities), fair.INITIAL_COV)),
        missed=frozen(np.ones(devices, dtype=np.bool_)),
        correct=tuple(correct),
        reported=tuple(each.reporting for each in measured),
        buffers=tuple(buffers),
        pending=tuple({} for _ in federation.communities),
    )


def untrained(federation: Federation, state: FederationState) -> RoundLearning:
    """Round 0: what the initial models know; nothing was trained or received."""
    return _round_learning(federation, state, np.full(federation.p.size, np.nan))


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
    federation: Federation, state: FederationState, who: Participation, *, workers: int = 1
) -> tuple[FederationState, RoundLearning]:
    """One communication round, given who was scheduled and whose update arrives.

    Of all devices only those are trained whose update arrives, or who keep it: nobody would ever
    see the rest, and every device draws from its own stream, so the result is the same. Up to
    `workers` devices train at a time, with the same result for any number. Raises
    `DivergedError` naming round, community and device.
    """
    scheduled, delivered = who.scheduled, who.delivered
    if scheduled.shape != federation.p.shape or delivered.shape != federation.p.shape:
        raise ValueError(f"scheduled and delivered must be of shape {federation.p.shape}")
    if np.any(delivered & ~scheduled):
        raise ValueError("a device that was not scheduled cannot deliver")
    number = state.rounds + 1
    begun = np.full(delivered.shape, number) if who.begun is None else who.begun
    kept = np.zeros_like(delivered) if who.kept is None else who.kept
    if np.any(delivered & kept):
        raise ValueError("a device whose update arrives does not keep it")
    period = federation.learning.cov_period_rounds
    # Along with its update a device sends its mean accuracy over the models that came down in the
    # l rounds before.
    sent = fair.windowed_accuracy(state.eps_history, period=period)
    eps_received = np.where(delivered, sent, state.eps_received)
    workers = workers if all(c.network.parallel for c in federation.communities) else 1
    wanted = (delivered | kept) & (begun == number)
    made = trained(federation, state, wanted, workers=workers)
    arrived, pending = (
        [_of(made[index], each[federation.members(index)]) for index in range(len(made))]
        for each in (delivered, kept)
    )
    learnt = in_parallel(
        [partial(_learn, federation, state, *each) for each in enumerate(arrived)], workers=workers
    )
    correct = [each.measured.validation for each in learnt]
    losses = np.concatenate([each.losses for each in learnt])
    cov = _cov(federation, eps_received) if number % period == 0 else state.cov.copy()
    eps = _device_accuracy(federation, correct)
    after = FederationState(
        rounds=number,
        models=tuple(each.model for each in learnt),
        algorithm=tuple(each.algorithm for each in learnt),
        eps_history=frozen(np.vstack([state.eps_history, eps])[-(period + 1) :]),
        eps_received=frozen(eps_received),
        cov=frozen(cov),
        missed=frozen(~(delivered if federation.learning.missed == "lost-too" else scheduled)),
        correct=tuple(correct),
        reported=tuple(each.measured.reporting for each in learnt),
        buffers=tuple(each.buffers for each in learnt),
        pending=tuple(pending),
    )
    return after, _round_learning(federation, after, losses)


def _cov(federation: Federation, eps_received: Floats) -> Floats:
    """(C,) of each community, by what was received of its devices' accuracies."""
    return np.array(
        [
            fair.coefficient_of_variation(
                community.p,
                eps_received[federation.members(index)],
                unheard=federation.learning.cov_unheard,
            )
            for index, community in enumerate(federation.communities)
        ]
    )


def _of(made: Mapping[int, Pending], devices: Bools) -> dict[int, Pending]:
    """What some devices of a community, (K_c,), have made."""
    return {device: made[device] for device in np.flatnonzero(devices).tolist()}


def accuracy(federation: Federation, state: FederationState) -> dict[str, float]:
    """Accuracy of each community's model on the images that it is reported on."""
    return {
        community.name: _mean_accuracy(community, right)
        for community, right in zip(federation.communities, state.reported, strict=True)
    }


def _mean_accuracy(community: Community, right: Ints) -> float:
    """Over the community's images; where devices measure for themselves, weighted by p_k."""
    every = len(community.reporting.labels)
    if right.ndim == 1:
        return float(right.sum() / every)
    return float(community.p @ (right.sum(axis=1) / every))


def _round_learning(
    federation: Federation, after: FederationState, losses: Floats
) -> RoundLearning:
    return RoundLearning(
        accuracy=accuracy(federation, after),
        cov=dict(zip(federation.names, map(float, after.cov), strict=True)),
        loss={
            name: _mean_of_known(losses[federation.members(index)])
            for index, name in enumerate(federation.names)
        },
        device_accuracy=after.eps_history[-1],
        received_accuracy=after.eps_received,
        device_loss=frozen(losses),
    )


def _mean_of_known(losses: Floats) -> float:
    known = losses[np.isfinite(losses)]
    return float(known.mean()) if known.size else np.nan


@dataclass(frozen=True, eq=False)
class _Measured:
    """How many images of each class, (classes,) or by device (K_c, classes), a model gets right."""

    validation: Ints
    reporting: Ints


@dataclass(frozen=True, eq=False)
class CommunityUpdate:
    """What a round made of one community."""

    model: Vector
    algorithm: AlgorithmState
    buffers: Vector  # (K_c, B) that devices keep; (0, B) where they are averaged
    losses: Floats  # (K_c,)
    measured: _Measured


def _learn(
    federation: Federation, state: FederationState, index: int, arrived: Mapping[int, Pending]
) -> CommunityUpdate:
    """Aggregate what arrived from one community's devices, and measure."""
    community = federation.communities[index]
    model, algorithm_state = state.models[index], state.algorithm[index]
    kept, losses = state.buffers[index], np.full(len(community.shares), np.nan)
    if not arrived:
        measured = _Measured(state.correct[index], state.reported[index])
        return CommunityUpdate(model, algorithm_state, kept, losses, measured)
    parameters, buffers = parts_of(community, model)
    updates, statistics = [], []
    for device, made in arrived.items():
        losses[device] = made.result.loss
        p, age = float(community.p[device]), state.rounds + 1 - made.begun
        ends = zip(
            parts_of(community, made.result.model), parts_of(community, made.start), strict=True
        )
        sent, own = (
            Update(device, p, frozen(end[:]), made.result.steps, frozen(start[:]), age)
            for end, start in ends
        )
        updates.append(replace(sent, correction=made.correction))
        statistics.append(own)
    after, algorithm_state = federation.algorithm.apply(algorithm_state, parameters, updates)
    if buffers.size:
        # Averages of what the devices saw, whatever the algorithm makes of the parameters.
        averaged = (buffers + mean_step(buffers, statistics)).astype(np.float32)
        after = frozen(np.concatenate([after, averaged]))
    if community.own_buffers:
        kept = kept.copy()
        for update in statistics:
            kept[update.device] = update.model
        frozen(kept)
    measured = _measured(community, after, kept)
    return CommunityUpdate(after, algorithm_state, kept, losses, measured)


def _measured(community: Community, model: Vector, kept: Vector) -> _Measured:
    """What a model gets right; where devices keep buffers, what it does with those of each."""
    models = [model]
    if community.own_buffers:
        parameters, _ = parts_of(community, model)
        models = [np.concatenate([parameters, buffers]) for buffers in kept]

    def correct(split: Split) -> Ints:
        right = [
            community.network.correct_per_class(split, each, scaling=community.scaling)
            for each in models
        ]
        return frozen(np.stack(right) if community.own_buffers else right[0])

    validation = correct(community.validation)
    same = community.reporting is community.validation
    return _Measured(validation, validation if same else correct(community.reporting))


def _device_accuracy(federation: Federation, correct: Sequence[Ints]) -> Floats:
    return np.concatenate(
        [
            fair.device_accuracy(right, community.validation_counts, community.counts)
            for community, right in zip(federation.communities, correct, strict=True)
        ]
    )
