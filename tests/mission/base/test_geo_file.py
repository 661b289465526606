"""Places and areas out of files: every border of what is taken, and what is said beyond it."""

import json
from pathlib import Path
from typing import Any

import pytest

from mission.base.errors import InputError
from mission.base.geo_file import Place, Ring, read_buildings, read_places, read_rings


def table(path: Path, text: str) -> tuple[Place, ...]:
    (path / "x.csv").write_text(text)
    return read_places(path / "x.csv")


def geojson(path: Path, *features: Any) -> Path:
    document = {"type": "FeatureCollection", "features": list(features)}
    (path / "x.geojson").write_text(json.dumps(document))
    return path / "x.geojson"


def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def test_a_table_has_metres_or_degrees_communities_and_shares(tmp_path: Path) -> None:
    found = table(tmp_path, " X , y,community,Share\n1,-2.5,a,2\n\n , , ,\n3,4,,\n")
    assert [(p.at, p.geodetic, p.community, p.share) for p in found] == [
        ((1.0, -2.5), False, "a", 2.0), ((3.0, 4.0), False, None, None),
    ]  # fmt: skip
    assert [p.where for p in found] == [f"{tmp_path}/x.csv: row {n}" for n in (2, 5)]
    for head in ("lat,lon", "lat_deg,lon_deg", "latitude,lng", "lat,longitude"):
        (place,) = table(tmp_path, f"{head}\n47,8\n")
        assert (place.at, place.geodetic) == ((47.0, 8.0), True)
    (place,) = table(tmp_path, "lon,x_m,lat,y_m\n8,1,47,2\n".replace("lon,", "of,"))
    assert (place.at, place.geodetic) == ((1.0, 2.0), False)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,y\n100000,-100000\n", ""),
        ("x,y\n0,100000.1\n", "y = 100000: must be from -100000 to 100000 m"),
        ("lat,lon\n-85,180\n", ""),
        ("lat,lon\n85.1,8\n", "85.1: must be from -85 to 85 degrees; are lat and lon swapped"),
        ("lat,lon\n180,85\n", "swapped"),
        ("lat,lon\n180.5,85\n", "lat = 180.5: must be from -85 to 85 degrees$"),
        ("lat,lon\n100,85.1\n", "lat = 100: must be from -85 to 85 degrees$"),
        ("lat,lon\n8,180.1\n", "lon = 180.1: must be from -180 to 180 degrees$"),
        ("x,y,share\n1,1,1000000\n", ""),
        ("x,y,share\n1,1,1000001\n", "must be above 0 and at most 1000000"),
        ("x,y,share\n1,1,0\n", "share = 0: must be above 0"),
        ("x,y,share\n1,1,1e-9\n", ""),
        ("x,y\n1,nan\n", "row 2: y = 'nan': must be a number"),
        ("x,y\n1,2,3\n", "row 2: has 3 cells, the header has 2"),
        ("x,y,x\n1,2,3\n", "the column x is there twice"),
        ("x,y,,\n1,2,,\n", ""),
        ("x,y,lat,lon\n1,2,3,4\n", "has metres and degrees"),
        ("x,lon\n1,2\n", "row 1: the columns are x, lon; there must be x and y"),
        ("x;y\n1;2\n", "the columns are x;y; commas separate columns; there must be"),
        ("x;y,b\n1;2,3\n", "the columns are x;y, b; there must be"),
        (" \n", "has no names of columns"),
        ("x,y\n", "holds no device"),
    ],
)  # fmt: skip
def test_a_row_is_taken_up_to_its_limits(tmp_path: Path, text: str, words: str) -> None:
    if words:
        with pytest.raises(InputError, match=words.replace("(", r"\(")):
            table(tmp_path, text)
    else:
        assert len(table(tmp_path, text)) == 1


@pytest.mark.parametrize(
    ("coordinates", "words"),
    [
        ([8, 47], ""), ([8, 47, 400], ""), ([8], "must be .lon, lat."),
        ([8, 47, 1, 2], "must be .lon, lat."), ([True, 47], "lon = true: must be a number|True"),
        (["8", 47], ""), ([8, None], "lat = "), ([47, 88], "lat = 88: .*swapped"), (5, "must be"),
    ],
)  # fmt: skip
def test_a_point_is_longitude_and_latitude(tmp_path: Path, coordinates: Any, words: str) -> None:
    path = geojson(tmp_path, feature("Point", coordinates, community="a", share=3))
    if words:
        with pytest.raises(InputError, match=words):
            read_places(path)
    else:
        (place,) = read_places(path)
        assert (place.at, place.geodetic) == ((47.0, 8.0), True)
        assert (place.community, place.share) == ("a", 3.0)
        assert place.where == f"{path}: features[0]"


