"""What the flight of a plan file asks of a vehicle, and where it lies."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint
from mission.base.airspace import OPEN, Airspace
from mission.base.area import Area
from mission.base.errors import InputError
from mission.commands.options import load
from mission.config.models import MissionConfig, RunConfig
from mission.flight.missions.plan_file import (
    checked_home,
    read_plan_file,
    write_round_plan,
)
from mission.flight.missions.round_mission import FlightPlan, climb, direct_flight, stop_items
from mission.flight.pilot.parameters import VehicleLimit, VehicleLimits
from mission.planner.flyable import Stop
from mission.run.plan_flight import _speeds, order_of

HOME = GeodeticPoint(47.4, 8.5, 488.0)


def item(command: int, north_m: float, east_m: float, z: float, *params: float | None) -> Any:
    at = LocalFrame(HOME).to_geodetic(np.array([north_m, east_m, 0.0]))
    four = [*params, *[0.0] * 4][:4]
    return {
        "type": "SimpleItem", "autoContinue": True, "command": command, "frame": 3,
        "params": [*four, round(at.lat_deg, 7), round(at.lon_deg, 7), z],
    }  # fmt: skip


def speed(mps: float) -> Any:
    return {
        "type": "SimpleItem", "autoContinue": True, "command": 178, "frame": 2,
        "params": [1, mps, -1, 0, 0, 0, 0],
    }  # fmt: skip


def written(path: Path, *items: Any, home: Any = (47.4, 8.5, 488.0), **more: Any) -> Any:
    document = {
        "fileType": "Plan", "version": 1, "groundStation": "x",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {"version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": 5,
                    "hoverSpeed": 5, "plannedHomePosition": home, "items": list(items)},
        **more,
    }  # fmt: skip
    (path / "x.plan").write_text(json.dumps(document))
    return read_plan_file(path / "x.plan")


def config() -> RunConfig:
    return load(None, ())


def test_a_flight_asks_for_its_speed_height_reach_and_sharpest_corner(tmp_path: Path) -> None:
    plan = written(
        tmp_path, item(22, 0, 0, 20), speed(4.0), item(16, 30, 40, 25, 0, 3.0), speed(7.0),
        item(16, 10, 0, 15, 0, 2.0), item(16, 20, 0, 15, 0, 0.0),
    )  # fmt: skip
    order = order_of(config(), plan)
    demand = order.task.demand
    assert (demand.speed_mps, demand.acceptance_m) == (7.0, 2.0)
    assert demand.altitude_m == pytest.approx(25.0, abs=0.01)
    assert demand.distance_m == pytest.approx(50.0, abs=0.05)
    assert order.area.home == HOME
    assert order.area.size_m == pytest.approx((140.0, 130.0), abs=0.1)
    assert order.area.home_m == pytest.approx((50.0, 50.0), abs=0.1)
    assert order.config.area.home_m == order.area.home_m
    assert order.config.area.home_alt_msl_m == 488.0
    bare = order_of(config(), written(tmp_path, item(22, 0, 0, 20)))
    assert bare.task.demand.speed_mps == 0.0
    assert math.isinf(bare.task.demand.acceptance_m)
    assert bare.path.places[0][0] == 0


def test_home_is_the_planned_one_or_the_first_place(tmp_path: Path) -> None:
    items = item(22, 10, 0, 20), item(16, 30, 40, 25)
    low = order_of(config(), written(tmp_path, *items, home=None))
    assert low.area.home.lat_deg == pytest.approx(47.4 + 10 / 111_200, abs=1e-6)
    assert low.area.home.alt_msl_m == config().area.home_alt_msl_m
    rally = {"points": [[47.4, 8.501, 30]], "version": 2}
    order = order_of(config(), written(tmp_path, *items, rallyPoints=rally))
    # 0.001 degrees of longitude are 75.5 m there.
    assert order.area.size_m[0] == pytest.approx(75.5 + 100.0, abs=0.3)
    with pytest.raises(InputError, match="neither a planned home nor an item that has a place"):
        order_of(config(), written(tmp_path, speed(5.0), home=None))


@pytest.mark.parametrize(
    ("place", "taken"),
    [
        ((85.0, 180.0, 5000.0), True), ((-85.0, -180.0, -400.0), True), ((85.1, 0.0, 0.0), False),
        ((-85.1, 0.0, 0.0), False), ((0.0, 180.1, 0.0), False), ((0.0, -180.1, 0.0), False),
        ((1.0, 1.0, 5000.1), False), ((1.0, 1.0, -400.1), False), ((1.0, 1.0, math.nan), True),
        ((math.nan, 1.0, 0.0), False),
    ],
)  # fmt: skip
def test_a_home_lies_where_somebody_flies(place: tuple[float, float, float], taken: bool) -> None:
    if taken:
        found = checked_home(Path("a.plan"), *place)
        assert (found.lat_deg, found.lon_deg) == place[:2]
    else:
        with pytest.raises(InputError, match=r"^a\.plan: planned home .*latitude is -85\.\.85"):
            checked_home(Path("a.plan"), *place)


@pytest.mark.parametrize(
    ("known", "adjusts", "speeds"),
    [
        ({}, False, {"MPC_XY_VEL_MAX": 30.0}),
        ({"speed_mps": 12.0, "cruise_mps": 0.5}, False,
         {"MPC_XY_CRUISE": 1.0, "MPC_XY_VEL_MAX": 12.0}),
        ({"speed_mps": 12.0, "cruise_mps": 31.0}, True,
         {"MPC_XY_CRUISE": 30.0, "MPC_XY_VEL_MAX": 30.0}),
    ],
)  # fmt: skip
def test_a_plan_is_timed_by_how_fast_its_vehicle_is(
    known: dict[str, float], adjusts: bool, speeds: dict[str, float]
) -> None:
    base = config()
    link = base.link.model_copy(update={"set_parameters": adjusts})
    limits = VehicleLimits({name: VehicleLimit("X", 0.01, mps) for name, mps in known.items()})
    assert _speeds(base.model_copy(update={"link": link}), limits) == speeds
    for limit in limits.known.values():
        assert limit.raw == limit.value / 0.01
    lines = [f"X = {100 * mps:g}" for mps in known.values()]
    assert limits.lines() == lines


def test_limits_of_the_vehicle_are_those_of_its_guidance() -> None:
    ours = VehicleLimits().guidance
    assert math.isinf(ours.speed_mps)
    for told, used in ((3.5, 3.5), (0.0, ours.acceleration_mps2)):
        limits = VehicleLimits({"acceleration_mps2": VehicleLimit("A", 1.0, told)})
        assert limits.guidance.acceleration_mps2 == used


def test_ways_that_serve_nobody() -> None:
    mission = MissionConfig()
    up = climb(np.array([3.0, 4.0]), 70.0, mission=mission)
    (stop,) = up.stops
    assert (stop.xy_m.tolist(), stop.steps, stop.hold_s) == ([3.0, 4.0], (), 1.0)
    assert (up.alt_rel_m, up.acceptance_m, up.speed_mps) == (70.0, 1.0, mission.speed_mps)
    start, end = np.array([0.0, 0.0]), np.array([30.0, 40.0])
    way = direct_flight(start, end, altitude_m=60.0, mission=mission, airspace=OPEN)
    assert way.points_m.tolist() == [[0.0, 0.0], [30.0, 40.0]]
    assert way.acceptance_m == mission.acceptance_radius_m
    square = np.array([[10.0, 10.0], [20.0, 10.0], [20.0, 30.0], [10.0, 30.0]])
    around = direct_flight(
        start, end, altitude_m=60.0, mission=mission, airspace=Airspace((square,), margin_m=3.0)
    )
    assert len(around.stops) > 2
    assert around.acceptance_m == 1.5
    assert stop_items(way) == [0, 2]
    assert stop_items(around)[:3] == [0, 2, 3]


def test_a_round_is_written_as_qgroundcontrol_shows_it(tmp_path: Path) -> None:
    area = Area.at((400.0, 300.0), (100.0, 50.0), HOME)
    stops = tuple(Stop(np.array(xy), (n,), 2.0 * n) for n, xy in enumerate(((0, 0), (9, 9))))
    write_round_plan(tmp_path / "p" / "r.plan", FlightPlan(stops, 60.0, 20.0, 5.0), area)
    document = json.loads((tmp_path / "p" / "r.plan").read_text())
    assert (document["fileType"], document["version"]) == ("Plan", 1)
    assert (document["geoFence"]["version"], document["rallyPoints"]["version"]) == (2, 2)
    mission = document["mission"]
    assert (mission["version"], mission["firmwareType"], mission["vehicleType"]) == (2, 12, 2)
    assert (mission["cruiseSpeed"], mission["hoverSpeed"]) == (20.0, 20.0)
    assert mission["globalPlanAltitudeMode"] == 1
    assert mission["plannedHomePosition"] == [47.4, 8.5, 488.0]
    first, order, second = mission["items"]
    assert (order["command"], order["frame"], order["params"][:2]) == (178, 2, [1.0, 20.0])
    assert "Altitude" not in order
    for each, number, hold_s in ((first, 1, 0.0), (second, 3, 2.0)):
        assert (each["command"], each["frame"], each["doJumpId"]) == (16, 3, number)
        assert (each["Altitude"], each["AltitudeMode"]) == (60.0, 1)
        assert each["AMSLAltAboveTerrain"] is None
        assert each["params"][:4] == [hold_s, 5.0, 0.0, None]
        assert each["params"][6] == 60.0
        assert each["autoContinue"] is True
    assert order["doJumpId"] == 2
