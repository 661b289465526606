"""What one device does: local training; and what a model gets right. Python calls these."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fl.kernels.compiled import SOURCES, cached, compiled
from fl.kernels.lanes import WIDTH, Floats, multiply_add
from fl.kernels.network import (
    Indices,
    Pixels,
    Room,
    Shape,
    backward,
    fill,
    forward,
    loss,
    rows,
)
from fl.kernels.views import part, views


class Images(NamedTuple):
    """Images (n, height, width, channels), their labels, and pixels to numbers by channel."""

    pixels: Pixels
    labels: Indices
    scale: Floats
    shift: Floats


class Rates(NamedTuple):
    """How the weights descend."""

    learning_rate: np.float32
    momentum: np.float32
    mu: np.float32


class Vectors(NamedTuple):
    """Flat vectors (P,)."""

    weights: Floats  # changed in place
    anchor: Floats  # the global model
    velocity: Floats  # changed in place
    slopes: Floats  # zeros on entry and exit
    correction: Floats  # (P,) added to every gradient, or (0,)


@compiled
def labels_of(images: Images, chosen: Indices, out: Indices) -> None:
    """Labels of the indices `chosen` (16,), negative where those are."""
    for lane in range(WIDTH):
        out[lane] = images.labels[chosen[lane]] if chosen[lane] >= 0 else -1


@compiled
def descend(vectors: Vectors, rates: Rates) -> None:
    """v = m v + g + mu (w - w_global), w -= eta v, and g = 0."""
    weights, velocity, slopes = vectors.weights, vectors.velocity, vectors.slopes
    for i in range(vectors.correction.shape[0]):
        slopes[i] += vectors.correction[i]
    for i in range(weights.shape[0]):
        slope = multiply_add(rates.mu, weights[i] - vectors.anchor[i], slopes[i])
        velocity[i] = multiply_add(rates.momentum, velocity[i], slope)
        weights[i] = multiply_add(-rates.learning_rate, velocity[i], weights[i])
        slopes[i] = np.float32(0.0)


Train = Callable[[Images, Indices, Shape, Room, Vectors, Rates], float]
Count = Callable[[Images, Shape, Room, Floats, Indices], None]


def _make_train(sources: str) -> Train:
    @cached
    def train(
        images: Images, order: Indices, shape: Shape, room: Room, vectors: Vectors, rates: Rates
    ) -> float:
        sources  # noqa: B018  # in the closure, see `cached`
        images, order, shape = views(images), views(order), views(shape)
        room, vectors = views(room), views(vectors)
        classes = shape.widths[shape.widths.shape[0] - 1]
        total = 0.0
        for step in range(order.shape[0]):
            real = 0
            for i in range(order.shape[1]):
                real += order[step, i] >= 0
            for start in range(0, real, WIDTH):
                chosen = part(order[step], start, (WIDTH,))
                fill(
                    images.pixels, chosen, images.scale, images.shift, shape.borders[0], room.image
                )
                labels_of(images, chosen, room.labels)
                forward(vectors.weights, shape, room)
                total += loss(room, classes, 1.0 / real)
                backward(vectors.weights, shape, room, vectors.slopes)
            descend(vectors, rates)
        mean: float = total / order.shape[0]
        return mean

    return train


def _make_count(sources: str) -> Count:
    @cached
    def count_correct(
        images: Images, shape: Shape, room: Room, weights: Floats, out: Indices
    ) -> None:
        sources  # noqa: B018
        images, shape, room = views(images), views(shape), views(room)
        weights, out = views(weights), views(out)
        count, end = images.labels.shape[0], room.features.shape[0]
        classes, chosen = out.shape[0], room.chosen
        logits = rows(room.features, end - classes, end)
        for start in range(0, count, WIDTH):
            for lane in range(WIDTH):
                chosen[lane] = start + lane if start + lane < count else -1
            fill(images.pixels, chosen, images.scale, images.shift, shape.borders[0], room.image)
            forward(weights, shape, room)
            for lane in range(min(WIDTH, count - start)):
                label = images.labels[start + lane]
                best = 0
                for j in range(1, classes):
                    if logits[j, lane] > logits[best, lane]:
                        best = j
                out[label] += best == label

    return count_correct


train = _make_train(SOURCES)
"""Steps of SGD with the batches of `order` (steps, batch): a multiple of 16 wide, with -1 behind
the last of a smaller one. Changes `vectors.weights`; returns the mean cross-entropy over steps."""

count_correct = _make_count(SOURCES)
"""Add to `out` (classes,) how many images of each class the weights get right."""
