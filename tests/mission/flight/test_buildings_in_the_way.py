"""Buildings of an area as its vehicles meet them."""

import numpy as np
import pytest

from fl.radio.city import Building
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from mission.api.vehicles import vehicle_config
from mission.base.area import Area
from mission.flight.flyers.built_in import simulated_vehicle
from mission.flight.serve.vehicle import make_vehicles
from sitl.config import VehicleConfig
from sitl.firmware.vehicle import plant_for

HOME = GeodeticPoint(47.0, 8.0, 488.0)
HALL = np.array([[30.0, 10.0], [40.0, 10.0], [40.0, 50.0], [30.0, 50.0]])  # east, north


def area(*home_m: float) -> Area:
    return Area.at((100.0, 100.0), home_m, HOME, buildings=(Building((HALL,), 12.0),))  # type: ignore[arg-type]


def test_they_stand_north_and_east_of_home() -> None:
    found = area(20.0, 10.0).obstacles
    assert found is not None
    assert found.contain(35.0, 15.0, 5.0)  # x = 35, y = 45
    assert not found.contain(15.0, 35.0, 5.0)
    assert not found.contain(35.0, 15.0, 12.0)
    assert Area.at((9.0, 9.0), (1.0, 1.0), HOME).obstacles is None


@pytest.mark.parametrize(("home_m", "within"), [((35.0, 30.0), True), ((20.0, 30.0), False)])
def test_every_vehicle_of_the_area_meets_them(home_m: tuple[float, float], within: bool) -> None:
    ground = area(*home_m)
    vehicle = simulated_vehicle(VehicleConfig(), area=ground, streams=RandomStreams(1))
    for _ in range(60):
        vehicle.step()
    plant = plant_for(
        VehicleConfig.model_construct(**{**dict(VehicleConfig()), "autopilot": "px4"}),
        home=HOME, streams=RandomStreams(1), obstacles=ground.obstacles,
    )  # fmt: skip
    for _ in range(200):
        plant.step()
    assert vehicle.aircraft.crashed == plant.crashed == within
    assert vehicle.aircraft.hit == plant.hit == ("a building" if within else "")


def test_all_vehicles_of_one_place_meet_the_same_building() -> None:
    corners = [[10.0, 20.0], [30.0, 20.0], [30.0, 60.0], [10.0, 60.0]]
    config = vehicle_config(
        {"area.size_m": [100, 100], "area.home_m": [5, 5],
         "area.buildings": [{"polygon_m": corners, "height_m": 12}]},
        source="quickstart",
    )  # fmt: skip
    found = make_vehicles(config, count=3, udp=(), logs=None)
    places = [
        [
            one.area.frame.to_geodetic(one.area.to_ned(np.array(xy), 0.0))
            for xy in one.area.buildings[0].outlines_m[0]
        ]
        for one in found
    ]
    for other in places[1:]:
        for mine, theirs in zip(places[0], other, strict=True):
            assert abs(mine.lat_deg - theirs.lat_deg) < 3e-9  # 0.3 mm: meridians converge
            assert abs(mine.lon_deg - theirs.lon_deg) < 3e-9
    for one in found:  # just within a corner, just beside it, each in the vehicle's own frame
        for x, within in ((10.01, True), (9.99, False)):
            north, east, _ = one.area.to_ned(np.array([x, 20.01]), 0.0)
            assert one.area.obstacles is not None
            assert one.area.obstacles.contain(north, east, 5.0) == within
    assert [one.area.home_m for one in found] == [(5.0, 5.0), (10.0, 5.0), (15.0, 5.0)]
    assert {one.area.home.alt_msl_m for one in found} == {config.area.home_alt_msl_m}