def ring(corners: int, east: float = 0.0) -> list[list[float]]:
    there = [[east + 1e-4 * n, 47.0 + 1e-8 * n * n] for n in range(corners)]
    return [*there, there[0]]


@pytest.mark.parametrize(
    ("corners", "words"),
    [(3, ""), (500, ""), (501, "a ring of 502 positions: an area has 500 corners at most"),
     (2, "a ring of 3 positions: there must be 4 at least")],
)  # fmt: skip
def test_an_outline_is_closed_and_has_its_corners_once(
    tmp_path: Path, corners: int, words: str
) -> None:
    path = geojson(tmp_path, feature("Polygon", [ring(corners)]))
    if words:
        with pytest.raises(InputError, match=words):
            read_rings(path)
    else:
        (found,) = read_rings(path)
        assert len(found.corners_deg) == corners
        assert found.corners_deg[1] == pytest.approx((47.0 + 1e-8, 1e-4))
        assert found.holes_deg == ()
    open_ = geojson(tmp_path, feature("Polygon", [[*ring(4)[:-1], [0.5, 47.0]]]))
    with pytest.raises(InputError, match="the last the same as the first"):
        read_rings(open_)


def test_several_polygons_are_as_many_outlines_and_only_buildings_have_holes(
    tmp_path: Path,
) -> None:
    both = [[ring(3), ring(3, 1.0)], [ring(4, 2.0)]]
    path = geojson(tmp_path, feature("MultiPolygon", both, building="yes", height="7"))
    rings, skipped = read_buildings(path)
    assert [(len(r.corners_deg), len(r.holes_deg)) for r in rings] == [(3, 1), (4, 0)]
    assert skipped == 0
    assert rings[1].properties["height"] == "7"
    with pytest.raises(InputError, match=r"has 1 hole: an area must have none"):
        read_rings(path)
    three = geojson(tmp_path, feature("Polygon", [ring(3), ring(3, 1), ring(3, 2)]))
    with pytest.raises(InputError, match=r"has 2 holes"):
        read_rings(three)
    wrong: list[Any] = [[], [5], 5, [[]]]
    for nothing in wrong:
        with pytest.raises(InputError):
            read_rings(geojson(tmp_path, feature("Polygon", nothing)))


@pytest.mark.parametrize(
    ("properties", "is_one"),
    [
        ({"building": "yes"}, True), ({"building": "no"}, False), ({"building:part": "yes"}, True),
        ({"building": "no", "building:part": "yes"}, True), ({"height": 5}, True),
        ({"building": "no", "height": 5}, False), ({"building:levels": "2"}, True),
        ({"building": None}, False), ({"building": None, "height": 5}, True), ({}, False),
        ({"natural": "wood"}, False), ({"building:part": "no"}, False),
    ],
)  # fmt: skip
def test_a_building_says_that_it_is_one(
    tmp_path: Path, properties: dict[str, Any], is_one: bool
) -> None:
    sure = feature("Polygon", [ring(3)], building="hall")
    other = feature("Polygon", [ring(4)], **properties)
    path = geojson(tmp_path, sure, other, feature("Point", [8, 47], building="yes"))
    rings, skipped = read_buildings(path)
    assert (len(rings), skipped) == (1 + is_one, 2 - is_one)
    if not is_one:
        with pytest.raises(InputError, match="holds no building"):
            read_buildings(geojson(tmp_path, other))


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ([], "not GeoJSON"), ({}, "not GeoJSON"),
        ({"type": "FeatureCollection", "features": 5}, "features = 5: must be a list"),
        ({"type": "FeatureCollection", "features": [5]}, r"features\[0\]: no Feature with"),
        ({"type": "Feature", "geometry": None}, r"x\.geojson: no Feature with a geometry"),
        ({"type": "FeatureCollection", "features": []}, "holds no area"),
        ({"type": "Point", "coordinates": [8, 47]}, "must be 'Polygon' or 'MultiPolygon'"),
    ],
)  # fmt: skip
def test_what_is_no_collection_of_areas_is_said(tmp_path: Path, document: Any, words: str) -> None:
    path = tmp_path / "x.geojson"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=words):
        read_rings(path)


def test_a_geometry_may_stand_alone(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    for whole in (feature("Polygon", [ring(3)]), feature("Polygon", [ring(3)])["geometry"]):
        path.write_text(json.dumps(whole))
        (found,) = read_rings(path)
        assert isinstance(found, Ring)
        assert found.where == str(path)
    path.write_text(json.dumps(feature("LineString", [[8, 47]])))
    with pytest.raises(InputError, match="must be 'Point', one a device"):
        read_places(path)
    path.write_text(json.dumps(feature("Point", [8, 47], community=5)))
    with pytest.raises(InputError, match="community = 5: must be text"):
        read_places(path)
    with pytest.raises(InputError, match=r"must end in \.csv"):
        read_places(tmp_path / "x.txt")
