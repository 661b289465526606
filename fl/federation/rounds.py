"""The rounds of a federation: a state and one pure function per round.

Rounds count from 1. theta_j is the global model after round j, theta_0 the initial one, so
theta_{m-1} is what comes down in round m: the paper's theta_m, which it numbers by that round.

Of the paper's fairness: p_k data share of device k in its community, eps_k its mean validation
accuracy over the last l models, psi_c the coefficient of variation (CoV) of its community, delta_k
its importance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fl.arrays import Bools, Floats, Ints, Vector, frozen
from fl.config import Unheard
from fl.data.dataset import Split
from fl.federation.algorithms import Update, mean_step
from fl.federation.community import Community, Federation
from fl.federation.state import CommunityState, FederationState, Pending, parts_of
from fl.federation.updates import Begun, trained
from fl.training.local import in_parallel

INITIAL_COV = 1.0  # psi_c of every community before the first update


@dataclass(frozen=True, eq=False)
class Participation:
    """Which devices are scheduled, deliver and keep an update in a round, each (K,)."""

    scheduled: Bools
    delivered: Bools  # whose update arrives
    begun: Ints | None = None  # round whose model each has trained from; None: this one's
    kept: Bools | None = None  # who may send in a later round what they are at; trained too


@dataclass(frozen=True, eq=False)
class RoundLearning:
    """Accuracies, losses and fairness after one round."""

    accuracy: dict[str, float]  # by community, on the images to report on, after the round
    cov: dict[str, float]  # psi in force for the next round
    loss: dict[str, float]  # mean over the devices that were trained; NaN where none was
    device_accuracy: Floats  # (K,) eps_k(theta) of the new models, on each device's validation set
    received_accuracy: Floats  # (K,) the last eps_k that reached the UAV; NaN: none yet
    device_loss: Floats  # (K,) mean training loss; NaN where nothing was trained


def init(federation: Federation) -> FederationState:
    """The state before the first round: initial models, psi_c = 1, every device missed."""
    begun = []
    for community in federation.communities:
        devices = len(community.shares)
        model = frozen(community.network.initial(federation.stream(f"fl/{community.name}/model")))
        parameters, own = parts_of(community, model)
        buffers = frozen(np.tile(own, (devices if community.own_buffers else 0, 1)))
        algorithm = federation.algorithm.init(parameters, devices)
        measured = _measured(community, model, buffers)
        begun.append(CommunityState(model, algorithm, buffers, *measured, {}))
    devices = federation.p.size
    return FederationState(
        rounds=0,
        communities=tuple(begun),
        eps_history=frozen(_device_accuracy(federation, begun)[np.newaxis]),
        eps_received=frozen(np.full(devices, np.nan)),
        cov=frozen(np.full(len(begun), INITIAL_COV)),
        missed=frozen(np.ones(devices, dtype=np.bool_)),
    )


def untrained(federation: Federation, state: FederationState) -> RoundLearning:
    """Return the `RoundLearning` of round 0: the initial models measured, nothing trained."""
    return _round_learning(federation, state, np.full(federation.p.size, np.nan))


def first_importance(federation: Federation) -> Floats:
    """Return the importance delta (K,) for round 1, the same without fairness; needs no model."""
    devices = federation.p.size
    return _importance(federation, np.full(devices, INITIAL_COV), np.ones(devices, np.bool_))


def importance(federation: Federation, state: FederationState, *, fairness: bool) -> Floats:
    """Return the importance delta (K,) for the next round; without `fairness` psi is 1 (No-CoV)."""
    cov = state.cov[federation.community_of] if fairness else np.ones(federation.p.size)
    return _importance(federation, cov, state.missed)


def _importance(federation: Federation, cov: Floats, missed: Bools) -> Floats:
    boost, floor = federation.learning.importance_boost, federation.learning.cov_floor
    return importance_of(federation.p, cov, missed, boost=boost, floor=floor)


def play_round(
    federation: Federation,
    state: FederationState,
    who: Participation,
    *,
    workers: int = 1,
    early: Begun | None = None,
) -> tuple[FederationState, RoundLearning]:
    """Play one communication round, given who was scheduled and whose update arrives.

    Of all devices only those are trained whose update arrives, or who keep it: the
    others would change nothing, as every device draws from its own random stream. Up to
    `workers` devices train at a time, some of them `early`, from `begin_training` with the same
    state; the result is the same for any number. Raises `DivergedError` naming round, community
    and device.
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
    sent = windowed_accuracy(state.eps_history, period=period)
    eps_received = np.where(delivered, sent, state.eps_received)
    workers = workers if all(c.network.parallel for c in federation.communities) else 1
    wanted = (delivered | kept) & (begun == number)
    made = trained(federation, state, wanted, early or {}, workers=workers)
    learnt = in_parallel(
        [
            partial(_learn, federation, state, index, made[index], delivered[who], kept[who])
            for index in range(len(made))
            for who in [federation.members(index)]
        ],
        workers=workers,
    )
    communities = tuple(each for each, _ in learnt)
    losses = np.concatenate([each for _, each in learnt])
    cov = _cov(federation, eps_received) if number % period == 0 else state.cov.copy()
    eps = _device_accuracy(federation, communities)
    after = FederationState(
        rounds=number,
        communities=communities,
        eps_history=frozen(np.vstack([state.eps_history, eps])[-(period + 1) :]),
        eps_received=frozen(eps_received),
        cov=frozen(cov),
        missed=frozen(~(delivered if federation.learning.missed == "lost-too" else scheduled)),
    )
    return after, _round_learning(federation, after, losses)


