"""Checks of what environments are given: actions, and numbers that describe them."""

import numpy as np

from mission.base.arrays import Floats
from mission.base.errors import InputError
from native.errors import printable


def checked(action: object, count: int, *, under_way: bool) -> Floats:
    """Return the action (count,), each in [-1, 1]; InputError for others, or with no episode."""
    if not under_way:
        raise InputError("step: no episode is under way; call reset() first")
    try:
        given = np.asarray(action)
    except (TypeError, ValueError):  # of several lengths
        given = np.empty(0)
    real = given.dtype.kind in "iuf" and not np.ma.isMaskedArray(action)
    if not real or given.shape != (count,) or not (np.abs(given) <= 1.0).all():
        said = " ".join(printable(action, repr).split())
        raise InputError(f"action = {said}: must be {count} numbers from -1 to 1, shape ({count},)")
    return np.asarray(given, dtype=np.float64)


def within(**given: tuple[object, float]) -> None:
    """Raise InputError unless each value is a number, more than 0, at most what is beside it."""
    for name, (value, most) in given.items():
        if not isinstance(value, int | float) or not 0 < value <= most:
            raise InputError(f"{name} = {value!r}: must be more than 0, at most {most:g}")
