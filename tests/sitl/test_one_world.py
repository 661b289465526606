"""Several aircraft on one clock, in one air."""

import itertools
import math
import re
from typing import Any

import numpy as np
import pytest

from flightdyn.frames import LocalFrame
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint, Vector
from native.errors import InputError
from sitl.config import VehicleConfig
from sitl.nearness import TOUCH_M, Nearness
from sitl.observer import VehicleEvent, VehicleSample
from sitl.vehicle import Vehicle
from sitl.world import World

ORIGIN = GeodeticPoint(47.0, 8.0, 488.0)
FRAME = LocalFrame(ORIGIN)


class Watch:
    """Keeps what a vehicle tells."""

    def __init__(self) -> None:
        self.events: list[VehicleEvent] = []

    def sampled(self, sample: VehicleSample) -> None:
        pass

    def happened(self, event: VehicleEvent) -> None:
        self.events.append(event)


def vehicle_at(north_m: float, east_m: float, *, number: int = 0, **keys: Any) -> Vehicle:
    streams = RandomStreams(1)
    home = FRAME.to_geodetic(np.array([north_m, east_m, 0.0]))
    return Vehicle(
        VehicleConfig.model_validate({"system_id": number + 1, **keys}), home=home,
        streams=streams.of_vehicle(number), in_step=True,
    )  # fmt: skip


def hover(vehicle: Vehicle, height_m: float, *, north_m: float = 0.0, east_m: float = 0.0) -> None:
    """Fly to a place near its home."""
    vehicle.aircraft.arm()
    vehicle.aircraft.hold(np.array([north_m, east_m, -height_m]), 0.0)


def run(world: World, seconds: float) -> None:
    """Let time pass."""
    until = world.t_ns + round(seconds * 1e9)
    while world.t_ns < until:
        world.stride(until)


def same(one: Vehicle, other: Vehicle) -> bool:
    mine, theirs = one.aircraft.truth, other.aircraft.truth
    return np.array_equal(mine.pos_ned_m, theirs.pos_ned_m) and np.array_equal(
        mine.vel_ned_mps, theirs.vel_ned_mps
    )


def test_one_alone_is_stepped_as_ever() -> None:
    alone, in_world = vehicle_at(0.0, 0.0), vehicle_at(0.0, 0.0)
    world = World({"vehicle": in_world})
    for vehicle in (alone, in_world):
        hover(vehicle, 20.0)
    while alone.t_ns < 10e9:
        alone.stride(10e9)
    run(world, 10.0)
    assert world.t_ns == alone.t_ns == 10_000_000_000
    assert same(in_world, alone)


def test_who_stands_far_apart_is_run_for_a_second_at_once() -> None:
    """Nobody can come near another one in it, and nobody is waited for."""
    world = World({"a": vehicle_at(0.0, 0.0), "b": vehicle_at(0.0, 500.0, number=1)})
    world.stride()
    assert world.t_ns == 1_000_000_000


def test_how_far_time_runs_at_once_changes_nothing() -> None:
    fleets, leasts = [], []
    for piece in (10.0, 0.07):
        world = World(pair := {"a": vehicle_at(0.0, 0.0), "b": vehicle_at(0.0, 9.0, number=1)})
        hover(pair["a"], 10.0, east_m=60.0)
        hover(pair["b"], 12.0, east_m=-60.0)
        while world.t_ns < 10e9:
            run(world, min(piece, 10.0 - world.t_ns * 1e-9))
        fleets.append(pair)
        leasts.append(world.least)
    assert all(same(fleets[0][name], fleets[1][name]) for name in "ab")
    for one, other in zip(*leasts, strict=True):
        assert one.distance_m == pytest.approx(other.distance_m, abs=1e-3)


