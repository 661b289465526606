"""The rounds of a federation: a state and one pure function per round.

Rounds count from 1. theta_j is the global model after round j, theta_0 the initial one, so
theta_{m-1} is what comes down in round m: the paper's theta_m, which it numbers by that round.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fl.data.dataset import Split
from fl.errors import DivergedError
from fl.federation import fairness as fair
from fl.federation.algorithms import AlgorithmState, StaleStart, Update, mean_step
from fl.federation.community import Community, Federation, build
from fl.plugins import PluginError
from fl.training.custom_trainer import TrainingDevice
from fl.training.local import LocalResult, LocalSettings, LocalTask, LocalWork, Vector, in_parallel

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
    "untrained",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Indices = NDArray[np.int64]
Buffers = NDArray[np.float32]
Array = TypeVar("Array", bound=NDArray[np.generic])


@dataclass(frozen=True, eq=False)
class Pending:
    """What a device has made, or is at, and may send in a later round."""

    begun: int  # round whose model it trained from
    start: Vector  # (P + B,) that model as the device had it
    result: LocalResult


@dataclass(frozen=True, eq=False)
class FederationState:
    """All that changes from round to round."""

    rounds: int  # played so far
    models: tuple[Vector, ...]  # theta of each community
    algorithm: tuple[AlgorithmState, ...]
    eps_history: Floats  # (<= l + 1, K) eps_k of the last models, newest last: it goes down next
    eps_received: Floats  # (K,) last eps_k that reached the UAV; NaN: none yet
    cov: Floats  # (C,) psi
    missed: Bools  # (K,) in the last round, as `learning.missed` has it
    correct: tuple[Indices, ...]  # validation images each model gets right, (classes,)
    reported: tuple[Indices, ...]  # the same of the images that accuracy is reported on
    # (K_c, B) of each community whose devices keep their buffers; (0, B) where they are averaged.
    # `correct` and `reported` are (K_c, classes) there: each device measures with its own.
    buffers: tuple[Buffers, ...]
    pending: tuple[Mapping[int, Pending], ...]  # of each community, by device within it


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
        model = community.network.initial(federation.stream(f"fl/{community.name}/model"))
        model.setflags(write=False)
        models.append(model)
        keepers = len(community.shares) if community.own_buffers else 0
        buffers.append(_frozen(np.tile(_parts(community, model)[1], (keepers, 1))))
    devices = federation.p.size
    measured = [
        _measured(*each) for each in zip(federation.communities, models, buffers, strict=True)
    ]
    correct = [each.validation for each in measured]
    return FederationState(
        rounds=0,
        models=tuple(models),
        algorithm=tuple(
            federation.algorithm.init(_parts(community, model)[0], len(community.shares))
            for community, model in zip(federation.communities, models, strict=True)
        ),
        eps_history=_frozen(_device_accuracy(federation, correct)[np.newaxis]),
        eps_received=_frozen(np.full(devices, np.nan)),
        cov=_frozen(np.full(len(federation.communities), fair.INITIAL_COV)),
        missed=_frozen(np.ones(devices, dtype=np.bool_)),
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
    federation: Federation,
    state: FederationState,
    *,
    scheduled: Bools,
    delivered: Bools,
    begun: Ints | None = None,
    kept: Bools | None = None,
    workers: int = 1,
) -> tuple[FederationState, RoundLearning]:
    """One communication round, given who was scheduled and whose update arrives, both (K,).

    `begun` (K,) says which round's model each device has trained from: by default this one's.
    `kept` (K,) are those who may send in a later round what they are at; they are trained too.

    Of the others only devices whose update arrives are trained: nobody would ever see the rest,
    and every device draws from its own stream, so the result is the same. Up to `workers` devices
    train at a time, one thread each, with the same result for any number; on a GPU a community's
    train together, the same within rounding whoever they are. Raises `DivergedError` naming
    round, community and device.
    """
    if scheduled.shape != federation.p.shape or delivered.shape != federation.p.shape:
        raise ValueError(f"scheduled and delivered must be of shape {federation.p.shape}")
    if np.any(delivered & ~scheduled):
        raise ValueError("a device that was not scheduled cannot deliver")
    number = state.rounds + 1
    begun = np.full(delivered.shape, number) if begun is None else begun
    kept = np.zeros_like(delivered) if kept is None else kept
    if np.any(delivered & kept):
        raise ValueError("a device whose update arrives does not keep it")
    period = federation.learning.cov_period_rounds
    # Along with its update a device sends its mean accuracy over the models that came down in the
    # l rounds before.
    sent = fair.windowed_accuracy(state.eps_history, period=period)
    eps_received = np.where(delivered, sent, state.eps_received)
    workers = workers if all(c.network.parallel for c in federation.communities) else 1
    parts: list[tuple[int, list[int]]] = []  # a community, and devices that it trains in one call
    wanted = (delivered | kept) & (begun == number)
    for index, community in enumerate(federation.communities):
        trains = np.flatnonzero(wanted[federation.members(index)]).tolist()
        if community.network.parallel or _own_starts(federation, community):
            parts += [(index, [device]) for device in trains]
        elif trains:
            parts.append((index, trains))
    results = in_parallel(
        [partial(_train, federation, state, index, devices) for index, devices in parts],
        workers=workers if federation.trainer is None else 1,
    )
    made = [dict(pending) for pending in state.pending]
    for (index, devices), result in zip(parts, results, strict=True):
        made[index].update(zip(devices, result, strict=True))
    arrived, pending = (
        [_of(made[index], each[federation.members(index)]) for index in range(len(made))]
        for each in (delivered, kept)
    )
    learnt = in_parallel(
        [partial(_learn, federation, state, *each) for each in enumerate(arrived)],
        workers=workers,
    )
    correct = [each.measured.validation for each in learnt]
    losses = np.concatenate([each.losses for each in learnt])
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
        models=tuple(each.model for each in learnt),
        algorithm=tuple(each.algorithm for each in learnt),
        eps_history=_frozen(np.vstack([state.eps_history, eps])[-(period + 1) :]),
        eps_received=_frozen(eps_received),
        cov=_frozen(cov),
        missed=_frozen(~(delivered if federation.learning.missed == "lost-too" else scheduled)),
        correct=tuple(correct),
        reported=tuple(each.measured.reporting for each in learnt),
        buffers=tuple(each.buffers for each in learnt),
        pending=tuple(pending),
    )
    return after, _round_learning(federation, after, losses)


def _of(made: Mapping[int, Pending], devices: Bools) -> dict[int, Pending]:
    """What some devices of a community, (K_c,), have made."""
    return {device: made[device] for device in np.flatnonzero(devices).tolist()}


def accuracy(federation: Federation, state: FederationState) -> dict[str, float]:
    """Accuracy of each community's model on the images that it is reported on."""
    return {
        community.name: _mean_accuracy(community, right)
        for community, right in zip(federation.communities, state.reported, strict=True)
    }


