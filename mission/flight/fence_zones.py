"""The autopilot's fence as it lies on the ground, for the log and the maps."""

import math
from collections.abc import Sequence

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.log.values import Zone
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.fence import Circle, Polygon, compile_fence
from sitl.autopilot.parameters import Parameters


def fence_items(area: Area) -> list[MissionItem]:
    """The fence of an area's airspace as it is uploaded; nothing where it is open."""
    items: list[MissionItem] = []
    for zone in airspace_zones(area):
        for place in corners_of(zone, area):
            items.append(
                MissionItem(
                    seq=len(items),
                    command=mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
                    if zone.keep_in
                    else mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
                    frame=mav.MAV_FRAME_GLOBAL,
                    params=(float(len(zone.outline_m)), 0.0, 0.0, 0.0),
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


def corners_of(zone: Zone, area: Area) -> list[GeodeticPoint]:
    """The corners of a zone on the globe, in its order."""
    return [area.frame.to_geodetic(ned) for ned in area.to_ned(zone.outline_m, 0.0)]


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
