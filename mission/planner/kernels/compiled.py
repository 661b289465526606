"""What the kernels are compiled by, and the arrays that they work on."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fl.kernels.compiled import cached, compiled, digest
from fl.kernels.views import views

__all__ = [
    "NONE", "SOURCES", "ZERO", "Cube", "Flags", "Indices", "Masks", "Matrix", "Vector", "cached",
    "compiled", "typed", "views",
]  # fmt: skip

Vector = NDArray[np.float64]  # (n,)
Matrix = NDArray[np.float64]  # (n, m)
Cube = NDArray[np.float64]  # (n, m, l)
Indices = NDArray[np.int64]
Masks = NDArray[np.uint64]
Flags = NDArray[np.bool_]


def typed(number: int) -> int:
    """A constant that may be an argument: for a literal a function is compiled once more."""
    return np.int64(number)  # type: ignore[return-value]


ZERO, NONE = typed(0), typed(-1)

SOURCES = digest(Path(__file__).parent)
