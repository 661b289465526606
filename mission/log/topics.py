"""The topics of a flight log and their schemas.

Whatever has a well-known Foxglove schema uses it (protobuf); records of our own are small JSON
objects with a JSON schema that says the unit of every number. NaN is written as null.
"""

import json
from dataclasses import dataclass
from typing import Any

from foxglove import messages as fox

from mission.base.tables import columns
from mission.log.records import Kind, RoundRecord, UplinkRecord
from mission.log.values import BatteryTrack, Devices, EventRecord, LearningRecord, PlanRecord

FORMAT_VERSION = "1"
FRAME = "area"  # x east, y north from the area's south-west corner; z height above home
BODY_FRAME = "aircraft"  # x forward, y left, z up


@dataclass(frozen=True, slots=True, eq=False)  # each is one of a kind
class Topic:
    """One channel of the log."""

    name: str
    schema_name: str
    schema_encoding: str
    schema: bytes
    encoding: str
    description: str


def _foxglove(name: str, message: Any, description: str) -> Topic:
    schema = message.get_schema()
    return Topic(name, schema.name, schema.encoding, bytes(schema.data), "protobuf", description)


def _json(name: str, title: str, description: str, **properties: tuple[str, str]) -> Topic:
    """A topic of records. Lichtblick and Foxglove Studio refuse one whose `properties` are more
    than plain values and lists of them; what patterns say they leave alone, and plot all the same.
    """
    described = {
        key: {**_TYPES[kind], "description": text} for key, (kind, text) in properties.items()
    }
    plain = {key for key, (kind, _) in properties.items() if kind in _PLAIN}
    schema = {
        "title": title,
        "description": description,
        "type": "object",
        "properties": {key: value for key, value in described.items() if key in plain},
        "patternProperties": {
            f"^{key}$": value for key, value in described.items() if key not in plain
        },
        "required": list(described),
    }
    data = json.dumps(schema, separators=(",", ":")).encode()
    return Topic(name, title, "jsonschema", data, "json", description)


def _declared(record: type) -> dict[str, tuple[str, str]]:
    """The columns of a record that have words, and how they are written."""
    found: dict[str, tuple[str, str]] = {}
    for column in columns(record):
        words, kind = column.find(str), column.find(Kind)
        if words is not None:
            found[column.name] = (kind.name if kind else _PLAIN_TYPES[column.holds], words)
    return found


def fields(schema: bytes) -> dict[str, dict[str, Any]]:
    """What one of our JSON schemas says of each field, in the order in which they are written."""
    told = json.loads(schema)
    named = told["properties"] | {
        pattern.strip("^$"): value for pattern, value in told["patternProperties"].items()
    }
    return {key: named[key] for key in told["required"]}


_NUMBERS: dict[str, object] = {"type": "array", "items": {"type": "number"}}
_TYPES: dict[str, dict[str, object]] = {
    "integer": {"type": "integer"},
    "number": {"type": "number"},
    "boolean": {"type": "boolean"},
    "string": {"type": "string"},
    "numbers": _NUMBERS,
    "strings": {"type": "array", "items": {"type": "string"}},
    "maybe": {"type": ["number", "null"]},
    "pairs": {"type": "array", "items": _NUMBERS},
    "outlines": {"type": "array", "items": {"type": "array", "items": _NUMBERS}},
    "innovation": {
        "type": ["object", "null"],
        "properties": {
            "values": {**_NUMBERS, "description": "measured less predicted"},
            "stds": {**_NUMBERS, "description": "standard deviations expected of the values"},
            "ratio": {"type": "number", "description": "size; refused from 1 on"},
            "accepted": {"type": "boolean", "description": "whether it was used"},
        },
    },
    "by_community": {"type": "object", "additionalProperties": {"type": "number"}},
}
_PLAIN_TYPES: dict[object, str] = {int: "integer", float: "number", bool: "boolean", str: "string"}
_PLAIN = frozenset({"boolean", "integer", "number", "string", "numbers", "strings"})

