"""The layouts inside a log: every topic and message path of theirs is in that log's schemas."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from foxglove import layouts as sdk
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory
from synthetic_flight import Fixed, fly

from mission.log.layout import ATTACHMENT
from mission.log.reader import read_log

NUMBERS = frozenset({FieldDescriptor.TYPE_DOUBLE, FieldDescriptor.TYPE_FLOAT})
PATH = re.compile(r'(?P<topic>/[a-z_/]+)(?:\{(?P<key>\w+)=="(?P<value>[^"]+)"\})?\.(?P<field>.+)')


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Fixed:
    return fly(tmp_path_factory.mktemp("run"), rounds=2)


@pytest.fixture(scope="module")
def layouts(made: Fixed) -> tuple[dict[str, Any], dict[str, Any]]:
    found = read_log(made.log).attachments
    return json.loads(found[ATTACHMENT]), json.loads(found["lichtblick-layout.json"])


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


def is_number(schema: Schema, example: bytes, field: str) -> bool:
    """Whether a dotted field leads to a number, by the schema that is in the file."""
    if schema.encoding == "jsonschema":
        node = json.loads(schema.data)
        for name in field.split("."):
            node = node["properties"][name]
        return "number" in node["type"] or "integer" in node["type"]
    decode = DecoderFactory().decoder_for("protobuf", schema)
    assert decode is not None
    kind: Descriptor = decode(example).DESCRIPTOR
    *way, last = field.split(".")
    for name in way:
        kind = kind.fields_by_name[name].message_type
    return kind.fields_by_name[last].type in NUMBERS


def test_topics_and_message_paths_are_in_the_log(
    made: Fixed, layouts: tuple[dict[str, Any], dict[str, Any]]
) -> None:
    ours, classic = layouts
    there = schemas(made.log)
    configs = [panel["config"] for panel in panels(ours["content"])]
    topics, paths = topics_and_paths(configs)
    assert topics_and_paths(list(classic["configById"].values())) == (topics, paths)
    assert len(topics) >= 10
    assert topics <= set(there)
    assert len(paths) >= 14
    for path in paths:
        match = PATH.fullmatch(path)
        assert match, path
        schema, examples = there[match["topic"]]
        assert is_number(schema, examples[0], match["field"]), path
        if match["key"]:
            assert any(json.loads(e)[match["key"]] == match["value"] for e in examples), path


def test_every_panel_is_one_that_the_viewers_have(
    layouts: tuple[dict[str, Any], dict[str, Any]],
) -> None:
    ours, classic = layouts
    for panel in panels(ours["content"]):
        assert hasattr(sdk, f"{panel['panelType']}Panel")
    # What Lichtblick asks of a file that it imports, and the names of its panels.
    assert set(classic) == {
        "configById", "globalVariables", "userNodes", "playbackConfig", "layout",
    }  # fmt: skip
    assert classic["playbackConfig"]["speed"] == 1
    kinds = {name.split("!")[0] for name in classic["configById"]}
    assert kinds == {"3D", "map", "Plot", "RosOut"}


def test_the_classic_tree_holds_every_panel_once(
    layouts: tuple[dict[str, Any], dict[str, Any]],
) -> None:
    _, classic = layouts

    def leaves(node: Any) -> list[str]:
        if isinstance(node, str):
            return [node]
        assert set(node) == {"direction", "first", "second", "splitPercentage"}
        assert 0 < node["splitPercentage"] < 100
        return leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(classic["layout"])) == sorted(classic["configById"])
