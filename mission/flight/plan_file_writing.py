"""A round's flight as a QGroundControl `.plan` file, for ground stations to show or to fly.

Format: QGroundControl developer guide, "Plan File Format".
"""

import json
import math
from pathlib import Path

from mission.base.area import Area
from mission.base.errors import InputError
from mission.base.run_folder import write_atomically
from mission.flight.flight_plan import FlightPlan
from mission.flight.mission_items import mission_items
from sitl.autopilot.values.enums import Command, Frame

_PX4, _MULTIROTOR = 12, 2  # MAV_AUTOPILOT, MAV_TYPE


def write_round_plan(path: Path, plan: FlightPlan, area: Area) -> None:
    """Write a round's flight as a `.plan` file: the very items that are uploaded.

    Raises:
        InputError: it cannot be written.
    """
    items = []
    for item in mission_items(plan, plan.positions(area)):
        place = item.command != Command.DO_CHANGE_SPEED
        where = {"Altitude": item.z, "AltitudeMode": 1, "AMSLAltAboveTerrain": None}
        items.append(
            {
                **(where if place else {}),
                "autoContinue": True,
                "command": item.command,
                "doJumpId": item.seq + 1,
                "frame": Frame.GLOBAL_RELATIVE_ALT if place else Frame.MISSION,
                "params": [*map(_or_null, item.params), item.x, item.y, item.z],
                "type": "SimpleItem",
            }
        )
    home = area.home
    document = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "Aerofed",
        "geoFence": {"circles": [], "polygons": _polygons(area), "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {
            "version": 2,
            "firmwareType": _PX4,
            "vehicleType": _MULTIROTOR,
            "cruiseSpeed": plan.speed_mps,
            "hoverSpeed": plan.speed_mps,
            "globalPlanAltitudeMode": 1,
            "plannedHomePosition": [home.lat_deg, home.lon_deg, home.alt_msl_m],
            "items": items,
        },
    }
    try:
        path.parent.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot write: {error.strerror}") from None
    write_atomically(path, json.dumps(document, indent=2, allow_nan=False) + "\n")


def _polygons(area: Area) -> list[dict[str, object]]:
    """The areas that must not be flown, and the fence."""
    space = area.airspace
    rings = [(False, ring) for ring in space.keep_out]
    if space.keep_in is not None:
        rings.append((True, space.keep_in))
    polygons: list[dict[str, object]] = []
    for inclusion, ring in rings:
        places = [area.frame.to_geodetic(ned) for ned in area.to_ned(ring, 0.0)]
        corners = [[place.lat_deg, place.lon_deg] for place in places]
        polygons.append({"inclusion": inclusion, "polygon": corners, "version": 1})
    return polygons


def _or_null(value: float) -> float | None:
    return None if math.isnan(value) else value
