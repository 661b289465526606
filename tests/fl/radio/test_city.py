"""Radio among buildings: against another ray caster, the standards' formulas, and statistics."""

from math import exp, log10, pi

import numpy as np
import pytest
import shapely

from fl.arrays import Floats, Ints
from fl.radio.city import Building, City
from fl.radio.place import LinkTerms, PlacedRadio

RNG = np.random.default_rng(1)


def house(rng: np.random.Generator, *, court: bool) -> Building:
    """A turned rectangle, or one around a courtyard."""
    size, angle = rng.uniform(12.0, 60.0, 2), rng.uniform(0.0, pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size / 2.0 @ turn
    outer = corners + rng.uniform(0.0, 800.0, 2)
    middle = outer.mean(axis=0)
    rings = (outer, middle + 0.5 * (outer - middle)) if court else (outer,)
    return Building(rings, float(rng.uniform(6.0, 80.0)))


HOUSES = [house(RNG, court=index % 5 == 0) for index in range(150)]
DEVICES = RNG.uniform(0.0, 800.0, (12, 2))


def made(buildings=HOUSES, devices=DEVICES, *, environment="UMi", rng=None, **more) -> City:
    known = {"device_height_m": 1.5, "carrier_hz": 2.4e9, **more}
    return City(buildings, devices, environment=environment, rng=rng, **known)


def seen_by_shapely(device: Ints, place_m: Floats) -> np.ndarray:
    """Whether each line is nowhere under a roof, by the parts of it that are over buildings."""
    polygons = np.array([shapely.Polygon(h.outlines_m[0], h.outlines_m[1:]) for h in HOUSES])
    roofs = np.array([h.height_m for h in HOUSES])
    ground = DEVICES[device]
    lines = shapely.linestrings(np.stack((ground, place_m[:, :2]), axis=1))
    line, polygon = shapely.STRtree(polygons).query(lines, predicate="intersects")
    parts = shapely.intersection(lines[line], polygons[polygon])
    corners, pair = shapely.get_coordinates(parts, return_index=True)
    whole = np.hypot(*(place_m[:, :2] - ground).T)
    share = np.hypot(*(corners - ground[line[pair]]).T) / whole[line[pair]]
    height = 1.5 + share * (place_m[line[pair], 2] - 1.5)
    seen = np.ones(len(place_m), dtype=bool)
    seen[line[pair][height < roofs[polygon[pair]]]] = False
    return seen


def test_line_of_sight_is_that_of_another_ray_caster() -> None:
    count = 20_000
    device = RNG.integers(0, 12, count)
    place_m = np.column_stack((RNG.uniform(-50, 850, (count, 2)), RNG.uniform(2.0, 120.0, count)))
    seen, expected = made().in_sight(device, place_m), seen_by_shapely(device, place_m)
    assert 0.05 < expected.mean() < 0.95
    assert (seen == expected).mean() >= 0.9999


def test_above_all_roofs_in_a_courtyard_and_within() -> None:
    outer = np.array([[0.0, 0], [40, 0], [40, 40], [0, 40]])
    court = np.array([[10.0, 10], [30, 10], [30, 30], [10, 30]])
    devices = np.array([[20.0, 20.0], [5.0, 20.0], [-20.0, 20.0]])
    city = made([Building((outer, court), 20.0)], devices)
    assert city.indoors.tolist() == [False, True, False]
    at = np.array([20.0, 20.0, 60.0])
    assert city.in_sight(np.arange(3), np.tile(at, (3, 1))).tolist() == [True, False, True]
    over = np.array([[-20.0, 20.0, 60.0], [60.0, 20.0, 15.0], [60.0, 20.0, 300.0]])
    assert city.in_sight(np.array([2, 2, 2]), over).tolist() == [True, False, True]
    assert made([], devices).in_sight(np.arange(3), over).all()


def path_loss_db(environment: str, flat: float, up: float, ghz: float, *, seen: bool) -> float:
    """TR 38.901, table 7.4.1-1, up to 22.5 m with the aircraft as base station; TR 36.777, B-2."""
    d, f = (flat**2 + (up - 1.5) ** 2) ** 0.5, 20 * log10(ghz)
    if up > 22.5 and environment == "UMa":
        if seen:
            return 28.0 + 22 * log10(d) + f
        return -17.5 + (46 - 7 * log10(up)) * log10(d) + 20 * log10(40 * pi * ghz / 3)
    if up > 22.5:
        free = 20 * log10(4 * pi * d * ghz * 1e9 / 299_792_458)
        los = max(free, 30.9 + (22.25 - 0.5 * log10(up)) * log10(d) + f)
        return los if seen else max(los, 32.4 + (43.2 - 7.6 * log10(up)) * log10(d) + f)
    breakpoint_m = 4 * (up - 1.0) * (1.5 - 1.0) * ghz * 1e9 / 299_792_458
    bend = log10(breakpoint_m**2 + (up - 1.5) ** 2)
    if environment == "UMa":
        near, far = 28 + 22 * log10(d) + f, 28 + 40 * log10(d) + f - 9 * bend
        nlos = 13.54 + 39.08 * log10(d) + f - 0.6 * (1.5 - 1.5)
    else:
        near, far = 32.4 + 21 * log10(d) + f, 32.4 + 40 * log10(d) + f - 9.5 * bend
        nlos = 35.3 * log10(d) + 22.4 + 21.3 * log10(ghz) - 0.3 * (1.5 - 1.5)
    los = near if flat <= breakpoint_m else far
    return los if seen else max(los, nlos)


@pytest.mark.parametrize("environment", ["UMi", "UMa"])
@pytest.mark.parametrize("ghz", [0.9, 2.4, 28.0])
@pytest.mark.parametrize("seen", [True, False])
def test_path_loss_is_the_standards(environment, ghz: float, seen: bool) -> None:
    flat = np.repeat([12.0, 60.0, 300.0, 1500.0], 5)
    up = np.tile([4.0, 15.0, 30.0, 60.0, 95.0], 4)
    place_m = np.column_stack((flat, 0 * flat, up))
    wall = np.array([[3.0, -5.0], [11.0, -5.0], [11.0, 5.0], [3.0, 5.0]])
    houses = [] if seen else [Building((wall,), 900.0)]
    city = made(houses, np.zeros((1, 2)), environment=environment, carrier_hz=ghz * 1e9)
    assert not city.indoors.any()
    expected = [
        -path_loss_db(environment, x, h, ghz, seen=seen) for x, h in zip(flat, up, strict=True)
    ]
    found = city.gain_db(np.zeros(len(up), dtype=np.int64), place_m)
    assert found == pytest.approx(expected, abs=1e-6)


def test_the_way_through_a_wall() -> None:
    room = Building((np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]]),), 9.0)
    place_m, first = np.array([[60.0, 0.0, 60.0]]), np.zeros(1, dtype=np.int64)
    inside = made([room], np.zeros((1, 2))).gain_db(first, place_m)[0]
    glass, concrete = 2 + 0.2 * 2.4, 5 + 4 * 2.4
    entry = 5 - 10 * log10(0.3 * 10 ** (-glass / 10) + 0.7 * 10 ** (-concrete / 10))
    outdoors = -path_loss_db("UMi", 60.0, 60.0, 2.4, seen=False)
    assert inside == pytest.approx(outdoors - entry, abs=1e-9)


