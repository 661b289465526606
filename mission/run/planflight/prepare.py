"""From a plan file to everything that its flight needs; whatever can be refused is refused here."""

import math
from dataclasses import dataclass, replace

import numpy as np

from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.base.errors import InputError
from mission.config.models import AreaConfig, RunConfig
from mission.flight.fence_zones import fence_of
from mission.flight.flyers.simulated import simulated_vehicle
from mission.flight.pilot.importer import Imported, import_plan
from mission.flight.plan_file import PlanFile
from mission.log.values import Zone
from mission.run.planflight.check import PlannedPath, check_items, here_means
from sitl.autopilot.protocol.item_rules import PLACES
from sitl.vehicle import Vehicle

_MARGIN_M = 50.0  # around the plan, for the map


@dataclass(frozen=True)
class PreparedPlan:
    """A plan that may be flown, and the vehicle on the ground at its home."""

    plan: PlanFile
    imported: Imported
    path: PlannedPath
    area: Area
    fence: tuple[Zone, ...]
    vehicle: Vehicle
    config: RunConfig


def prepare_plan(config: RunConfig, plan: PlanFile) -> PreparedPlan:
    """Import and check a plan.

    Raises:
        InputError: it holds what may not be flown, or the vehicle's settings are refused.
    """
    ground = config.area.home_alt_msl_m
    planned = plan.home or GeodeticPoint(config.area.home_lat_deg, config.area.home_lon_deg, ground)
    vehicle, imported = _at(planned, config, plan)
    if plan.home is None:
        first = next((item for item in imported.items if item.command in PLACES), None)
        if first is None:
            raise InputError(f"{plan.path}: neither a planned home nor an item that has a place")
        planned = GeodeticPoint(first.x, first.y, ground)
        vehicle, imported = _at(planned, config, plan)
    path = check_items(
        imported.items, imported.fence, imported.rally, vehicle=vehicle, source=str(plan.path)
    )
    area_config = _area_around(path, vehicle.autopilot.flight.home)
    area = area_config.build()
    fence = fence_of(imported.fence, vehicle.autopilot.parameters, area)
    resolved = config.model_copy(update={"area": area_config})
    return PreparedPlan(plan, imported, path, area, fence, vehicle, resolved)


def _at(home: GeodeticPoint, config: RunConfig, plan: PlanFile) -> tuple[Vehicle, Imported]:
    """A vehicle on the ground at `home`, and the plan as imported for it."""
    if math.isnan(home.alt_msl_m):
        home = GeodeticPoint(home.lat_deg, home.lon_deg, config.area.home_alt_msl_m)
    vehicle = simulated_vehicle(config.vehicle, home=home, streams=RandomStreams(config.seed))
    vehicle.greet()
    imported = import_plan(plan, heartbeat=b"".join(vehicle.outgoing(0.0)))
    items = here_means(imported.items, home)
    return vehicle, replace(imported, items=items)


def _area_around(path: PlannedPath, home: GeodeticPoint) -> AreaConfig:
    """The rectangle around the plan."""
    points_m = np.vstack((path.points_ned_m, *path.rally_ned_m))[:, :2]
    low, high = points_m.min(axis=0) - _MARGIN_M, points_m.max(axis=0) + _MARGIN_M
    return AreaConfig(
        size_m=(float(high[1] - low[1]), float(high[0] - low[0])),
        home_m=(float(-low[1]), float(-low[0])),
        home_lat_deg=home.lat_deg,
        home_lon_deg=home.lon_deg,
        home_alt_msl_m=home.alt_msl_m,
    )
