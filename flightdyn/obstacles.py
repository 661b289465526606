"""Outlines of areas, and obstacles, which wreck an aircraft that flies into them."""

from collections.abc import Sequence
from copy import copy
from typing import Self

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


# (n, 2) corners north and east of home, around a building and its courtyards; its floor (-inf: the
# ground) and roof above home.
Prism = tuple[Sequence[NDArray[np.float64]], float, float]


class Obstacles:
    """Prisms with flat floors and roofs; in metres north and east of home, and above it."""

    def __init__(self, prisms: Sequence[Prism]) -> None:
        walls = [
            np.hstack((ring, np.roll(ring, -1, axis=0))) for rings, *_ in prisms for ring in rings
        ]
        counts = [sum(map(len, rings)) for rings, *_ in prisms]
        self._whose = np.repeat(np.arange(len(prisms)), counts)
        self._walls = np.vstack([np.empty((0, 4)), *walls])
        self._floors = np.array([floor for _, floor, _ in prisms])
        self._roofs = np.array([roof for *_, roof in prisms])
        self._highest = float(self._roofs.max(initial=-np.inf))
        self._home = 0.0, 0.0

    def seen_from(self, north: float, east: float) -> Self:
        """The same obstacles about another home, so many metres north and east of this one."""
        seen = copy(self)
        seen._home = self._home[0] + north, self._home[1] + east
        return seen

    def contain(self, north: float, east: float, up: float) -> bool:
        """Whether a place (m north, east and above home) is inside one."""
        if up >= self._highest:
            return False
        between = (self._floors < up) & (up < self._roofs)
        return bool((self.within(north, east) & between).any())

    def within(self, north: float, east: float) -> NDArray[np.bool_]:
        """(P,) whether a place is within the walls of each, at any height, by ray casting."""
        north, east = north + self._home[0], east + self._home[1]
        n1, e1, n2, e2 = self._walls.T
        beside = (e1 > east) != (e2 > east)
        with np.errstate(divide="ignore", invalid="ignore"):  # of walls that are not beside it
            cross = n1 + (east - e1) / (e2 - e1) * (n2 - n1)
        met = np.bincount(self._whose[beside & (cross > north)], minlength=len(self._roofs))
        inside: NDArray[np.bool_] = met % 2 == 1
        return inside
