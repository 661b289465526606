"""The geofence: polygons and circles to stay in or out of, and the cylinder about home."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import LocalFrame
from flightdyn.state import Vector
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.parameters import Parameters
from sitl.errors import SitlInputError

_INCLUSIONS = frozenset(
    {mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION}
)
_CIRCLES = frozenset(
    {mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION}
)


_PAIRS = 1 << 20  # of a point and an edge that are looked at together


@dataclass(frozen=True, slots=True)
class Polygon:
    """An area with these corners, in either direction of rotation."""

    corners_ne_m: Vector  # (M, 2)

    def contains(self, north: float, east: float) -> bool:
        """Whether a point lies in it."""
        return bool(Areas((self,)).contain(np.array([[north, east]]))[0])


@dataclass(frozen=True, slots=True)
class Circle:
    """An area about a point."""

    north_m: float
    east_m: float
    radius_m: float


class Areas:
    """Polygons and circles, prepared to be asked about many points at once."""

    def __init__(self, shapes: Sequence[Polygon | Circle]) -> None:
        polygons = [shape.corners_ne_m for shape in shapes if isinstance(shape, Polygon)]
        circles = [s for s in shapes if isinstance(s, Circle)]
        self._circles = np.array([(c.north_m, c.east_m, c.radius_m) for c in circles]).T
        self._firsts = np.cumsum([0, *map(len, polygons)])[:-1]  # edge of each polygon
        self._edges = np.empty((4, 0))
        if polygons:
            (n1, e1), (n2, e2) = (
                np.vstack(polygons).T,
                np.vstack([np.roll(corners, -1, axis=0) for corners in polygons]).T,
            )
            crosswise = e1 != e2  # an edge due north is never crossed
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = np.where(crosswise, (n2 - n1) / (e2 - e1), 0.0)
            self._edges = np.array([n1, e1, e2, slope])

    def contain(self, points_ne_m: Vector) -> NDArray[np.bool_]:
        """Whether each of `points_ne_m` (P, 2) lies in one of the areas: (P,)."""
        inside = np.zeros(len(points_ne_m), dtype=bool)
        for test, parts in ((self._in_circles, self._circles), (self._in_polygons, self._edges)):
            if parts.size:
                at_once = max(1, _PAIRS // parts.shape[1])
                for first in range(0, len(points_ne_m), at_once):
                    some = slice(first, first + at_once)
                    inside[some] |= test(points_ne_m[some])
        return inside

    def _in_circles(self, points_ne_m: Vector) -> NDArray[np.bool_]:
        north, east, radius = self._circles
        distance = np.hypot(points_ne_m[:, :1] - north, points_ne_m[:, 1:] - east)
        return np.asarray((distance <= radius).any(axis=1))

    def _in_polygons(self, points_ne_m: Vector) -> NDArray[np.bool_]:
        """Crossing-number test of each point against each polygon."""
        n1, e1, e2, slope = self._edges
        north, east = points_ne_m[:, :1], points_ne_m[:, 1:]
        crossed = ((e1 > east) != (e2 > east)) & (north < slope * (east - e1) + n1)
        odd = np.logical_xor.reduceat(crossed, self._firsts, axis=1)
        return np.asarray(odd.any(axis=1))


@dataclass(frozen=True)
class Fence:
    """Be inside one of `inclusions`, if there are any, and outside all `exclusions`."""

    inclusions: tuple[Polygon | Circle, ...] = ()
    exclusions: tuple[Polygon | Circle, ...] = ()

    @cached_property
    def _prepared(self) -> tuple[Areas, Areas]:
        return Areas(self.inclusions), Areas(self.exclusions)

    def breach(self, pos_ned_m: Vector) -> str:
        """What is wrong with being there, (3,), or in any of (P, 3) places; empty if nothing."""
        points = np.atleast_2d(pos_ned_m)[:, :2]
        keep_in, keep_out = self._prepared
        if self.inclusions and not keep_in.contain(points).all():
            return "outside the fence"
        if self.exclusions and keep_out.contain(points).any():
            return "inside an excluded area"
        return ""


def breach_of(
    fence: Fence, pos_ned_m: Vector, *, home_ned_m: Vector, parameters: Parameters
) -> str:
    """What fence and cylinder have against being there, (3,), or in any of (P, 3) places; empty if
    nothing, or if switched off."""
    if parameters["GF_ACTION"] == 0:
        return ""
    return fence.breach(pos_ned_m) or _cylinder_breach(pos_ned_m, home_ned_m, parameters)


def _cylinder_breach(pos_ned_m: Vector, home_ned_m: Vector, parameters: Parameters) -> str:
    """Whether a position is too far from home or too high; empty if not."""
    far, high = parameters["GF_MAX_HOR_DIST"], parameters["GF_MAX_VER_DIST"]
    offset = np.atleast_2d(pos_ned_m) - np.asarray(home_ned_m)
    if far > 0 and np.hypot(offset[:, 0], offset[:, 1]).max() > far:
        return f"farther than {far:g} m from home"
    if high > 0 and -offset[:, 2].min() > high:
        return f"higher than {high:g} m above home"
    return ""


class Geofence:
    """The fence that is in force: as it was uploaded, and the cylinder of the parameters."""

    def __init__(self, frame: LocalFrame, parameters: Parameters) -> None:
        self.enabled = True
        self._frame = frame
        self._parameters = parameters
        self._drawn = Fence()

    def draw(self, items: Sequence[MissionItem]) -> None:
        """Another fence; none where there are no items.

        Raises:
            SitlInputError: the items make no fence.
        """
        self._drawn = compile_fence(items, self._frame)

    @property
    def in_force(self) -> bool:
        """Whether there is a fence, and it is not switched off."""
        p = self._parameters
        cylinder = p["GF_MAX_HOR_DIST"] > 0 or p["GF_MAX_VER_DIST"] > 0
        drawn = bool(self._drawn.inclusions or self._drawn.exclusions)
        return self.enabled and p["GF_ACTION"] != 0 and (cylinder or drawn)

    def breach(self, pos_ned_m: Vector, *, home_ned_m: Vector) -> str:
        """What it has against being there, (3,), or in any of (P, 3) places; empty if nothing."""
        if not self.enabled:
            return ""
        return breach_of(self._drawn, pos_ned_m, home_ned_m=home_ned_m, parameters=self._parameters)


def compile_fence(items: Sequence[MissionItem], frame: LocalFrame) -> Fence:
    """The fence that uploaded items describe.

    Raises:
        SitlInputError: the vertices of a polygon are not as many as each of them says.
    """
    areas: dict[bool, list[Polygon | Circle]] = {True: [], False: []}
    index = 0
    while index < len(items):
        item = items[index]
        count = 1
        if item.command in _CIRCLES:
            north, east, _ = frame.to_ned(item.x, item.y, frame.origin.alt_msl_m)
            area: Polygon | Circle = Circle(float(north), float(east), item.params[0])
        else:
            count = round(item.params[0])
            group = items[index : index + count]
            same = all((i.command, i.params[0]) == (item.command, item.params[0]) for i in group)
            if len(group) < count or not same:
                raise SitlInputError(f"fence item {index}: a polygon of {count} corners is needed")
            points = [frame.to_ned(i.x, i.y, frame.origin.alt_msl_m)[:2] for i in group]
            area = Polygon(np.array(points))
        areas[item.command in _INCLUSIONS].append(area)
        index += count
    return Fence(tuple(areas[True]), tuple(areas[False]))
