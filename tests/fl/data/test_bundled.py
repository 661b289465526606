"""The tasks that come along: the digits of the file, and images drawn from random numbers."""

import cmath
import colorsys
import hashlib
import itertools
import math

import numpy as np

from fl.data.bundled import SEED, colour_shapes
from fl.data.load import load

# UCI's own count of the test set, class by class.
UCI = [178, 182, 177, 183, 181, 182, 181, 179, 174, 180]
# SHA-256 of both splits, made of what scikit-learn 1.9's load_digits gives.
DIGITS = [
    "bbe2d1df6534cebe3f4b7667c26c227ac4a6910307829e29809eca39a84a1db1",
    "78bc29476c3389b7408634c078b77c9a75a348c884573e45d879286754440370",
]


def test_bundled_tasks_need_no_folder() -> None:
    digits, shapes = load("digits", data_dir=None), load("colour-shapes", data_dir=None)
    assert digits.image_shape == (8, 8, 1)
    assert digits.train.images.max() == 240
    splits = (digits.train, digits.validation)
    assert np.bincount(np.concatenate([s.labels for s in splits])).tolist() == UCI
    sums = [hashlib.sha256(s.images.tobytes() + s.labels.tobytes()).hexdigest() for s in splits]
    assert sums == DIGITS
    assert shapes.image_shape == (16, 16, 3)
    for split in (shapes.train, shapes.validation):
        assert np.ptp(np.bincount(split.labels, minlength=10)) == 0
    assert "generated" in shapes.provenance.source
    again = load("colour-shapes", data_dir=None)
    np.testing.assert_array_equal(shapes.train.images, again.train.images)


def test_colour_shapes_are_what_their_random_numbers_say_pixel_by_pixel() -> None:
    """The same images in plain Python: all numbers first, then the noise, image after image."""
    stream, count = np.random.Generator(np.random.PCG64(SEED)), 300
    labels = stream.permutation(np.arange(count) % 10)
    limits = [(5.6, 10.4, (count, 2)), (4.48, 6.72), (0, math.tau), (0.45, 0.78), (-0.06, 0.17)]
    limits += [(0.45, 1), (0.45, 1), (0, 1), (0, 0.35), (0, 1)]
    drawn = [stream.uniform(a, b, *(more or (count,))) for a, b, *more in limits]
    centre, radius, angle, cool, warm, deep, bright, *paper = drawn
    noise = stream.normal(0.0, 0.08, (count, 16, 16, 3))
    images = colour_shapes(train=count, validation=10).train.images
    for i in (0, 1, 2, 3, 4, 126, 127, 128, 129, 130, 255, 256, 257, 299):
        hue = (cool if labels[i] % 2 else warm)[i] % 1.0
        ink = np.array(colorsys.hsv_to_rgb(hue, deep[i], bright[i]))
        ground = np.array(colorsys.hsv_to_rgb(*(values[i] for values in paper)))
        for row, column in itertools.product(range(16), range(16)):
            dx, dy = column + 0.5 - centre[i, 0], row + 0.5 - centre[i, 1]
            point = complex(dx, dy) * cmath.exp(-1j * angle[i])
            share = min(1.0, max(0.0, 0.5 - beyond_edge(labels[i] // 2, point, radius[i])))
            mixed = share * ink + (1 - share) * ground + noise[i, row, column]
            expected = 255 * np.clip(mixed, 0, 1)
            assert np.abs(images[i, row, column] - expected).max() <= 0.5 + 1e-6


def beyond_edge(kind: int, point: complex, r: float) -> float:
    """Signed distance of a point from the edge of disc, ring, square, triangle or cross."""
    x, y = abs(point.real), point.imag
    return [
        abs(point) - r,
        abs(abs(point) - 0.8 * r) - 0.22 * r,
        max(x, abs(y)) - 0.8 * r,
        max(0.866 * x - 0.5 * y, y) - 0.6 * r,
        min(max(x - r, abs(y) - 0.3 * r), max(abs(y) - r, x - 0.3 * r)),
    ][kind]
