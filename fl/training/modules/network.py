"""A torch module as a network: on one thread of the processor, or on a GPU."""

import logging
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from fl.arrays import Vector
from fl.data.dataset import Split
from fl.errors import first_line
from fl.plugins import FAILURES
from fl.training.local import (
    LocalResult,
    LocalSettings,
    LocalTask,
    LocalWork,
    Scaling,
    Shapes,
    scaling_of,
)
from fl.training.modules.alone import OneByOne, images_of, take
from fl.training.modules.repeatable import own_randomness, repeatable
from fl.training.modules.statistics import Statistics
from fl.training.modules.users import Factory, built, check_answer, made

logger = logging.getLogger(__name__)

EVALUATION_BATCH = 250
# Devices in lockstep at most: a GPU holds some five times as many copies of the parameters.
MOST_SLOTS = 32
# Of the way that one trial step goes, alone and in lockstep: sums in another order differ by less.
TRIAL_TOLERANCE = 1e-3


class Training(Protocol):
    """How the devices of a round are trained."""

    def train(self, work: LocalWork) -> list[LocalResult]:
        """As `fl.training.local.Network.train`, with the module in training mode."""


class ModuleNetwork:
    """A `torch.nn.Module`, called with images (batch, channels, height, width).

    A community's `devices` train one by one on the processor, where that is faster, and in
    `lockstep` on a GPU. A module that cannot train so is found out by a trial; its devices train
    one by one. `NetworkError` says why a module cannot be used at all.
    """

    parallel = False  # the module holds the weights, and torch has one generator

    def __init__(
        self,
        factory: Factory,
        *,
        name: str,
        image_shape: tuple[int, int, int],
        classes: int,
        device: str = "cpu",
        devices: int = 1,
        lockstep: bool | None = None,
    ) -> None:
        self._factory = factory
        self._classes = classes
        self._device = torch.device(device)
        height, width, channels = image_shape
        self._images = torch.zeros(2, channels, height, width)
        self._module = built(factory, self._images, name=name).to(self._device)
        self._parameters = list(self._module.parameters())
        self._statistics = Statistics(self._module)
        check_answer(self._module, self._images.to(self._device), name=name, classes=classes)
        alone = OneByOne(self._module, self._device)
        self._training: Training = alone
        # Buffers change within a step, which no module shares between devices.
        if not self.buffers and (lockstep or (lockstep is None and device == "cuda")):
            # Imported here: experimental, and no other path has any of it.
            from fl.training.modules.lockstep import Lockstep

            together = Lockstep(self._module, self._device, slots=min(devices, MOST_SLOTS))
            reason = self._trial(alone, together, image_shape)
            if reason is None:
                self._training = together
            else:
                logger.warning("network %s: devices train one by one: %s", name, reason)

    @property
    def lockstep(self) -> bool:
        """Whether devices take their steps together."""
        return not isinstance(self._training, OneByOne)

    @property
    def shapes(self) -> Shapes:
        """Shapes in the order of `named_parameters`, then of `buffers`."""
        return tuple(tuple(value.shape) for value in self._parameters) + self._statistics.shapes

    @property
    def buffers(self) -> int:
        """How many numbers the module's buffers hold."""
        return self._statistics.size

    def initial(self, rng: np.random.Generator) -> Vector:
        """The module's own initialisation, with torch's generator seeded from `rng`."""
        with own_randomness(rng, self._device):
            module = made(self._factory, self._images)
        values = [value.detach().reshape(-1).numpy() for value in module.parameters()]
        return np.concatenate([*values, Statistics(module).read()])

    def train(self, work: LocalWork) -> list[LocalResult]:
        """As `fl.training.local.Network.train`."""
        self._module.train()
        with repeatable():
            return self._training.train(work)

    def correct_per_class(
        self, split: Split, model: Vector, *, scaling: Scaling
    ) -> NDArray[np.int64]:
        """How many images of each class the model gets right, (classes,)."""
        correct = np.zeros(self._classes, dtype=np.int64)
        parameters, buffers = np.split(model, [model.size - self.buffers])
        take(self._parameters, torch.tensor(parameters, device=self._device))
        self._statistics.write(buffers)
        self._module.eval()
        with repeatable(), torch.inference_mode():
            for start in range(0, len(split.labels), EVALUATION_BATCH):
                part = np.arange(start, min(start + EVALUATION_BATCH, len(split.labels)))
                logits = self._module(images_of(split, part, scaling, self._device))
                guess = logits.argmax(dim=1).cpu().numpy()
                right = split.labels[part][guess == split.labels[part]]
                correct += np.bincount(right, minlength=self._classes)
        return correct

    def _trial(
        self, alone: Training, together: Training, image_shape: tuple[int, int, int]
    ) -> str | None:
        """Why devices cannot train in lockstep; None where that makes the same of them."""
        rng = np.random.Generator(np.random.PCG64(0))
        images = rng.integers(0, 256, (8, *image_shape)).astype(np.uint8)
        split = Split(images, np.arange(8) % self._classes)
        scaling = scaling_of(split)
        settings = LocalSettings(0.01, 0.9, 0.0, batch_size=3, epochs=1)
        start = self.initial(rng)

        def models(training: Training) -> list[Vector]:
            # Batches of three and two, and of three: one is filled up, and one device waits.
            tasks = [
                LocalTask(samples, np.random.Generator(np.random.PCG64(0)))
                for samples in (np.arange(5), np.arange(5, 8))
            ]
            results = training.train(LocalWork(split, start, tasks, scaling, settings))
            return [result.model for result in results]

        self._module.train()
        try:
            with repeatable():
                pairs = zip(models(alone), models(together), strict=True)
        except FAILURES as error:
            return first_line(error)
        for one, other in pairs:
            if not np.linalg.norm(one - other) <= TRIAL_TOLERANCE * np.linalg.norm(one - start):
                return "samples that fill up a batch change what the others do"
        return None
