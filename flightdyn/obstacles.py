"""Obstacles, which wreck an aircraft that flies into them."""

from collections.abc import Sequence
from copy import copy
from typing import Self

import numpy as np
from numpy.typing import NDArray

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
