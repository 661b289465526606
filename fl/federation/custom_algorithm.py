"""A researcher's own federated algorithm, held to what every algorithm must keep."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np

from fl.arrays import Vector, frozen
from fl.config import LearningConfig
from fl.errors import kind_of
from fl.federation.algorithms import (
    Algorithm,
    AlgorithmState,
    StaleStart,
    Update,
    built_in_algorithm,
)
from fl.plugins import PluginError, guarded, make

KEY = "learning.algorithm"
MEMBERS = ("mu", "momentum", "init", "correction", "apply")


@dataclass(frozen=True)
class CustomAlgorithm:
    """Checks what the researcher's algorithm answers: an error is found where it is made."""

    name: str
    inner: Algorithm = field(repr=False)  # a fingerprint is made of the rest

    @property
    def mu(self) -> float:
        """What the researcher's algorithm says."""
        return self._number("mu", 0.0, 100.0)

    @property
    def momentum(self) -> float:
        """What the researcher's algorithm says."""
        return self._number("momentum", 0.0, 1.0)

    def init(self, model: Vector, devices: int) -> AlgorithmState:
        """The researcher's state before the first round, as float32 arrays."""
        with guarded(self.name, key=KEY, doing="init()"):
            state = self.inner.init(model, devices)
        return self._state(state, "init()")

    def correction(self, state: AlgorithmState, device: int) -> Vector | None:
        """The researcher's correction; refused where it is not finite."""
        doing = f"correction() of device {device}"
        with guarded(self.name, key=KEY, doing=doing):
            found = self.inner.correction(state, device)
            correction = None if found is None else np.ascontiguousarray(found, dtype=np.float32)
        if correction is not None and not np.isfinite(correction).all():
            self._refuse(f"{doing} gives values that are not finite")
        return correction

    def apply(
        self, state: AlgorithmState, model: Vector, updates: Sequence[Update]
    ) -> tuple[Vector, AlgorithmState]:
        """The researcher's next model and state."""
        with guarded(self.name, key=KEY, doing="apply()"):
            found: object = self.inner.apply(state, model, updates)
        if not isinstance(found, tuple) or len(found) != 2:
            self._refuse(f"apply() gives {kind_of(found)}, not the two of model and state")
        after, kept = found
        return self._model(after, model, "apply()"), self._state(kept, "apply()")

    def _number(self, member: str, low: float, high: float) -> float:
        with guarded(self.name, key=KEY, doing=member):
            value = float(getattr(self.inner, member))
        if not low <= value <= high:
            self._refuse(f"{member} is {value}: must be from {low:g} to {high:g}")
        return value

    def _model(self, found: object, model: Vector, doing: str) -> Vector:
        with guarded(self.name, key=KEY, doing=f"{doing}: the model that it gives"):
            after = np.array(found, dtype=np.float32)
        if after.shape != model.shape:
            self._refuse(f"{doing} gives a model of shape {after.shape}, not {model.shape}")
        if not np.isfinite(after).all():
            self._refuse(f"{doing} gives a model with values that are not finite")
        return frozen(after)

    def _state(self, state: object, doing: str) -> AlgorithmState:
        if not isinstance(state, Mapping):
            self._refuse(
                f"{doing} gives a {type(state).__name__} as its state, not a dictionary of arrays"
            )
        with guarded(self.name, key=KEY, doing=f"{doing}: the state that it gives"):
            kept = {str(key): np.array(value, dtype=np.float32) for key, value in state.items()}
        for name, value in kept.items():
            if not np.isfinite(value).all():
                self._refuse(f"{doing} gives a state with values that are not finite: {name}")
            frozen(value)  # as it will be when a run is resumed
        return kept

    def _refuse(self, reason: str) -> NoReturn:
        raise PluginError(KEY, self.name, reason)


@dataclass(frozen=True)
class CustomStaleAlgorithm(CustomAlgorithm):
    """One whose devices train from models of their own, which may be old."""

    def start(self, state: AlgorithmState, model: Vector, device: int) -> Vector:
        """The researcher's start of a device."""
        assert isinstance(self.inner, StaleStart)
        doing = f"start() of device {device}"
        with guarded(self.name, key=KEY, doing=doing):
            found = self.inner.start(state, model, device)
        return self._model(found, model, doing)


def make_algorithm(learning: LearningConfig) -> Algorithm:
    """The algorithm that the settings name: a built-in one, or what a factory makes of them.

    Raises:
        PluginError: it cannot be imported, or what it makes is no algorithm.
    """
    built_in = built_in_algorithm(learning)
    if built_in is not None:
        return built_in
    name = learning.algorithm
    made = make(name, learning, key=KEY, members=MEMBERS)
    kind = CustomStaleAlgorithm if isinstance(made, StaleStart) else CustomAlgorithm
    found = kind(name, made)
    _ = found.mu, found.momentum
    return found
