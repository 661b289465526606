"""Buildings in the way: what is within one, and what becomes of an aircraft that is."""

import math

import numpy as np
import pytest
import shapely

from flightdyn.aircraft import Aircraft
from flightdyn.config import AircraftConfig
from flightdyn.obstacles import Obstacles
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint

SQUARE = np.array([[-20.0, -20.0], [20.0, -20.0], [20.0, 20.0], [-20.0, 20.0]])
COURT = SQUARE / 2.0
KITE = np.array([[40.0, 0.0], [60.0, 15.0], [90.0, 5.0], [60.0, -15.0]])
PRISMS = (((SQUARE, COURT), 4.0, 12.0), ((KITE,), -np.inf, 40.0))


def test_places_within_are_those_of_a_geometry_library() -> None:
    rng, found = np.random.default_rng(2), Obstacles(PRISMS)
    house, kite = shapely.Polygon(SQUARE, [COURT]), shapely.Polygon(KITE)
    for north, east, up in rng.uniform((-30, -30, 0), (100, 30, 50), (3000, 3)):
        at = shapely.Point(north, east)
        expected = (house.contains(at) and 4.0 < up < 12.0) or (kite.contains(at) and up < 40.0)
        assert found.contain(north, east, up) == expected
    assert not Obstacles(()).contain(0.0, 0.0, 0.0)


def test_seen_from_another_home_they_stand_where_they_stood() -> None:
    about, rng = Obstacles(PRISMS), np.random.default_rng(3)
    once, twice = about.seen_from(7.0, -30.0), about.seen_from(2.0, -10.0).seen_from(5.0, -20.0)
    inside = 0
    for north, east, up in rng.uniform((-30, -30, 0), (100, 30, 50), (300, 3)):
        expected = about.contain(north, east, up)
        assert once.contain(north - 7.0, east + 30.0, up) == expected
        assert twice.contain(north - 7.0, east + 30.0, up) == expected
        inside += expected
    assert 10 < inside < 290


@pytest.mark.parametrize("height_m", [10.0, 60.0])
def test_who_flies_into_a_wall_is_a_wreck_and_who_flies_over_it_is_not(height_m: float) -> None:
    config = AircraftConfig(sensors={"kind": "perfect"})
    home = GeodeticPoint(47.0, 8.0, 488.0)
    obstacles = Obstacles(PRISMS[1:])
    aircraft = Aircraft(config, home=home, streams=RandomStreams(1), obstacles=obstacles)
    aircraft.arm()
    for north in (0.0, 100.0):
        aircraft.hold(np.array([north, 0.0, -height_m]), 0.0)
        while not (aircraft.progress.finished or aircraft.crashed):
            aircraft.step()
    assert aircraft.crashed == (height_m < 40.0)
    if aircraft.crashed:
        assert 40.0 < aircraft.truth.pos_ned_m[0] < 44.0
        assert (aircraft.hit, aircraft.armed) == ("a building", False)
        assert aircraft.impact_mps is not None
        assert 5.0 < aircraft.impact_mps < 25.0
        assert math.dist(aircraft.truth.vel_ned_mps, (0.0, 0.0, 0.0)) == 0.0
