"""Loading a library, choosing its level, and checking what it is given."""

import ctypes
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from native.building import Library, build, levels
from native.errors import LibraryError

LEVEL = "AEROFED_LEVEL"  # environment variable: a level lower than the processor's best
FOLDER = "AEROFED_LIBRARIES"  # environment variable: libraries from here, as they are


def load(library: Library) -> ctypes.CDLL:
    """Load a library, built first where its sources are at hand and have changed.

    Raises:
        LibraryError: it is not there and cannot be built.
    """
    folder = os.environ.get(FOLDER)
    if folder:
        return ctypes.CDLL(str(Path(folder, f"lib{library.name}.so")))
    if library.has_sources:
        path = library.path
        if not path.exists():
            build(library)
    elif library.built:
        path = library.built[0]
    else:
        raise LibraryError(f"{library.folder}: holds no library; install aerofed anew")
    return ctypes.CDLL(str(path))


def check_sizes(loaded: ctypes.CDLL, **structures: type[ctypes.Structure]) -> None:
    """Refuse ctypes structures whose size differs from that of C under their names.

    Raises:
        LibraryError: one differs, and what is read through it would be anything.
    """
    for name, structure in structures.items():
        size, here = (
            ctypes.c_int64.in_dll(loaded, f"size_of_{name}").value,
            ctypes.sizeof(structure),
        )
        if size != here:
            raise LibraryError(f"{loaded._name}: {name} has {size} bytes there, {here} in Python")


def level(loaded: ctypes.CDLL) -> int:
    """Return the index of the level to use: the processor's best, or what the environment asks for.

    Raises:
        LibraryError: there is no such level here.
    """
    possible = list(levels())[: loaded.best_level() + 1]
    asked = os.environ.get(LEVEL) or possible[-1]
    if asked not in possible:
        raise LibraryError(f"{LEVEL}={asked}: this processor has {', '.join(possible)}")
    return possible.index(asked)


def functions(loaded: ctypes.CDLL, table: type[ctypes.Structure]) -> Any:
    """Return the library's functions at its level, as a structure of ctypes prototypes."""
    loaded.at_level.restype = ctypes.POINTER(table)
    return loaded.at_level(level(loaded)).contents


def address(
    array: NDArray[np.generic], dtype: DTypeLike, shape: tuple[int, ...], *, written: bool = False
) -> int:
    """Return the address of an array, after checking its type, shape and layout.

    Raises:
        ValueError: another kind of number or shape, gaps, or read-only where it is written.
    """
    flags = array.flags
    if (
        array.dtype != dtype
        or array.shape != shape
        or not (flags.c_contiguous and flags.aligned)
        or (written and not flags.writeable)
    ):
        raise ValueError(
            f"the native code takes a contiguous array of {np.dtype(dtype)} {shape}"
            f"{' to write to' if written else ''}, not {array.dtype} {array.shape}"
        )
    return int(array.ctypes.data)
