"""The C interface of an airspace (`airspace.c`, `native/include/airspace.h`)."""

import ctypes
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mission.base.arrays import Bools, Floats, Ints
from native.building import library
from native.headers import columns
from native.loading import address, interface

_AIRSPACE = interface(library("airspace"))
_POINT = columns(_AIRSPACE.Point, "x y")


class Outlines:
    """Outlines of an airspace as C uses them: checks of points and legs, free places, routes."""

    def __init__(
        self,
        rings: Sequence[Floats],
        *,
        fenced: bool,
        margins_m: tuple[float, float, float],
        vertices_m: Floats,
        places_m: Floats,
        shifts: Floats,
    ) -> None:
        """Take outlines `rings` (n, 2), free side on the left; `fenced`: the last is a fence.

        `margins_m`: distances from an outline that count as free, as on it, and that a point is
        moved to. Around a point that is not free, `places_m` and `shifts` (S, 2; times the last
        margin) are tried, too. Paths lead over those of `vertices_m` (V, 2) that are free."""
        first = np.cumsum([0, *map(len, rings)])
        self._kept = [first, np.vstack(rings), *(
            np.array([end(ring, axis=0) for ring in rings]) for end in (np.min, np.max)
        ), shifts]  # fmt: skip
        at = [array.ctypes.data for array in self._kept]
        clear, touching, beside = margins_m
        self._space = _AIRSPACE.Airspace(
            outlines=len(rings), fenced=fenced, first=at[0], corner=at[1], low=at[2], high=at[3],
            clear=clear, touching=touching, beside=beside, shifts=len(shifts), shift=at[4],
        )  # fmt: skip
        self._at = ctypes.addressof(self._space)
        vertices_m, places_m = (points[self.free(points)] for points in (vertices_m, places_m))
        vertices = np.vstack((vertices_m, places_m))
        self._kept.append(vertices)
        self._space.vertices, self._space.places = len(vertices_m), len(places_m)
        self._space.vertex = vertices.ctypes.data

    @cached_property
    def at(self) -> int:
        """Address of the C struct, with the shortest paths between its vertices filled in."""
        count = self._space.vertices
        self._kept += [np.empty((count, count)), np.empty((count, count), np.int32)]
        self._space.length, self._space.before = (m.ctypes.data for m in self._kept[-2:])
        _AIRSPACE.find_ways(self._at)
        return self._at

    def keep(self, from_m: Floats, to_m: Floats, away_m: float) -> Bools:
        """(S,) whether legs (S, 2) -> (S, 2) are farther than `away_m` from every outline."""
        count, kept = len(to_m), np.empty(len(to_m), np.bool_)
        ends = [np.ascontiguousarray(points_m, dtype=np.float64) for points_m in (from_m, to_m)]
        at = [address(points_m, np.float64, (count, _POINT)) for points_m in ends]
        _AIRSPACE.keep_away(self._at, count, *at, away_m, kept.ctypes.data)
        return kept

    def allow(self, points_m: Floats) -> Bools:
        """(P,) whether points (P, 2) may be flown, margin aside; not those on an outline."""
        allowed = np.empty(len(points_m), np.bool_)
        _call(_AIRSPACE.allow, self._at, points_m, allowed)
        return allowed

    def free(self, points_m: Floats) -> Bools:
        """(P,) whether points (P, 2) may be flown and keep the margin from every outline."""
        return self.keep(points_m, points_m, self._space.clear) & self.allow(points_m)

    def away(self, points_m: Floats) -> Floats:
        """(P,) metres from points (P, 2) to the nearest outline, margin aside; 0 where allowed."""
        metres = np.empty(len(points_m))
        _call(_AIRSPACE.measure_away, self._at, points_m, metres)
        return metres

    def moved(self, points_m: Floats) -> Floats:
        """Return points (P, 2), each that is not free moved to the nearest free place found.

        Raises:
            ValueError: no free place was found for a point.
        """
        moved = np.array(points_m, dtype=np.float64)
        if _call(_AIRSPACE.move_all, self._at, moved) < len(moved):
            raise ValueError("nowhere is free")
        return moved

    def route(self, waypoints_m: Floats) -> tuple[Floats, Ints]:
        """Return the route (P, 2) through waypoints (N, 2), and their indices (N,) in it."""
        steps, spare = len(waypoints_m), np.empty(2 * self.corners)
        route, at = np.empty((steps * (self.corners + 1), 2)), np.empty(steps, np.int64)
        points = _call(_AIRSPACE.find_route, self.at, waypoints_m, route, at, spare)
        return route[:points].copy(), at

    @property
    def pairs(self) -> int:
        """Number of pairs of outline and vertex: a measure of what finding a path costs."""
        return int(self._space.outlines * self._space.vertices)

    @property
    def corners(self) -> int:
        """Most corners that a path can have, with one beside a start that is not free."""
        return int(self._space.vertices) + 1


def _call(function: Callable[..., Any], space: int, points_m: Floats, *arrays: NDArray[Any]) -> int:
    points_m = np.ascontiguousarray(points_m, dtype=np.float64)
    where = address(points_m, np.float64, (len(points_m), _POINT))
    called: int = function(space, len(points_m), where, *(array.ctypes.data for array in arrays))
    return called
