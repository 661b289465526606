"""5x5 convolutions over 16 images at once, forward with pooling and ReLU, and backward.

Maps are (channel, row, column, lane), weights (out, in, 5, 5). Two output channels and 2x2
places at a time: eight sums stay in registers, each number read serves several of them. The
number of output channels is even.
"""

import numpy as np

from fl.kernels.compiled import compiled, inlined
from fl.kernels.lanes import (
    Floats,
    Lanes,
    if_equal,
    if_greater,
    load,
    multiply_add,
    splat,
    store,
    total,
)

KERNEL = 5
ZERO = np.float32(0.0)
ONE = np.float32(1.0)
DEAD = np.float32(-1.0)  # in place of a winner: ReLU lets nothing through

Tile = tuple[Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes]


@inlined
def tile(maps: Floats, weights: Floats, o: int, y: int, x: int) -> Tile:
    """Channels o and o + 1 of the convolution at (y, x), (y, x+1), (y+1, x), (y+1, x+1)."""
    a0 = splat(ZERO)
    a1 = a0
    a2 = a0
    a3 = a0
    b0 = a0
    b1 = a0
    b2 = a0
    b3 = a0
    for c in range(maps.shape[0]):
        for i in range(KERNEL):
            for j in range(KERNEL):
                a = splat(weights[o, c, i, j])
                b = splat(weights[o + 1, c, i, j])
                v = load(maps, (c, y + i, x + j))
                a0 = multiply_add(a, v, a0)
                b0 = multiply_add(b, v, b0)
                v = load(maps, (c, y + i, x + j + 1))
                a1 = multiply_add(a, v, a1)
                b1 = multiply_add(b, v, b1)
                v = load(maps, (c, y + i + 1, x + j))
                a2 = multiply_add(a, v, a2)
                b2 = multiply_add(b, v, b2)
                v = load(maps, (c, y + i + 1, x + j + 1))
                a3 = multiply_add(a, v, a3)
                b3 = multiply_add(b, v, b3)
    return a0, a1, a2, a3, b0, b1, b2, b3


@inlined
def pooled(a0: Lanes, a1: Lanes, a2: Lanes, a3: Lanes, bias: Lanes) -> tuple[Lanes, Lanes]:
    """ReLU of the largest plus bias, and which of the four it is (the first of equals)."""
    winner = splat(ZERO)
    best = a0
    winner = if_greater(a1, best, splat(ONE), winner)
    best = if_greater(a1, best, a1, best)
    winner = if_greater(a2, best, splat(np.float32(2.0)), winner)
    best = if_greater(a2, best, a2, best)
    winner = if_greater(a3, best, splat(np.float32(3.0)), winner)
    best = if_greater(a3, best, a3, best)
    best = multiply_add(best, splat(ONE), bias)
    winner = if_greater(best, splat(ZERO), winner, splat(DEAD))
    return if_greater(best, splat(ZERO), best, splat(ZERO)), winner


@compiled
def forward(
    maps: Floats, weights: Floats, bias: Floats, out: Floats, winner: Floats, border: int
) -> None:
    """Convolution, 2x2 max-pooling, bias and ReLU; `out` has a border, `winner` none."""
    for y in range(winner.shape[1]):
        for x in range(winner.shape[2]):
            for o in range(0, winner.shape[0], 2):
                a0, a1, a2, a3, b0, b1, b2, b3 = tile(maps, weights, o, 2 * y, 2 * x)
                best, which = pooled(a0, a1, a2, a3, splat(bias[o]))
                store(out, (o, y + border, x + border), best)
                store(winner, (o, y, x), which)
                best, which = pooled(b0, b1, b2, b3, splat(bias[o + 1]))
                store(out, (o + 1, y + border, x + border), best)
                store(winner, (o + 1, y, x), which)


@compiled
def unpooled(slope: Floats, winner: Floats, out: Floats, border: int, bias_slope: Floats) -> None:
    """The slope of the loss behind pooling and ReLU, back at the places before; adds the bias'."""
    zero = splat(ZERO)
    for o in range(winner.shape[0]):
        here = zero
        for y in range(winner.shape[1]):
            for x in range(winner.shape[2]):
                which = load(winner, (o, y, x))
                value = if_equal(which, splat(DEAD), zero, load(slope, (o, y, x)))
                here = multiply_add(value, splat(ONE), here)
                for place in range(4):
                    i = 2 * y + place // 2 + border
                    j = 2 * x + place % 2 + border
                    at = splat(np.float32(place))
                    store(out, (o, i, j), if_equal(which, at, value, zero))
        bias_slope[o] += total(here)


@compiled
def add_weight_slopes(
    maps: Floats, slope: Floats, border: int, height: int, width: int, out: Floats
) -> None:
    """Add the slopes of the weights, given those of the convolution's (height, width) output."""
    for o in range(0, out.shape[0], 2):
        for c in range(maps.shape[0]):
            for i in range(KERNEL):
                a0 = splat(ZERO)
                a1 = a0
                a2 = a0
                a3 = a0
                a4 = a0
                b0 = a0
                b1 = a0
                b2 = a0
                b3 = a0
                b4 = a0
                for y in range(height):
                    for x in range(width):
                        a = load(slope, (o, y + border, x + border))
                        b = load(slope, (o + 1, y + border, x + border))
                        v = load(maps, (c, y + i, x))
                        a0 = multiply_add(a, v, a0)
                        b0 = multiply_add(b, v, b0)
                        v = load(maps, (c, y + i, x + 1))
                        a1 = multiply_add(a, v, a1)
                        b1 = multiply_add(b, v, b1)
                        v = load(maps, (c, y + i, x + 2))
                        a2 = multiply_add(a, v, a2)
                        b2 = multiply_add(b, v, b2)
                        v = load(maps, (c, y + i, x + 3))
                        a3 = multiply_add(a, v, a3)
                        b3 = multiply_add(b, v, b3)
                        v = load(maps, (c, y + i, x + 4))
                        a4 = multiply_add(a, v, a4)
                        b4 = multiply_add(b, v, b4)
                for j, (a, b) in enumerate(((a0, b0), (a1, b1), (a2, b2), (a3, b3), (a4, b4))):
                    out[o, c, i, j] += total(a)
                    out[o + 1, c, i, j] += total(b)


@compiled
def turned(weights: Floats, out: Floats) -> None:
    """(out, in, i, j) to (in, out, 4 - i, 4 - j): what carries slopes back to the inputs."""
    last = KERNEL - 1
    for o in range(weights.shape[0]):
        for c in range(weights.shape[1]):
            for i in range(KERNEL):
                for j in range(KERNEL):
                    out[c, o, last - i, last - j] = weights[o, c, i, j]


@compiled
def correlate(maps: Floats, weights: Floats, out: Floats) -> None:
    """The bare convolution; rows and columns of `out` are even in number."""
    for y in range(0, out.shape[1], 2):
        for x in range(0, out.shape[2], 2):
            for o in range(0, out.shape[0], 2):
                a0, a1, a2, a3, b0, b1, b2, b3 = tile(maps, weights, o, y, x)
                store(out, (o, y, x), a0)
                store(out, (o, y, x + 1), a1)
                store(out, (o, y + 1, x), a2)
                store(out, (o, y + 1, x + 1), a3)
                store(out, (o + 1, y, x), b0)
                store(out, (o + 1, y, x + 1), b1)
                store(out, (o + 1, y + 1, x), b2)
                store(out, (o + 1, y + 1, x + 1), b3)
