"""Compilation of the inner loops: the home of numba."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

P = ParamSpec("P")
R = TypeVar("R")

Vector = NDArray[np.float64]  # (n,)
Matrix = NDArray[np.float64]  # (n, m)
Indices = NDArray[np.int64]
Masks = NDArray[np.uint64]
Flags = NDArray[np.bool_]


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile at first use, without reordering of floating-point operations."""
    # Only compiled code calls these: without wrappers for Python they compile much faster.
    result: Callable[P, R] = njit(
        error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True
    )(function)
    return result
