"""The layout inside a log: every topic and message path of theirs is in that log's schemas."""

import dataclasses
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
import pytest
from foxglove import layouts as sdk
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory
from synthetic_flight import AREA, Fixed, fly

from mission.base.area import Area
from mission.log.reader import read_log
from mission.log.scene import LAYOUT, layout
from mission.log.topics import fields

NUMBERS = frozenset({FieldDescriptor.TYPE_DOUBLE, FieldDescriptor.TYPE_FLOAT})
PATH = re.compile(r'(?P<topic>/[a-z_/]+)(?:\{(?P<key>\w+)=="(?P<value>[^"]+)"\})?\.(?P<field>.+)')


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Fixed:
    return fly(tmp_path_factory.mktemp("run"), rounds=2)


@pytest.fixture(scope="module")
def ours(made: Fixed) -> Any:
    return json.loads(read_log(made.log).attachments[LAYOUT])


def panels(content: dict[str, Any]) -> Iterator[dict[str, Any]]:
    if content["type"] == "panel":
        yield content
    for item in content.get("items", ()):
        yield from panels(item["content"])


def topics_and_paths(configs: list[dict[str, Any]]) -> tuple[set[str], set[str]]:
    topics: set[str] = set()
    paths: set[str] = set()
    for config in configs:
        topics |= set(config.get("topics", {})) | set(config.get("topicColors", {}))
        topics |= {config[k] for k in ("followTopic", "topicToRender") if k in config}
        paths |= {series["value"] for series in config.get("paths", ())}
    return topics, paths


def schemas(path: Path) -> dict[str, tuple[Schema, list[bytes]]]:
    """By topic, of the topics that have messages."""
    found: dict[str, tuple[Schema, list[bytes]]] = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            found.setdefault(channel.topic, (schema, []))[1].append(message.data)
    return found


def is_shown(schema: Schema, example: bytes, field: str) -> bool:
    """Whether a dotted field leads to what its panel shows, by the schema that is in the file:
    numbers, of modes their names."""
    if schema.encoding == "jsonschema":
        first, *way = field.split(".")
        node = fields(schema.data)[first]
        for name in way:
            node = node["properties"][name]
        return "number" in node["type"] or (schema.name, node["type"]) == ("aerofed.Mode", "string")
    decode = DecoderFactory().decoder_for("protobuf", schema)
    assert decode is not None
    kind: Descriptor = decode(example).DESCRIPTOR
    *way, last = field.split(".")
    for name in way:
        kind = kind.fields_by_name[name].message_type
    return kind.fields_by_name[last].type in NUMBERS


def test_topics_and_message_paths_are_in_the_log(made: Fixed, ours: Any) -> None:
    there = schemas(made.log)
    configs = [panel["config"] for panel in panels(ours["content"])]
    topics, paths = topics_and_paths(configs)
    assert len(topics) >= 10
    assert topics <= set(there)
    assert len(paths) >= 14
    for path in paths:
        match = PATH.fullmatch(path)
        assert match, path
        schema, examples = there[match["topic"]]
        assert is_shown(schema, examples[0], match["field"]), path
        if match["key"]:
            assert any(json.loads(e)[match["key"]] == match["value"] for e in examples), path


def test_every_panel_is_one_that_the_viewers_have(ours: Any) -> None:
    for panel in panels(ours["content"]):
        assert hasattr(sdk, f"{panel['panelType']}Panel")


def test_no_frame_draws_a_line_to_the_aircraft(ours: Any) -> None:
    """There is no switch for all frames, only one for each."""
    hidden = {"visible": False}
    configs = [panel["config"] for panel in panels(ours["content"])]
    (scene,) = (config for config in configs if "cameraState" in config)
    assert scene["transforms"] == {"frame:area": hidden, "frame:aircraft": hidden}


