"""LeNet-size networks and McMahan's CNN, trained by compiled code (`fl.kernels`)."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fl.datasets import Split
from fl.kernels import local
from fl.kernels.convolution import KERNEL
from fl.kernels.lanes import WIDTH
from fl.kernels.network import Room, Shape
from fl.training import LocalResult, LocalSettings, LocalTask, Scaling, Shapes, Vector, batch_order

_CACHE_LINE = 64  # bytes


@dataclass(frozen=True)
class ConvNet:
    """Two (5x5 convolution, 2x2 max-pooling, ReLU) blocks, then dense layers with ReLU between.

    Parameters and their order are those of torch's modules: weights (out, in, 5, 5) or
    (out, in), then biases; pooled maps are flattened as (channel, height, width).
    """

    image_shape: tuple[int, int, int]  # height, width, channels
    channels: tuple[int, int]  # even numbers
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
        correct = np.zeros(self.classes, dtype=np.int64)
        weights = _aligned(model.shape)
        weights[:] = model
        local.count_correct(_images(split, scaling), self._shape, self._room(), weights, correct)
        return correct

    def _train(
        self, images: local.Images, model: Vector, task: LocalTask, settings: LocalSettings
    ) -> LocalResult:
        order = batch_order(task, settings)
        order = np.pad(order, ((0, 0), (0, -order.shape[1] % WIDTH)), constant_values=-1)
        weights, anchor = _aligned(model.shape), _aligned(model.shape)
        weights[:] = anchor[:] = model
        correction = np.empty(0, np.float32) if task.correction is None else task.correction
        vectors = local.Vectors(
            weights, anchor, _aligned(model.shape), _aligned(model.shape), correction
        )
        rates = local.Rates(
            np.float32(settings.learning_rate),
            np.float32(settings.momentum),
            np.float32(settings.mu),
        )
        loss = local.train(images, order, self._shape, self._room(), vectors, rates)
        return LocalResult(weights, len(order), loss)

    @cached_property
    def _shape(self) -> Shape:
        sizes = [math.prod(shape) for shape in self.shapes]
        return Shape(
            channels=np.array((self.image_shape[2], *self.channels)),
            borders=np.array((*self.padding, 0)),
            late_borders=np.array((0, KERNEL - 1 - self.padding[1])),
            widths=np.array(self.widths),
            starts=np.cumsum([0, *sizes]),
        )

    def _room(self) -> Room:
        height, width, depth = self.image_shape
        (first, second), (pad, inner) = self.channels, self.padding
        (h1, w1), (h2, w2) = self.pooled
        even_h, even_w = h1 + h1 % 2, w1 + w1 % 2
        rows = sum(self.widths)
        return Room(
            image=_aligned((depth, height + 2 * pad, width + 2 * pad, WIDTH)),
            middle=_aligned((first, h1 + 2 * inner, w1 + 2 * inner, WIDTH)),
            winners=(_aligned((first, h1, w1, WIDTH)), _aligned((second, h2, w2, WIDTH))),
            features=_aligned((rows, WIDTH)),
            slopes=_aligned((rows, WIDTH)),
            before=(
                _aligned((first, 2 * h1, 2 * w1, WIDTH)),
                _aligned((second, even_h + KERNEL - 1, even_w + KERNEL - 1, WIDTH)),
            ),
            back=_aligned((first, even_h, even_w, WIDTH)),
            turned_kernels=_aligned((first, second, KERNEL, KERNEL)),
            turned_features=_aligned((WIDTH, max(self.widths))),
            chosen=np.zeros(WIDTH, np.int64),
            labels=np.zeros(WIDTH, np.int64),
        )


def _images(split: Split, scaling: Scaling) -> local.Images:
    return local.Images(split.images, split.labels, scaling.scale, scaling.shift)


def _aligned(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Zeros that begin on a cache line: vectors across two lines cost twice."""
    size = math.prod(shape)
    raw = np.zeros(size + _CACHE_LINE // 4, np.float32)
    start = -raw.ctypes.data % _CACHE_LINE // 4
    return raw[start : start + size].reshape(shape)


def rehearse() -> None:
    """Train on one black image, and classify it."""
    net = ConvNet((16, 16, 1), (2, 2), (0, 0), (), 2)
    split = Split(np.zeros((1, 16, 16, 1), np.uint8), np.zeros(1, np.int64))
    scaling = Scaling(np.ones(1, np.float32), np.zeros(1, np.float32))
    rng = np.random.Generator(np.random.PCG64(0))
    tasks, settings = [LocalTask(np.zeros(1, np.int64), rng)], LocalSettings(0.0, 0.0, 0.0, 1, 1)
    (trained,) = net.train(split, net.initial(rng), tasks, scaling=scaling, settings=settings)
    net.correct_per_class(split, trained.model, scaling=scaling)
