"""The geofence: polygons and circles to stay in or out of, and the cylinder about home."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightdyn.frames import LocalFrame
from flightdyn.state import Vector
from sitl.autopilot.enums import Command
from sitl.autopilot.messages import MissionItem
from sitl.autopilot.parameters import Parameters
from sitl.errors import SitlInputError

_INCLUSIONS = frozenset(
    {Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, Command.NAV_FENCE_CIRCLE_INCLUSION}
)
_CIRCLES = frozenset({Command.NAV_FENCE_CIRCLE_INCLUSION, Command.NAV_FENCE_CIRCLE_EXCLUSION})


@dataclass(frozen=True, slots=True)
class Polygon:
    """An area with these corners, in either direction of rotation."""

    corners_ne_m: Vector  # (M, 2)

    def contains(self, north: float, east: float) -> bool:
        """Crossing-number test of a point."""
        inside = False
        ahead = self.corners_ne_m
        for (n1, e1), (n2, e2) in zip(ahead, np.roll(ahead, -1, axis=0), strict=True):
            if (e1 > east) != (e2 > east) and north < (n2 - n1) * (east - e1) / (e2 - e1) + n1:
                inside = not inside
        return inside


@dataclass(frozen=True, slots=True)
class Circle:
    """An area about a point."""

    north_m: float
    east_m: float
    radius_m: float

    def contains(self, north: float, east: float) -> bool:
        """Whether a point lies in it."""
        return math.hypot(north - self.north_m, east - self.east_m) <= self.radius_m


@dataclass(frozen=True, slots=True)
class Fence:
    """Be inside one of `inclusions`, if there are any, and outside all `exclusions`."""

    inclusions: tuple[Polygon | Circle, ...] = ()
    exclusions: tuple[Polygon | Circle, ...] = ()

    def breach(self, pos_ned_m: Vector) -> str:
        """What is wrong with being there; empty if nothing."""
        north, east = float(pos_ned_m[0]), float(pos_ned_m[1])
        if self.inclusions and not any(area.contains(north, east) for area in self.inclusions):
            return "outside the fence"
        if any(area.contains(north, east) for area in self.exclusions):
            return "inside an excluded area"
        return ""


def breach_of(
    fence: Fence, pos_ned_m: Vector, *, home_ned_m: Vector, parameters: Parameters
) -> str:
    """What fence and cylinder have against being there; empty if nothing, or if switched off."""
    if parameters["GF_ACTION"] == 0:
        return ""
    return fence.breach(pos_ned_m) or _cylinder_breach(pos_ned_m, home_ned_m, parameters)


def _cylinder_breach(pos_ned_m: Vector, home_ned_m: Vector, parameters: Parameters) -> str:
    """Whether a position is too far from home or too high; empty if not."""
    far, high = parameters["GF_MAX_HOR_DIST"], parameters["GF_MAX_VER_DIST"]
    offset = np.asarray(pos_ned_m) - np.asarray(home_ned_m)
    if far > 0 and math.hypot(float(offset[0]), float(offset[1])) > far:
        return f"farther than {far:g} m from home"
    if high > 0 and -float(offset[2]) > high:
        return f"higher than {high:g} m above home"
    return ""


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
