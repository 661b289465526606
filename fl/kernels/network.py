"""Two (convolution, pooling, ReLU) blocks and dense layers, for 16 images: there and back.

Parameters lie in one flat vector as torch's own modules hold them: weights (out, in, 5, 5) or
(out, in), then biases, layer by layer.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fl.kernels import convolution, dense
from fl.kernels.compiled import compiled
from fl.kernels.lanes import WIDTH, Floats, multiply_add
from fl.kernels.views import part

Pixels = NDArray[np.uint8] | NDArray[np.float32]
Indices = NDArray[np.int64]


class Shape(NamedTuple):
    """Sizes of a network."""

    channels: Indices  # (3,) of the images and after each convolution
    borders: Indices  # (3,) zeros around the image, the middle maps, the pooled maps: padding, 0
    late_borders: Indices  # (2,) the same of `Room.before`
    widths: Indices  # of the pooled maps, the hidden layers and the logits
    starts: Indices  # where weights and biases of each layer begin in the flat vector, the end last


class Room(NamedTuple):
    """Memory for one batch of 16; maps are (channel, row, column, lane)."""

    image: Floats  # with a border of zeros
    middle: Floats  # after the first block, with a border of zeros
    winners: tuple[Floats, Floats]  # which of 2x2 places went through, of either block
    features: Floats  # (sum of widths, lane): pooled maps, hidden layers, logits
    slopes: Floats  # of the loss in the features
    before: tuple[Floats, Floats]  # slopes before pooling; the second with a border of zeros
    back: Floats  # slopes after the first block
    turned_kernels: Floats  # of the second convolution
    turned_features: Floats  # (lane, feature)
    chosen: Indices  # (lane,) the images of the batch; negative where there is none
    labels: Indices  # (lane,) theirs


@compiled
def fill(
    images: Pixels, chosen: Indices, scale: Floats, shift: Floats, border: int, out: Floats
) -> None:
    """Scaled images of the indices `chosen` (16,); lanes of negative ones stay as they were."""
    _, height, width, depth = images.shape
    # Row by row, so that what is written 16 times stays in the nearest cache.
    for y in range(height):
        for lane in range(WIDTH):
            index = chosen[lane]
            if index < 0:
                continue
            for c in range(depth):
                a, b = scale[c], shift[c]
                for x in range(width):
                    number = multiply_add(np.float32(images[index, y, x, c]), a, b)
                    out[c, y + border, x + border, lane] = number


@compiled
def kernels(flat: Floats, shape: Shape, layer: int) -> Floats:
    """Weights (out, in, 5, 5) of a convolution, as a view."""
    k = convolution.KERNEL
    axes = (shape.channels[layer + 1], shape.channels[layer], k, k)
    return part(flat, shape.starts[2 * layer], axes)


@compiled
def matrix(flat: Floats, shape: Shape, layer: int) -> Floats:
    """Weights (out, in) of a dense layer, as a view."""
    axes = (shape.widths[layer + 1], shape.widths[layer])
    return part(flat, shape.starts[2 * layer + 4], axes)


@compiled
def biases(flat: Floats, shape: Shape, layer: int) -> Floats:
    """Biases (out,) of a layer, as a view; convolutions count first."""
    start = shape.starts[2 * layer + 1]
    return part(flat, start, (shape.starts[2 * layer + 2] - start,))


@compiled
def rows(features: Floats, start: int, end: int) -> Floats:
    """Rows of features, as a view."""
    return part(features, start, (end - start, WIDTH))


@compiled
def forward(weights: Floats, shape: Shape, room: Room) -> None:
    """From `room.image` to the logits, the last rows of `room.features`."""
    first, second = room.winners
    convolution.forward(
        room.image, kernels(weights, shape, 0), biases(weights, shape, 0),
        room.middle, first, shape.borders[1],
    )  # fmt: skip
    convolution.forward(
        room.middle, kernels(weights, shape, 1), biases(weights, shape, 1),
        part(room.features, 0, second.shape), second, shape.borders[2],
    )  # fmt: skip
    start, last = 0, shape.widths.shape[0] - 2
    for layer in range(last + 1):
        middle = start + shape.widths[layer]
        dense.forward(
            rows(room.features, start, middle), matrix(weights, shape, layer),
            biases(weights, shape, layer + 2), layer < last,
            rows(room.features, middle, middle + shape.widths[layer + 1]),
        )  # fmt: skip
        start = middle


@compiled
def loss(room: Room, classes: int, share: float) -> float:
    """Sum of `share` times the cross-entropy of the images whose label is not negative.

    Its slopes in the logits go to `room.slopes`. In double precision, so that it is the same
    wherever the exponential is nearly right.
    """
    end = room.features.shape[0]
    logits, slopes = rows(room.features, end - classes, end), rows(room.slopes, end - classes, end)
    value = 0.0
    for lane in range(WIDTH):
        label = room.labels[lane]
        if label < 0:
            for j in range(classes):
                slopes[j, lane] = np.float32(0.0)
            continue
        top = float(logits[0, lane])
        for j in range(1, classes):
            top = max(top, float(logits[j, lane]))
        total = 0.0
        for j in range(classes):
            total += math.exp(float(logits[j, lane]) - top)
        value += share * (top + math.log(total) - float(logits[label, lane]))
        for j in range(classes):
            slope = math.exp(float(logits[j, lane]) - top) / total
            if j == label:
                slope -= 1.0
            slopes[j, lane] = np.float32(share * slope)
    return value


@compiled
def backward(weights: Floats, shape: Shape, room: Room, out: Floats) -> None:
    """From the slopes in the logits to those in the weights, which are added to `out`."""
    end = room.features.shape[0]
    for layer in range(shape.widths.shape[0] - 2, -1, -1):
        middle = end - shape.widths[layer + 1]
        start = middle - shape.widths[layer]
        features, slope = rows(room.features, start, middle), rows(room.slopes, middle, end)
        inner = rows(room.slopes, start, middle)
        dense.add_weight_slopes(
            features, slope, room.turned_features,
            matrix(out, shape, layer), biases(out, shape, layer + 2),
        )  # fmt: skip
        dense.input_slopes(slope, matrix(weights, shape, layer), inner)
        if layer:  # the pooled maps stop by themselves
            dense.stopped(inner, features)
        end = middle
    (first, second), (early, late) = room.winners, room.before
    border, none = shape.late_borders[1], shape.late_borders[0]
    convolution.unpooled(
        part(room.slopes, 0, second.shape), second, late, border,
        biases(out, shape, 1),
    )  # fmt: skip
    convolution.add_weight_slopes(
        room.middle, late, border, 2 * second.shape[1], 2 * second.shape[2], kernels(out, shape, 1)
    )
    convolution.turned(kernels(weights, shape, 1), room.turned_kernels)
    convolution.correlate(late, room.turned_kernels, room.back)
    convolution.unpooled(room.back, first, early, none, biases(out, shape, 0))
    convolution.add_weight_slopes(
        room.image, early, none, 2 * first.shape[1], 2 * first.shape[2], kernels(out, shape, 0)
    )