@pytest.mark.parametrize(("environment", "length"), [("UMi", 10.0), ("UMa", 37.0)])
def test_shadowing_varies_and_hangs_together_as_the_standard_has_it(environment, length) -> None:
    """4000 devices' fields, in sight at 60 m, at places on one line."""
    devices = np.zeros((4000, 2))
    away = np.array([0.0, 5.0, 20.0, 60.0])
    plain = made([], devices, environment=environment)
    shadowed = made([], devices, environment=environment, rng=np.random.default_rng(5))
    device = np.arange(4000)
    places = [np.tile([x, 7.0, 60.0], (4000, 1)) for x in away]
    assert (plain.shadowing_db(device, places[0]) == shadowed.shadowing_db(device, places[0])).all()
    fields = [shadowed.gain_db(device, at) - plain.gain_db(device, at) for at in places]
    sigma = max(5 * exp(-0.6), 2.0) if environment == "UMi" else 4.64 * exp(-0.0066 * 60)
    assert np.std(fields, axis=1) == pytest.approx(np.full(4, sigma), rel=0.05)
    assert np.mean(fields, axis=1) == pytest.approx(np.zeros(4), abs=0.08 * sigma)
    found = [np.corrcoef(fields[0], field)[0, 1] for field in fields]
    assert found == pytest.approx(np.exp(-away / length), abs=0.05)
    again = made([], devices, environment=environment, rng=np.random.default_rng(5))
    assert (again.gain_db(device, places[1]) == shadowed.gain_db(device, places[1])).all()


def test_packet_error_rate_of_a_gain() -> None:
    terms = LinkTerms(10.0, 1e6, 7.0, 10.0, 3.0)
    assert terms.noise_dbm == pytest.approx(-107.0)
    radio = PlacedRadio(made([], np.zeros((1, 2))), terms)
    first, place_m = np.zeros(1, dtype=np.int64), np.array([[80.0, 0.0, 60.0]])
    snr = 117.0 - path_loss_db("UMi", 80.0, 60.0, 2.4, seen=True)
    assert radio.snr_db(first, place_m)[0] == pytest.approx(snr, abs=1e-6)
    even = LinkTerms(10.0 - snr + 10.0, 1e6, 7.0, 10.0, 3.0)
    assert PlacedRadio(radio.gains, even).per(first, place_m)[0] == pytest.approx(0.5)
    weak = LinkTerms(10.0 - snr + 7.0, 1e6, 7.0, 10.0, 3.0)  # one standard deviation too little
    assert PlacedRadio(radio.gains, weak).per(first, place_m)[0] == pytest.approx(0.841344746)
