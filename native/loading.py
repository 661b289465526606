"""Loading a library with what it declares, choosing its level, and checking what it is given."""

import ctypes
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from native.building import Library, build, levels
from native.errors import InputError
from native.headers import declared

LEVEL = "AEROFED_LEVEL"  # environment variable: a level lower than the processor's best
FOLDER = "AEROFED_LIBRARIES"  # environment variable: libraries from here, as they are


def load(library: Library) -> ctypes.CDLL:
    """Load a library, built first where it is not there for the present sources.

    Raises:
        InputError: it cannot be built.
    """
    folder = os.environ.get(FOLDER)
    path = Path(folder, library.path.name) if folder else library.path
    if not folder and not path.exists():
        build(library)
    return ctypes.CDLL(str(path))


def interface(library: Library, *, keeps_lock: bool = False) -> Any:
    """Load a library, and return all that its sources declare as attributes: structures, constants
    and functions, at its level and exported; their calls release Python's lock or keep it.

    Raises:
        InputError: it cannot be built, or has no such level.
    """
    loaded, found = load(library), declared(library.folder / library.border)
    kind = ctypes.PYFUNCTYPE if keeps_lock else ctypes.CFUNCTYPE
    made = {
        name: kind(*types)((name, loaded))
        for name, types in found.items()
        if isinstance(types, list)
    }
    if library.levelled is not None:
        table = found[library.name.capitalize()]
        loaded.at_level.restype = ctypes.c_void_p
        here = table.from_address(loaded.at_level(level(loaded)))
        made |= {name: kind(*types)(getattr(here, name)) for name, types in table.functions.items()}
    return SimpleNamespace(**{**found, **made})


def level(loaded: ctypes.CDLL) -> int:
    """Return the index of the level to use: the processor's best, or what the environment asks for.

    Raises:
        InputError: there is no such level here.
    """
    possible = list(levels())[: loaded.best_level() + 1]
    asked = os.environ.get(LEVEL) or possible[-1]
    if asked not in possible:
        raise InputError(f"{LEVEL}={asked}: this processor has {', '.join(possible)}")
    return possible.index(asked)


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
