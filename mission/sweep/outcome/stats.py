"""Mean and confidence interval over seeds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import stdtrit

from mission.base.arrays import Floats

CONFIDENCE = 0.95
ENOUGH = 3  # values: the interval of two is 13 times as wide as their standard error


@dataclass(frozen=True)
class Interval:
    """A mean and the half-width of its 95 % confidence interval."""

    mean: float
    half: float  # NaN with fewer than three values
    count: int


def interval(values: Sequence[float] | Floats) -> Interval:
    """Mean over independent runs with Student's t interval; NaN for no values."""
    mean, half = band(np.asarray(values, dtype=np.float64).reshape(-1, 1))
    return Interval(float(mean[0]), float(half[0]), len(values))


def band(curves: Floats) -> tuple[Floats, Floats]:
    """Mean and half-width at every point of (runs, points) curves.

    Of fewer than three runs the half-width is NaN: nothing can be said.
    """
    count = len(curves)
    if count == 0:
        nothing = np.full(curves.shape[1:], math.nan)
        return nothing, nothing
    mean = np.asarray(curves.mean(axis=0), dtype=np.float64)
    if count < ENOUGH:
        return mean, np.full_like(mean, math.nan)
    spread = curves.std(axis=0, ddof=1)
    return mean, np.asarray(_student(count - 1) * spread / math.sqrt(count), dtype=np.float64)


@lru_cache
def _student(freedom: int) -> float:
    return float(stdtrit(freedom, 0.5 + CONFIDENCE / 2.0))
