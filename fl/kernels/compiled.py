"""Compilation of kernels, here and in planning: once per installation and kind of processor."""

import hashlib
import logging
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

from numba import njit

from fl.kernels.parts import PartCompiler

logger = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")

# Kernels make no arrays, so that numba's counting of who still holds one is left out. Sums are
# never reordered.
_KERNEL = {"error_model": "numpy", "no_cfunc_wrapper": True, "_nrt": False}
_PART = {**_KERNEL, "no_cpython_wrapper": True, "pipeline_class": PartCompiler}

UNCACHED: list[str] = []  # kernels for which no folder can be written


def digest(folder: Path) -> str:
    """Of all sources in a folder of kernels, and of how they are compiled.

    The cache looks at a function's source file and closure, not at what it calls. With this in
    the closure a change anywhere compiles anew.
    """
    found = hashlib.sha256()
    for source in sorted({*Path(__file__).parent.glob("*.py"), *folder.glob("*.py")}):
        found.update(source.read_bytes())
    return found.hexdigest()


SOURCES = digest(Path(__file__).parent)


def cached(function: Callable[P, R]) -> Callable[P, R]:
    """For functions that Python calls: threads may run them at the same time.

    The closure over a `digest` is up to the function. Where no folder can be written, everything
    is compiled once per process.
    """
    try:
        result: Callable[P, R] = njit(cache=True, nogil=True, **_KERNEL)(function)
    except RuntimeError as error:
        logger.warning("kernels are compiled anew in every process: %s", error)
        UNCACHED.append(function.__name__)
        result = njit(nogil=True, **_KERNEL)(function)
    return result


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """For functions that only compiled code calls, with `views` of arrays."""
    result: Callable[P, R] = njit(**_PART)(function)
    return result


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """The same, pasted into the caller, so that vectors stay in registers."""
    result: Callable[P, R] = njit(forceinline=True, **_PART)(function)
    return result
