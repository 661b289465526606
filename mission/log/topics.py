"""The topics of a flight log and their schemas.

Whatever has a well-known Foxglove schema uses it (protobuf); records of our own are small JSON
objects with a JSON schema that says the unit of every number. NaN is written as null.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from foxglove import messages as fox

from mission.log import control
from mission.log.records import RoundRecord, UplinkRecord, described
from mission.log.values import (
    BatteryTrack,
    Devices,
    EventRecord,
    FenceRecord,
    InnovationsRecord,
    LearningRecord,
    MissionRecord,
    ModeRecord,
    PlanRecord,
    SetpointRecord,
)

FORMAT_VERSION = "2"
# Names by REP 105, https://www.ros.org/reps/rep-0105.html
FRAME = "map"  # x east, y north from the area's south-west corner; z height above home
BODY_FRAME = "base_link"  # x forward, y left, z up


@dataclass(frozen=True, slots=True, eq=False)  # each is one of a kind
class Topic:
    """One topic of the log: its channel's name, schema, encoding and description."""

    name: str
    schema_name: str
    schema_encoding: str
    schema: bytes
    encoding: str
    description: str
    latched: bool = False  # who looks on live gets the latest at once


def _foxglove(name: str, message: Any, description: str, *, latched: bool = False) -> Topic:
    schema = message.get_schema()
    data = bytes(schema.data)
    return Topic(name, schema.name, schema.encoding, data, "protobuf", description, latched)


def _json(name: str, title: str, record: type, *, latched: bool = False) -> Topic:
    """Return a topic of JSON records. Fields that are more than plain values or lists of them go to
    `patternProperties`: Lichtblick and Foxglove Studio refuse them in `properties`, but plot them
    all the same."""
    description = " ".join((record.__doc__ or "").split()).removesuffix(".")
    properties = {
        key: {**kind.schema, "description": text} for key, kind, text in described(record)
    }
    plain = {key for key, field in properties.items() if _is_plain(field)}
    schema = {
        "title": title,
        "description": description,
        "type": "object",
        "properties": {key: value for key, value in properties.items() if key in plain},
        "patternProperties": {
            f"^{key}$": value for key, value in properties.items() if key not in plain
        },
        "required": list(properties),
    }
    data = json.dumps(schema, separators=(",", ":")).encode()
    return Topic(name, title, "jsonschema", data, "json", description, latched)


@cache
def of_vehicle(topic: Topic, name: str) -> Topic:
    """Return the topic of one of several vehicles: `/north/true/pose`; what is of all, as it is."""
    return topic if topic in OF_ALL else replace(topic, name=f"/{name}{topic.name}")


def _is_plain(field: Mapping[str, Any]) -> bool:
    kind = field["items"]["type"] if field["type"] == "array" else field["type"]
    return kind in ("boolean", "integer", "number", "string")


def fields(schema: bytes) -> dict[str, dict[str, Any]]:
    """Return the property schema of each field of one of our JSON schemas, in writing order."""
    told = json.loads(schema)
    named = told["properties"] | {
        pattern.strip("^$"): value for pattern, value in told["patternProperties"].items()
    }
    return {key: named[key] for key in told["required"]}


TF = _foxglove(
    "/tf", fox.FrameTransform, f"frame `{FRAME}` to `{BODY_FRAME}` (x forward, y left, z up); 2 Hz"
)
TRUE_POSE = _foxglove(
    "/true/pose", fox.PoseInFrame, "where the aircraft is; 10 Hz, under a firmware 20 Hz"
)
EST_POSE = _foxglove("/est/pose", fox.PoseInFrame, "where the autopilot believes it is; 10, 20 Hz")
TRUE_VELOCITY = _foxglove("/true/velocity", fox.Vector3, "east, north, up in m/s; 2 Hz")
EST_VELOCITY = _foxglove("/est/velocity", fox.Vector3, "the same as believed; 2 Hz")
TRUE_LOCATION = _foxglove(
    "/true/location", fox.LocationFix, "where the aircraft is, on the globe; 1 Hz"
)
GNSS = _foxglove(
    "/gnss",
    fox.LocationFix,
    "the receiver's solutions, stamped with the instant that they describe",
)
PLAN_PATH = _foxglove("/plan/path", fox.PosesInFrame, "a round's planned polyline", latched=True)
FLOWN_PATH = _foxglove(
    "/flown/path",
    fox.PosesInFrame,
    "the round's true track so far; every 5 s or 5 % of it, and at the end",
)
PLAN_MAP = _foxglove(
    "/plan/map", fox.GeoJson, "devices, planned path and fence, for the map panel", latched=True
)
SCENE_GROUND = _foxglove(
    "/scene/ground", fox.SceneUpdate, "edge of the area, take-off point, fence", latched=True
)
SCENE_BUILDINGS = _foxglove(
    "/scene/buildings", fox.SceneUpdate, "what stands in the area, once", latched=True
)
SCENE_DEVICES = _foxglove(
    "/scene/devices", fox.SceneUpdate, "devices; colour: community, size: importance", latched=True
)
SCENE_LINKS = _foxglove(
    "/scene/links", fox.SceneUpdate, "transmissions; colour: true PER, thin: lost"
)
RADIO_BELIEVED = _foxglove(
    "/radio/believed",
    fox.Grid,
    "success of each device's packets by place, 255 for 1, 81 places a side at most: "
    "what a round is planned with, where that is not the channel and another than before",
    latched=True,
)
RADIO_TRUE = _foxglove(
    "/radio/true", fox.Grid, "the same as it is, once, where the belief is not it", latched=True
)
LOG = _foxglove("/log", fox.Log, "events as lines for people")

DEVICES = _json("/devices", "aerofed.Devices", Devices, latched=True)
PLAN = _json("/plan", "aerofed.Plan", PlanRecord, latched=True)
ROUNDS = _json("/rounds", "aerofed.Round", RoundRecord, latched=True)
UPLINKS = _json("/uplinks", "aerofed.Uplink", UplinkRecord)
LEARNING = _json("/learning", "aerofed.Learning", LearningRecord, latched=True)
BATTERY = _json("/battery", "aerofed.Battery", BatteryTrack)
MODE = _json("/mode", "aerofed.Mode", ModeRecord, latched=True)
EVENTS = _json("/events", "aerofed.Event", EventRecord)
TRUE_WIND = _foxglove(
    "/true/wind", fox.Vector3, "velocity of the air at the aircraft, east, north, up in m/s; 1 Hz"
)
CONTROL = Topic(
    *("/control", control.NAME, "protobuf", control.schema(), "protobuf"),
    "what the control believed and ordered while armed: `vehicle.control_rate_hz`, 50 Hz",
)
INNOVATIONS = _json("/innovations", "aerofed.Innovations", InnovationsRecord)
FENCE = _json("/fence", "aerofed.Fence", FenceRecord, latched=True)
MISSION = _json("/mission", "aerofed.Mission", MissionRecord, latched=True)
SETPOINT = _json("/setpoint", "aerofed.Setpoint", SetpointRecord)

# Of several vehicles alike: the place, the devices, the radio, what was learnt.
OF_ALL = frozenset({
    SCENE_BUILDINGS, SCENE_DEVICES, DEVICES, FENCE, RADIO_BELIEVED, RADIO_TRUE, LEARNING,
})  # fmt: skip
TOPICS = tuple(topic for topic in list(globals().values()) if isinstance(topic, Topic))
