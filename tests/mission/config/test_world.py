"""Devices at given places: where they come to stand, and which files are refused in which words."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
import pytest

from mission.base.errors import InputError
from mission.config.loading import load_config
from mission.config.models import RunConfig
from mission.flight.missions.geofence import airspace_rings, fence_items
from mission.scenario.scenario import build_scenario
from sitl.autopilot.fence import compile_fence

BASE = """
[[communities]]
name = "a"
task = "digits"
partition = "iid"
"""
# Of a town by the sea: lat, lon.
TOWN = ((43.580, 7.120), (43.584, 7.125), (43.582, 7.132))


@pytest.fixture
def load(tmp_path: Path):
    def _load(text: str = BASE, **overrides: Any) -> RunConfig:
        path = tmp_path / "c.toml"
        path.write_text(text)
        return load_config(path, {k.replace("__", "."): v for k, v in overrides.items()})

    return _load


def collection(kind: str, *features: tuple[dict[str, Any], Any]) -> str:
    """GeoJSON of (properties, coordinates) each."""
    found = [
        {"type": "Feature", "properties": told, "geometry": {"type": kind, "coordinates": at}}
        for told, at in features
    ]
    return json.dumps({"type": "FeatureCollection", "features": found})


def points(*places: tuple[float, float], **properties: Any) -> str:
    told = ({k: v[i] for k, v in properties.items()} for i in range(len(places)))
    return collection(
        "Point", *((p, [lon, lat]) for p, (lat, lon) in zip(told, places, strict=True))
    )


def from_file(tmp_path: Path, name: str, text: str) -> str:
    (tmp_path / name).write_text(text)
    return BASE + f'positions_file = "{name}"\n'


def test_positions_in_the_configuration_say_how_many_devices_there_are(load) -> None:
    config = load(BASE + "positions_m = [[100, 200], [300, 50]]\n[area]\nsize_m = [400, 400]\n")
    assert config.communities[0].devices == 2
    scenario = build_scenario(config, data_dir=None)
    np.testing.assert_array_equal(scenario.devices_m, [[100, 200], [300, 50]])


def test_devices_that_have_no_place_are_drawn_as_if_nobody_had_one(load) -> None:
    other = BASE.replace('"a"', '"b"') + "devices = 2\n"
    drawn = build_scenario(load(BASE + "devices = 2\n" + other), data_dir=None).devices_m
    placed = load(BASE + "positions_m = [[1, 2], [3, 4]]\n" + other + "[area]\nsize_m=[800,800]\n")
    found = build_scenario(placed, data_dir=None).devices_m
    np.testing.assert_array_equal(found[:2], [[1, 2], [3, 4]])
    np.testing.assert_array_equal(found[2:], drawn[2:])


def test_area_and_home_lie_about_places_in_metres(load) -> None:
    config = load(BASE + "positions_m = [[100, 200], [700, 300]]\n")
    assert config.area.size_m == (760.0, 360.0)  # a tenth of 600 m beyond the farthest
    assert config.area.home_m == (380.0, 180.0)


@pytest.mark.parametrize(
    ("positions", "given", "size_m", "home_m"),
    [
        # 50 m beyond the farthest, where a tenth of the extent is less; home in the middle.
        ([[10, 20], [30, 25]], {}, (80.0, 75.0), (40.0, 37.5)),
        ([[0, 0]], {}, (50.0, 50.0), (25.0, 25.0)),
        ([[0, 0], [100, 600.2]], {}, (161.0, 661.0), (80.5, 330.5)),
        ([[10, 20], [30, 25]], {"home_m": [5, -6]}, (80.0, 75.0), (5.0, -6.0)),
        ([[0, 0], [31, 26]], {"size_m": [31, 26]}, (31.0, 26.0), (400.0, 400.0)),
    ],
)
def test_what_is_not_said_of_the_area_is_taken_from_its_places(
    load, positions: Any, given: dict[str, Any], size_m: Any, home_m: Any
) -> None:
    keys = "".join(f"{key} = {value}\n" for key, value in given.items())
    config = load(BASE + f"positions_m = {positions}\n[area]\n{keys}")
    assert (config.area.size_m, config.area.home_m) == (size_m, home_m)


@pytest.mark.parametrize(
    ("given", "size_m", "corner_m"),
    [
        ({}, None, None),  # the extent with its margin, in the middle
        ({"size_m": (3000.0, 1200.0)}, (3000.0, 1200.0), None),
        ({"home_lat_deg": 43.57, "home_lon_deg": 7.121}, None, None),
        # The area reaches as far beyond the last place as its margin.
        ({"home_lat_deg": 43.58, "home_lon_deg": 7.12, "home_m": (100.0, 150.0)}, None, (100, 150)),
        ({"home_m": (70.0, -20.0)}, None, None),
    ],
)
def test_the_area_about_places_on_the_globe(
    load, tmp_path: Path, given: dict[str, Any], size_m: Any, corner_m: Any
) -> None:
    keys = "".join(f"{k} = {list(v) if isinstance(v, tuple) else v}\n" for k, v in given.items())
    area = load(from_file(tmp_path, "d.geojson", points(*TOWN)) + f"[area]\n{keys}").area
    at = given.get("home_lat_deg", 43.582), given.get("home_lon_deg", 7.126)
    enu = [pymap3d.geodetic2enu(lat, lon, 130.0, *at, 130.0)[:2] for lat, lon in TOWN]
    low, high = np.min(enu, axis=0), np.max(enu, axis=0)
    margin_m = 0.1 * (high - low).max()  # some 97 m
    if corner_m is None:
        wanted = size_m or np.ceil(high - low + 2.0 * margin_m)
        south_west = (low + high) / 2.0 - np.array(wanted) / 2.0
    else:
        wanted, south_west = np.ceil(np.add(corner_m, high) + margin_m), -np.array(corner_m)
    assert area.size_m == pytest.approx(wanted)
    if "home_m" in given and corner_m is None:  # home is moved to there
        assert area.home_m == given["home_m"]
        moved = pymap3d.geodetic2enu(
            area.home_lat_deg, area.home_lon_deg, 130.0, 43.582, 7.126, 130.0
        )
        assert moved[:2] == pytest.approx(south_west + area.home_m, abs=0.02)
    else:
        assert area.home_m == pytest.approx(-south_west, abs=2e-3)
        assert (area.home_lat_deg, area.home_lon_deg) == at


def test_a_community_has_a_thousand_devices_and_no_more(load, tmp_path: Path) -> None:
    rows = "".join(f"{n % 40},{n // 40}\n" for n in range(1000))
    assert load(from_file(tmp_path, "d.csv", "x,y\n" + rows)).communities[0].devices == 1000
    with pytest.raises(InputError, match="holds 1001 places; a community has 1000 devices at most"):
        load(from_file(tmp_path, "d.csv", "x,y\n" + rows + "9,9\n"))


def test_shares_are_of_the_file_or_of_the_configuration(load, tmp_path: Path) -> None:
    text = from_file(tmp_path, "d.geojson", points(*TOWN, share=[2, 1, 1]))
    with pytest.raises(InputError, match=r"has shares, as communities\.0\.data_shares has: one of"):
        load(text + "data_shares = [1, 2, 3]\n")


def test_who_is_in_the_area_is_told_at_its_edge(load) -> None:
    text = BASE + "positions_m = [[0, 0], [50, 30], [%s, %s]]\n[area]\nsize_m = [50, 30]\n"
    assert load(text % (0, 30)).communities[0].devices == 3
    for x, y in ((50.01, 0), (0, 30.01), (-0.01, 0), (0, -0.01)):
        with pytest.raises(
            InputError, match=r"positions_m\.2: a device at .*, outside the area: x"
        ):
            load(text % (x, y))


def test_degrees_become_metres_as_a_geodesy_library_has_them(load, tmp_path: Path) -> None:
    config = load(from_file(tmp_path, "d.geojson", points(*TOWN)))
    area = config.area
    for (lat, lon), (x, y) in zip(TOWN, config.communities[0].positions_m or (), strict=True):
        east, north, _ = pymap3d.geodetic2enu(
            lat, lon, area.home_alt_msl_m, area.home_lat_deg, area.home_lon_deg, area.home_alt_msl_m
        )
        assert (x, y) == pytest.approx((area.home_m[0] + east, area.home_m[1] + north), abs=1e-6)
        assert 0 < x < area.size_m[0]
        assert 0 < y < area.size_m[1]
    assert (area.home_lat_deg, area.home_lon_deg) == pytest.approx((43.582, 7.126))


def test_a_table_and_geojson_of_the_same_places_are_the_same(load, tmp_path: Path) -> None:
    table = "id,LAT, lon ,community\n" + "".join(f"7,{lat},{lon},a\n" for lat, lon in TOWN)
    first = load(from_file(tmp_path, "d.csv", table))
    second = load(from_file(tmp_path, "d.geojson", points(*TOWN)))
    assert first == second


def test_home_that_is_given_stays_where_it_is(load, tmp_path: Path) -> None:
    text = from_file(tmp_path, "d.geojson", points(*TOWN))
    area = "[area]\nhome_lat_deg = 43.58\nhome_lon_deg = 7.12\nhome_m = [100, 150]\n"
    config = load(text + area)
    assert config.communities[0].positions_m[0] == pytest.approx((100, 150), abs=1e-6)
    assert config.area.home_m == (100, 150)


def test_places_west_of_a_home_that_is_fixed_are_not_told_to_move(load, tmp_path: Path) -> None:
    text = from_file(tmp_path, "d.geojson", points(*TOWN))
    area = "[area]\nhome_lat_deg = 43.58\nhome_lon_deg = 7.2\nhome_m = [100, 150]\n"
    with pytest.raises(InputError, match=r"outside the area: x must be from 0 to .*area.size_m"):
        load(text + area)


def test_shares_say_who_has_how_much_of_the_data(load, tmp_path: Path) -> None:
    text = from_file(tmp_path, "d.geojson", points(*TOWN, share=[2, 1, 1]))
    scenario = build_scenario(load(text), data_dir=None)
    np.testing.assert_allclose(scenario.federation.p, [0.5, 0.25, 0.25], atol=1e-3)


@pytest.mark.parametrize("partition", ["labels", "dirichlet", "iid"])
def test_the_devices_of_a_run_go_back_in(load, tmp_path: Path, partition: str) -> None:
    text = BASE.replace("iid", partition) + "positions_file = 'd.geojson'\ndirichlet_alpha = 50.0\n"
    (tmp_path / "d.geojson").write_text(points(*TOWN, share=[3, 1, 2], community=["a"] * 3))
    first = build_scenario(load(text), data_dir=None).devices_csv()
    (tmp_path / "devices.csv").write_text(first)
    again = load(text.replace("d.geojson", "devices.csv"))
    assert build_scenario(again, data_dir=None).devices_csv() == first


def test_shares_are_refused_where_the_partition_weighs_nothing(load) -> None:
    words = "data_shares weighs nothing with partition = 'owners'.* or have labels, dirichlet, iid"
    with pytest.raises(InputError, match=words):
        load(BASE.replace("iid", "owners") + "devices = 2\ndata_shares = [1, 2]\n")


def test_shares_of_a_file_are_left_where_owners_share_out(load, tmp_path: Path) -> None:
    text = from_file(tmp_path, "d.geojson", points(*TOWN, share=[2, 1, 1])).replace("iid", "owners")
    config = load(text)
    assert config.communities[0].data_shares is None
    assert load(config.to_toml()) == config


def test_the_resolved_configuration_needs_no_file(load, tmp_path: Path) -> None:
    config = load(from_file(tmp_path, "d.geojson", points(*TOWN)))
    (tmp_path / "d.geojson").unlink()
    assert load(config.to_toml()) == config


def test_a_file_named_on_the_command_line_is_found_from_there(load, tmp_path: Path) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "d.csv").write_text("x,y\n1,2\n")
    config = load(communities__0__positions_file=str(folder / "d.csv"))
    assert config.communities[0].positions_m == ((1, 2),)


BAD_TABLES = {
    "x,y\n1,2\n3,abc\n": "d.csv: row 3: y = 'abc': must be a number",
    "x,y\n1,2\n3,nan\n": "d.csv: row 3: y = 'nan': must be a number",
    "x,y\n1,2\n3\n": "d.csv: row 3: has 1 cells, the header has 2",
    "a,b\n1,2\n": "row 1: the columns are a, b; there must be x and y",
    "x;y\n1;2\n": "row 1: the columns are x;y; commas separate columns; there must be x and y",
    "": "row 1: has no names of columns; there must be x and y",
    "x,x,y\n1,2,3\n": "d.csv: row 1: the column x is there twice",
    "x,y,lat,lon\n1,2,43.6,7.1\n": "d.csv: row 1: has metres and degrees; leave x and y, or lat",
    "x,y\n": "holds no device; it must hold a point a device",
    "lat,lon\n95,7\n": "row 2: lat = 95: must be from -85 to 85 degrees",
    "lat,lon\n143,43\n": "row 2: lat = 143: must be from -85 to 85 degrees; are lat",
    "lat,lon\n43,190\n": "row 2: lon = 190: must be from -180 to 180 degrees",
    "lat,lon\n43.5,7.1\n7.1,43.5\n": "km at most are allowed; are lat and lon of one swapped?",
    "x,y\n-3,4\n": "row 2: a device at x = -3.0, y = 4.0 m: x and y must be 0 or more, from the "
    "area's south-west corner; add the same to all places",
    "x,y\n0,0\n1e9,4\n": "d.csv: row 3: x = 1e+09: must be from -100000 to 100000 m",
    "x,y\n0,0\n3,-1e6\n": "d.csv: row 3: y = -1e+06: must be from -100000 to 100000 m",
    "x,y\n1,2\n9,9\n99000,4\n": "d.csv: row 4 (99000, 4) lie so far apart that the area around "
    "all places, margins counted, has 108.9 km; 100 km at most are allowed",
    "x,y,share\n1,2,0\n": "row 2: share = 0: must be above 0",
    "x,y,share\n1,2,1\n3,4,\n": "row 3: has no share, as other devices of the community do",
    "x,y,community\n1,2,a\n3,4,b\n": "row 3: community = 'b': must be one of 'a'",
    "x,y,community\n1,2,a\n3,4,\n": "row 3: names no community, as others in the file do",
}


@pytest.mark.parametrize("table", BAD_TABLES)
def test_a_wrong_table_is_one_line_that_says_what_is_allowed(load, tmp_path: Path, table) -> None:
    with pytest.raises(InputError) as error:
        load(from_file(tmp_path, "d.csv", table))
    assert BAD_TABLES[table] in str(error.value)
    assert "\n" not in str(error.value)
    assert "d.csv" in str(error.value) or "100 km" in str(error.value)


def feature(kind: str, coordinates: Any) -> str:
    geometry = {"type": kind, "coordinates": coordinates}
    return json.dumps({"type": "Feature", "properties": {}, "geometry": geometry})


BAD_GEOJSON = {
    "nothing": "not valid JSON",
    "[]": "a FeatureCollection is wanted",
    '{"type": "FeatureCollection", "features": 3}': "features = 3: must be a list",
    '{"type": "FeatureCollection", "features": []}': "holds no device",
    '{"type": "FeatureCollection", "features": [{"type": "Feature"}]}': "features[0]: no Feature",
    feature("LineString", [[7, 43], [7, 44]]): "geometry is 'LineString': must be 'Point'",
    feature("Point", [7]): "coordinates = [7]: must be [lon, lat]",
    feature("Point", ["7", None]): "lat = null: must be a number",
    feature("Point", [4e5, 5e6]): "lat = 5e+06: must be from -85 to 85 degrees",
}


def test_a_community_that_the_configuration_does_not_have_is_refused(load, tmp_path) -> None:
    text = from_file(tmp_path, "d.geojson", points(*TOWN, community=["a", "b", "bb"]))
    both = text + BASE.replace('"a"', '"b"') + 'positions_file = "d.geojson"\n'
    with pytest.raises(InputError) as error:
        load(both)
    assert str(error.value).endswith(
        "d.geojson: features[2]: community = 'bb': must be one of 'a', 'b'"
    )
    (tmp_path / "d.geojson").write_text(points(*TOWN, community=["a", "b", "b"]))
    assert [community.devices for community in load(both).communities] == [1, 2]
    (tmp_path / "d.geojson").write_text(points(*TOWN, community=["a", "a", "a"]))
    with pytest.raises(InputError, match="holds no device of community 'b', only of 'a'"):
        load(both)


@pytest.mark.parametrize("text", BAD_GEOJSON)
def test_wrong_geojson_is_one_line(load, tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError) as error:
        load(from_file(tmp_path, "d.geojson", text))
    assert BAD_GEOJSON[text] in str(error.value)
    assert "d.geojson" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (
            "devices = 4\n",
            "c.toml: communities.0.devices = 4: communities.0.positions_file = 'd.geojson' "
            "holds 3 places",
        ),
        ("positions_m = [[1, 2]]\n", "positions_m and positions_file: one of them, not both"),
        ("data_shares = [1, 2]\n", "community 'a' has 3 places, but 2 data_shares"),
        ("[area]\nsize_m = [100, 100]\n", "outside the area: x must be from 0 to 100"),
        ("[area]\nhome_lat_deg = 43.0\n", "area.home_lon_deg: missing"),
        (
            "[area]\nhome_lat_deg = 7.12\nhome_lon_deg = 43.58\n",
            "100 km at most are allowed; are lat and lon of one swapped?",
        ),
    ],
)
def test_what_contradicts_a_file_is_refused(load, tmp_path: Path, more: str, words: str) -> None:
    with pytest.raises(InputError, match=r"c\.toml|d\.geojson") as error:
        load(from_file(tmp_path, "d.geojson", points(*TOWN)) + more)
    assert words in str(error.value)


@pytest.mark.parametrize("name", ["d.kml", "none.csv"])
def test_a_file_that_cannot_be_read_is_refused(load, tmp_path: Path, name: str) -> None:
    if name == "d.kml":
        (tmp_path / name).write_text("<kml/>")
    with pytest.raises(InputError, match=r"must end in .csv|No such file"):
        load(BASE + f'positions_file = "{name}"\n')


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("positions_m = [[1, 2]]\ndevices = 3\n", "positions_m has 1 entries for 3 devices"),
        ("devices = 2\ndata_shares = [1]\n", "data_shares has 1 entries for 2 devices"),
        ("positions_m = [[1, 2, 3]]\n", "must have at most 2 items"),
        ("positions_m = [[1e9, 2]]\n", "must be less than or equal to 100000"),
        (
            "positions_m = [[9, -2]]\n",
            r"positions_m\.0: a device at x = 9.0, y = -2.0 m: x and y must be 0",
        ),
        ("positions_m = [[9, -2]]\n[area]\nsize_m = [800, 800]\n", "outside the area"),
        ("positions_m = [[900, 2]]\n[area]\nsize_m = [800, 800]\n", "outside the area"),
    ],
)
def test_wrong_positions_in_the_configuration_are_refused(load, keys: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load(BASE + keys)


def test_a_configuration_whose_file_nobody_read_is_no_scenario() -> None:
    community = {"name": "a", "task": "digits", "positions_file": "d.csv"}
    with pytest.raises(InputError, match="not read yet"):
        build_scenario(RunConfig(communities=(community,)), data_dir=None)


def zones(*polygons: Any) -> str:
    """GeoJSON of (properties, ((lat, lon), ...)) each."""
    return collection(
        "Polygon",
        *((told, [[[lon, lat] for lat, lon in (*ring, ring[0])]]) for told, ring in polygons),
    )


SCHOOL = ((43.581, 7.121), (43.581, 7.123), (43.583, 7.123), (43.583, 7.121))
AREA = "[area]\nhome_lat_deg = 43.580\nhome_lon_deg = 7.127\n"


def test_areas_out_of_a_file_lie_where_they_are_on_the_globe(load, tmp_path: Path) -> None:
    properties = {"name": "School", "from_m": 0.0, "to_m": 90, "colour": "red"}
    (tmp_path / "z.geojson").write_text(zones((properties, SCHOOL)))
    text = from_file(tmp_path, "d.geojson", points(*TOWN)) + AREA
    config = load(text + 'no_fly_file = "z.geojson"\nfence_file = "z.geojson"\n')
    zone = config.area.no_fly[0]
    assert (zone.name, zone.from_m, zone.to_m) == ("School", 0, 90)
    for (lat, lon), (x, y) in zip(SCHOOL, zone.polygon_m, strict=True):
        east, north, _ = pymap3d.geodetic2enu(lat, lon, 130.0, 43.580, 7.127, 130.0)
        home = config.area.home_m
        assert (x, y) == pytest.approx((home[0] + east, home[1] + north), abs=1e-3)
    assert config.area.fences is not None
    assert [(one.polygon_m, one.group) for one in config.area.fences] == [(zone.polygon_m, 0)]
    assert load(config.to_toml()) == config


def test_an_area_with_a_hole_is_refused(load, tmp_path: Path) -> None:
    document = json.loads(zones(({}, SCHOOL)))
    document["features"][0]["geometry"]["coordinates"] *= 2
    (tmp_path / "z.geojson").write_text(json.dumps(document))
    text = from_file(tmp_path, "d.geojson", points(*TOWN)) + AREA
    with pytest.raises(InputError, match="has 1 hole: an area must have none"):
        load(text + 'no_fly_file = "z.geojson"\n')


@pytest.mark.parametrize(
    ("low", "high", "counts"),
    [
        (0, None, True),
        (0, 54, False),
        (0, 55, False),
        (0, 56, True),
        (64, None, True),
        (65, None, False),
        (66, None, False),
    ],
)
def test_an_area_counts_at_its_heights(load, low: float, high: float | None, counts: bool) -> None:
    heights = f"from_m = {low}\n" + ("" if high is None else f"to_m = {high}\n")
    text = BASE + "[[area.no_fly]]\npolygon_m = [[10,10],[90,10],[90,90]]\n" + heights
    config = load(text)
    assert bool(config.area.build((60.0, 60.0)).airspace.keep_out) is counts
    assert config.area.build().airspace.is_open, "where nothing is flown"


@pytest.mark.parametrize(
    ("area", "words"),
    [
        (
            "[[area.no_fly]]\nname = 'school'\npolygon_m = [[410,300],[500,300],[410,500]]",
            "lies nearer than area.margin_m = 15 m to the area 'school', which must not be flown",
        ),
        (
            "[[area.no_fly]]\nname = 'school'\npolygon_m = [[0,0],[800,0],[800,800],[0,800]]",
            "c.toml: area.home_m: the start, area.home_m = [400.0, 400.0], lies inside the area",
        ),
        (
            "[[area.no_fly]]\nname = 'low'\nto_m = 30\npolygon_m = [[300,300],[500,300],[500,500]]",
            "lies inside the area 'low', which must not be flown",
        ),
        ("[area]\nfence_m = [[0,0],[100,0],[100,100]]", "lies outside the fence"),
        ("[area]\nfence_m = [[0,0],[405,0],[405,800],[0,800]]", "nearer than area.margin_m = 15 m"),
    ],
)
def test_a_start_from_which_nobody_may_climb_is_refused(
    load, tmp_path: Path, area: str, words: str
) -> None:
    with pytest.raises(InputError) as error:
        build_scenario(load(BASE + area + "\n"), data_dir=None)
    assert words in str(error.value)
    assert "move home" in str(error.value)
    assert "home_lat_deg = 43.6145" in str(error.value)
    assert str(error.value).startswith(f"{tmp_path / 'c.toml'}: ")


@pytest.mark.parametrize(
    ("key", "value", "blamed"),
    [
        ("area__no_fly", [{"polygon_m": [[300, 300], [500, 300], [400, 500]]}], "area.no_fly.0"),
        ("area__fence_m", [[0, 0], [100, 0], [100, 100]], "area.fence_m"),
        ("area__home_m", [900, 900], "area.home_m"),
    ],
)
def test_of_a_start_that_is_refused_the_key_set_over_the_file_is_blamed(
    load, key: str, value: object, blamed: str
) -> None:
    fence = (
        "" if key == "area__fence_m" else "[area]\nfence_m = [[0,0],[800,0],[800,800],[0,800]]\n"
    )
    with pytest.raises(InputError, match=f"^command line: {re.escape(blamed)}: the start, area"):
        build_scenario(load(BASE + fence, **{key: value}), data_dir=None)


def test_an_area_counts_where_it_reaches_into_the_limits_of_the_altitude(load) -> None:
    low = "[[area.no_fly]]\nto_m = 50\npolygon_m = [[500,500],[700,500],[700,700],[500,700]]\n"
    above = BASE + "[mission]\naltitude_m = [60, 120]\n" + low
    assert build_scenario(load(above), data_dir=None).area.airspace.is_open
    reached = load(above.replace("altitude_m = [60", "altitude_m = [40"))
    assert not build_scenario(reached, data_dir=None).area.airspace.is_open


def test_a_start_below_an_area_overhead_is_fine(load) -> None:
    zone = "[[area.no_fly]]\nfrom_m = 100\npolygon_m = [[300,300],[500,300],[500,500],[300,500]]\n"
    assert build_scenario(load(BASE + zone), data_dir=None).area.airspace.is_open


BAD_AREAS = {
    "no_fly = [{polygon_m = [[0,0],[1,1]]}]": "area.no_fly.0.polygon_m",
    "no_fly = [{polygon_m = [[0,0],[9,9],[9,0],[0,9]]}]": (
        "polygon_m of 'no-fly area' crosses itself: its edges 0-1 and 2-3 meet"
    ),
    "buildings = [{height_m = 9, polygon_m = [[0,0],[9,9],[9,9]]}]": (
        "area.buildings.0: its outline has no area: its corners lie on one line"
    ),
    "no_fly = [{polygon_m = [[0,0],[9,9],[9,0]], to_m = 0}]": "to_m = 0 must be above from_m = 0",
    "fence_m = [[0,0],[9,9],[9,0],[0,9]]": "fence_m crosses itself: its edges 0-1 and 2-3 meet",
    "fences = [{polygon_m = [[0,0],[9,9],[9,0],[0,9]]}]": "fences.0: its outline crosses itself",
    "fences = [{radius_m = 9}]": "fences.0: must have polygon_m, or center_m and radius_m",
    "fences = [{center_m = [0, 0], radius_m = 0}]": "radius_m = 0: must be greater than 0",
    "fences = [{center_m = [0, 0], radius_m = nan}]": "radius_m = nan: must be",
    "fences = [{center_m = [0, 0], radius_m = 9, group = -1}]": "group = -1: must be greater than",
    "fences = [{center_m = [0, 0], radius_m = 9, group = 0.5}]": "group = 0.5: must be a whole",
    "fence_m = [[0,0],[9,9],[9,0]]\nfences = [{center_m = [50, 0], radius_m = 9}]": (
        "the areas of no group have a place in common"
    ),
    "margin_m = 1": "margin_m = 1: must be greater than or equal to 5",
    "no_fly_file = 'none.geojson'": "none.geojson: cannot be read",
}


@pytest.mark.parametrize("keys", BAD_AREAS)
def test_wrong_areas_in_the_configuration_are_refused(load, keys: str) -> None:
    with pytest.raises(InputError) as error:
        load(BASE + "[area]\n" + keys + "\n")
    assert BAD_AREAS[keys] in str(error.value)


FAR = tuple((lon, lat) for lat, lon in SCHOOL)
BAD_RINGS = {
    points(*TOWN): "features[0]: geometry is 'Point': must be 'Polygon' or 'MultiPolygon'",
    zones(({}, FAR)): "100 km at most are allowed; are lat and lon of one swapped?",
    zones(({}, SCHOOL[:2])): "a ring of 3 positions: there must be 4 at least",
    zones(({"from_m": "low"}, SCHOOL)): "features[0]: from_m = 'low': must be a number",
    zones(({"to_m": -5}, SCHOOL)): "z.geojson: features[0]: to_m = -5 must be above from_m = 0",
    zones(({}, (SCHOOL[0], SCHOOL[2], SCHOOL[1], SCHOOL[3]))): "crosses itself",
    '{"type": "FeatureCollection", "features": []}': "holds no area",
}


@pytest.mark.parametrize("text", BAD_RINGS)
def test_wrong_areas_in_a_file_are_one_line(load, tmp_path: Path, text: str) -> None:
    (tmp_path / "z.geojson").write_text(text)
    world = from_file(tmp_path, "d.geojson", points(*TOWN)) + AREA
    with pytest.raises(InputError) as error:
        load(world + 'no_fly_file = "z.geojson"\n')
    assert BAD_RINGS[text] in str(error.value)
    assert "\n" not in str(error.value)
    assert "z.geojson" in str(error.value)


def fenced_ground(load, text: str, *places: tuple[float, float]) -> list[bool]:
    config = load(BASE + text)
    space = config.area.build(config.mission.heights_m).airspace
    assert load(config.to_toml()) == config
    return space.allows(np.array(places, dtype=float)).tolist()


# About home at (400, 400): in both, in the circle, in the square, in neither.
TWO = """[area]
fence_m = [[300, 300], [500, 300], [500, 500], [300, 500]]
[[area.fences]]
center_m = [400, 350]
radius_m = 120
group = %d
"""
PLACES = ((400.0, 400.0), (400.0, 240.0), (310.0, 490.0), (600.0, 600.0))


@pytest.mark.parametrize(
    ("group", "allowed"),
    [(0, [True, False, False, False]), (1, [True, True, True, False])],
)
def test_flights_are_within_all_areas_of_a_group(load, group: int, allowed: list[bool]) -> None:
    assert fenced_ground(load, TWO % group, *PLACES) == allowed


def test_what_two_groups_enclose_is_a_hole_and_what_is_apart_is_out_of_reach(load) -> None:
    """Four bars about home, and an island: the vehicle gets one outline and one hole."""
    bars = [(300, 300, 500, 350), (300, 450, 500, 500), (300, 300, 350, 500), (450, 300, 500, 500)]
    bars.append((700, 700, 780, 780))
    text = "".join(
        f"[[area.fences]]\ngroup = {n}\npolygon_m = [[{a},{b}],[{c},{b}],[{c},{d}],[{a},{d}]]\n"
        for n, (a, b, c, d) in enumerate(bars)
    )
    text = "[area]\nhome_m = [325, 400]\n" + text
    places = (325.0, 400.0), (400.0, 400.0), (475.0, 400.0), (740.0, 740.0)
    assert fenced_ground(load, text, *places) == [True, False, True, False]
    items = fence_items(airspace_rings(load(BASE + text).area.build((60.0, 60.0))))
    frame = load(BASE + text).area.build().frame
    fence = compile_fence(items, frame)
    assert [len(fence.inclusions), len(fence.exclusions)] == [1, 1]
    for shape, half_m in ((fence.inclusions[0], 100.0), (fence.exclusions[0], 50.0)):
        corners = np.array(shape) - [0.0, 75.0]  # north and east of home
        np.testing.assert_allclose(corners.min(axis=0), -half_m, atol=0.02)
        np.testing.assert_allclose(corners.max(axis=0), half_m, atol=0.02)


def test_polygons_of_a_fence_file_have_groups(load, tmp_path: Path) -> None:
    def moved(east_deg: float) -> tuple[tuple[float, float], ...]:
        return tuple((lat, lon + east_deg) for lat, lon in SCHOOL)

    home = "[area]\nhome_lat_deg = 43.582\nhome_lon_deg = 7.122\n"
    text = from_file(tmp_path, "d.geojson", points(*TOWN)) + home + 'fence_file = "z.geojson"\n'
    east_m = 80.0  # about 0.001 deg
    for told, allowed in (({}, [True, False, False]), ({"group": 4}, [True, True, True])):
        (tmp_path / "z.geojson").write_text(zones((told, moved(0.0)), ({}, moved(-0.0007))))
        area = load(text).area
        at = np.add(area.home_m, [[-40.0, 0.0], [0.75 * east_m, 0.0], [-1.25 * east_m, 0.0]])
        assert area.build((60.0, 60.0)).airspace.allows(at).tolist() == allowed
    wrong = {
        zones(({}, SCHOOL), ({}, moved(0.01))): "area.fence_file: the areas of no group have a",
        zones(({"group": 1.5}, SCHOOL)): "features[0]: group = 1.5: must be a whole number",
        zones(({}, SCHOOL), ({}, (SCHOOL[0], SCHOOL[2], SCHOOL[1], SCHOOL[3]))): (
            "features[1]: its outline crosses itself: its edges 0-1 and 2-3 meet"
        ),
    }
    for content, words in wrong.items():
        (tmp_path / "z.geojson").write_text(content)
        with pytest.raises(InputError) as error:
            load(text)
        assert words in str(error.value)
        assert "\n" not in str(error.value)


def test_home_given_as_a_place_in_the_area_of_devices_in_degrees(load, tmp_path: Path) -> None:
    text = from_file(tmp_path, "d.geojson", points(*TOWN))
    usual, moved = load(text), load(text, area__home_m=[100.0, -50.0])
    for first, second in zip(
        usual.communities[0].positions_m, moved.communities[0].positions_m, strict=True
    ):  # the devices stay where they are in the area
        assert first == pytest.approx(second, abs=0.2)
    east, north, _ = pymap3d.geodetic2enu(
        moved.area.home_lat_deg, moved.area.home_lon_deg, 0.0,
        usual.area.home_lat_deg, usual.area.home_lon_deg, 0.0,
    )  # fmt: skip
    there = (100.0 - usual.area.home_m[0], -50.0 - usual.area.home_m[1])
    assert (east, north) == pytest.approx(there, abs=0.1)


def test_a_file_named_on_the_command_line_is_not_blamed_on_the_configuration(load) -> None:
    for key in ("communities.0.positions_file", "area.no_fly_file"):
        with pytest.raises(InputError, match=rf"^command line: {key}: \S+nope.csv: "):
            load(**{key.replace(".", "__"): "/nope.csv"})


def test_a_number_of_devices_that_contradicts_a_file_is_what_is_blamed(load, tmp_path) -> None:
    text = from_file(tmp_path, "d.geojson", points(*TOWN))
    with pytest.raises(InputError, match=r"^command line: communities.0.devices = 2: .* holds 3 "):
        load(text, communities__0__devices=2)


def test_paths_stand_beside_the_configuration_and_may_begin_at_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "me"))
    folder = tmp_path / "configs"
    for path in (folder, tmp_path / "me", tmp_path / "work"):
        path.mkdir()
    (folder / "vehicle.parm").write_text("NAV_ACC_RAD 3")
    (tmp_path / "me" / "key").write_text("a long pass phrase")
    (folder / "places.csv").write_text("x_m,y_m\n1,2\n")
    (folder / "c.toml").write_text(
        BASE + 'positions_file = "places.csv"\n[vehicle]\nparameter_file = "vehicle.parm"\n'
        '[link]\nsigning_key = "~/key"\n'
    )
    monkeypatch.chdir(tmp_path / "work")
    config = load_config(Path("../configs/c.toml"))
    assert config.vehicle.parameter_file == folder / "vehicle.parm"
    assert config.link.signing_key == tmp_path / "me" / "key"
    px4 = {"vehicle.autopilot": "px4", "vehicle.firmware.path": "bin/px4"}
    (folder / "c.toml").write_text(BASE)
    assert load_config(folder / "c.toml", px4).vehicle.firmware.path == tmp_path / "work/bin/px4"
    (folder / "c.toml").write_text(
        BASE + '[vehicle]\nautopilot = "px4"\nfirmware.path = "../bin/px4"\n'
    )
    assert load_config(folder / "c.toml").vehicle.firmware.path == tmp_path / "bin/px4"
    again = load_config(load_config(folder / "c.toml"))
    assert again.vehicle.firmware.path == tmp_path / "bin/px4"


TALL = {"height": "61.5 m", "building:levels": "3", "name": "Town hall"}
PLACED = BASE + "positions_m = [[0, 0]]\n[area]\nsize_m = [900, 900]\nhome_m = [400, 300]\n"
PLACED += "home_lat_deg = 43.580\nhome_lon_deg = 7.120\nbuildings_file = 'b.geojson'\n"


def houses(*found: dict[str, Any]) -> str:
    """The school as so many buildings, the first with a courtyard."""
    document = json.loads(zones(*((properties, SCHOOL) for properties in found)))
    middle = np.mean(SCHOOL, axis=0)
    court = [[*reversed((middle + 0.2 * (np.array(at) - middle)).tolist())] for at in SCHOOL]
    document["features"][0]["geometry"]["coordinates"].append([*court, court[0]])
    return json.dumps(document)


def test_buildings_out_of_a_map_of_the_streets(load, tmp_path: Path) -> None:
    (tmp_path / "b.geojson").write_text(houses(TALL, {"building:levels": "4"}))
    config = load(PLACED)
    first, second = config.area.buildings
    assert (first.height_m, second.height_m) == (61.5, 12.0)
    assert (len(first.holes_m), len(second.holes_m)) == (1, 0)
    school = [(x, y) for x, y in first.polygon_m]
    for (lat, lon), (x, y) in zip(SCHOOL, school, strict=True):
        east, north, _ = pymap3d.geodetic2enu(lat, lon, 130.0, 43.580, 7.120, 130.0)
        assert (x, y) == pytest.approx((400.0 + east, 300.0 + north), abs=1e-3)
    assert load(config.to_toml()) == config
    flown = config.area.build((60.0, 60.0))
    assert [ring.tolist() for ring in flown.airspace.keep_out] == [list(map(list, school))]
    assert config.area.build((120.0, 120.0)).airspace.is_open
    assert len(flown.buildings) == len(config.area.build().buildings) == 2


BAD_HOUSES = {
    '{"building": "yes"}': "features[0]: has neither height nor building:levels; give it one, or s",
    '{"height": "two"}': "features[0]: height = 'two': must be a number",
    '{"building:levels": [3]}': "features[0]: building:levels = [3]: must be a number",
    '{"height": -3}': "features[0]: height_m = -3.0: must be greater than 0",
    '{"height": "nan"}': "area.buildings_file: ",
    '{"height": "40 ft"}': "features[0]: height = '40 ft': must be a number of metres",
    '{"height": 9, "min_height": "?"}': "features[0]: min_height = '?': must be a number of metres",
    '{"height": 9, "building:min_level": 3}': "features[0]: from_m = 9 must be below height_m = 9",
}


@pytest.mark.parametrize("properties", BAD_HOUSES)
def test_buildings_without_a_height_are_refused(load, tmp_path: Path, properties: str) -> None:
    (tmp_path / "b.geojson").write_text(houses(json.loads(properties)))
    with pytest.raises(InputError) as error:
        load(PLACED)
    assert BAD_HOUSES[properties] in str(error.value)
    assert "\n" not in str(error.value)


def test_trees_and_streets_between_buildings_are_passed_over(load, tmp_path: Path) -> None:
    park = {"leisure": "park", "height": None, "building": None}
    document = json.loads(houses(TALL, park))
    others = [
        feature("Point", [7.12, 43.58]),
        feature("LineString", [[7.12, 43.58], [7.13, 43.58]]),
    ]
    document["features"][:0] = map(json.loads, others)
    (tmp_path / "b.geojson").write_text(json.dumps(document))
    config = load(PLACED)
    assert [one.height_m for one in config.area.buildings] == [61.5]
    (note,) = config.notes
    assert "b.geojson: 3 features passed over that say neither building, height nor" in note
    assert not load(config.to_toml()).notes
    document["features"].pop(2)
    (tmp_path / "b.geojson").write_text(json.dumps(document))
    with pytest.raises(
        InputError, match=r"b\.geojson: holds no building; it must hold Poly"
    ) as error:
        load(PLACED)
    assert "\n" not in str(error.value)


def test_parts_of_buildings_begin_above_the_ground(load, tmp_path: Path) -> None:
    bridge = {"building": "no", "building:part": "yes", "height": "12", "min_height": "6.5 m"}
    levels = {"building:part": "yes", "building:levels": 5, "building:min_level": "2"}
    gone: list[dict[str, Any]] = [
        {"building": "no", "height": "9"},
        {"building:part": "no", "height": 9},
        {"building": "no", "building:part": "no", "height": 9},
    ]
    (tmp_path / "b.geojson").write_text(houses(TALL, bridge, levels, *gone))
    config = load(PLACED)
    heights = [(one.from_m, one.height_m) for one in config.area.buildings]
    assert heights == [(0.0, 61.5), (6.5, 12.0), (6.0, 15.0)]
    assert "3 features passed over" in config.notes[0]
    assert load(config.to_toml()) == config
    # A flight passes below it, as far as the margin goes.
    assert [zone.counts_at(1.0, 1.0) for zone in config.area.zones] == [True, False, False]


def test_three_corners_on_a_line_are_no_building(load, tmp_path: Path) -> None:
    document = json.loads(houses(TALL, TALL))
    line = [[7.121, 43.581], [7.122, 43.582], [7.123, 43.583], [7.121, 43.581]]
    document["features"][1]["geometry"]["coordinates"] = [line]
    (tmp_path / "b.geojson").write_text(json.dumps(document))
    with pytest.raises(
        InputError, match=r"b\.geojson: features\[1\]: its outline has no area: its"
    ):
        load(PLACED)


def test_what_says_no_height_may_have_one_of_all(load, tmp_path: Path) -> None:
    (tmp_path / "b.geojson").write_text(houses({"building": "yes"}, TALL))
    heights = [b.height_m for b in load(PLACED + "building_height_m = 7\n").area.buildings]
    assert heights == [7.0, 61.5]


def test_buildings_of_another_place_are_refused(load, tmp_path: Path) -> None:
    (tmp_path / "b.geojson").write_text(houses(TALL, TALL))
    with pytest.raises(InputError, match=r"none of 2 buildings stands in the area; the nearest"):
        load(PLACED.replace("43.580", "43.680"))
    # 3 m west, 4 m south of the area's corner; beside it to the north; and at its very edge.
    hall = (
        "[area]\nsize_m = [80, 60]\nhome_m = [9, 9]\nbuildings = [{polygon_m = %s, height_m = 9}]\n"
    )
    for ring, away_m in (
        ([[-9, -8], [-3, -8], [-3, -4]], 5),
        ([[20, 67], [40, 67], [40, 90]], 7),
        ([[91, 10], [95, 10], [95, 20]], 11),
    ):
        words = (
            rf"c\.toml: area.buildings: none of 1 buildings stands .* nearest is {away_m} m away"
        )
        with pytest.raises(InputError, match=words):
            load(BASE + hall % ring)
    assert load(BASE + hall % [[80, 60], [90, 60], [90, 90]]).area.buildings


def test_buildings_that_flights_go_around_have_few_corners(load) -> None:
    tower = "{polygon_m = [[1, 1], [2, 1], [2, 2]], height_m = 80}, "
    with pytest.raises(
        InputError, match=r"buildings as high as the flight.* have 501 corners; 500"
    ):
        load(BASE + f"[area]\nbuildings = [{tower * 167}]\n")
    low = tower.replace("80", "40")
    assert len(load(BASE + f"[area]\nbuildings = [{low * 167}]\n").area.buildings) == 167


def test_a_start_among_buildings_is_refused(load) -> None:
    hall = "buildings = [{polygon_m = [[390, 390], [395, 390], [395, 410]], height_m = 12}]\n"
    with pytest.raises(InputError, match=r"lies nearer than area.margin_m = 15 m to .*building 0"):
        build_scenario(load(BASE + "[area]\n" + hall), data_dir=None)


@pytest.mark.parametrize("hole", ["[[5,5],[50,5],[50,9]]", "[[60,5],[70,5],[70,9]]"])
def test_a_courtyard_outside_its_building_is_refused(load, hole: str) -> None:
    square = "polygon_m = [[0, 0], [40, 0], [40, 40], [0, 40]], height_m = 9"
    with pytest.raises(InputError, match="its holes must lie within its outline, and apart from"):
        load(BASE + f"[area]\nbuildings = [{{{square}, holes_m = [{hole}]}}]\n")


HALL = "buildings = [{polygon_m = [[90, 90], [110, 90], [110, 110], [90, 110]], height_m = 12}]\n"
CITY = BASE + "positions_m = [[700, 700], [100, 100]]\n[area]\nsize_m = [800, 800]\n" + HALL


def test_a_device_indoors_pays_or_is_refused(load) -> None:
    text = CITY + "[radio]\ntruth = 'buildings'\n"
    above = np.array([1]), np.array([[100.0, 100.0, 60.0]])
    elsewhere = {"area.buildings.0.polygon_m": [[0, 0], [9, 0], [9, 9]]}
    outdoors, indoors = (
        float(np.asarray(build_scenario(load(text, **more), data_dir=None).radio.per(*above))[0])
        for more in (elsewhere, {})
    )
    assert outdoors < 0.1 < 0.5 < indoors
    with pytest.raises(
        InputError, match=r"device 1 at x = 100.0, y = 100.0 m stands within a buil"
    ):
        build_scenario(load(text + "indoors = 'refused'\n"), data_dir=None)


def test_a_radio_among_buildings_needs_some_and_draws_by_their_rates(load) -> None:
    with pytest.raises(InputError, match=r"'buildings' needs area.buildings, or area"):
        load(BASE + "[radio]\ntruth = 'buildings'\n")
    with pytest.raises(
        InputError, match=r"draws packets on the channel, so it needs radio.truth ="
    ):
        load(CITY + "[radio]\ntruth = 'buildings'\n[channel]\ngate = 'instantaneous'\n")
    with pytest.raises(
        InputError, match=r"channel\.correlation_m = 30\.0 draws packets on the chan"
    ):
        load(CITY + "[radio]\ntruth = 'buildings'\n[channel]\ncorrelation_m = 30\n")
    with pytest.raises(
        InputError, match=r"'instantaneous' draws each packet anew: leave out channel"
    ):
        load(BASE + "[channel]\ngate = 'instantaneous'\ncorrelation_m = 30\n")


MAP_FREE = CITY + "[radio]\nbelief = 'buildings'\n"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (BASE + "[radio]\nbelief = 'buildings'\n", "radio.belief = 'buildings' needs area.buildin"),
        (
            BASE + "[radio]\nbelief = 'map'\n",
            "radio.map_file or .scene, and 'map' as radio.truth, .belief or .prior, need",
        ),
        (
            BASE + "[radio]\nbelief = 'learned'\nprior = 'buildings'\n",
            "radio.prior = 'buildings' needs area.buildings",
        ),
        (
            MAP_FREE + "prior = 'buildings'\n",
            "radio.prior is of a belief that listens: radio.belief = 'learned', or your own, not "
            "'buildings'",
        ),
        (MAP_FREE + "pilots = 'all'\n", "radio.pilots is of a belief that listens: radio.belief ="),
        (
            BASE + "[radio]\nbelief = 'guess'\n",
            "belief = 'guess': must be one of 'channel', ",
        ),
        (
            BASE + "[radio]\npilots = 'some'\n",
            "pilots = 'some': must be 'all' or 'scheduled'",
        ),
        (
            BASE + "[radio]\nbelief = 'examples.mean_gain:make'\n",
            "'examples.mean_gain:make' is learned from the SNR of places: radio.truth must be",
        ),
        (
            BASE + "[radio]\nbelief = 'learned'\n",
            "radio.truth must be 'buildings' or 'map', not 'channel'",
        ),
        (MAP_FREE + "[planner]\nkind = 'paper'\n", "'paper' knows distances only: radio.belief"),
        (
            MAP_FREE + "[mission]\naltitude_m = [50, 70]\n",
            "one height: give one mission.alt",
        ),
    ],
)
def test_what_cannot_be_believed_is_refused(load, text: str, why: str) -> None:
    with pytest.raises(InputError, match=re.escape(why)):
        load(text)


def test_keys_that_contradict_each_other_name_who_set_one_of_them(load) -> None:
    with pytest.raises(
        InputError, match=r"^command line: radio\.belief = 'learned' is learned from"
    ):
        load(radio__belief="learned")
