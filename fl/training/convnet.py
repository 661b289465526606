"""Convolutional networks, trained by native code (`fl.native`)."""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fl.arrays import Vector
from fl.data.dataset import Split
from fl.native.library import Images, Network, count_correct, train
from fl.training.local import LocalResult, LocalTask, LocalWork, Scaling, Shapes, batch_order


@dataclass(frozen=True)
class ConvNet:
    """(Convolution, 2x2 max-pooling, ReLU) blocks, then dense layers with ReLU between.

    Parameters and their order are those of torch's modules: weights (out, in, kernel, kernel) or
    (out, in), then biases; pooled maps are flattened as (channel, height, width).
    """

    image_shape: tuple[int, int, int]  # height, width, channels
    channels: tuple[int, ...]  # feature maps after each block
    kernel: int
    padding: tuple[int, ...]  # of each block
    hidden: tuple[int, ...]
    classes: int

    parallel = True
    buffers = 0

    @property
    def widths(self) -> tuple[int, ...]:
        """Of the flattened maps, the hidden layers, the logits."""
        height, width, depth = self.image_shape
        for pad in self.padding:
            height, width = ((n + 2 * pad - self.kernel + 1) // 2 for n in (height, width))
        features = height * width * (depth, *self.channels)[-1]
        return features, *self.hidden, self.classes

    @property
    def shapes(self) -> Shapes:
        """Weight and bias of each layer in turn."""
        depths = (self.image_shape[2], *self.channels)
        weights: list[tuple[int, ...]] = [
            (out, inside, self.kernel, self.kernel) for inside, out in itertools.pairwise(depths)
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

    def train(self, work: LocalWork) -> list[LocalResult]:
        """As `fl.training.local.Network.train`, in any number of threads."""
        images = _images(work.split, work.scaling)
        return [self._train(images, task, work) for task in work.tasks]

    def correct_per_class(
        self, split: Split, model: Vector, *, scaling: Scaling
    ) -> NDArray[np.int64]:
        """How many images of each class the model gets right, (classes,)."""
        return count_correct(self._network, _images(split, scaling), model)

    def _train(self, images: Images, task: LocalTask, work: LocalWork) -> LocalResult:
        order, how = batch_order(task, work.settings), work.settings
        rates = how.learning_rate, how.momentum, how.mu
        weights, loss = train(
            self._network, images, order, work.model, correction=task.correction, rates=rates
        )
        return LocalResult(weights, len(order), loss)

    @cached_property
    def _network(self) -> Network:
        return Network(
            self.image_shape,
            self.channels,
            (self.kernel,) * len(self.channels),
            self.padding,
            self.widths[1:],
            sum(math.prod(shape) for shape in self.shapes),
        )


def _images(split: Split, scaling: Scaling) -> Images:
    return Images(split.images, split.labels, scaling.scale, scaling.shift)
