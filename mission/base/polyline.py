"""Lengths along a polyline, in the unit of its points."""

import numpy as np

from mission.base.arrays import Floats, Ints


def legs(points: Floats) -> Floats:
    """(n - 1,) lengths of the legs between (n, d) points."""
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=1))


def length(points: Floats) -> float:
    """Length of the polyline through (n, d) points."""
    return float(legs(points).sum())


def along(points: Floats) -> Floats:
    """(n,) lengths of the way from the first of (n, d) points to each."""
    return np.concatenate(([0.0], np.cumsum(legs(points))))


def at(where: float | Floats | Ints, known: Floats | Ints, points: Floats) -> Floats:
    """Interpolate points (n, d), which lie at `known` (n,), ascending, linearly: (..., d)."""
    return np.stack([np.interp(where, known, axis) for axis in points.T], axis=-1)


def to_segments(points: Floats, start: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Return vectors (n, d) from segments to points, row by row, and the foot (n,) as a share
    (0..1) of its segment."""
    way = end - start
    square = (way**2).sum(axis=1)
    along = ((points - start) * way).sum(axis=1)
    share = np.clip(np.divide(along, square, out=np.zeros(len(way)), where=square > 0), 0.0, 1.0)
    return points - start - share[:, None] * way, share
