"""Local training of the devices in a round: which ones, from which model, in which threads."""

from collections.abc import Mapping
from concurrent.futures import Executor, Future
from functools import partial
from typing import TypeAlias

import numpy as np

from fl.arrays import Bools, Vector, frozen
from fl.errors import DivergedError
from fl.federation.algorithms import CustomAlgorithm, StaleStart
from fl.federation.community import Federation
from fl.federation.state import FederationState, Pending, parts_of
from fl.training.local import LocalSettings, LocalTask, TrainingDevice, in_parallel
from native.errors import UsersCodeError

# Training that has begun, by community and by device within it.
Begun: TypeAlias = Mapping[tuple[int, int], Future[Pending]]


def begin_training(
    pool: Executor, federation: Federation, state: FederationState, likely: Bools
) -> Begun:
    """Start training the `likely` devices (K,) in `pool`, before it is known which are wanted.

    A researcher's own code is left to `trained`: it is asked for what is wanted, and no more.
    """
    own = federation.trainer is not None or isinstance(federation.algorithm, CustomAlgorithm)
    if own or not all(community.network.parallel for community in federation.communities):
        return {}
    return {
        each: pool.submit(_train, federation, state, *each) for each in _chosen(federation, likely)
    }


def trained(
    federation: Federation, state: FederationState, wanted: Bools, begun: Begun, *, workers: int
) -> list[dict[int, Pending]]:
    """Train the `wanted` devices (K,); return the pending updates of each community, by device.

    Up to `workers` train at a time, one thread each, beside the last of those that have `begun`.

    Raises:
        DivergedError: names round, community and device.
    """
    asked = _chosen(federation, wanted)
    for each in begun.keys() - asked:
        begun[each].cancel()

    def finished(each: tuple[int, int]) -> Pending:
        early = begun.get(each)
        if early is None or early.cancel():  # who only waits there is trained here, beside others
            return _train(federation, state, *each)
        return early.result()

    results = in_parallel(
        [partial(finished, each) for each in asked],
        workers=workers if federation.trainer is None else 1,
    )
    made = [dict(community.pending) for community in state.communities]
    for (index, device), result in zip(asked, results, strict=True):
        made[index][device] = result
    return made


def _chosen(federation: Federation, devices: Bools) -> list[tuple[int, int]]:
    """Return (community index, device index within it) of each device set in `devices` (K,)."""
    return [
        (index, device)
        for index in range(len(federation.communities))
        for device in np.flatnonzero(devices[federation.members(index)]).tolist()
    ]


def _train(federation: Federation, state: FederationState, index: int, device: int) -> Pending:
    """Train a device, counted within its community; raise DivergedError on non-finite results."""
    community, learning = federation.communities[index], federation.learning
    algorithm, number = federation.algorithm, state.rounds + 1
    start = _start(federation, state, index, device)
    correction = algorithm.correction(state.communities[index].algorithm, device)
    shape = (start.size - community.network.buffers,)
    if correction is not None and correction.shape != shape:  # a user's may be of any
        key = f"learning.algorithm = {learning.algorithm!r}: correction() of device {device}"
        raise UsersCodeError(f"{key} is of shape {correction.shape}, not {shape}")
    task = LocalTask(
        community.dataset.train,
        community.shares[device],
        community.scaling,
        start,
        LocalSettings(
            learning_rate=learning.learning_rate,
            momentum=algorithm.momentum,
            mu=algorithm.mu,
            batch_size=learning.batch_size,
            epochs=learning.local_epochs,
        ),
        federation.stream(f"fl/{community.name}/device{device}/round{number}"),
        correction,
    )
    if federation.trainer is None:
        result = community.network.train(task)
    else:
        shapes, classes = community.network.shapes, community.dataset.classes
        result = federation.trainer.train(
            TrainingDevice(
                community.name, device, number, shapes, classes, task.settings, correction
            ),
            task,
        )
    if not (np.isfinite(result.loss) and np.all(np.isfinite(result.model))):
        raise DivergedError(number, community.name, device, result.loss)
    return Pending(number, start, result, correction)


def _start(federation: Federation, state: FederationState, index: int, device: int) -> Vector:
    """Return the model that a device trains from: parameters as the algorithm says, and buffers."""
    community, algorithm = federation.communities[index], federation.algorithm
    now = state.communities[index]
    if not (community.own_buffers or isinstance(algorithm, StaleStart)):
        return now.model
    parameters, buffers = parts_of(community, now.model)
    if isinstance(algorithm, StaleStart):
        parameters = algorithm.start(now.algorithm, parameters, device)
    if community.own_buffers:
        buffers = now.buffers[device]
    return frozen(np.concatenate([parameters, buffers]))