def _mean_accuracy(community: Community, right: Indices) -> float:
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
        device_loss=_frozen(losses),
    )


def _mean_of_known(losses: Floats) -> float:
    known = losses[np.isfinite(losses)]
    return float(known.mean()) if known.size else np.nan


@dataclass(frozen=True, eq=False)
class _Measured:
    """How many images of each class, (classes,) or by device (K_c, classes), a model gets right."""

    validation: Indices
    reporting: Indices


@dataclass(frozen=True, eq=False)
class CommunityUpdate:
    """What a round made of one community."""

    model: Vector
    algorithm: AlgorithmState
    buffers: Buffers  # (K_c, B) that devices keep; (0, B) where they are averaged
    losses: Floats  # (K_c,)
    measured: _Measured


def _correction(
    federation: Federation, state: FederationState, index: int, device: int
) -> Vector | None:
    """What the algorithm adds to a device's gradients; that of a user's may be of any size."""
    found = federation.algorithm.correction(state.algorithm[index], device)
    if found is not None and found.shape != state.models[index].shape:
        raise PluginError(
            "learning.algorithm",
            federation.learning.algorithm,
            f"correction() of device {device} is of shape {found.shape}, not the model's "
            f"{state.models[index].shape}",
        )
    return found


def _train(
    federation: Federation, state: FederationState, index: int, devices: Sequence[int]
) -> list[Pending]:
    """Local training of devices, which count within their community, from one model."""
    community, learning = federation.communities[index], federation.learning
    algorithm, number = federation.algorithm, state.rounds + 1
    tasks = [
        LocalTask(
            samples=community.shares[device],
            rng=federation.stream(f"fl/{community.name}/device{device}/round{number}"),
            correction=_correction(federation, state, index, device),
        )
        for device in devices
    ]
    settings = LocalSettings(
        learning_rate=learning.learning_rate,
        momentum=algorithm.momentum,
        mu=algorithm.mu,
        batch_size=learning.batch_size,
        epochs=learning.local_epochs,
    )
    start, split = _start(federation, state, index, devices[0]), community.dataset.train
    if federation.trainer is None:
        results = community.network.train(
            LocalWork(split, start, tasks, community.scaling, settings)
        )
    else:
        results = [
            federation.trainer.train(
                TrainingDevice(
                    community.name, device, number, community.network.shapes,
                    community.dataset.classes, settings, task.correction,
                ),
                start, split, task, community.scaling,
            )
            for device, task in zip(devices, tasks, strict=True)
        ]  # fmt: skip
    for device, result in zip(devices, results, strict=True):
        if not (np.isfinite(result.loss) and np.all(np.isfinite(result.model))):
            raise DivergedError(number, community.name, device, result.loss)
    return [Pending(number, start, result) for result in results]


