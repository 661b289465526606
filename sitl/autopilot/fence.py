"""The geofence: polygons and circles to stay in or out of, and the cylinder about home."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import LocalFrame
from flightdyn.obstacles import Obstacles
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


@dataclass(frozen=True, slots=True)
class Circle:
    """A circular area about a point."""

    north_m: float
    east_m: float
    radius_m: float


Shape: TypeAlias = Circle | Vector  # of a polygon the corners (M, 2), either way round


class _Areas:
    """Polygons and circles, prepared for point-in-area tests."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        circles = [(s.north_m, s.east_m, s.radius_m) for s in shapes if isinstance(s, Circle)]
        self._circles = np.array(circles).reshape(-1, 3).T
        rings = [shape for shape in shapes if not isinstance(shape, Circle)]
        self._polygons = Obstacles([((ring,), np.inf) for ring in rings])  # of any height

    def contain(self, north: float, east: float) -> bool:
        """Whether a point lies in one of the areas."""
        n, e, radius = self._circles
        within = np.hypot(north - n, east - e) <= radius
        return bool(within.any()) or self._polygons.contain(north, east, 0.0)


@dataclass(frozen=True)
class Fence:
    """A geofence: be inside one of `inclusions`, if there are any, and outside all `exclusions`."""

    inclusions: tuple[Shape, ...] = ()
    exclusions: tuple[Shape, ...] = ()

    @cached_property
    def _prepared(self) -> tuple[_Areas, _Areas]:
        return _Areas(self.inclusions), _Areas(self.exclusions)

    def breach(self, pos_ned_m: Vector) -> str:
        """Describe the breach at one (3,) or any of (P, 3) points; empty if there is none."""
        points = np.atleast_2d(pos_ned_m)[:, :2]
        keep_in, keep_out = self._prepared
        if self.inclusions and not all(keep_in.contain(*point) for point in points):
            return "outside the fence"
        if self.exclusions and any(keep_out.contain(*point) for point in points):
            return "inside an excluded area"
        return ""


def breach_of(
    fence: Fence, pos_ned_m: Vector, *, home_ned_m: Vector, parameters: Parameters
) -> str:
    """Describe the breach of the fence or the cylinder about home at one (3,) or any of (P, 3)
    points; empty if there is none, or if GF_ACTION switches both off."""
    if parameters["GF_ACTION"] == 0:
        return ""
    return fence.breach(pos_ned_m) or _cylinder_breach(pos_ned_m, home_ned_m, parameters)


def _cylinder_breach(pos_ned_m: Vector, home_ned_m: Vector, parameters: Parameters) -> str:
    """Describe how (3,) or any of (P, 3) points is too far from home or too high; empty if not."""
    far, high = parameters["GF_MAX_HOR_DIST"], parameters["GF_MAX_VER_DIST"]
    offset = np.atleast_2d(pos_ned_m) - np.asarray(home_ned_m)
    if far > 0 and np.hypot(offset[:, 0], offset[:, 1]).max() > far:
        return f"farther than {far:g} m from home"
    if high > 0 and -offset[:, 2].min() > high:
        return f"higher than {high:g} m above home"
    return ""


def compile_fence(items: Sequence[MissionItem], frame: LocalFrame) -> Fence:
    """Build the fence that uploaded items describe.

    Raises:
        SitlInputError: a polygon has fewer vertices than its items say, or they disagree.
    """
    areas: dict[bool, list[Shape]] = {True: [], False: []}
    index = 0
    while index < len(items):
        item = items[index]
        count = 1
        if item.command in _CIRCLES:
            north, east, _ = frame.to_ned(item.x, item.y, frame.origin.alt_msl_m)
            area: Shape = Circle(float(north), float(east), item.params[0])
        else:
            count = round(item.params[0])
            group = items[index : index + count]
            same = all((i.command, i.params[0]) == (item.command, item.params[0]) for i in group)
            if len(group) < count or not same:
                raise SitlInputError(f"fence item {index}: a polygon of {count} corners is needed")
            points = [frame.to_ned(i.x, i.y, frame.origin.alt_msl_m)[:2] for i in group]
            area = np.array(points)
        areas[item.command in _INCLUSIONS].append(area)
        index += count
    return Fence(tuple(areas[True]), tuple(areas[False]))
