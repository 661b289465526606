"""The state of a federation between two rounds, and its bytes for a checkpoint.

The bytes are a line of JSON, then the arrays in the .npy format, one after the other; nothing is
pickled. The same state gives the same bytes.
"""

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from fl.arrays import Bools, Floats, Ints, Vector, frozen
from fl.errors import CheckpointError
from fl.federation.algorithms import AlgorithmState
from fl.federation.community import Community, Federation
from fl.training.local import LocalResult

FORMAT = 3
Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Pending:
    """An update that a device has made, or is making, and may send in a later round."""

    begun: int  # round whose model it trained from
    start: Vector  # (P + B,) that model as the device had it
    result: LocalResult
    correction: Vector | None = None  # what the algorithm added to its gradients


@dataclass(frozen=True, eq=False)
class CommunityState:
    """A community's model, the state of its algorithm, and its devices' pending updates."""

    model: Vector  # theta
    algorithm: AlgorithmState
    buffers: Vector  # (K_c, B) where devices keep theirs; (0, B) where they are averaged
    # Validation images of each class that the model gets right, (classes,); (K_c, classes) where
    # devices keep their buffers, as each measures with its own.
    correct: Ints
    reported: Ints  # the same of the images that accuracy is reported on
    pending: Mapping[int, Pending]  # by device


@dataclass(frozen=True, eq=False)
class FederationState:
    """Models, received accuracies and fairness: all that changes from round to round."""

    rounds: int  # played so far
    communities: tuple[CommunityState, ...]
    eps_history: Floats  # (<= l + 1, K) eps_k of the last models, newest last: it goes down next
    eps_received: Floats  # (K,) last eps_k that reached the UAV; NaN: none yet
    cov: Floats  # (C,) psi
    missed: Bools  # (K,) in the last round, as `learning.missed` has it


def parts_of(community: Community, model: Vector) -> tuple[Vector, Vector]:
    """Split a flat model into parameters and buffers."""
    count = model.size - community.network.buffers
    return model[:count], model[count:]


_SHARED = ("eps_history", "eps_received", "cov", "missed")
_OWN = ("model", "buffers", "correct", "reported")


def to_bytes(federation: Federation, state: FederationState) -> bytes:
    """Serialise the whole state for a checkpoint; a few times the size of the models."""
    arrays = {key: getattr(state, key) for key in _SHARED}
    for index, community in enumerate(state.communities):
        arrays |= {f"{index}/{key}": value for key, value in _arrays_of(community).items()}
    header = {
        "format": FORMAT,
        "rounds": state.rounds,
        "federation": federation.fingerprint,
        "arrays": list(arrays),
    }
    out = io.BytesIO()
    out.write(json.dumps(header).encode() + b"\n")
    for array in arrays.values():
        npy.write_array(out, np.asarray(array, order="C"), allow_pickle=False)
    return out.getvalue()


def from_bytes(federation: Federation, data: bytes) -> FederationState:
    """The state that `to_bytes` wrote for the same federation; `CheckpointError` otherwise."""
    source = io.BytesIO(data)
    try:
        header = json.loads(source.readline())
        if header["format"] != FORMAT:
            raise CheckpointError(f"format {header['format']}, this program reads {FORMAT}")
        if header["federation"] != federation.fingerprint:
            raise CheckpointError("written with other data, devices, networks or algorithm")
        arrays: dict[str, NDArray[Any]] = {}
        for key in header["arrays"]:
            arrays[key] = frozen(npy.read_array(source, allow_pickle=False))
        communities = tuple(
            _community_of(_within(arrays, f"{index}/"))
            for index in range(len(federation.communities))
        )
        shared = {key: arrays[key] for key in _SHARED}
        return FederationState(int(header["rounds"]), communities, **shared)
    except (ValueError, KeyError, TypeError, EOFError) as error:
        raise CheckpointError(f"damaged: {error!r}") from error


def _arrays_of(community: CommunityState) -> Arrays:
    arrays = {key: getattr(community, key) for key in _OWN}
    arrays |= {f"algorithm/{key}": value for key, value in community.algorithm.items()}
    for device, made in community.pending.items():
        result = made.result
        arrays[f"pending/{device}"] = np.stack((made.start, result.model))
        arrays[f"told/{device}"] = np.array((made.begun, result.steps, result.loss), np.float64)
        if made.correction is not None:
            arrays[f"correction/{device}"] = made.correction
    return arrays


def _community_of(arrays: Arrays) -> CommunityState:
    pending = {}
    for device, (start, model) in _within(arrays, "pending/").items():
        begun, steps, loss = arrays[f"told/{device}"].tolist()
        result = LocalResult(model, int(steps), loss)
        added = arrays.get(f"correction/{device}")
        pending[int(device)] = Pending(int(begun), start, result, added)
    own = {key: arrays[key] for key in _OWN}
    return CommunityState(**own, algorithm=_within(arrays, "algorithm/"), pending=pending)


def _within(arrays: Arrays, folder: str) -> Arrays:
    """The arrays whose keys begin with `folder`, by their keys without it."""
    return {key.removeprefix(folder): v for key, v in arrays.items() if key.startswith(folder)}
