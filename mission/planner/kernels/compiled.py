"""Compilation of the inner loops: the home of numba."""

import hashlib
import logging
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

logger = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")

Vector = NDArray[np.float64]  # (n,)
Matrix = NDArray[np.float64]  # (n, m)
Cube = NDArray[np.float64]  # (n, m, l)
Indices = NDArray[np.int64]
Masks = NDArray[np.uint64]
Flags = NDArray[np.bool_]


def _digest() -> str:
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()


# The cache of a compiled function looks at its source file and its closure, not at what it
# calls. With the digest of all sources in the closure a change anywhere compiles anew.
SOURCES = _digest()


def cached(function: Callable[P, R]) -> Callable[P, R]:
    """Compile once per installation, for functions that Python calls; a closure over `SOURCES`
    is up to the function. Where no folder can be written, once per process."""
    try:
        result: Callable[P, R] = njit(cache=True, error_model="numpy")(function)
    except RuntimeError as error:
        logger.warning("planning compiles anew in every process: %s", error)
        result = njit(error_model="numpy")(function)
    return result


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile at first use, without reordering of floating-point operations."""
    # Only compiled code calls these: without wrappers for Python they compile much faster.
    result: Callable[P, R] = njit(
        error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True
    )(function)
    return result
