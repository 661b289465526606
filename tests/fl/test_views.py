"""Views in compiled code against the same reads and writes in numpy."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from fl.kernels.compiled import compiled
from fl.kernels.views import part, views


class Table(NamedTuple):
    """Arrays of every number of axes and several kinds of number, and a tuple within."""

    line: np.ndarray
    square: np.ndarray
    cube: np.ndarray
    flags: np.ndarray
    small: np.ndarray
    pair: tuple[np.ndarray, np.ndarray]
    factor: float


def table(rng):
    return Table(
        rng.random(5),
        rng.random((4, 5)),
        rng.random((3, 4, 5)).astype(np.float32),
        rng.random(5) > 0.5,
        rng.integers(-9, 9, (4, 5)).astype(np.int8),
        (rng.random((2, 5)), rng.integers(0, 9, 5)),
        2.5,
    )


@compiled
def _one(cube, i, j, k):
    return cube[i, j, k]


@njit
def _compute(given):
    t = views(given)
    rows, columns = t.square.shape
    for i in range(rows):
        row, plane = t.square[i], t.cube[2]
        for j in range(columns):
            row[j] += t.line[j] * t.factor + plane[i, j] + t.cube[0][i][j]
            t.small[i, j] += 1
            t.flags[j] = not t.flags[j] and t.pair[1][j] > 4
            t.pair[0][1, j] = _one(t.cube, 1, i, j)
    tail = part(t.square, 1, (2, columns))
    tail[1, 0] = -7.0
    flat = part(t.line, 2, (3,))
    flat[0] = 11.0
    return t.cube.shape[1] + tail.shape[0] + flat.shape[0]


def expected(t):
    t.square[:] += t.line * t.factor + t.cube[2] + t.cube[0]
    t.small[:] += 1
    for i in range(4):
        t.flags[:] = ~t.flags & (t.pair[1] > 4)
        t.pair[0][1] = t.cube[1, i]
    t.square[2, 0] = -7.0
    t.line[2] = 11.0
    return 4 + 2 + 3


def test_views_read_and_write_what_numpy_does():
    ours, theirs = table(np.random.default_rng(1)), table(np.random.default_rng(1))
    assert _compute(ours) == expected(theirs)
    for mine, other in zip(ours[:5], theirs[:5], strict=True):
        np.testing.assert_array_equal(mine, other)
    np.testing.assert_array_equal(ours.pair[0], theirs.pair[0])


def test_what_may_not_be_written_to_can_be_read():
    given = np.arange(4.0)
    given.flags.writeable = False

    @njit
    def last(array):
        return views(array)[3]

    assert last(given) == 3.0


@pytest.mark.parametrize("array", [np.zeros((4, 3)).T, np.zeros(8)[::2]])
def test_arrays_with_gaps_are_refused(array):
    @njit
    def first(array):
        return views(array).shape[0]

    with pytest.raises(TypingError, match="a kernel takes contiguous arrays"):
        first(array)