TF = _foxglove(
    "/tf", fox.FrameTransform, "frame `area` to `aircraft` (x forward, y left, z up); 5 Hz"
)
TRUE_POSE = _foxglove(
    "/true/pose", fox.PoseInFrame, "where the aircraft is; 10 Hz, under a firmware 20 Hz"
)
EST_POSE = _foxglove("/est/pose", fox.PoseInFrame, "where the autopilot believes it is; 10 Hz")
TRUE_VELOCITY = _foxglove("/true/velocity", fox.Vector3, "east, north, up in m/s; 2 Hz")
EST_VELOCITY = _foxglove("/est/velocity", fox.Vector3, "the same as believed; 2 Hz")
COMMAND = _foxglove("/cmd/position", fox.Point3InFrame, "where the guidance wants to be; 1 Hz")
TRUE_LOCATION = _foxglove(
    "/true/location", fox.LocationFix, "where the aircraft is, on the globe; 1 Hz"
)
GNSS = _foxglove(
    "/gnss",
    fox.LocationFix,
    "the receiver's solutions, stamped with the instant that they describe",
)
PLAN_PATH = _foxglove("/plan/path", fox.PosesInFrame, "a round's planned polyline")
FLOWN_PATH = _foxglove(
    "/flown/path",
    fox.PosesInFrame,
    "the round's true track so far; every 5 s or 5 % of it, and at the end",
)
PLAN_MAP = _foxglove("/plan/map", fox.GeoJson, "devices, planned path and fence, for the map panel")
SCENE_GROUND = _foxglove(
    "/scene/ground", fox.SceneUpdate, "edge of the area, take-off point, fence"
)
SCENE_DEVICES = _foxglove(
    "/scene/devices", fox.SceneUpdate, "devices; colour: community, size: importance"
)
SCENE_LINKS = _foxglove(
    "/scene/links", fox.SceneUpdate, "transmissions; colour: true PER, thin: lost"
)
LOG = _foxglove("/log", fox.Log, "events as lines for people")

DEVICES = _json(
    "/devices",
    "aerofed.Devices",
    "The ground devices; written at the start and with every plan",
    **_declared(Devices),
)
PLAN = _json(
    "/plan",
    "aerofed.Plan",
    "A round's plan, at the instant the round starts",
    **_declared(PlanRecord),
)
ROUNDS = _json(
    "/rounds",
    "aerofed.Round",
    "One round, when it has ended: the row of rounds.csv",
    **_declared(RoundRecord),
)
UPLINKS = _json(
    "/uplinks",
    "aerofed.Uplink",
    "One scheduled device of one round, at its transmission: the row of uplinks.csv",
    **_declared(UplinkRecord),
)
LEARNING = _json(
    "/learning",
    "aerofed.Learning",
    "Accuracy and fairness of one community after a round",
    **_declared(LearningRecord),
)
BATTERY = _json("/battery", "aerofed.Battery", "The battery", **_declared(BatteryTrack))
MODE = _json(
    "/mode",
    "aerofed.Mode",
    "Flight mode, whenever it changes",
    mode=("string", "name of the mode"),
    armed=("boolean", "motors enabled"),
)
EVENTS = _json(
    "/events",
    "aerofed.Event",
    "Something that happened, with truth and belief of that instant",
    **_declared(EventRecord),
)

TRUE_WIND = _foxglove(
    "/true/wind", fox.Vector3, "velocity of the air at the aircraft, east, north, up in m/s; 1 Hz"
)
# By what the estimator calls its sensors; the unit of each.
SENSORS: dict[str, str] = {
    "gnss position": "metres north, east, down",
    "gnss velocity": "m/s north, east, down",
    "baro": "metres of height",
    "heading": "radians",
}
INNOVATIONS = _json(
    "/innovations",
    "aerofed.Innovations",
    "Measurements against the estimator's predictions of them, once a second, and all that were "
    "refused: for each sensor `values` (measured less predicted), `stds` (their expected standard "
    "deviations), `ratio` (size divided by the largest that is accepted) and `accepted`",
    t_s=("number", "the instant that the estimator was at; behind the log's by its delay"),
    **{
        kind.replace(" ", "_"): ("innovation", f"{unit}; null where not measured then")
        for kind, unit in SENSORS.items()
    },
)

FENCE = _json(
    "/fence",
    "aerofed.Fence",
    "The fence that the vehicle was given, where it was given one; written at the start and with "
    "every plan",
    keep_in_m=("outlines", "corners [x, y] of each area to keep to, area coordinates"),
    keep_out_m=("outlines", "corners [x, y] of each area to keep out of"),
)

TOPICS: tuple[Topic, ...] = (
    *(TF, TRUE_POSE, EST_POSE, TRUE_VELOCITY, EST_VELOCITY, COMMAND, TRUE_LOCATION, GNSS),
    *(PLAN_PATH, FLOWN_PATH, PLAN_MAP, SCENE_GROUND, SCENE_DEVICES, SCENE_LINKS, LOG),
    *(DEVICES, PLAN, ROUNDS, UPLINKS, LEARNING, BATTERY, MODE, EVENTS),
    *(TRUE_WIND, INNOVATIONS, FENCE),
)
