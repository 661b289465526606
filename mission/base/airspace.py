"""Where may be flown: areas to keep out of, a fence to keep within, and the ways around them.

Everything keeps a margin from the outlines, since nobody flies exactly where the plan has it. The
shortest way between two places leads over corners (de Berg et al., Computational Geometry, 15):
here over points about the outlines' corners, at the margin from them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mission.base.arrays import Bools, Floats

_SLACK_M = 1e-6  # of the margin: what is at the margin is free
_TURN = math.pi / 3  # of an outline's corner that one point leads around
_CACHED_WAYS = 10_000  # ways
_TRIED_AT_ONCE = 50  # places that may be free
_REACHES = np.linspace(0.25, 8.0, 32)  # how far around a point is looked, in margins
_DIRECTIONS = np.linspace(0.0, 2.0 * math.pi, 32, endpoint=False)
_RAYS = np.column_stack((np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)))
_RINGS = (_REACHES[:, None, None] * _RAYS).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class Airspace:
    """Areas in metres: x east, y north. Without any, everywhere may be flown."""

    keep_out: tuple[Floats, ...] = ()  # corners (n, 2) of each; the last joins the first
    keep_in: Floats | None = None
    margin_m: float = 1.0

    @property
    def is_open(self) -> bool:
        """Whether everywhere may be flown."""
        return not self.keep_out and self.keep_in is None

    @cached_property
    def _edges(self) -> tuple[Floats, Floats]:
        """(E, 2) the two ends of every outline's every edge, the free side on its left."""
        return (
            np.vstack(self._rings),
            np.vstack([np.roll(ring, -1, axis=0) for ring in self._rings]),
        )

    @cached_property
    def _rings(self) -> list[Floats]:
        """Every outline (n, 2), turned so that the free side is on the left of its edges."""
        rings = [_oriented(ring, clockwise=True) for ring in self.keep_out]
        fence = [] if self.keep_in is None else [_oriented(self.keep_in, clockwise=False)]
        return rings + fence

    @property
    def _beside_m(self) -> float:
        """A little more than the margin, so that rounding leaves what lies there free."""
        return self.margin_m + 2 * _SLACK_M

    @cached_property
    def _vertices(self) -> Floats:
        """(V, 2) vertices of the visibility graph: free points about the outlines' corners."""
        return self._about_corners(inner=False)

    @cached_property
    def _concave_vertices(self) -> Floats:
        """(V, 2) free points at the margin from both edges that meet in an inner corner."""
        return self._about_corners(inner=True)

    def _about_corners(self, *, inner: bool) -> Floats:
        every = [_offset_corners(ring, self._beside_m, inner=inner) for ring in self._rings]
        points = np.vstack(every)
        return points[self.free(points)]

    @cached_property
    def _visibility_graph(self) -> tuple[Floats, NDArray[np.int32]]:
        """Visibility graph: (V, V) lengths of shortest paths between vertices, and predecessors."""
        # Imported here: few ask, and every configuration is read by way of this module.
        from scipy.sparse.csgraph import shortest_path

        corners, count = self._vertices, len(self._vertices)
        i, j = np.triu_indices(count, 1)
        seen = self.clear(corners[i], corners[j])
        direct = np.full((count, count), np.inf)
        apart = np.hypot(*(corners[i] - corners[j]).T)
        direct[i[seen], j[seen]] = direct[j[seen], i[seen]] = apart[seen]
        lengths, before = shortest_path(direct, directed=False, return_predecessors=True)
        return np.asarray(lengths), np.asarray(before)

    @cached_property
    def _outlines(self) -> Any:
        """Every outline as one Shapely geometry, from which distances are measured."""
        # Imported here, as in `allows`: most runs have no areas.
        import shapely

        outlines = shapely.multilinestrings([shapely.linearrings(ring) for ring in self._rings])
        shapely.prepare(outlines)
        return outlines

    @cached_property
    def _areas(self) -> tuple[Any, Any]:
        """(A, 1) the areas to keep out of, (B, 1) those to keep within."""
        import shapely

        fences = () if self.keep_in is None else (self.keep_in,)
        both = [
            np.array([shapely.polygons(ring) for ring in rings], dtype=object)[:, None]
            for rings in (self.keep_out, fences)
        ]
        for areas in both:
            shapely.prepare(areas)
        return both[0], both[1]

    def allows(self, points_m: Floats) -> Bools:
        """(P,) whether points (P, 2) lie outside all areas to keep out of, and within the fence.

        An outline belongs to what must not be flown.
        """
        if self.is_open:
            return np.ones(len(points_m), dtype=bool)
        import shapely

        x, y = points_m.T
        keep_out, keep_in = self._areas
        forbidden = shapely.intersects_xy(keep_out, x, y).any(axis=0)
        return np.asarray(~forbidden & shapely.contains_xy(keep_in, x, y).all(axis=0))

    def outside(self, points_m: Floats) -> Bools:
        """(P,) whether points (P, 2) are allowed, and on no outline."""
        return self.allows(points_m) & ~self.crosses(points_m, points_m)

    def free(self, points_m: Floats) -> Bools:
        """(P,) whether they are allowed, and at the margin from every outline."""
        return self.clear(points_m, points_m) & self.allows(points_m)

    def clear(self, from_m: Floats, to_m: Floats) -> Bools:
        """(S,) whether legs (S, 2) -> (S, 2) keep the margin from every outline."""
        return self._keeps(from_m, to_m, self.margin_m - _SLACK_M)

    def crosses(self, from_m: Floats, to_m: Floats) -> Bools:
        """(S,) whether legs (S, 2) -> (S, 2) meet an outline, margin or not."""
        return ~self._keeps(from_m, to_m, _SLACK_M)

    def _keeps(self, from_m: Floats, to_m: Floats, away_m: float) -> Bools:
        if self.is_open:
            return np.ones(len(from_m), dtype=bool)
        import shapely

        legs = shapely.linestrings(np.stack((from_m, to_m), axis=1))
        still = (from_m == to_m).all(axis=1)  # lines without a length are nowhere, to Shapely
        legs[still] = shapely.points(from_m[still])
        return np.asarray(~shapely.dwithin(self._outlines, legs, away_m))

    def moved(self, points_m: Floats) -> Floats:
        """(P, 2) the points; one that is not free is at a place close to it that is.

        From an allowed point the place is on its own side of every outline.

        Raises:
            ValueError: nowhere is free.
        """
        places = np.array(points_m, dtype=np.float64)
        for index in np.flatnonzero(~self.free(places)):
            places[index] = self._nearest(places[index])
        return places

    def _nearest(self, point_m: Floats) -> Floats:
        start, end = self._edges
        along = end - start
        length = np.hypot(*along.T)
        share = np.clip(((point_m - start) * along).sum(axis=1) / length**2, 0.0, 1.0)
        left = np.column_stack((-along[:, 1], along[:, 0])) / length[:, None]
        feet = start + share[:, None] * along
        away = point_m - feet
        far = np.maximum(np.hypot(*away.T), _SLACK_M)[:, None]
        beside = self._beside_m
        # Where the margins of two outlines meet, the nearest place is at neither's side.
        places = np.vstack(
            (
                feet + beside * left,
                feet + beside * away / far,
                self._vertices,
                self._concave_vertices,
                point_m + beside * _RINGS,
            )
        )
        places = places[np.hypot(*(places - point_m).T).argsort(kind="stable")]
        outside = self.outside(point_m[None])[0]
        for first in range(0, len(places), _TRIED_AT_ONCE):
            some = places[first : first + _TRIED_AT_ONCE]
            some = some[self.free(some)]
            if outside:
                some = some[~self.crosses(np.broadcast_to(point_m, some.shape), some)]
            if len(some):
                return np.asarray(some[0])
        raise ValueError("nowhere is free")

    def way(self, from_m: Floats, to_m: Floats) -> Floats:
        """(P, 2) the shortest way, both ends among its points.

        A start that is not free leaves to the nearest place that is; the end has to be free.

        Raises:
            ValueError: there is no way.
        """
        key = (from_m.tobytes(), to_m.tobytes())
        if key not in self._ways:
            if len(self._ways) >= _CACHED_WAYS:
                self._ways.clear()
            self._ways[key] = self._way(from_m, to_m)
        return self._ways[key]

    @cached_property
    def _ways(self) -> dict[tuple[bytes, bytes], Floats]:
        """Ways found so far, by their ends: paths that a planner tries share most legs."""
        return {}

    def _way(self, from_m: Floats, to_m: Floats) -> Floats:
        if bool(self.clear(from_m[None], to_m[None])[0]):
            return np.array([from_m, to_m])
        corners, (lengths, before) = self._vertices, self._visibility_graph
        ends = self._visible(np.array([from_m, to_m]), corners)
        # From where nothing is seen it may have to get out first.
        if not np.isfinite(ends[0]).any() and not self.free(from_m[None])[0]:
            out = self._nearest(from_m)
            return np.vstack((from_m[None], self.way(out, to_m)))
        total = ends[0][:, None] + lengths + ends[1][None, :] if len(corners) else np.empty((0, 0))
        if not total.size or not np.isfinite(total.min()):
            raise ValueError("there is no way")
        first, last = (int(index) for index in np.unravel_index(total.argmin(), total.shape))
        chain = [last]
        while chain[-1] != first:
            chain.append(int(before[first, chain[-1]]))
        return np.vstack((from_m[None], corners[chain[::-1]], to_m[None]))

    def _visible(self, points_m: Floats, corners: Floats) -> Floats:
        """(P, V) distances of points (P, 2) to vertices that are visible; infinity to others."""
        from_m, to_m = (
            np.repeat(points_m, len(corners), axis=0),
            np.tile(corners, (len(points_m), 1)),
        )
        far = np.where(self.clear(from_m, to_m), np.hypot(*(to_m - from_m).T), np.inf)
        return far.reshape(len(points_m), len(corners))

    def away(self, points_m: Floats) -> Floats:
        """(P,) metres from points (P, 2) to where may be flown, margin or not."""
        import shapely

        if self.is_open:
            return np.zeros(len(points_m))
        far_m = shapely.distance(self._outlines, shapely.points(points_m))
        return np.where(self.allows(points_m), 0.0, far_m)