def _cov(federation: Federation, eps_received: Floats) -> Floats:
    """Return the CoV psi of each community, (C,), from the accuracies received of its devices."""
    return np.array(
        [
            coefficient_of_variation(
                community.p,
                eps_received[federation.members(index)],
                unheard=federation.learning.cov_unheard,
            )
            for index, community in enumerate(federation.communities)
        ]
    )


def _mean_accuracy(community: Community, right: Ints) -> float:
    """Accuracy on the reporting images; its mean by p_k where devices have their own buffers."""
    every = len(community.reporting.labels)
    if right.ndim == 1:
        return float(right.sum() / every)
    return float(community.p @ (right.sum(axis=1) / every))


def _round_learning(
    federation: Federation, after: FederationState, losses: Floats
) -> RoundLearning:
    return RoundLearning(
        accuracy={
            community.name: _mean_accuracy(community, each.reported)
            for community, each in zip(federation.communities, after.communities, strict=True)
        },
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


def _learn(
    federation: Federation,
    state: FederationState,
    index: int,
    made: Mapping[int, Pending],
    delivered: Bools,
    kept: Bools,
) -> tuple[CommunityState, Floats]:
    """Return a community's state after a round, and the losses of its devices, (K_c,).

    `made`: pending updates by device. Those of `delivered` devices (K_c,) are aggregated, those of
    `kept` ones (K_c,) stay pending.
    """
    community, before = federation.communities[index], state.communities[index]
    losses = np.full(len(community.shares), np.nan)
    pending = {device: made[device] for device in np.flatnonzero(kept).tolist()}
    if not delivered.any():
        return replace(before, pending=pending), losses
    parameters, buffers = parts_of(community, before.model)
    updates, statistics = [], []
    for device in np.flatnonzero(delivered).tolist():
        result, begun = made[device].result, made[device].begun
        losses[device] = result.loss
        p, age = float(community.p[device]), state.rounds + 1 - begun
        sent, own = (
            Update(device, p, frozen(end[:]), result.steps, frozen(start[:]), age)
            for end, start in zip(
                parts_of(community, result.model),
                parts_of(community, made[device].start),
                strict=True,
            )
        )
        updates.append(replace(sent, correction=made[device].correction))
        statistics.append(own)
    after, algorithm = federation.algorithm.apply(before.algorithm, parameters, updates)
    if buffers.size:
        # Averages of what the devices saw, whatever the algorithm makes of the parameters.
        averaged = (buffers + mean_step(buffers, statistics)).astype(np.float32)
        after = frozen(np.concatenate([after, averaged]))
    own_buffers = before.buffers
    if community.own_buffers:
        own_buffers = own_buffers.copy()
        for update in statistics:
            own_buffers[update.device] = update.model
        frozen(own_buffers)
    measured = _measured(community, after, own_buffers)
    return CommunityState(after, algorithm, own_buffers, *measured, pending), losses


def _measured(community: Community, model: Vector, own_buffers: Vector) -> tuple[Ints, Ints]:
    """Count the validation and the reporting images of each class that a model gets right.

    (classes,) each, or (K_c, classes) where each device measures with buffers of its own.
    """
    models = [model]
    if community.own_buffers:
        parameters, _ = parts_of(community, model)
        models = [np.concatenate([parameters, buffers]) for buffers in own_buffers]

    def correct(split: Split) -> Ints:
        right = [
            community.network.correct_per_class(split, each, scaling=community.scaling)
            for each in models
        ]
        return frozen(np.stack(right) if community.own_buffers else right[0])

    validation = correct(community.validation)
    same = community.reporting is community.validation
    return validation, validation if same else correct(community.reporting)


def _device_accuracy(federation: Federation, states: Sequence[CommunityState]) -> Floats:
    """Return the accuracy eps_k of each device with its community's model, (K,)."""
    return np.concatenate(
        [
            device_accuracy(each.correct, community.validation_counts, community.counts)
            for community, each in zip(federation.communities, states, strict=True)
        ]
    )


def device_accuracy(correct: Ints, total: Ints, counts: Ints) -> Floats:
    """eps_k(theta): accuracy of one model on the validation samples of each device, (K_c,).

    A device's validation samples are the task's in the proportions of its own training data,
    `counts` (K_c, classes); `correct` and `total` (classes,) count over the task's whole set, and
    `correct` is (K_c, classes) where every device has a model of its own. So
    eps_k is the mean of the classes' accuracies, weighted by the device's share of each. A class
    without a validation sample is left out; a device that owns no other scores 0.
    """
    weights = counts * (total > 0)
    share = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1)
    accuracy = correct / np.maximum(total, 1)
    eps = share @ accuracy if accuracy.ndim == 1 else (share * accuracy).sum(axis=1)
    return np.asarray(eps, dtype=np.float64)