def _own_starts(federation: Federation, community: Community) -> bool:
    """Whether devices train from models of their own."""
    return community.own_buffers or isinstance(federation.algorithm, StaleStart)


def _start(federation: Federation, state: FederationState, index: int, device: int) -> Vector:
    """What a device trains from: parameters as the algorithm says, and buffers."""
    community, algorithm = federation.communities[index], federation.algorithm
    if not _own_starts(federation, community):
        return state.models[index]
    parameters, buffers = _parts(community, state.models[index])
    if isinstance(algorithm, StaleStart):
        parameters = algorithm.start(state.algorithm[index], parameters, device)
    if community.own_buffers:
        buffers = state.buffers[index][device]
    return _frozen(np.concatenate([parameters, buffers]))


def _parts(community: Community, model: Vector) -> tuple[Vector, Vector]:
    """Parameters and buffers of a model."""
    count = model.size - community.network.buffers
    return model[:count], model[count:]


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
    parameters, buffers = _parts(community, model)
    updates, statistics = [], []
    for device, made in arrived.items():
        losses[device] = made.result.loss
        p, age = float(community.p[device]), state.rounds + 1 - made.begun
        ends = zip(_parts(community, made.result.model), _parts(community, made.start), strict=True)
        sent, own = (Update(device, p, end, made.result.steps, start, age) for end, start in ends)
        updates.append(sent)
        statistics.append(own)
    after, algorithm_state = federation.algorithm.apply(algorithm_state, parameters, updates)
    if buffers.size:
        # Averages of what the devices saw, whatever the algorithm makes of the parameters.
        averaged = (buffers + mean_step(buffers, statistics)).astype(np.float32)
        after = np.concatenate([after, averaged])
        after.setflags(write=False)
    if community.own_buffers:
        kept = kept.copy()
        for update in statistics:
            kept[update.device] = update.model
        kept.setflags(write=False)
    measured = _measured(community, after, kept)
    return CommunityUpdate(after, algorithm_state, kept, losses, measured)


def _measured(community: Community, model: Vector, kept: Buffers) -> _Measured:
    """What a model gets right; where devices keep buffers, what it does with those of each."""
    models = [model]
    if community.own_buffers:
        parameters, _ = _parts(community, model)
        models = [np.concatenate([parameters, buffers]) for buffers in kept]

    def correct(split: Split) -> Indices:
        right = [
            community.network.correct_per_class(split, each, scaling=community.scaling)
            for each in models
        ]
        return _frozen(np.stack(right) if community.own_buffers else right[0])

    validation = correct(community.validation)
    same = community.reporting is community.validation
    return _Measured(validation, validation if same else correct(community.reporting))


def _device_accuracy(federation: Federation, correct: Sequence[Indices]) -> Floats:
    return np.concatenate(
        [
            fair.device_accuracy(right, community.validation_counts, community.counts)
            for community, right in zip(federation.communities, correct, strict=True)
        ]
    )


def _frozen(array: Array) -> Array:
    array.setflags(write=False)
    return array