OPEN = Airspace()


def triangles(rings_m: Sequence[Floats]) -> Floats:
    """(T, 3, 2) that fill the first outline (n, 2), without the others, which lie within."""
    import shapely

    area = shapely.Polygon(rings_m[0], rings_m[1:])
    found = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    corners: Floats = shapely.get_coordinates(found).reshape(-1, 4, 2)[:, :3]
    return corners


def crossing(ring_m: Floats) -> bool:
    """Whether an outline (n, 2) crosses itself, or has no area."""
    # Imported here: most configurations have no areas.
    import shapely

    area = shapely.polygons(ring_m)
    return not shapely.is_valid(area) or bool(shapely.area(area) < 1e-9)


def _oriented(ring_m: Floats, *, clockwise: bool) -> Floats:
    import shapely

    ring_m = ring_m[(ring_m != np.roll(ring_m, 1, axis=0)).any(axis=1)]  # each corner once
    return ring_m[::-1] if shapely.is_ccw(shapely.linearrings(ring_m)) == clockwise else ring_m


def _offset_corners(ring_m: Floats, margin_m: float, *, inner: bool) -> Floats:
    """(n, 2) corners of a ring (n, 2) offset by the margin to its free (left) side: points around
    corners that stick out into it, or with `inner` one in each other corner.
    """
    points: list[Floats] = []
    into = ring_m - np.roll(ring_m, 1, axis=0)
    out = np.roll(ring_m, -1, axis=0) - ring_m
    for corner, a, b in zip(ring_m, into, out, strict=True):
        turn = math.atan2(a[0] * b[1] - a[1] * b[0], float(a @ b))
        if (turn >= 0.0) != inner:
            continue
        many = max(1, math.ceil(-turn / _TURN))
        half = -turn / (2 * many)
        first = math.atan2(a[0], -a[1])  # of the normal to the left of the edge that comes in
        for step in range(many):
            angle = first - (2 * step + 1) * half
            ray = np.array([math.cos(angle), math.sin(angle)])
            points.append(corner + margin_m / math.cos(half) * ray)
    return np.array(points).reshape(-1, 2)


def thin(points: Floats, tolerance: float) -> Floats:
    """Points of a path (n, 2), enough for the others to lie within `tolerance`; without those that
    have a NaN."""
    import shapely

    points = points[~np.isnan(points).any(axis=1)]
    if len(points) < 2:
        return points
    line = shapely.simplify(shapely.linestrings(points), tolerance, preserve_topology=False)
    return np.asarray(shapely.get_coordinates(line))
