"""LeNet-size networks and McMahan's CNN, trained by native code (`fl.native`)."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fl.data.dataset import Split
from fl.native.library import Images, Network, count_correct, train
from fl.training.local import (
    LocalResult,
    LocalSettings,
    LocalTask,
    Scaling,
    Shapes,
    Vector,
    batch_order,
)

KERNEL = 5


@dataclass(frozen=True)
class ConvNet:
    """Two (5x5 convolution, 2x2 max-pooling, ReLU) blocks, then dense layers with ReLU between.

    Parameters and their order are those of torch's modules: weights (out, in, 5, 5) or
    (out, in), then biases; pooled maps are flattened as (channel, height, width).
    """

    image_shape: tuple[int, int, int]  # height, width, channels
    channels: tuple[int, int]
    padding: tuple[int, int]
    hidden: tuple[int, ...]
    classes: int

    parallel = True

    @property
    def pooled(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """(height, width) of the maps after either block."""
        height, width = self.image_shape[:2]
        sizes = []
        for pad in self.padding:
            height, width = ((n + 2 * pad - KERNEL + 1) // 2 for n in (height, width))
            sizes.append((height, width))
        return sizes[0], sizes[1]

    @property
    def widths(self) -> tuple[int, ...]:
        """Of the flattened maps, the hidden layers, the logits."""
        return math.prod(self.pooled[1]) * self.channels[1], *self.hidden, self.classes

    @property
    def shapes(self) -> Shapes:
        """Weight and bias of each layer in turn."""
        depths = (self.image_shape[2], *self.channels)
        weights: list[tuple[int, ...]] = [
            (out, inside, KERNEL, KERNEL) for inside, out in itertools.pairwise(depths)
        ]
        weights += [(out, inside) for inside, out in itertools.pairwise(self.widths)]
        return tuple(shape for weight in weights for shape in (weight, weight[:1]))

    def initial(self, rng: np.random.Generator) -> Vector:
        """Uniform in +-1/sqrt(fan in), weights and biases alike: the customary start in torch."""
        parts = []
        for weight, bias in zip(self.shapes[::2], self.shapes[1::2], strict=True):
            bound = 1.0 / math.sqrt(math.prod(weight[1:]))
            parts += [rng.uniform(-bound, bound, math.prod(shape)) for shape in (weight, bias)]
        return np.concatenate(parts).astype(np.float32)

    def train(
        self,
        split: Split,
        model: Vector,
        tasks: Sequence[LocalTask],
        *,
        scaling: Scaling,
        settings: LocalSettings,
    ) -> list[LocalResult]:
        """Local training of each task from the global `model` (P,), in any number of threads."""
        images = _images(split, scaling)
        return [self._train(images, model, task, settings) for task in tasks]

    def correct_per_class(
        self, split: Split, model: Vector, *, scaling: Scaling
    ) -> NDArray[np.int64]:
        """How many images of each class the model gets right, (classes,)."""
        return count_correct(self._network, _images(split, scaling), model)

    def _train(
        self, images: Images, model: Vector, task: LocalTask, settings: LocalSettings
    ) -> LocalResult:
        order = batch_order(task, settings)
        rates = settings.learning_rate, settings.momentum, settings.mu
        weights, loss = train(
            self._network, images, order, model, correction=task.correction, rates=rates
        )
        return LocalResult(weights, len(order), loss)

    @cached_property
    def _network(self) -> Network:
        return Network(
            self.image_shape,
            self.channels,
            (KERNEL, KERNEL),
            self.padding,
            self.widths[1:],
            sum(math.prod(shape) for shape in self.shapes),
        )


def _images(split: Split, scaling: Scaling) -> Images:
    return Images(split.images, split.labels, scaling.scale, scaling.shift)
