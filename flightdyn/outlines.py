"""Outlines of areas: polygons that must not cross themselves."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

_Points: TypeAlias = NDArray[np.float64]  # (n, 2)

_FLAT_M2 = 1e-9  # what corners on one line enclose by rounding
_AT_ONCE = 1_000_000  # pairs of edges


def flaw(corners: _Points, *, first: int = 0) -> str:
    """Say why corners (n, 2) enclose no area, in words that follow its name; empty if they do.

    The last joins the first. Corners are counted from `first`; one that repeats the one before it
    counts for nothing.
    """
    if not np.isfinite(corners).all():
        return "has a corner that is no place"
    at = np.flatnonzero((corners != corners[np.arange(len(corners)) - 1]).any(axis=1))
    ring, count = corners[at], len(at)
    index = np.arange(count)
    ends = ring[index + 1 - count]
    edges, rays = ends - ring, ring - corners[0]
    far = rays[(rays**2).sum(axis=1).argmax()] if count else rays
    if (np.abs(_cross(far, rays)) <= _FLAT_M2).all():
        return "has no area: its corners lie on one line"
    into = edges[index - 1]
    back = (_cross(into, edges) == 0.0) & ((into * edges).sum(axis=1) < 0.0)
    met = [((i - 1) % count, i) for i in np.flatnonzero(back)]
    low, high = np.minimum(ring, ends).T, np.maximum(ring, ends).T
    step = 1 + _AT_ONCE // count
    for top in range(0, count, step):
        rows = index[top : top + step, None]
        near = (index > rows + 1) & (index - rows < count - 1)  # neighbours share a corner
        for one, other in zip(low, high, strict=True):
            near &= (one[rows] <= other) & (one <= other[rows])
        i, j = np.nonzero(near)
        i += top
        found = _meet(ring[i], ends[i], ring[j], ends[j])
        if found.any():
            met.append((i[found][0], j[found][0]))
            break
    if not met:
        return ""
    one, two = (f"{first + at[i]}-{first + at[(i + 1) % count]}" for i in sorted(min(met)))
    return f"crosses itself: its edges {one} and {two} meet"


def _cross(a: _Points, b: _Points) -> NDArray[np.float64]:
    crossed: NDArray[np.float64] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return crossed


def _meet(a: _Points, b: _Points, c: _Points, d: _Points) -> NDArray[np.bool_]:
    """Whether segments a-b and c-d, whose boxes overlap, have a point in common."""
    astride = _cross(b - a, c - a) * _cross(b - a, d - a) <= 0.0
    met: NDArray[np.bool_] = astride & (_cross(d - c, a - c) * _cross(d - c, b - c) <= 0.0)
    return met
