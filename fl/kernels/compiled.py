"""Compilation of kernels, here and in planning: once per installation and kind of processor."""

import hashlib
import logging
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

from numba import njit

logger = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")


def digest(folder: Path) -> str:
    """Of all sources in a folder of kernels, and of how they are compiled.

    The cache looks at a function's source file and closure, not at what it calls. With this in
    the closure a change anywhere compiles anew.
    """
    found = hashlib.sha256()
    for source in (Path(__file__), *sorted(folder.glob("*.py"))):
        found.update(source.read_bytes())
    return found.hexdigest()


SOURCES = digest(Path(__file__).parent)


def cached(function: Callable[P, R]) -> Callable[P, R]:
    """For functions that Python calls: threads may run them at the same time.

    The closure over a `digest` is up to the function. Where no folder can be written, everything
    is compiled once per process.
    """
    try:
        result: Callable[P, R] = njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError as error:
        logger.warning("kernels are compiled anew in every process: %s", error)
        result = njit(nogil=True, error_model="numpy")(function)
    return result


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """For functions that only compiled code calls. Sums are never reordered."""
    result: Callable[P, R] = njit(
        error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True
    )(function)
    return result


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """The same, pasted into the caller, so that vectors stay in registers."""
    result: Callable[P, R] = njit(
        error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True
    )(function)
    return result


def merged(function: Callable[P, R]) -> Callable[P, R]:
    """Read as if written in the caller: each level of calls costs another round of optimisation."""
    result: Callable[P, R] = njit(inline="always", error_model="numpy")(function)
    return result
