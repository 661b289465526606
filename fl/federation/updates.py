"""What devices make of the models that come down: whom to train, from what, and how."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from fl.arrays import Bools, Vector, frozen
from fl.errors import DivergedError
from fl.federation.algorithms import StaleStart
from fl.federation.community import Community, Federation
from fl.federation.state import FederationState, Pending, parts_of
from fl.plugins import PluginError
from fl.training.custom_trainer import TrainingDevice
from fl.training.local import LocalSettings, LocalTask, LocalWork, in_parallel


def trained(
    federation: Federation, state: FederationState, wanted: Bools, *, workers: int
) -> list[dict[int, Pending]]:
    """What the devices of each community have at hand after the `wanted` (K,) were trained.

    Up to `workers` train at a time, one thread each; on a GPU a community's train together.

    Raises:
        DivergedError: names round, community and device.
    """
    parts: list[tuple[int, list[int]]] = []  # a community, and devices that it trains in one call
    for index, community in enumerate(federation.communities):
        devices = np.flatnonzero(wanted[federation.members(index)]).tolist()
        if community.network.parallel or _own_starts(federation, community):
            parts += [(index, [device]) for device in devices]
        elif devices:
            parts.append((index, devices))
    results = in_parallel(
        [partial(_train, federation, state, index, devices) for index, devices in parts],
        workers=workers if federation.trainer is None else 1,
    )
    made = [dict(pending) for pending in state.pending]
    for (index, devices), result in zip(parts, results, strict=True):
        made[index].update(zip(devices, result, strict=True))
    return made


def _correction(
    federation: Federation, state: FederationState, index: int, device: int
) -> Vector | None:
    """What the algorithm adds to a device's gradients; that of a user's may be of any size."""
    found = federation.algorithm.correction(state.algorithm[index], device)
    parameters, _ = parts_of(federation.communities[index], state.models[index])
    if found is None:
        return None
    if found.shape != parameters.shape:
        raise PluginError(
            "learning.algorithm",
            federation.learning.algorithm,
            f"correction() of device {device} is of shape {found.shape}, not the model's "
            f"{parameters.shape}",
        )
    return frozen(found[:])


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
        name, shapes, classes = community.name, community.network.shapes, community.dataset.classes
        results = []
        for device, task in zip(devices, tasks, strict=True):
            how = TrainingDevice(name, device, number, shapes, classes, settings, task.correction)
            results.append(federation.trainer.train(how, start, split, task, community.scaling))
    for device, result in zip(devices, results, strict=True):
        if not (np.isfinite(result.loss) and np.all(np.isfinite(result.model))):
            raise DivergedError(number, community.name, device, result.loss)
    return [
        Pending(number, start, result, task.correction)
        for task, result in zip(tasks, results, strict=True)
    ]


def _own_starts(federation: Federation, community: Community) -> bool:
    """Whether devices train from models of their own."""
    return community.own_buffers or isinstance(federation.algorithm, StaleStart)


def _start(federation: Federation, state: FederationState, index: int, device: int) -> Vector:
    """What a device trains from: parameters as the algorithm says, and buffers."""
    community, algorithm = federation.communities[index], federation.algorithm
    if not _own_starts(federation, community):
        return state.models[index]
    parameters, buffers = parts_of(community, state.models[index])
    if isinstance(algorithm, StaleStart):
        parameters = algorithm.start(state.algorithm[index], parameters, device)
    if community.own_buffers:
        buffers = state.buffers[index][device]
    return frozen(np.concatenate([parameters, buffers]))
