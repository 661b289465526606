"""Federated algorithms: corrections of the devices' gradients, and aggregation of their updates.

Each is `init(model, devices) -> state` and `apply(state, model, updates) -> (model, state)`,
pure functions of numpy vectors; where and how the devices train is no concern of theirs. A
community without an arrival keeps model and state. Answers of a researcher's own algorithm
(`learning.algorithm`) are checked as they are given.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from fl.arrays import Vector, frozen
from fl.config import LearningConfig
from fl.plugins import PlugIn
from native.errors import kind_of

AlgorithmState = Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class Update:
    """An update that arrived from one device, and how it was trained."""

    device: int  # within its community, from 0
    p: float  # p_k in (0, 1], its share of the community's data
    model: Vector  # (P,) its parameters after local training
    steps: int  # local SGD steps that it took, 1 or more
    start: Vector  # (P,) parameters that it trained from
    staleness: int = 0  # rounds since they came down; 0: in this very round
    correction: Vector | None = None  # (P,) what was added to each of its gradients


class Algorithm(Protocol):
    """A federated algorithm: corrections of the devices' gradients, and aggregation of updates.

    A model is its P parameters as one vector (P,) of float32, in the order in which torch lists
    them. A state is a dictionary of float32 arrays of any shapes; with it a run is resumed, so the
    methods may depend on their arguments alone. Arrays that are handed in are read-only.
    """

    @property
    def mu(self) -> float:
        """Weight mu of mu/2 |w - w_start|^2 in the local objective; 0 for none."""

    @property
    def momentum(self) -> float:
        """Momentum of the local SGD, in [0, 1)."""

    def init(self, model: Vector, devices: int) -> AlgorithmState:
        """The state of a community before the first round; `model` (P,), `devices` K_c."""

    def correction(self, state: AlgorithmState, device: int) -> Vector | None:
        """What a device adds to each of its gradients, (P,); None for nothing."""

    def apply(
        self, state: AlgorithmState, model: Vector, updates: Sequence[Update]
    ) -> tuple[Vector, AlgorithmState]:
        """The next global model (P,) and state from the updates that arrived.

        Participation is partial: `updates` are those of this round alone, in order of device, at
        least one. Where none arrives, it is not called.
        """


@runtime_checkable
class StaleStart(Protocol):
    """Optional part of an `Algorithm` whose devices may train from older models."""

    def start(self, state: AlgorithmState, model: Vector, device: int) -> Vector:
        """Return the model (P,) a device trains from, such as the last it got, kept in `state`."""


@dataclass(frozen=True, kw_only=True)
class FedAvg:
    """Federated averaging, weighted by p_k; with mu > 0 in local training this is FedProx.

    McMahan et al. 2017; Li et al. 2020 (FedProx).
    """

    momentum: float
    mu: float = 0.0

    def init(self, model: Vector, devices: int) -> AlgorithmState:  # noqa: ARG002  # protocol
        """Return an empty state."""
        return {}

    def correction(self, state: AlgorithmState, device: int) -> Vector | None:  # noqa: ARG002
        """Return None: nothing is added to the gradients."""
        return None

    def apply(
        self, state: AlgorithmState, model: Vector, updates: Sequence[Update]
    ) -> tuple[Vector, AlgorithmState]:
        """Return theta + sum p_k (theta_k - theta) / sum p_k over the arrivals, and the state."""
        return _moved(model, mean_step(model, updates)), state


@dataclass(frozen=True, kw_only=True)
class FedAvgM(FedAvg):
    """Averaging with server momentum: v' = beta v + step, theta' = theta + eta v'.

    Hsu, Qi, Brown 2019.
    """

    server_learning_rate: float
    server_momentum: float

    def init(self, model: Vector, devices: int) -> AlgorithmState:  # noqa: ARG002  # protocol
        """Return the state with velocity 0."""
        return {"velocity": np.zeros_like(model)}

    def apply(
        self, state: AlgorithmState, model: Vector, updates: Sequence[Update]
    ) -> tuple[Vector, AlgorithmState]:
        """Take a step of server momentum (heavy ball) along the mean update."""
        velocity = self.server_momentum * state["velocity"] + mean_step(model, updates)
        moved = _moved(model, self.server_learning_rate * velocity)
        return moved, {"velocity": velocity.astype(np.float32)}


@dataclass(frozen=True, kw_only=True)
class FedAdam(FedAvg):
    """Adam on the server, the mean update as its gradient, without bias correction.

    m' = b1 m + (1 - b1) step, v' = b2 v + (1 - b2) step^2, theta' = theta + eta m' / (sqrt v' +
    tau), from v = tau^2. Reddi et al. 2021.
    """

    server_learning_rate: float
    beta1: float
    beta2: float
    tau: float

    def init(self, model: Vector, devices: int) -> AlgorithmState:  # noqa: ARG002  # protocol
        """Return the state with first moment 0 and second moment tau^2."""
        return {
            "first_moment": np.zeros_like(model),
            "second_moment": np.full_like(model, self.tau**2),
        }

    def apply(
        self, state: AlgorithmState, model: Vector, updates: Sequence[Update]
    ) -> tuple[Vector, AlgorithmState]:
        """Take a step of Adam along the mean update."""
        step = mean_step(model, updates)
        first = self.beta1 * state["first_moment"] + (1.0 - self.beta1) * step
        second = self.beta2 * state["second_moment"] + (1.0 - self.beta2) * np.square(step)
        moved = _moved(model, self.server_learning_rate * first / (np.sqrt(second) + self.tau))
        return moved, {
            "first_moment": first.astype(np.float32),
            "second_moment": second.astype(np.float32),
        }


@dataclass(frozen=True)
class Scaffold:
    """Control variates against client drift: every gradient gets c - c_k added.

    After training c_k' = c_k - c + (theta - theta_k) / (steps eta_local), theta' = theta +
    eta times the mean update, c' = c + sum p_k (c_k' - c_k) over the arrivals, which keeps
    c = sum p_k c_k. Karimireddy et al. 2020, option II, for plain local SGD. In c_k' of a stale
    update theta and c are those that the device began with: c_k' is the mean of its gradients.
    """

    learning_rate: float
    server_learning_rate: float
    momentum: float = 0.0
    mu: float = 0.0

    def init(self, model: Vector, devices: int) -> AlgorithmState:
        """Return the state with all control variates 0."""
        return {
            "control": np.zeros_like(model),
            "device_controls": np.zeros((devices, model.size), dtype=np.float32),
        }

    def correction(self, state: AlgorithmState, device: int) -> Vector | None:
        """Return the difference of the control variates, c - c_k, (P,)."""
        return np.asarray(state["control"] - state["device_controls"][device], dtype=np.float32)

    def apply(
        self, state: AlgorithmState, model: Vector, updates: Sequence[Update]
    ) -> tuple[Vector, AlgorithmState]:
        """Apply the mean update, and update the control variates of the devices that arrived."""
        control = state["control"].astype(np.float64)
        controls = state["device_controls"].copy()
        drift = np.zeros(model.size)
        for update in updates:
            way = update.start - update.model.astype(np.float64)
            slope = way / (update.steps * self.learning_rate)
            used = control
            if update.staleness and update.correction is not None:
                used = update.correction + controls[update.device].astype(np.float64)
            change = slope - used
            controls[update.device] = controls[update.device] + change
            drift += update.p * change
        moved = _moved(model, self.server_learning_rate * mean_step(model, updates))
        return moved, {"control": (control + drift).astype(np.float32), "device_controls": controls}


def mean_step(model: Vector, updates: Sequence[Update]) -> NDArray[np.float64]:
    """Return the mean update sum p_k (theta_k - theta) / sum p_k over the arrivals, in float64."""
    step = np.zeros(model.size)
    for update in updates:
        step += update.p * (update.model.astype(np.float64) - model)
    return np.asarray(step / sum(update.p for update in updates), dtype=np.float64)


def built_in_algorithm(learning: LearningConfig) -> Algorithm | None:
    """Return the built-in algorithm that the settings name, or None; server rates have defaults."""
    rate = learning.server_learning_rate
    match learning.algorithm:
        case "fedprox":
            return FedAvg(momentum=learning.momentum, mu=learning.mu)
        case "fedavg":
            return FedAvg(momentum=learning.momentum)
        case "fedavgm":
            return FedAvgM(
                momentum=learning.momentum,
                server_learning_rate=1.0 if rate is None else rate,
                server_momentum=learning.server_momentum,
            )
        case "fedadam":
            return FedAdam(
                momentum=learning.momentum,
                server_learning_rate=0.01 if rate is None else rate,
                beta1=learning.server_momentum,
                beta2=learning.server_beta2,
                tau=learning.server_tau,
            )
        case "scaffold":
            return Scaffold(
                learning_rate=learning.learning_rate,
                server_learning_rate=1.0 if rate is None else rate,
            )
        case _:
            return None


def _moved(model: Vector, step: NDArray[np.float64]) -> Vector:
    return frozen((model + step).astype(np.float32))


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
        correction = self.ask("correction", state, device, of=of)
        if correction is None:
            return None
        return self.array(correction, f"what correction(){of} gives", dtype=np.float32)

    def apply(
        self, state: AlgorithmState, model: Vector, updates: Sequence[Update]
    ) -> tuple[Vector, AlgorithmState]:
        """Return the next model and state, as `Algorithm.apply`."""
        answer = self.of_kind(self.ask("apply", state, model, updates), tuple, "apply()")
        if len(answer) != 2:
            self.refuse(f"apply() gives {len(answer)} things, not the two of model and state")
        return self._model(answer[0], model, "apply()"), self._state(answer[1], "apply()")

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
    custom = CustomAlgorithm.made(learning.algorithm, learning)
    if isinstance(custom.inner, StaleStart):
        custom = CustomStaleAlgorithm(custom.name, custom.inner)
    _ = custom.mu, custom.momentum
    return custom
