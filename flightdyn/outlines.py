"""Outlines of areas, which must not cross themselves."""

import numpy as np
from numpy.typing import NDArray

_THIN = 1e-4  # of its length: corners so near to a line, by rounding, are on it
_ROWS = 200  # of edges, looked at together with all others


def flaw(corners: NDArray[np.float64], *, first: int = 0) -> str:
    """Say why corners (n, 2), counted from `first`, enclose no area, in words that follow its name;
    empty if they do. One that repeats the one before it counts for nothing."""
    at = np.flatnonzero((corners != corners[np.arange(len(corners)) - 1]).any(axis=1))
    a, rays, index = corners[at], corners - corners[0], np.arange(len(at))
    far = rays[(rays**2).sum(axis=1).argmax()]
    if not (np.abs(_cross(far, rays)) > _THIN * (far @ far)).any():
        return "has no area: its corners lie on one line"
    following = index + 1 - len(at)
    b = a[following]
    u, v = b - a, b[following] - b
    back = (_cross(u, v) == 0.0) & ((u * v).sum(axis=1) < 0.0)
    low, high = np.minimum(a, b).T, np.maximum(a, b).T
    for top in range(0, len(at), _ROWS):
        rows = index[top : top + _ROWS, None]
        near = (index > rows + 1) & (
            index < rows + len(at) - 1
        )  # neighbours have a corner in common
        for least, most in zip(low, high, strict=True):
            near &= (least[rows] <= most) & (least <= most[rows])
        i, j = np.nonzero(near | (back[rows] & (index == following[rows] % len(at))))
        i += top
        met = _cross(u[i], a[j] - a[i]) * _cross(u[i], b[j] - a[i]) <= 0.0
        met &= _cross(u[j], a[i] - a[j]) * _cross(u[j], b[i] - a[j]) <= 0.0
        if met.any():
            pair = sorted((i[met][0], j[met][0]))
            one, two = (f"{first + at[k]}-{first + at[following[k]]}" for k in pair)
            return f"crosses itself: its edges {one} and {two} meet"
    return ""


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
