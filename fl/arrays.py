"""Types of the arrays that this package hands on, all of them read-only."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Vector = NDArray[np.float32]  # a model, or part of one
Array = TypeVar("Array", bound=NDArray[np.generic])


def frozen(array: Array) -> Array:
    """The array itself, made read-only (not a copy)."""
    array.setflags(write=False)
    return array