def windowed_accuracy(history: Floats, *, period: int) -> Floats:
    """Return eps_k (K,), the mean accuracy over the models of the `period` (l) rounds before.

    `history` (<= l + 1, K) ends with the model that has just come down, which does not count yet
    (the paper's j = m-l .. m-1 in round m). In the first round there is no other: it stands in.
    """
    before = history[:-1][-period:] if len(history) > 1 else history
    return np.asarray(before.mean(axis=0), dtype=np.float64)


def coefficient_of_variation(
    p: Floats, accuracy: Floats, *, unheard: Unheard = "left-out"
) -> float:
    """psi_c = sqrt(sum_k (eps_k - eps_bar)^2) / eps_bar with eps_bar = sum_k p_k eps_k.

    `accuracy` (K_c,) holds the last values received, NaN for a device never heard of, of which
    the paper says nothing. "left-out": psi is that of the others, with their p_k scaled to sum to
    1. "zero": it counts as 0; but then one device out of reach holds its community's psi above 1
    for good, however well the others are served. Where eps_bar is 0 (nothing received, or nothing
    learnt) the ratio is undefined and the answer is that of the start, 1: the community keeps an
    ordinary claim.
    """
    if unheard == "left-out":
        known = ~np.isnan(accuracy)
        accuracy = accuracy[known]
        p = p[known] / p[known].sum() if known.any() else p[known]
    heard = np.where(np.isnan(accuracy), 0.0, accuracy)
    mean = float(p @ heard)
    if mean <= 0.0:
        return INITIAL_COV
    return float(np.sqrt(np.sum((heard - mean) ** 2)) / mean)


def importance_of(p: Floats, cov: Floats, missed: Bools, *, boost: float, floor: float) -> Floats:
    """delta_k = p_k psi_c lambda if device k missed the previous round, p_k psi_c otherwise.

    `cov` (K,) is psi of each device's community, `boost` lambda > 1; before the first round all
    devices missed one. psi_c = 0 (perfectly equal devices) would make a community worthless, so
    that it waits for ever behind any other however badly it does: psi_c counts as `floor` at
    least. The floor is ours, the paper has none.
    """
    return np.asarray(p * np.maximum(cov, floor) * np.where(missed, boost, 1.0), dtype=np.float64)