def test_devices_are_discs_on_the_map_where_they_stand(made: Fixed) -> None:
    """A disc: leaflet makes a pin of a point, whatever its style."""
    schema, (first, *_) = schemas(made.log)["/plan/map"]
    decode = DecoderFactory().decoder_for("protobuf", schema)
    assert decode is not None
    features = json.loads(decode(first).geojson)["features"]
    discs = [
        f["geometry"]["coordinates"][0] for f in features if f["geometry"]["type"] == "Polygon"
    ]
    home = AREA.home
    sizes_m = []
    for ring, place_m in zip(discs, made.world.pos_m, strict=True):
        lon, lat = np.array(ring).T
        east, north, _ = pymap3d.geodetic2enu(
            lat, lon, home.alt_msl_m, home.lat_deg, home.lon_deg, home.alt_msl_m
        )
        corners_m = np.column_stack((east, north)) + AREA.home_m
        assert ring[0] == ring[-1]
        from_middle_m = np.linalg.norm(corners_m - place_m, axis=1)
        np.testing.assert_allclose(from_middle_m, from_middle_m[0], atol=0.02)
        sizes_m.append(2 * from_middle_m[0])
    order = np.argsort(made.problems[0].importance)
    assert (np.diff(np.array(sizes_m)[order]) >= -0.05).all()
    assert max(sizes_m) == pytest.approx(22.0, abs=0.05)


@pytest.mark.parametrize("home", [(0.5, 0.5), (0.0, 0.25), (1.0, 1.0)])
@pytest.mark.parametrize("side_m", [150.0, 800.0, 30_000.0])
@pytest.mark.parametrize("lat_deg", [-10.0, 47.4, 69.0])
def test_the_map_about_home_shows_the_whole_area_and_little_more(
    home: tuple[float, float], side_m: float, lat_deg: float
) -> None:
    area = Area.at(
        size_m=(side_m, side_m),
        home_m=(home[0] * side_m, home[1] * side_m),
        home=dataclasses.replace(AREA.home, lat_deg=lat_deg),
    )
    (config,) = (
        panel["config"]
        for panel in panels(json.loads(layout(area, ["digits"]))["content"])
        if panel["panelType"] == "Map"
    )
    # Slippy map, web mercator: 2^zoom tiles of 256 pixels around the world.
    metres_a_pixel = 156_543.034 * math.cos(math.radians(lat_deg)) / 2 ** config["zoomLevel"]
    reach_m = max(max(home), 1 - min(home)) * side_m
    assert 75 < reach_m / metres_a_pixel <= 150.1
    assert "followTopic" not in config


def test_a_flight_of_a_plan_file_has_no_empty_panels_of_learning() -> None:
    def topics_of(communities: list[str]) -> set[str]:
        shown = panels(json.loads(layout(AREA, communities))["content"])
        _, paths = topics_and_paths([panel["config"] for panel in shown])
        return {re.split(r"[.{]", path)[0] for path in paths}

    assert topics_of(["digits"]) - topics_of([]) == {"/learning", "/uplinks"}


@pytest.mark.parametrize(("side_m", "zoom"), [(1e8, 0), (1e-3, 19)])
def test_a_map_has_the_zooms_that_maps_have(side_m: float, zoom: int) -> None:
    area = Area.at(size_m=(side_m, side_m), home_m=(0.0, 0.0), home=AREA.home)
    (config,) = (
        panel["config"]
        for panel in panels(json.loads(layout(area, ["digits"]))["content"])
        if panel["panelType"] == "Map"
    )
    assert config["zoomLevel"] == zoom


def test_the_scene_is_seen_from_above_the_middle_of_the_area() -> None:
    area = Area.at((600.0, 400.0), (0.0, 0.0), AREA.home)
    shown = list(panels(json.loads(layout(area, ["a", "b"]))["content"]))
    (camera,) = (p["config"]["cameraState"] for p in shown if "cameraState" in p["config"])
    assert camera["targetOffset"] == [300.0, 200.0, 0.0]
    assert 600.0 < camera["distance"] < 900.0  # the longer side, and a little around
    assert camera["far"] > 10 * camera["distance"]
    paths = [p["config"].get("paths", []) for p in shown]
    learnt = [path for each in paths for path in each if "/learning" in path["value"]]
    assert [path["label"] for path in learnt] == ["a", "b"]
    assert len({path["color"] for path in learnt}) == 2
    without = list(panels(json.loads(layout(area, []))["content"]))
    assert len(without) == len(shown) - 2
