"""What the kernels are compiled by, and the arrays that they work on."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fl.kernels.compiled import cached, compiled, digest

__all__ = [
    "SOURCES", "Cube", "Flags", "Indices", "Masks", "Matrix", "Vector", "cached", "compiled",
]  # fmt: skip

Vector = NDArray[np.float64]  # (n,)
Matrix = NDArray[np.float64]  # (n, m)
Cube = NDArray[np.float64]  # (n, m, l)
Indices = NDArray[np.int64]
Masks = NDArray[np.uint64]
Flags = NDArray[np.bool_]

SOURCES = digest(Path(__file__).parent)
