"""NumPy array types by element; statistics that ignore NaN; pickling without caches for C."""

import math
from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]


def given_alone(item: Any) -> dict[str, Any]:
    """Return the pickle state of a dataclass: its fields, without values cached for C."""
    return {given.name: getattr(item, given.name) for given in fields(item)}


def _known(reduce: Callable[[Floats], float]) -> Callable[[Floats], float]:
    """Make a statistic that ignores NaN values, and is NaN where none is left."""

    def of(values: Floats) -> float:
        known = values[~np.isnan(values)]
        return float(reduce(known)) if len(known) else math.nan

    return of


rms = _known(lambda values: math.sqrt((values**2).mean()))
mean = _known(np.mean)
greatest = _known(np.max)
least = _known(np.min)
total = _known(np.sum)
