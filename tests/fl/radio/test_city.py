"""Radio among buildings: against another ray caster, the standards' formulas, and statistics."""

from math import exp, log10, pi

import numpy as np
import pytest
import shapely

from fl.arrays import Bools, Floats, Ints
from fl.radio.city import Building, City
from fl.radio.place import LinkTerms, PlacedRadio, drawn_waves

RNG = np.random.default_rng(1)


def house(rng: np.random.Generator, *, court: bool) -> Building:
    """A turned rectangle, or one around a courtyard."""
    size, angle = rng.uniform(12.0, 60.0, 2), rng.uniform(0.0, pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size / 2.0 @ turn
    outer = corners + rng.uniform(0.0, 800.0, 2)
    middle = outer.mean(axis=0)
    rings = (outer, middle + 0.5 * (outer - middle)) if court else (outer,)
    return Building(rings, float(rng.uniform(10.0, 80.0)), rng.choice([0.0, 8.0], p=[0.8, 0.2]))


HOUSES = [house(RNG, court=index % 5 == 0) for index in range(150)]
POLYGONS = np.array([shapely.Polygon(h.outlines_m[0], h.outlines_m[1:]) for h in HOUSES])
FROM_M, TO_M = np.array([(h.from_m, h.height_m) for h in HOUSES]).T
# The odd ones are in some building on the ground.
DEVICES = RNG.uniform(0.0, 800.0, (24, 2))
DEVICES[1::2] = [
    (houses.outlines_m[0][0] + houses.outlines_m[0][1]) / 2 * 0.99 + 0.01 * houses.outlines_m[0][2]
    for houses in [one for one in HOUSES if not one.from_m][:12]
]


def made(buildings=HOUSES, devices=DEVICES, *, environment="UMi", rng=None, **more) -> City:
    known = {"device_height_m": 1.5, "carrier_hz": 2.4e9, "walls": "low-loss", **more}
    return City(buildings, devices, environment=environment, rng=rng, **known)


def ways_by_shapely(device: Ints, place_m: Floats) -> tuple[np.ndarray, np.ndarray]:
    """How many metres of each line's ground track are in the building around its device, and
    whether the rest is in none: by the stretches that are over one, between floor and roof."""
    ground, rise = DEVICES[device], place_m[:, 2] - 1.5
    whole = np.hypot(*(place_m[:, :2] - ground).T)
    lines = shapely.linestrings(np.stack((ground, place_m[:, :2]), axis=1))
    line, polygon = shapely.STRtree(POLYGONS).query(lines, predicate="intersects")
    parts, pair = shapely.get_parts(
        shapely.intersection(lines[line], POLYGONS[polygon]), return_index=True
    )
    pair = pair[shapely.length(parts) > 0.0]
    parts = parts[shapely.length(parts) > 0.0]
    ends = shapely.get_coordinates(
        shapely.linestrings([(p.coords[0], p.coords[-1]) for p in parts])
    )
    line, polygon = line[pair], polygon[pair]
    far = np.hypot(*(ends.reshape(-1, 2, 2) - ground[line][:, None]).transpose(2, 0, 1))
    under = np.stack((FROM_M, TO_M))[:, polygon] - 1.5
    under[0, FROM_M[polygon] == 0.0] = -np.inf
    between = np.sort(under / rise[line] * whole[line], axis=0)
    low, high = np.maximum(far.min(axis=1), between[0]), np.minimum(far.max(axis=1), between[1])
    line, low, high = (values[low < high] for values in (line, low, high))
    within = np.zeros(len(device))
    np.maximum.at(within, line[low < 1e-9], high[low < 1e-9])
    seen = np.ones(len(device), dtype=bool)
    seen[line[high > within[line] + 1e-6]] = False
    return within, seen


def in_sight(city: City, device: Ints, place_m: Floats) -> Bools:
    """(n,) whether no building stands between devices (n,) and places (n, 3), but their own."""
    return city._native.gains(device, place_m).seen


def test_paths_are_those_of_another_ray_caster() -> None:
    count = 20_000
    device = RNG.integers(0, len(DEVICES), count)
    place_m = np.column_stack((RNG.uniform(-50, 850, (count, 2)), RNG.uniform(2.0, 120.0, count)))
    city = made()
    within, expected = ways_by_shapely(device, place_m)
    assert (city.indoors[device] == (within > 0.0)).all()
    assert 8 <= city.indoors.sum() <= 16
    for indoors in (True, False):
        some = city.indoors[device] == indoors
        assert 0.05 < expected[some].mean() < 0.95
        assert (in_sight(city, device, place_m) == expected)[some].mean() >= 0.9999
    # What a path has more to lose than one from the same place without the building around it.
    some = city.indoors[device] & expected & (in_sight(city, device, place_m))
    free = made([]).gain_db(device[some], place_m[some])
    more = free - city.gain_db(device[some], place_m[some])
    assert more == pytest.approx(entry_db("low-loss") + 0.5 * within[some], abs=1e-3)


@pytest.mark.parametrize("device", [[-1, 0], [2, 3]])
def test_a_device_that_is_not_there_has_no_path(device: list[int]) -> None:
    city = made([], DEVICES[:3])
    at = np.full((2, 3), 50.0)
    assert in_sight(city, np.array([0, 2]), at).all()
    with pytest.raises(ValueError, match=r"^device must be from 0 to 2$"):
        in_sight(city, np.array(device), at)


def test_above_all_roofs_in_a_courtyard_and_within() -> None:
    outer = np.array([[0.0, 0], [40, 0], [40, 40], [0, 40]])
    court = np.array([[10.0, 10], [30, 10], [30, 30], [10, 30]])
    devices = np.array([[20.0, 20.0], [5.0, 20.0], [-20.0, 20.0]])
    city = made([Building((outer, court), 20.0)], devices)
    assert city.indoors.tolist() == [False, True, False]
    at = np.array([20.0, 20.0, 60.0])
    # The second leaves its building by the roof, 5 m within it; a lower one comes back into it.
    assert in_sight(city, np.arange(3), np.tile(at, (3, 1))).tolist() == [True, True, True]
    low = np.array([[35.0, 20.0, 19.0]])
    assert not in_sight(city, np.array([1]), low)[0]
    over = np.array([[-20.0, 20.0, 60.0], [60.0, 20.0, 15.0], [60.0, 20.0, 300.0]])
    assert in_sight(city, np.array([2, 2, 2]), over).tolist() == [True, False, True]
    assert in_sight(made([], devices), np.arange(3), over).all()


def path_loss_db(
    environment: str, flat: float, up: float, ghz: float, *, seen: bool, device: float = 1.5
) -> float:
    """TR 38.901, table 7.4.1-1, up to 22.5 m with the aircraft as base station; TR 36.777, B-2."""
    d, f = max(1.0, (flat**2 + (up - device) ** 2) ** 0.5), 20 * log10(ghz)
    if up > 22.5 and environment == "UMa":
        if seen:
            return 28.0 + 22 * log10(d) + f
        # Above 100 m all are in sight: what is not loses as much as at 100 m.
        return -17.5 + (46 - 7 * log10(min(up, 100))) * log10(d) + 20 * log10(40 * pi * ghz / 3)
    if up > 22.5:
        up = min(up, 300.0)
        free = 20 * log10(4 * pi * d * ghz * 1e9 / 299_792_458)
        los = max(free, 30.9 + (22.25 - 0.5 * log10(up)) * log10(d) + f)
        return los if seen else max(los, 32.4 + (43.2 - 7.6 * log10(up)) * log10(d) + f)
    # A street's heights are less the metre of what drives and walks there.
    breakpoint_m = 4 * max(up - 1.0, 0.5) * max(device - 1.0, 0.5) * ghz * 1e9 / 299_792_458
    bend = log10(breakpoint_m**2 + (up - device) ** 2)
    if environment == "UMa":
        near, far = 28 + 22 * log10(d) + f, 28 + 40 * log10(d) + f - 9 * bend
        nlos = 13.54 + 39.08 * log10(d) + f - 0.6 * (device - 1.5)
    else:
        near, far = 32.4 + 21 * log10(d) + f, 32.4 + 40 * log10(d) + f - 9.5 * bend
        nlos = 35.3 * log10(d) + 22.4 + 21.3 * log10(ghz) - 0.3 * (device - 1.5)
    los = near if flat <= breakpoint_m else far
    return los if seen else max(los, nlos)


WALL = Building((np.array([[3.0, -5.0], [11.0, -5.0], [11.0, 5.0], [3.0, 5.0]]),), 900.0)
# To the last metre of the street, and to where what hangs on the height ends.
HEIGHTS = [0.25, 1.75, 4.0, 15.0, 22.5, 22.6, 30.0, 60.0, 95.0, 120.0, 295.0, 400.0]


@pytest.mark.parametrize("environment", ["UMi", "UMa"])
@pytest.mark.parametrize("ghz", [0.9, 2.4, 28.0])
@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize("device_m", [0.5, 1.5, 9.0, 118.0])
def test_path_loss_is_the_standards(environment, ghz: float, seen: bool, device_m: float) -> None:
    far = [0.0, 0.5, 2.0] * seen + [12.0, 60.0, 300.0, 1500.0]
    flat, up = np.repeat(far, len(HEIGHTS)), np.tile(HEIGHTS, len(far))
    place_m = np.column_stack((flat, 0 * flat, up))
    city = made(
        [] if seen else [WALL], np.zeros((1, 2)), environment=environment, carrier_hz=ghz * 1e9,
        device_height_m=device_m,
    )  # fmt: skip
    assert not city.indoors.any()
    expected = [
        -path_loss_db(environment, x, h, ghz, seen=seen, device=device_m)
        for x, h in zip(flat, up, strict=True)
    ]
    found = city.gain_db(np.zeros(len(up), dtype=np.int64), place_m)
    assert found == pytest.approx(expected, abs=1e-6)
    low = np.array([[12.0, 0.0, -3.0]])  # below home: on the ground there
    expected_db = -path_loss_db(environment, 12.0, 0.0, ghz, seen=seen, device=device_m)
    assert city.gain_db(np.zeros(1, dtype=np.int64), low) == pytest.approx(expected_db, abs=1e-6)


@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize(
    ("environment", "sight_db", "hidden_db"),
    [
        ("UMi", [4.0, 4.0, 5 * exp(-0.226), 5 * exp(-0.6), 2.0], [7.82, 7.82, 8.0, 8.0, 8.0]),
        (
            "UMa",
            [4.0, 4.0, *(4.64 * exp(-0.0066 * up) for up in (22.6, 60.0, 120.0))],
            [6.0] * 5,
        ),
    ],
)
def test_shadowing_deviates_by_the_standards(
    environment, sight_db: list[float], hidden_db: list[float], seen: bool
) -> None:
    """TR 38.901, table 7.4.1-1, up to 22.5 m; TR 36.777, table B-3."""
    place_m = np.array([(30.0, 0.0, up) for up in (4.0, 22.5, 22.6, 60.0, 120.0)])
    city = made([] if seen else [WALL], np.zeros((1, 2)), environment=environment)
    found = city.unknown_db(np.zeros(5, dtype=np.int64), place_m)
    assert found == pytest.approx(sight_db if seen else hidden_db, abs=1e-9)


@pytest.mark.parametrize(("seen", "length_m"), [(True, 37.0), (False, 50.0)])
def test_shadowing_is_the_sum_of_its_waves(seen: bool, length_m: float) -> None:
    devices, places_m = np.zeros((3, 2)), np.array([(0.0, 60.0, 60.0), (70.0, 0.5, 60.0)])
    device, place_m = np.repeat(np.arange(3), 2), np.tile(places_m, (3, 1))
    ring = np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]])
    houses = [] if seen else [Building((ring, ring / 2), 900.0)]
    plain, drawn = (
        made(houses, devices, environment="UMa", rng=rng).gain_db(device, place_m)
        for rng in (None, np.random.default_rng(5))
    )
    east, north, phase = drawn_waves(np.random.default_rng(5), 3)[
        device, 0 if seen else 1
    ].transpose(1, 0, 2)
    x, y, _ = place_m.T[..., None] / length_m
    field = np.cos(2 * pi * (x * east + y * north + phase)).sum(axis=1) / 10.0
    sigma_db = 4.64 * exp(-0.0066 * 60.0) if seen else 6.0
    assert drawn - plain == pytest.approx(sigma_db * field, abs=1e-11)
    assert np.abs(field).max() > 0.5


