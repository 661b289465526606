"""What an environment takes as an action."""

import numpy as np

from mission.base.arrays import Floats
from mission.base.errors import InputError


def checked(action: object, count: int, *, under_way: bool) -> Floats:
    """The action (count,), each in [-1, 1]; InputError where it is none or no episode under way."""
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
