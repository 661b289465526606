"""Writes docs/configuration.md and docs/file-formats.md from the code.

`--check` writes nothing and fails where a page is not current.
"""

import json
import sys
import types
from pathlib import Path
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from mission.config import RunConfig
from mission.log import topics

CONFIGURATION = """# Configuration

Every key, generated from the code (`python docs/generate.py`). Units stand in the key names:
`_m` metres, `_s` seconds, `_mps` metres a second, `_deg` degrees, `_db` decibels, `_hz` hertz.
A file is TOML; tables are the headings below. Every key can be given on the command line too:
`--set mission.steps=8`, `--set communities.0.devices=4`.
"""

FORMATS = """# What a run leaves

Generated from the code (`python docs/generate.py`). Positions are area coordinates in metres:
x east, y north from the south-west corner; heights are above home. Times are simulated.

| file | what |
|---|---|
| `config.toml` | the resolved configuration; `aerofed run config.toml` flies the same again |
| `devices.csv` | a row a device: community, position, samples, weight p_k, `class:samples` |
| `rounds.csv` | a row a round, see below; `accuracy_NAME` and `cov_NAME` for each community |
| `uplinks.csv` | a row a scheduled device, see below |
| `learning.csv` | round, device, community, its accuracy on its own labels, its local loss |
| `flight.mcap` | the flight log, see below |
| `plans/` | every round as a QGroundControl `.plan`; `aerofed fly` takes it too |
| `summary.json` | how the run ended, versions, data sources, totals, wall seconds by phase |
| `figures/` | maps of planned and flown paths, learning curves |
| `checkpoint/` | what `aerofed run --resume` goes on from; in `interrupted/` the old log and \
tables until the new ones have caught up |

`aerofed fly` leaves `config.toml`, the plan file, `flight.mcap`, `track.csv` (a row a sample: true
and believed position), `figures/` (map; height, error and speed along the plan) and `summary.json`.

CSV files are UTF-8 with a header; numbers are written in their shortest exact form, `nan` where
there is no value. The same configuration and seed give the same bytes.
"""


def main() -> int:
    pages = {
        "configuration.md": CONFIGURATION + "\n".join(section("", RunConfig)) + "\n",
        "file-formats.md": FORMATS + "\n".join(formats()) + "\n",
    }
    stale = 0
    for name, text in pages.items():
        path = Path(__file__).with_name(name)
        if "--check" not in sys.argv[1:]:
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            print(f"{path} is not current: run python docs/generate.py")
            stale = 1
    return stale


def formats() -> list[str]:
    """The tables' columns, then every topic of the log."""
    every = topics.TOPICS
    lines = [
        *("", "## rounds.csv", "", *fields(topics.ROUNDS)),
        *("", "`accuracy` and `cov` are a column a community: `accuracy_digits`, `cov_digits`."),
        *("", "## uplinks.csv", "", *fields(topics.UPLINKS)),
        *("", "## flight.mcap", ""),
        "An MCAP file, for Foxglove, Lichtblick, PlotJuggler, rerun and every MCAP library:",
        "zstd chunks, indexes and statistics, `log_time` in simulated nanoseconds. Topics with a",
        "well-known Foxglove schema are protobuf, our own are JSON with a JSON schema.",
        *("", "| topic | schema | encoding | what |", "|---|---|---|---|"),
        *(
            f"| `{t.name}` | `{t.schema_name or 'none'}` | {t.encoding} | {t.description} |"
            for t in every
        ),
    ]
    for topic in every:
        if topic.encoding == "json" and topic not in (topics.ROUNDS, topics.UPLINKS):
            about = json.loads(topic.schema)["description"]
            lines += ["", f"### {topic.name}", "", f"{about}.", "", *fields(topic)]
    return lines


def fields(topic: topics.Topic) -> list[str]:
    properties = json.loads(topic.schema)["properties"]
    rows = (f"| `{name}` | {item.get('description', '')} |" for name, item in properties.items())
    return ["| column | what |", "|---|---|", *rows]


def section(path: str, model: type[BaseModel]) -> list[str]:
    """The table of one model, then those of the models in it."""
    lines = ["", f"## {path or 'Top level'}", "", (model.__doc__ or "").strip(), ""]
    lines += ["| key | default | allowed | what |", "|---|---|---|---|"]
    inner: list[str] = []
    for name, field in model.model_fields.items():
        key = f"{path}.{name}" if path else name
        models = nested(field.annotation)
        if models:
            for one in models:
                many = get_origin(field.annotation) is tuple
                inner += section(f"{key}[]" if many else key, one)
            continue
        what = (field.description or "").replace("|", "\\|")
        lines.append(f"| `{name}` | {default(field)} | {allowed(field)} | {what} |")
    if lines[-1].startswith("|---"):
        lines = lines[:-2]
    return [*lines, *inner]


def nested(annotation: Any) -> list[type[BaseModel]]:
    """The models in an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in nested(argument)]


def default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined:
        return "required"
    if value is None:
        return "none"
    if isinstance(value, tuple):
        value = list(value)
    return f"`{value}`"


def allowed(field: FieldInfo) -> str:
    """Type and bounds, in words."""
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<=", "pattern": "matching"}
    bounds = []
    for item in field.metadata:
        for name, sign in signs.items():
            bound = getattr(item, name, None)
            if bound is not None:
                bounds.append(f"{sign} `{bound}`")
    return ", ".join([kind(field.annotation), *bounds]).replace("|", "\\|")


def kind(annotation: Any) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (Union, types.UnionType):
        return " or ".join(kind(a) for a in arguments if a is not type(None))
    if hasattr(annotation, "__metadata__"):
        return kind(annotation.__origin__)
    if origin is tuple:
        inner = [a for a in arguments if a is not Ellipsis]
        count = "several" if Ellipsis in arguments else str(len(inner))
        return f"{count} of {kind(inner[0])}"
    if origin is dict:
        return f"table of {kind(arguments[0])} to {kind(arguments[1])}"
    if origin is not None:  # Literal
        return ", ".join(f"`{a}`" for a in arguments)
    names = {float: "number", int: "whole number", str: "text", bool: "true or false", Path: "path"}
    return names.get(annotation, str(annotation))


if __name__ == "__main__":
    sys.exit(main())
