"""Arrays by what they hold; their shapes stand where they are used. Statistics of what is known,
and what is pickled of values that keep something for C."""

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
    """The state that is pickled of a dataclass: without what it keeps for C."""
    return {given.name: getattr(item, given.name) for given in fields(item)}


def _known(reduce: Callable[[Floats], float]) -> Callable[[Floats], float]:
    """A statistic of the values that are no NaN; NaN of nothing."""

    def of(values: Floats) -> float:
        known = values[~np.isnan(values)]
        return float(reduce(known)) if len(known) else math.nan

    return of


rms = _known(lambda values: math.sqrt((values**2).mean()))
mean = _known(np.mean)
greatest = _known(np.max)
