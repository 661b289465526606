"""Local training: the protocol of networks, their tasks and results, scaling and batches; and of a
researcher's own trainer (`learning.trainer`), whose results are checked."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from fl.arrays import Vector
from fl.config import LearningConfig
from fl.data.dataset import Split
from fl.plugins import PlugIn

Shapes = tuple[tuple[int, ...], ...]
Result = TypeVar("Result")


@dataclass(frozen=True)
class Scaling:
    """Normalisation of pixels, by channel: the network sees scale * pixel + shift."""

    scale: NDArray[np.float32]  # (channels,)
    shift: NDArray[np.float32]


@dataclass(frozen=True)
class LocalSettings:
    """Hyperparameters of the local SGD."""

    learning_rate: float
    momentum: float
    mu: float  # weight of mu/2 |w - w_global|^2
    batch_size: int
    epochs: int


@dataclass(frozen=True, eq=False)
class LocalTask:
    """Local training of one device in one round."""

    split: Split  # training images of the whole task
    samples: NDArray[np.int64]  # of them, those that the device owns
    scaling: Scaling
    model: Vector  # (P,) that it begins from
    settings: LocalSettings
    rng: np.random.Generator  # the device's own stream of this round
    correction: Vector | None = None  # (P,) added to every gradient (control variates)


@dataclass(frozen=True)
class LocalResult:
    """A device's update: its model after local training."""

    model: Vector
    steps: int
    loss: float  # mean over its steps, without the proximal term


class Network(Protocol):
    """A network architecture with its training and evaluation, as the federation uses it."""

    @property
    def shapes(self) -> Shapes:
        """Shapes of parameters, then buffers, in the order in which they lie in the flat vector."""

    @property
    def buffers(self) -> int:
        """Number of buffer values, which end the flat vector and are set by training."""

    @property
    def parallel(self) -> bool:
        """Whether several threads may call it at a time."""

    def initial(self, rng: np.random.Generator) -> Vector:
        """Draw the initial model from `rng` alone: one flat vector, parameters, then buffers."""

    def train(self, task: LocalTask) -> LocalResult:
        """Train by SGD with momentum on the mean cross-entropy of each batch plus
        mu/2 |w - model|^2, in the batches of `batch_order`, on one core."""

    def correct_per_class(
        self, split: Split, model: Vector, *, scaling: Scaling
    ) -> NDArray[np.int64]:
        """How many images of each class one model gets right, (classes,)."""


def scaling_of(split: Split) -> Scaling:
    """Return the scaling to zero mean and unit variance per channel over a split.

    The deviation of images is a thousandth of their range at least. A variance of features (images
    of one pixel) that is lost in the rounding of their mean counts as 1.
    """
    _, height, width, channels = split.images.shape
    unit = 255.0 if split.images.dtype == np.uint8 else 1.0
    rows = split.images.reshape(len(split.images), -1)
    total = np.zeros(rows.shape[1])
    squares = np.zeros(rows.shape[1])
    for start in range(0, len(rows), 256):
        part = rows[start : start + 256].astype(np.float64)
        total += part.sum(axis=0)
        squares += np.einsum("ij,ij->j", part, part)
    total, squares = (x.reshape(-1, channels).sum(axis=0) for x in (total, squares))
    count = split.images.size // channels
    mean = total / count
    variance = squares / count - mean**2
    if height == width == 1:
        deviation = np.sqrt(np.where(variance > 1e-14 * mean**2, variance, 1.0))
    else:
        deviation = np.sqrt(np.maximum(variance, (1e-3 * unit) ** 2))
    return Scaling((1.0 / deviation).astype(np.float32), (-mean / deviation).astype(np.float32))


def batch_order(task: LocalTask) -> NDArray[np.int64]:
    """Return sample indices (steps, batch), shuffled in each epoch; -1 pads its last batch."""
    size = min(task.settings.batch_size, len(task.samples))
    steps = -(-len(task.samples) // size)
    epochs = []
    for _ in range(task.settings.epochs):
        order = np.full(steps * size, -1, dtype=np.int64)
        order[: len(task.samples)] = task.rng.permutation(task.samples)
        epochs.append(order.reshape(steps, size))
    return np.concatenate(epochs)


def in_parallel(jobs: Sequence[Callable[[], Result]], *, workers: int) -> list[Result]:
    """Run `jobs` in up to `workers` threads, and return their results in order."""
    if workers <= 1 or len(jobs) <= 1:
        return [job() for job in jobs]
    with ThreadPoolExecutor(min(workers, len(jobs))) as pool:
        try:
            return [future.result() for future in [pool.submit(job) for job in jobs]]
        except BaseException:
            # Ctrl-C waits for what is under way, not for what nobody will ask for.
            pool.shutdown(wait=False, cancel_futures=True)
            raise


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
        trained = self.ask("train", device, task.model, _data(task), task.rng, of=of)
        result = self.of_kind(trained, LocalResult, f"train(){of}")
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