def test_who_flies_in_the_hall_of_a_device_is_in_its_sight() -> None:
    """The whole path is indoors: nothing but a wall and its own length is in the way."""
    hall = Building((np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]]),), 30.0)
    first, place_m = np.zeros(1, dtype=np.int64), np.array([[8.0, 0.0, 25.0]])
    city = made([hall], np.zeros((1, 2)))
    assert in_sight(city, first, place_m).all()
    expected = -path_loss_db("UMi", 8.0, 25.0, 2.4, seen=True) - entry_db("low-loss") - 4.0
    assert city.gain_db(first, place_m)[0] == pytest.approx(expected, abs=1e-6)


def test_what_passes_along_a_roof_or_a_floor_is_free_and_corners_are_walls() -> None:
    """A house on pillars, 8 to 20 m high, turned so that its corners are east and west."""
    turned = np.array([[40.0, 20.0], [20.0, 40.0], [0.0, 20.0], [20.0, 0.0]])
    devices = np.array([[-20.0, 20.0], [20.0, 20.0], [20.0, 20.0 - 1e-9]])
    place_m, device = np.array([[60.0, 20.0, 20.0], [60.0, 20.0, 8.0]]), np.zeros(2, dtype=np.int64)
    for height_m, seen in ((20.0, [True, False]), (8.0, [False, True]), (14.0, [False, False])):
        city = made([Building((turned,), 20.0, 8.0)], devices, device_height_m=height_m)
        assert in_sight(city, device, place_m).tolist() == seen
        assert city.indoors.tolist() == [False, *[height_m == 14.0] * 2]


