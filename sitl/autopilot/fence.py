"""The geofence: polygons and circles to stay in or out of, and the cylinder about home."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import LocalFrame
from flightdyn.obstacles import Obstacles, flaw
from flightdyn.state import Vector
from native.errors import InputError
from sitl.autopilot.codec import ranges
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.parameters import Parameters

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


class FenceError(InputError):
    """Items make no fence; `result` is their MAV_MISSION_RESULT."""

    def __init__(self, text: str, result: int) -> None:
        super().__init__(text)
        self.result = result


class _Areas:
    """Polygons and circles, prepared for point-in-area tests."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        self._round = np.array([isinstance(shape, Circle) for shape in shapes], dtype=np.bool_)
        circles = [(s.north_m, s.east_m, s.radius_m) for s in shapes if isinstance(s, Circle)]
        self._circles = np.array(circles).reshape(-1, 3).T
        rings = [shape for shape in shapes if not isinstance(shape, Circle)]
        self._polygons = Obstacles([((ring,), -np.inf, np.inf) for ring in rings])  # of any height

    def contain(self, north: float, east: float) -> NDArray[np.bool_]:
        """(S,) whether each contains a point."""
        inside, (n, e, radius) = np.empty_like(self._round), self._circles
        inside[self._round] = np.hypot(north - n, east - e) <= radius
        inside[~self._round] = self._polygons.within(north, east)
        return inside


@dataclass(frozen=True)
class Fence:
    """A geofence: be inside all `inclusions` of a group, of one group at least if there are any,
    and outside all `exclusions`."""

    inclusions: tuple[Shape, ...] = ()
    exclusions: tuple[Shape, ...] = ()
    groups: tuple[float, ...] = ()  # of each inclusion

    @cached_property
    def _prepared(self) -> tuple[_Areas, _Areas, NDArray[np.intp]]:
        _, groups = np.unique(self.groups, return_inverse=True)
        return _Areas(self.inclusions), _Areas(self.exclusions), groups

    def breach(self, pos_ned_m: Vector) -> str:
        """Describe the breach at one (3,) or any of (P, 3) points; empty if there is none."""
        points = np.atleast_2d(pos_ned_m)[:, :2]
        keep_in, keep_out, groups = self._prepared
        for point in points if self.inclusions else ():
            left = groups[~keep_in.contain(*point)]
            if np.bincount(left, minlength=groups.max() + 1).all():
                return "outside the fence"
        if self.exclusions and any(keep_out.contain(*point).any() for point in points):
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


def compile_fence(
    items: Sequence[MissionItem], frame: LocalFrame, *, checked: bool = True
) -> Fence:
    """Build the fence that items describe; not `checked`, whatever its outlines and groups are.

    Raises:
        FenceError: a polygon has fewer vertices than its items say, they disagree, or it crosses
            itself.
    """
    areas: dict[bool, list[Shape]] = {True: [], False: []}
    groups: list[float] = []
    index = 0
    while index < len(items):
        item, size = items[index], items[index].params[0]
        count = 1 if item.command in _CIRCLES else int(size) if size in ranges.CORNERS else 0
        drawn, inside = items[index : index + count], item.command in _INCLUSIONS
        if not drawn or [(i.command, i.params[0]) for i in drawn] != [(item.command, size)] * count:
            words = f"fence item {index}: a polygon of {size:g} corners is needed"
            raise FenceError(words, mav.MAV_MISSION_INVALID_PARAM1)
        corners = np.array([frame.to_ned(i.x, i.y, frame.origin.alt_msl_m)[:2] for i in drawn])
        group, *others = {0.0 if math.isnan(i.params[1]) else i.params[1] for i in drawn}
        if checked and item.command not in _CIRCLES:
            number, last = len(areas[True] + areas[False]), index + count - 1
            words = f"fence area {number} (points {index} to {last})"
            # In degrees, where a parallel is straight; about the first, as longitudes turn over.
            placed = np.array([(i.x, (i.y - item.y + 180.0) % 360.0) for i in drawn])
            if wrong := flaw(placed, first=index):
                raise FenceError(f"{words} {wrong}", mav.MAV_MISSION_INVALID)
            if inside and others:
                reason = "has points of several groups (parameter 2): must be one"
                raise FenceError(f"{words} {reason}", mav.MAV_MISSION_INVALID_PARAM2)
        north, east = corners[0].tolist()
        areas[inside].append(Circle(north, east, size) if item.command in _CIRCLES else corners)
        groups += [group] * inside
        index += count
    return Fence(tuple(areas[True]), tuple(areas[False]), tuple(groups))
