"""Dense layers over 16 images at once: features are (feature, lane), weights (out, in)."""

import numpy as np

from fl.kernels.compiled import compiled
from fl.kernels.lanes import WIDTH, Floats, if_greater, load, multiply_add, splat, store, total

ZERO = np.float32(0.0)
ROWS = 8  # sums in registers at a time


@compiled
def forward(features: Floats, weights: Floats, bias: Floats, relu: bool, out: Floats) -> None:
    """Weights times features plus bias, through a ReLU if asked."""
    count, width = weights.shape
    zero = splat(ZERO)
    whole = count - count % ROWS
    for j in range(0, whole, ROWS):
        s0 = splat(bias[j])
        s1 = splat(bias[j + 1])
        s2 = splat(bias[j + 2])
        s3 = splat(bias[j + 3])
        s4 = splat(bias[j + 4])
        s5 = splat(bias[j + 5])
        s6 = splat(bias[j + 6])
        s7 = splat(bias[j + 7])
        for i in range(width):
            v = load(features, (i,))
            s0 = multiply_add(splat(weights[j, i]), v, s0)
            s1 = multiply_add(splat(weights[j + 1, i]), v, s1)
            s2 = multiply_add(splat(weights[j + 2, i]), v, s2)
            s3 = multiply_add(splat(weights[j + 3, i]), v, s3)
            s4 = multiply_add(splat(weights[j + 4, i]), v, s4)
            s5 = multiply_add(splat(weights[j + 5, i]), v, s5)
            s6 = multiply_add(splat(weights[j + 6, i]), v, s6)
            s7 = multiply_add(splat(weights[j + 7, i]), v, s7)
        for k, s in enumerate((s0, s1, s2, s3, s4, s5, s6, s7)):
            store(out, (j + k,), s)
    for j in range(whole, count):
        s = splat(bias[j])
        for i in range(width):
            s = multiply_add(splat(weights[j, i]), load(features, (i,)), s)
        store(out, (j,), s)
    if relu:
        for j in range(count):
            s = load(out, (j,))
            store(out, (j,), if_greater(s, zero, s, zero))


@compiled
def input_slopes(slope: Floats, weights: Floats, out: Floats) -> None:
    """The slopes of the loss in the layer's inputs, given those in its outputs."""
    count, width = weights.shape
    whole = width - width % ROWS
    for i in range(0, whole, ROWS):
        s0 = splat(ZERO)
        s1 = s0
        s2 = s0
        s3 = s0
        s4 = s0
        s5 = s0
        s6 = s0
        s7 = s0
        for j in range(count):
            v = load(slope, (j,))
            s0 = multiply_add(splat(weights[j, i]), v, s0)
            s1 = multiply_add(splat(weights[j, i + 1]), v, s1)
            s2 = multiply_add(splat(weights[j, i + 2]), v, s2)
            s3 = multiply_add(splat(weights[j, i + 3]), v, s3)
            s4 = multiply_add(splat(weights[j, i + 4]), v, s4)
            s5 = multiply_add(splat(weights[j, i + 5]), v, s5)
            s6 = multiply_add(splat(weights[j, i + 6]), v, s6)
            s7 = multiply_add(splat(weights[j, i + 7]), v, s7)
        for k, s in enumerate((s0, s1, s2, s3, s4, s5, s6, s7)):
            store(out, (i + k,), s)
    for i in range(whole, width):
        s = splat(ZERO)
        for j in range(count):
            s = multiply_add(splat(weights[j, i]), load(slope, (j,)), s)
        store(out, (i,), s)


@compiled
def stopped(slope: Floats, features: Floats) -> None:
    """Zero the slopes of features at which a ReLU let nothing through."""
    zero = splat(ZERO)
    for i in range(slope.shape[0]):
        store(slope, (i,), if_greater(load(features, (i,)), zero, load(slope, (i,)), zero))


@compiled
def add_weight_slopes(
    features: Floats, slope: Floats, turned: Floats, out: Floats, bias_slope: Floats
) -> None:
    """Add the slopes of weights and bias; `turned` (lane, feature) is room to work in."""
    count, width = out.shape
    for i in range(width):
        for lane in range(WIDTH):
            turned[lane, i] = features[i, lane]
    for j in range(count):
        bias_slope[j] += total(load(slope, (j,)))
        # Written out, so that the loop over the inputs becomes one of vectors.
        d0, d1, d2, d3 = slope[j, 0], slope[j, 1], slope[j, 2], slope[j, 3]
        d4, d5, d6, d7 = slope[j, 4], slope[j, 5], slope[j, 6], slope[j, 7]
        d8, d9, d10, d11 = slope[j, 8], slope[j, 9], slope[j, 10], slope[j, 11]
        d12, d13, d14, d15 = slope[j, 12], slope[j, 13], slope[j, 14], slope[j, 15]
        for i in range(width):
            s = multiply_add(d0, turned[0, i], out[j, i])
            s = multiply_add(d1, turned[1, i], s)
            s = multiply_add(d2, turned[2, i], s)
            s = multiply_add(d3, turned[3, i], s)
            s = multiply_add(d4, turned[4, i], s)
            s = multiply_add(d5, turned[5, i], s)
            s = multiply_add(d6, turned[6, i], s)
            s = multiply_add(d7, turned[7, i], s)
            s = multiply_add(d8, turned[8, i], s)
            s = multiply_add(d9, turned[9, i], s)
            s = multiply_add(d10, turned[10, i], s)
            s = multiply_add(d11, turned[11, i], s)
            s = multiply_add(d12, turned[12, i], s)
            s = multiply_add(d13, turned[13, i], s)
            s = multiply_add(d14, turned[14, i], s)
            s = multiply_add(d15, turned[15, i], s)
            out[j, i] = s