def test_side_by_side_they_feel_the_same_gusts() -> None:
    wind = {"speed_mps": 6, "turbulence_severity": 3, "gusts": [{"start_s": 14, "north_mps": 5}]}
    keys: dict[str, Any] = {"aircraft": {"wind": wind}}
    one, two = vehicle_at(0.0, 0.0, **keys), vehicle_at(0.0, 8.0, number=1, **keys)
    world = World({"one": one, "two": two})
    for vehicle in (one, two):
        hover(vehicle, 40.0)
    run(world, 12.0)
    airs: list[list[Vector]] = []
    while world.t_ns < 30e9:
        run(world, 0.1)
        airs.append([vehicle.aircraft.wind_ned_mps for vehicle in (one, two)])
    first, second = np.array(airs).transpose(1, 0, 2)
    assert first.std(axis=0).min() > 0.15  # it is turbulent
    assert np.abs(first - second).max() < 0.2  # they hover, each by its own sensors
    assert all(np.corrcoef(a, b)[0, 1] > 0.99 for a, b in zip(first.T, second.T, strict=True))
    assert one.aircraft.belief.pos_ned_m[0] != two.aircraft.belief.pos_ned_m[0]


def test_those_that_touch_are_wrecks_and_the_third_flies_on() -> None:
    places = {"a": (0.0, 0.0), "b": (0.0, 60.0), "c": (30.0, 30.0)}
    fleet = {
        name: vehicle_at(*place, aircraft={"sensors": {"kind": "perfect"}})
        for name, place in places.items()
    }
    watches = {name: Watch() for name in fleet}
    for name, vehicle in fleet.items():
        vehicle.add_observer(watches[name])
        hover(vehicle, 20.0)
    world = World(fleet)
    run(world, 15.0)
    hover(fleet["a"], 20.0, east_m=60.0)
    hover(fleet["b"], 20.0, east_m=-60.0)
    run(world, 12.0)
    assert [fleet[name].aircraft.crashed for name in "abc"] == [True, True, False]
    assert (fleet["a"].aircraft.hit, fleet["b"].aircraft.hit) == ("b", "a")
    ((t_ns, one, two),) = world.collisions
    assert (one, two) == (0, 1)
    assert 15e9 < t_ns < 27e9
    for name, other in (("a", "b"), ("b", "a")):
        said = [event.text for event in watches[name].events]
        assert any(re.match(rf"{other} is near: (2\.[5-9]|3\.0) m at 1\d\.", text) for text in said)
        assert any(text.startswith(f"Crashed: hit {other} at") for text in said)
    assert not any("near" in event.text for event in watches["c"].events)
    apart = world.least[0]
    assert apart.distance_m < TOUCH_M
    place = fleet["a"].aircraft.truth.pos_ned_m
    assert math.dist(apart.places_ned_m[0], place) < 0.5


def test_two_that_touch_on_the_ground_are_refused() -> None:
    with pytest.raises(InputError, match=r"a and c stand 0\.50 m apart: .* homes farther apart"):
        World({"a": vehicle_at(0.0, 0.0), "b": vehicle_at(0.0, 9.0), "c": vehicle_at(0.5, 0.0)})


@pytest.mark.parametrize("count", [2, 5])
def test_least_distances_are_those_of_straight_pieces(count: int) -> None:
    """Against a fine sampling of the same pieces."""
    rng = np.random.default_rng(count)
    t_ns = np.cumsum(rng.integers(4, 100, 40)) * 1_000_000
    places = rng.uniform(-50, 50, (count, 40, 3)) - [0, 0, 100]
    nearness = Nearness([5.0] * count)
    for begin in range(0, 39, 13):
        part = slice(begin, begin + 14)
        nearness.follow(t_ns[part], places[:, part], counts=np.ones(count, dtype=bool))
    fine = np.linspace(t_ns[0], t_ns[-1], 400_001)
    tracks = np.array([[np.interp(fine, t_ns, axis) for axis in one.T] for one in places])
    for found, (i, j) in zip(nearness.least, itertools.combinations(range(count), 2), strict=True):
        apart = np.linalg.norm(tracks[i] - tracks[j], axis=0)
        assert found.pair == (i, j)
        assert found.distance_m == pytest.approx(apart.min(), abs=0.02)
        assert found.t_ns == pytest.approx(fine[apart.argmin()], abs=3e6)
        here, there = found.places_ned_m
        assert math.dist(here, there) == pytest.approx(found.distance_m)
        assert math.hypot(found.horizontal_m, found.vertical_m) == pytest.approx(found.distance_m)