def entry_db(walls: str, ghz: float = 2.4) -> float:
    """TR 38.901, 7.4.3.1: PL_tw of the low-loss and of the high-loss model."""
    plain, coated, concrete = 2 + 0.2 * ghz, 23 + 0.3 * ghz, 5 + 4 * ghz
    if walls == "low-loss":
        return 5 - 10 * log10(0.3 * 10 ** (-plain / 10) + 0.7 * 10 ** (-concrete / 10))
    return 5 - 10 * log10(0.7 * 10 ** (-coated / 10) + 0.3 * 10 ** (-concrete / 10))


@pytest.mark.parametrize("walls", ["low-loss", "high-loss"])
def test_the_way_out_of_a_building(walls: str) -> None:
    room = Building((np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]]),), 9.0)
    behind = Building((room.outlines_m[0] + (20.0, 0.0),), 45.0)
    place_m, first = np.array([[60.0, 0.0, 60.0]]), np.zeros(1, dtype=np.int64)
    for houses, seen in (([room], True), ([room, behind], False)):
        inside = made(houses, np.zeros((1, 2)), walls=walls).gain_db(first, place_m)[0]
        # Through the roof, 7.5 m above the device, where the path has gone 7.69 m along the ground.
        within = 60.0 * 7.5 / 58.5
        outdoors = -path_loss_db("UMi", 60.0, 60.0, 2.4, seen=seen)
        assert inside == pytest.approx(outdoors - entry_db(walls) - 0.5 * within, abs=1e-9)


