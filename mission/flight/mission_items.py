"""A round's flight as mission items: those that are uploaded, and that its plan file holds."""

import math

from pymavlink.dialects.v20 import common as mav

from mission.base.area import Area, on_globe
from mission.flight.flight_plan import FlightPlan
from sitl.autopilot.codec.orders import MissionItem

DEG_E7 = 1e7  # places travel in whole ten-millionths of a degree
_GROUND_SPEED = 1.0
_UNCHANGED = -1.0


def mission_items(plan: FlightPlan, area: Area) -> list[MissionItem]:
    """The stops as items: the first stop, the speed of all legs, the other stops.

    The first stop is where the vehicle already is; the speed stands after it because autopilots
    apply DO_CHANGE_SPEED to the leg after the item before it. See `stop_items`.
    """
    places = on_globe(area, plan.points_m, plan.alt_rel_m)
    waypoints = [
        MissionItem(
            seq=seq,
            command=mav.MAV_CMD_NAV_WAYPOINT,
            frame=mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
            params=(stop.hold_s, plan.acceptance_m, 0.0, math.nan),
            x=round(place.lat_deg * DEG_E7) / DEG_E7,
            y=round(place.lon_deg * DEG_E7) / DEG_E7,
            z=plan.alt_rel_m,
        )
        for seq, stop, place in zip(stop_items(plan), plan.stops, places, strict=True)
    ]
    speed = MissionItem(
        seq=1,
        command=mav.MAV_CMD_DO_CHANGE_SPEED,
        frame=mav.MAV_FRAME_MISSION,
        params=(_GROUND_SPEED, plan.speed_mps, _UNCHANGED, 0.0),
        x=0.0,
        y=0.0,
        z=0.0,
    )
    return [waypoints[0], speed, *waypoints[1:]]


def stop_items(plan: FlightPlan) -> list[int]:
    """The number of every stop among the `mission_items`."""
    return [0, *range(2, len(plan.stops) + 1)]
