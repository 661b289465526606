"""Checks of the actions that environments take."""

import numpy as np

from mission.base.arrays import Floats
from mission.base.errors import InputError


def checked(action: object, count: int, *, under_way: bool) -> Floats:
    """Return the action (count,), each in [-1, 1]; InputError for others, or with no episode."""
    if not under_way:
        raise InputError("step: no episode is under way; call reset() first")
    try:
        given = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.empty(0)
    if given.shape != (count,) or not (np.abs(given) <= 1.0).all():
        said = " ".join(repr(action).split())
        raise InputError(f"action = {said}: must be {count} numbers from -1 to 1, shape ({count},)")
    return given
