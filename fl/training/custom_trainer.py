"""Local training by a researcher's own code (`learning.trainer`), its results checked."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fl.arrays import Vector
from fl.config import LearningConfig
from fl.plugins import PlugIn
from fl.training.local import LocalResult, LocalSettings, LocalTask, Shapes


@dataclass(frozen=True, eq=False)
class TrainingDevice:
    """A device to be trained in one round, the shapes of its model and the training settings."""

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
    """Local training of one device, whose result must be a function of the arguments alone."""

    def train(
        self, device: TrainingDevice, model: Vector, data: DeviceData, rng: np.random.Generator
    ) -> LocalResult:
        """The model (P,) after local training, the steps taken, 1 or more, and the mean loss.

        `model` (P,) is read-only. `rng` is the device's own stream of this round: all that is
        random must come from it. One call at a time.
        """


class CustomTrainer(PlugIn):
    """A plug-in `Trainer` whose results are checked for type, shape and finite numbers."""

    setting = "learning.trainer"
    members = ("train",)

    def train(self, device: TrainingDevice, task: LocalTask) -> LocalResult:
        """Train one device with the researcher's code.

        Raises:
            UsersCodeError: it fails, or gives something else than a result of finite numbers.
        """
        of = f" of device {device.device} in round {device.round}"
        found = self.ask("train", device, task.model, _data(task), task.rng, of=of)
        result = self.of_kind(found, LocalResult, f"train(){of}")
        what, shape = f"that train(){of} gives", task.model.shape
        model = self.array(result.model, f"the model {what}", shape=shape, dtype=np.float32)
        steps = self.array(result.steps, f"the number of steps {what}", shape=(), low=1)
        loss = self.array(result.loss, f"the loss {what}", shape=())
        return LocalResult(model, int(steps), float(loss))


def make_trainer(learning: LearningConfig) -> CustomTrainer | None:
    """Return the trainer that `learning.trainer` names; None for the built-in training.

    Raises:
        UsersCodeError: it cannot be imported, or what it makes is no trainer.
    """
    return None if learning.trainer is None else CustomTrainer.made(learning.trainer, learning)


def _data(task: LocalTask) -> DeviceData:
    images = task.split.images[task.samples].astype(np.float32)
    scaled = images * task.scaling.scale + task.scaling.shift
    return DeviceData(
        np.ascontiguousarray(np.moveaxis(scaled, -1, 1)), task.split.labels[task.samples]
    )
