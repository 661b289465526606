"""Plug-in federated algorithms (`learning.algorithm`), whose answers are checked."""

from collections.abc import Mapping, Sequence

import numpy as np

from aerofed_errors import kind_of
from fl.arrays import Vector
from fl.config import LearningConfig
from fl.federation.algorithms import (
    Algorithm,
    AlgorithmState,
    StaleStart,
    Update,
    built_in_algorithm,
)
from fl.plugins import PlugIn


class CustomAlgorithm(PlugIn):
    """A plug-in `Algorithm` whose answers are checked as they are given."""

    setting = "learning.algorithm"
    members = ("mu", "momentum", "init", "correction", "apply")

    @property
    def mu(self) -> float:
        """Weight of the proximal term, as `Algorithm.mu`."""
        return float(self.array(self.value("mu"), "mu", shape=(), low=0.0, high=100.0))

    @property
    def momentum(self) -> float:
        """Momentum of the local SGD, as `Algorithm.momentum`."""
        given = float(self.array(self.value("momentum"), "momentum", shape=(), low=0.0, high=1.0))
        if given == 1.0:
            self.refuse("momentum is 1.0: must be below 1")
        return given

    def init(self, model: Vector, devices: int) -> AlgorithmState:
        """Return a community's first state, as `Algorithm.init`."""
        return self._state(self.ask("init", model, devices), "init()")

    def correction(self, state: AlgorithmState, device: int) -> Vector | None:
        """Return what a device adds to its gradients, or None, as `Algorithm.correction`."""
        of = f" of device {device}"
        found = self.ask("correction", state, device, of=of)
        if found is None:
            return None
        return self.array(found, f"what correction(){of} gives", dtype=np.float32)

    def apply(
        self, state: AlgorithmState, model: Vector, updates: Sequence[Update]
    ) -> tuple[Vector, AlgorithmState]:
        """Return the next model and state, as `Algorithm.apply`."""
        found = self.of_kind(self.ask("apply", state, model, updates), tuple, "apply()")
        if len(found) != 2:
            self.refuse(f"apply() gives {len(found)} things, not the two of model and state")
        return self._model(found[0], model, "apply()"), self._state(found[1], "apply()")

    def _model(self, found: object, model: Vector, doing: str) -> Vector:
        what = f"the model that {doing} gives"
        return self.array(found, what, shape=model.shape, dtype=np.float32)

    def _state(self, found: object, doing: str) -> AlgorithmState:
        if not isinstance(found, Mapping):
            self.refuse(f"{doing} gives {kind_of(found)} as its state, not a dictionary of arrays")
        return {
            str(key): self.array(value, f"{key!r} in the state of {doing}", dtype=np.float32)
            for key, value in found.items()
        }


class CustomStaleAlgorithm(CustomAlgorithm):
    """A `CustomAlgorithm` that is also a `StaleStart`: devices may train from older models."""

    def start(self, state: AlgorithmState, model: Vector, device: int) -> Vector:
        """Return the model (P,) that a device trains from, as `StaleStart.start`."""
        of = f" of device {device}"
        return self._model(self.ask("start", state, model, device, of=of), model, f"start(){of}")


def make_algorithm(learning: LearningConfig) -> Algorithm:
    """The algorithm that the settings name: a built-in one, or what a factory makes of them.

    Raises:
        UsersCodeError: it cannot be imported, or what it makes is no algorithm.
    """
    built_in = built_in_algorithm(learning)
    if built_in is not None:
        return built_in
    found = CustomAlgorithm.made(learning.algorithm, learning)
    if isinstance(found.inner, StaleStart):
        found = CustomStaleAlgorithm(found.name, found.inner)
    _ = found.mu, found.momentum
    return found
