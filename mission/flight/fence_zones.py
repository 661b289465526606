"""The autopilot's fence as it lies on the ground, for the log and the maps."""

import math
from collections.abc import Sequence

import numpy as np
from pymavlink.dialects.v20 import common as mav

from mission.base.area import Area
from mission.base.arrays import Floats
from mission.log.values import Zone
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.fence import Circle, Polygon, compile_fence
from sitl.autopilot.parameters import Parameters


def fence_items(area: Area) -> list[MissionItem]:
    """The fence of an area's airspace as it is uploaded; nothing where it is open."""
    space = area.airspace
    rings = [(mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION, ring) for ring in space.keep_out]
    if space.keep_in is not None:
        rings.append((mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, space.keep_in))
    items: list[MissionItem] = []
    for command, ring in rings:
        for ned in area.to_ned(ring, 0.0):
            place = area.frame.to_geodetic(ned)
            items.append(
                MissionItem(
                    seq=len(items),
                    command=command,
                    frame=mav.MAV_FRAME_GLOBAL,
                    params=(float(len(ring)), 0.0, 0.0, 0.0),
                    x=place.lat_deg,
                    y=place.lon_deg,
                    z=0.0,
                    mission_type=mav.MAV_MISSION_TYPE_FENCE,
                )
            )
    return items


def airspace_zones(area: Area) -> tuple[Zone, ...]:
    """The areas and the fence of an area's airspace, for the log and the maps."""
    space = area.airspace
    zones = [Zone(ring, keep_in=False) for ring in space.keep_out]
    return (*zones, *(() if space.keep_in is None else (Zone(space.keep_in, keep_in=True),)))


_CORNERS = 72  # of a circle: its outline lies within a thousandth of the radius


def fence_of(items: Sequence[MissionItem], parameters: Parameters, area: Area) -> tuple[Zone, ...]:
    """What the vehicle keeps to: the fence drawn by `items`, and the circle about home that
    `GF_MAX_HOR_DIST` makes; nothing where `GF_ACTION` switches the fence off.

    Raises:
        SitlInputError: the items make no fence.
    """
    fence = compile_fence(items, area.frame)
    if parameters["GF_ACTION"] == 0:
        return ()
    zones = [Zone(_outline(shape, area), keep_in=True) for shape in fence.inclusions]
    zones += [Zone(_outline(shape, area), keep_in=False) for shape in fence.exclusions]
    if parameters["GF_MAX_HOR_DIST"] > 0:
        about_home = Circle(0.0, 0.0, parameters["GF_MAX_HOR_DIST"])
        zones.append(Zone(_outline(about_home, area), keep_in=True))
    return tuple(zones)


def _outline(shape: Polygon | Circle, area: Area) -> Floats:
    if isinstance(shape, Polygon):
        north, east = shape.corners_ne_m.T
    else:
        turn = np.linspace(0.0, 2 * math.pi, _CORNERS, endpoint=False)
        north = shape.north_m + shape.radius_m * np.cos(turn)
        east = shape.east_m + shape.radius_m * np.sin(turn)
    return area.from_ned(np.column_stack((north, east, np.zeros(len(north)))))
