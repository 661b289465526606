"""Geofences: from the airspace to MAVLink fence items, and from those to zones for log and maps."""

from collections.abc import Iterable, Sequence

import numpy as np
from pymavlink.dialects.v20 import common as mav

from mission.base.airspace import circle
from mission.base.area import Area, on_globe
from mission.base.arrays import Floats
from mission.log.values import Zone
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.fence import Circle, Shape, compile_fence
from sitl.autopilot.parameters import Parameters

_RINGS = (
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
)
_CIRCLES = mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION, mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION

Place = tuple[float, float]  # latitude, longitude in degrees


def fence_items(
    rings: Iterable[tuple[bool, Sequence[Place]]], circles: Iterable[tuple[bool, float, Place]] = ()
) -> tuple[MissionItem, ...]:
    """Return a fence's mission items: rings are (keep in, corners in degrees), circles (keep in,
    radius in metres, centre)."""
    drawn = [(_RINGS[inside], float(len(ring)), place) for inside, ring in rings for place in ring]
    drawn += [(_CIRCLES[inside], radius_m, centre) for inside, radius_m, centre in circles]
    return tuple(
        MissionItem(
            seq, command, mav.MAV_FRAME_GLOBAL, (size, 0.0, 0.0, 0.0), round(lat_deg, 7),
            round(lon_deg, 7), 0.0, mav.MAV_MISSION_TYPE_FENCE,
        )
        for seq, (command, size, (lat_deg, lon_deg)) in enumerate(drawn)
    )  # fmt: skip


def airspace_rings(area: Area) -> list[tuple[bool, list[Place]]]:
    """Return the airspace's zones as (keep in, corners in latitude and longitude); none if open."""
    return [
        (zone.keep_in, [(p.lat_deg, p.lon_deg) for p in on_globe(area, zone.outline_m, 0.0)])
        for zone in airspace_zones(area)
    ]


def airspace_zones(area: Area) -> tuple[Zone, ...]:
    """Return the polygons of an area's airspace: no-fly areas, and the fence if it has one."""
    space = area.airspace
    zones = [Zone(ring, keep_in=False) for ring in space.keep_out]
    return (*zones, *(() if space.keep_in is None else (Zone(space.keep_in, keep_in=True),)))


def fence_of(items: Sequence[MissionItem], parameters: Parameters, area: Area) -> tuple[Zone, ...]:
    """What the vehicle keeps to: the fence drawn by `items`, and the circle about home that
    `GF_MAX_HOR_DIST` makes; nothing where `GF_ACTION` switches the fence off.

    Raises:
        InputError: the items make no fence.
    """
    zones = item_zones(items, area)
    if parameters["GF_ACTION"] == 0:
        return ()
    if parameters["GF_MAX_HOR_DIST"] > 0:
        about_home = Circle(0.0, 0.0, parameters["GF_MAX_HOR_DIST"])
        zones = (*zones, Zone(_outline(about_home, area), keep_in=True))
    return zones


def item_zones(items: Sequence[MissionItem], area: Area) -> tuple[Zone, ...]:
    """Return the zones that fence items describe, with circles as polygons.

    Raises:
        InputError: the items make no fence.
    """
    corners = [i for i in items if i.command in _CIRCLES or (i.command in _RINGS and i.params[0])]
    fence = compile_fence(corners, area.frame, checked=False)
    return (
        *(Zone(_outline(shape, area), keep_in=True) for shape in fence.inclusions),
        *(Zone(_outline(shape, area), keep_in=False) for shape in fence.exclusions),
    )


def _outline(shape: Shape, area: Area) -> Floats:
    if isinstance(shape, Circle):
        shape = circle(np.array([shape.north_m, shape.east_m]), shape.radius_m)
    return area.from_ned(np.column_stack((shape, np.zeros(len(shape)))))