@pytest.mark.parametrize(("walls", "spread_db"), [("low-loss", 4.4), ("high-loss", 6.5)])
def test_indoors_shadowing_is_of_its_own_and_walls_differ(walls: str, spread_db: float) -> None:
    """4000 devices in a hall: 7 dB, correlated over 7 m, beside what is drawn once for each."""
    hall = Building((np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]]),), 9.0)
    devices, device, away = np.zeros((4000, 2)), np.arange(4000), np.array([0.0, 3.0, 14.0, 500.0])
    plain = made([hall], devices, walls=walls)
    drawn = made([hall], devices, walls=walls, rng=np.random.default_rng(5))
    places = [np.tile([x, 7.0, 60.0], (4000, 1)) for x in away]
    more = np.array([drawn.gain_db(device, at) - plain.gain_db(device, at) for at in places])
    both = (7.0**2 + spread_db**2) ** 0.5
    assert plain.unknown_db(device, places[0]) == pytest.approx(np.full(4000, both))
    assert np.std(more, axis=1) == pytest.approx(np.full(4, both), rel=0.05)
    found = [np.cov(more[0], field)[0, 1] for field in more]
    assert found == pytest.approx(49.0 * np.exp(-away / 7.0) + spread_db**2, abs=0.05 * both**2)


@pytest.mark.parametrize(("environment", "length"), [("UMi", 10.0), ("UMa", 37.0)])
def test_shadowing_varies_and_hangs_together_as_the_standard_has_it(environment, length) -> None:
    """4000 devices' fields, in sight at 60 m, at places on one line."""
    devices = np.zeros((4000, 2))
    away = np.array([0.0, 5.0, 20.0, 60.0])
    plain = made([], devices, environment=environment)
    shadowed = made([], devices, environment=environment, rng=np.random.default_rng(5))
    device = np.arange(4000)
    places = [np.tile([x, 7.0, 60.0], (4000, 1)) for x in away]
    assert (plain.unknown_db(device, places[0]) == shadowed.unknown_db(device, places[0])).all()
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
