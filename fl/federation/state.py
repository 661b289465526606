"""What a federation is at between two rounds."""

from collections.abc import Mapping
from dataclasses import dataclass

from fl.arrays import Bools, Floats, Ints, Vector
from fl.federation.algorithms import AlgorithmState
from fl.federation.community import Community
from fl.training.local import LocalResult


@dataclass(frozen=True, eq=False)
class Pending:
    """What a device has made, or is at, and may send in a later round."""

    begun: int  # round whose model it trained from
    start: Vector  # (P + B,) that model as the device had it
    result: LocalResult
    correction: Vector | None = None  # what the algorithm added to its gradients


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
    correct: tuple[Ints, ...]  # validation images each model gets right, (classes,)
    reported: tuple[Ints, ...]  # the same of the images that accuracy is reported on
    # (K_c, B) of each community whose devices keep their buffers; (0, B) where they are averaged.
    # `correct` and `reported` are (K_c, classes) there: each device measures with its own.
    buffers: tuple[Vector, ...]
    pending: tuple[Mapping[int, Pending], ...]  # of each community, by device within it


def parts_of(community: Community, model: Vector) -> tuple[Vector, Vector]:
    """Parameters and buffers of a model."""
    count = model.size - community.network.buffers
    return model[:count], model[count:]
