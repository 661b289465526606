"""Airspace: no-fly areas, a fence, and shortest paths around them.

Everything keeps a margin from the outlines, since no flight follows its plan exactly. The
shortest way between two places leads over corners (de Berg et al., Computational Geometry, 15):
here over points about the outlines' corners, at the margin from them. The work is done in C
(`native/include/airspace.h`), which the planner calls, too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from flightdyn.obstacles import flaw
from flightdyn.tables import Table
from mission.base.arrays import Bools, Floats, Ints, given_alone
from mission.base.errors import InputError

if TYPE_CHECKING:  # which loads a library
    from mission.base.native.library import Outlines

_SLACK_M = 1e-6  # of the margin: what is at the margin is free
_TURN = math.pi / 3  # of an outline's corner that one point leads around
_REACHES = np.linspace(0.25, 8.0, 32)  # how far around a point is looked, in margins
_DIRECTIONS = np.linspace(0.0, 2.0 * math.pi, 32, endpoint=False)
_RAYS = np.column_stack((np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)))
_GRID_M = 2.0**-10  # of the corners of areas that are joined: exact in binary
_OF_CIRCLE = 72  # corners: its outline lies within a thousandth of the radius
_RINGS = (_REACHES[:, None, None] * _RAYS).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class Airspace:
    """No-fly areas and a fence, in metres (x east, y north); without any, all is free to fly.

    Raises:
        InputError: an outline crosses itself or has no area.
    """

    keep_out: tuple[Floats, ...] = ()  # corners (n, 2) of each; the last joins the first
    keep_in: Floats | None = None
    margin_m: float = 1.0

    __getstate__ = given_alone

    def __post_init__(self) -> None:
        for number, ring in enumerate((*self.keep_out, self.keep_in)):
            if ring is not None and (wrong := flaw(ring)):
                raise InputError(f"airspace: outline {number} {wrong}")

    @property
    def is_open(self) -> bool:
        """Whether everywhere may be flown."""
        return not self.keep_out and self.keep_in is None

    @cached_property
    def _rings(self) -> list[Floats]:
        """Every outline (n, 2), turned so that the free side is on the left of its edges."""
        rings = [_oriented(ring, clockwise=True) for ring in self.keep_out]
        fence = [] if self.keep_in is None else [_oriented(self.keep_in, clockwise=False)]
        return rings + fence

    @cached_property
    def outlines(self) -> "Outlines":
        """The outlines for C, built on first use; only for an airspace that is not open."""
        # Imported here, as most runs have no areas: 24 ms, and shapely, below, 10 ms.
        from mission.base.native.library import Outlines

        # A little more than the margin, so that rounding leaves what lies there free.
        beside_m, rings = self.margin_m + 2 * _SLACK_M, self._rings
        vertices_m, places_m = (
            np.vstack([_offset_corners(ring, beside_m, inner=inner) for ring in rings])
            for inner in (False, True)
        )
        margins_m = self.margin_m - _SLACK_M, _SLACK_M, beside_m
        return Outlines(
            rings, fenced=self.keep_in is not None, margins_m=margins_m, vertices_m=vertices_m,
            places_m=places_m, shifts=_RINGS,
        )  # fmt: skip

    def allows(self, points_m: Floats) -> Bools:
        """(P,) whether points (P, 2) lie outside all no-fly areas and within the fence.

        A point on an outline is not allowed. The margin does not count.
        """
        if self.is_open:
            return np.ones(len(points_m), dtype=bool)
        return self.outlines.allow(points_m)

    def outside(self, points_m: Floats) -> Bools:
        """(P,) whether points (P, 2) are allowed, and off every outline by more than rounding."""
        return self.allows(points_m) & ~self.crosses(points_m, points_m)

    def free(self, points_m: Floats) -> Bools:
        """(P,) whether points (P, 2) are allowed, and at least the margin from every outline."""
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
        return self.outlines.keep(from_m, to_m, away_m)

    def moved(self, points_m: Floats) -> Floats:
        """Return points (P, 2), each that is not free moved to a free place close to it.

        An allowed point stays on its own side of every outline.

        Raises:
            ValueError: no free place was found for a point.
        """
        return np.array(points_m) if self.is_open else self.outlines.moved(points_m)

    def way(self, from_m: Floats, to_m: Floats) -> Floats:
        """Return the shortest path (P, 2) between two points (2,), both among its points.

        It leaves a start that is not free by a free place nearby; the end has to be free.

        Raises:
            ValueError: there is no way.
        """
        way, _ = self.route(np.array([from_m, to_m], dtype=np.float64))
        if (way[-1] != to_m).any():
            raise ValueError("there is no way")
        return way

    def route(self, waypoints_m: Floats) -> tuple[Floats, Ints]:
        """Return the route (P, 2) around areas through waypoints (N, 2), and their indices (N,).

        Waypoints that are not free are moved to free places; the start stays. A waypoint that
        cannot be reached is put where the one before it is.
        """
        if self.is_open:
            return np.ascontiguousarray(waypoints_m), np.arange(len(waypoints_m))
        return self.outlines.route(waypoints_m)

    def away(self, points_m: Floats) -> Floats:
        """(P,) metres from points (P, 2) to the nearest outline, margin aside; 0 where allowed."""
        return np.zeros(len(points_m)) if self.is_open else self.outlines.away(points_m)


OPEN = Airspace()


def apart_within(outline_m: Floats, holes_m: Sequence[Floats]) -> bool:
    """Whether holes (n, 2) lie within an outline, and apart from each other."""
    import shapely

    return bool(shapely.Polygon(outline_m, holes_m).is_valid)


def triangles(rings_m: Sequence[Floats]) -> Floats:
    """Triangulate the first outline (n, 2) without the others, its holes: corners (T, 3, 2)."""
    import shapely

    area = shapely.Polygon(rings_m[0], rings_m[1:])
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    corners: Floats = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    return corners


def circle(center_m: Floats, radius_m: float) -> Floats:
    """The outline of a circle: corners (n, 2) on it."""
    turn = np.linspace(0.0, 2 * math.pi, _OF_CIRCLE, endpoint=False)
    return center_m + radius_m * np.column_stack((np.cos(turn), np.sin(turn)))


def within(areas: Sequence[tuple[int, Floats]], place_m: ArrayLike) -> tuple[Floats, ...]:
    """Return the outline (n, 2), and its holes', of what lies inside all areas of one group,
    whichever (areas: group, corners); of several parts the nearest to a place (2,) or about it.

    Raises:
        ValueError: that is nowhere.
    """
    if len(areas) <= 1:
        return tuple(ring for _, ring in areas)
    import shapely

    groups: dict[int, list[shapely.Polygon]] = {}
    for group, ring in areas:
        groups.setdefault(group, []).append(shapely.Polygon(ring))
    shared = shapely.get_parts([shapely.intersection_all(group) for group in groups.values()])
    whole = shapely.union_all(shared[shapely.area(shared) > 0.0])  # without lines and points

    def outlines(part: shapely.Polygon) -> tuple[Floats, ...]:
        lines = part.exterior, *part.interiors
        corners = [shapely.get_coordinates(line)[:-1] for line in lines if not line.is_empty]
        return tuple(ring for ring in corners if not flaw(ring))  # without slivers, by rounding

    parts = shapely.get_parts(shapely.set_precision(whole, _GRID_M))
    parts = [part for part in parts if outlines(part)]
    if not parts:
        raise ValueError(
            "the areas of no group have a place in common; areas of which one is enough need "
            "different groups"
        )
    return outlines(min(parts, key=lambda part: float(part.distance(shapely.Point(place_m)))))


def _oriented(ring_m: Floats, *, clockwise: bool) -> Floats:
    import shapely

    ring_m = ring_m[(ring_m != np.roll(ring_m, 1, axis=0)).any(axis=1)]  # each corner once
    return ring_m[::-1] if shapely.is_ccw(shapely.linearrings(ring_m)) == clockwise else ring_m


def _offset_corners(ring_m: Floats, margin_m: float, *, inner: bool) -> Floats:
    """Offset a ring (n, 2) by the margin to its free (left) side: points (P, 2) around its convex
    corners, or with `inner` one at each of the other corners.
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
    """Simplify a path (n, 2): the dropped points lie within `tolerance` of it. Points with a NaN
    are dropped first."""
    import shapely

    points = points[~np.isnan(points).any(axis=1)]
    if len(points) < 2:
        return points
    line = shapely.simplify(shapely.linestrings(points), tolerance, preserve_topology=False)
    return np.asarray(shapely.get_coordinates(line))


