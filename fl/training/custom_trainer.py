"""A researcher's own local training, held to what every device sends up."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fl.arrays import Vector, frozen
from fl.config import LearningConfig
from fl.errors import kind_of
from fl.plugins import PluginError, guarded, make
from fl.training.local import LocalResult, LocalSettings, LocalTask, Shapes

KEY = "learning.trainer"


@dataclass(frozen=True, eq=False)
class TrainingDevice:
    """Who trains, and how it is asked to."""

    community: str
    device: int  # within its community, from 0
    round: int  # from 1
    shapes: Shapes  # of the model's parameters, then buffers, in the order of the flat vector
    classes: int
    settings: LocalSettings
    correction: Vector | None  # (P,) what the algorithm adds to every gradient; None for nothing


@dataclass(frozen=True, eq=False)
class DeviceData:
    """The samples of a device as the network gets them: each channel scaled to mean 0, variance 1
    over the community's training samples. Features are channels of one pixel."""

    x: NDArray[np.float32]  # (n, channels, height, width)
    y: NDArray[np.int64]  # (n,) classes from 0


class Trainer(Protocol):
    """Trains a device from a model; what it sends up is a function of the arguments alone."""

    def train(
        self, device: TrainingDevice, model: Vector, data: DeviceData, rng: np.random.Generator
    ) -> LocalResult:
        """The model (P,) after local training, the steps taken, 1 or more, and the mean loss.

        `model` (P,) is read-only. `rng` is the device's own stream of this round: all that is
        random must come from it. One call at a time.
        """


@dataclass(frozen=True)
class CustomTrainer:
    """Checks what the researcher's trainer answers: an error is found where it is made."""

    name: str
    inner: Trainer = field(repr=False)  # a fingerprint is made of the rest

    def train(self, device: TrainingDevice, task: LocalTask) -> LocalResult:
        """The researcher's training of one device.

        Raises:
            PluginError: it fails, or gives something else than a result of finite numbers.
        """
        model, data, doing = task.model, _data(task), f"train() of device {device.device}"
        with guarded(self.name, key=KEY, doing=doing):
            found = self.inner.train(device, model, data, task.rng)
        if not isinstance(found, LocalResult):
            raise PluginError(KEY, self.name, f"{doing} gives {kind_of(found)}, not a LocalResult")
        with guarded(self.name, key=KEY, doing=f"{doing}: the result that it gives"):
            sent = np.array(found.model, dtype=np.float32)
            steps, loss = int(found.steps), float(found.loss)
        if sent.shape != model.shape:
            reason = f"{doing} gives a model of shape {sent.shape}, not {model.shape}"
            raise PluginError(KEY, self.name, reason)
        if steps < 1:
            raise PluginError(KEY, self.name, f"{doing} gives {steps} steps: must be 1 or more")
        if not (np.isfinite(loss) and np.isfinite(sent).all()):
            reason = (
                f"{doing} in round {device.round} left the finite numbers (mean loss {loss:.3g}); "
                "a smaller learning rate may help"
            )
            raise PluginError(KEY, self.name, reason)
        return LocalResult(frozen(sent), steps, loss)


def make_trainer(learning: LearningConfig) -> CustomTrainer | None:
    """The trainer that the settings name; None for ours.

    Raises:
        PluginError: it cannot be imported, or what it makes is no trainer.
    """
    name = learning.trainer
    if name is None:
        return None
    return CustomTrainer(name, make(name, learning, key=KEY, members=("train",)))


def _data(task: LocalTask) -> DeviceData:
    images = task.split.images[task.samples].astype(np.float32)
    scaled = images * task.scaling.scale + task.scaling.shift
    x = np.ascontiguousarray(np.moveaxis(scaled, -1, 1))
    return DeviceData(frozen(x), frozen(task.split.labels[task.samples]))