Length = Annotated[float, Field(gt=0, le=100_000, strict=True)]
Coordinate = Annotated[float, Field(ge=-100_000, le=100_000, strict=True)]
Corners = Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=3, max_length=500)]


class FenceArea(Table):
    """A polygon or a circle; flights are inside all areas of one group, whichever."""

    polygon_m: Corners | None = None
    """its corners in area coordinates"""
    center_m: tuple[Coordinate, Coordinate] | None = None
    """of a circle"""
    radius_m: Length | None = None
    """of a circle"""
    group: int = Field(0, strict=True, ge=0, le=255)
    """its group"""

    @model_validator(mode="after")
    def _an_area(self) -> Self:
        if [self.center_m is None, self.radius_m is None] != [self.polygon_m is not None] * 2:
            raise ValueError("must have polygon_m, or center_m and radius_m")
        if wrong := flaw(self.outline_m):
            raise ValueError(f"its outline {wrong}")
        return self

    @property
    def outline_m(self) -> Floats:
        """Its corners (n, 2)."""
        if self.center_m is None or self.radius_m is None:
            return np.array(self.polygon_m)
        return circle(np.array(self.center_m), self.radius_m)


def joined(
    first_m: Sequence[ArrayLike] | None, areas: Sequence[FenceArea], place_m: ArrayLike
) -> tuple[Floats, ...]:
    """`within` of areas, and of corners (n, 2) that are one of group 0."""
    first = [] if first_m is None else [(0, np.array(first_m))]
    return within([*first, *((area.group, area.outline_m) for area in areas)], place_m)
