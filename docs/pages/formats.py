"""What a run leaves: files, columns and topics, from the schemas of the log."""

import json
from collections.abc import Iterable

from mission.base.columns import told
from mission.log import topics
from mission.log.records import DeviceRecord

HEAD = """# What a run leaves

Generated from the code (`python docs/generate.py`). Positions are area coordinates in metres:
x east, y north from the south-west corner; heights are above home. Times are simulated.

| file | what |
|---|---|
| `config.toml` | the resolved configuration; `aerofed run config.toml` flies the same again |
| `devices.csv` | a row a device: community, position, samples, weight p_k, `class:samples`, \
configured share; `positions_file` takes it |
| `rounds.csv` | a row a round, see below; `accuracy_NAME` and `cov_NAME` for each community |
| `uplinks.csv` | a row a scheduled device, see below |
| `learning.csv` | a row a device after every round, see below |
| `flight.mcap` | the flight log, see below |
| `plans/` | every round as a QGroundControl `.plan`; `aerofed fly` takes it too |
| `report.html` | the page of the run; `--no-report` leaves it out, `aerofed report` writes it |
| `summary.json` | how the run ended, versions, data sources, totals, wall seconds by phase |
| `figures/` | `map.png`: all rounds on one map; `rounds.png`: who was served from where, \
round by round, at most twelve; `learning.png`: accuracy, fairness and updates |
| `checkpoint/` | what `aerofed run --resume` goes on from; in `interrupted/` the old log and \
tables until the new ones have caught up |

`aerofed fly` leaves `config.toml`, the plan file, `flight.mcap`, `track.csv` (a row a sample: true
and believed position), `figures/` (map; height, distance from the path, speed and error of the
estimate) and `summary.json`.

CSV files are UTF-8 with a header; numbers are written in their shortest exact form, `nan` where
there is no value. The same configuration and seed give the same bytes.
"""


def page() -> str:
    return HEAD + "\n".join(_body()) + "\n"


def _body() -> list[str]:
    """The tables' columns, then every topic of the log."""
    every = topics.TOPICS
    lines = [
        *("", "## rounds.csv", "", *_fields(topics.ROUNDS)),
        *("", "`accuracy` and `cov` are a column a community: `accuracy_digits`, `cov_digits`."),
        *("", "## uplinks.csv", "", *_fields(topics.UPLINKS)),
        *("", "## learning.csv", "", *_columns(DeviceRecord)),
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
            lines += ["", f"### {topic.name}", "", f"{about}.", "", *_fields(topic)]
    return lines


def _fields(topic: topics.Topic) -> list[str]:
    described = topics.fields(topic.schema).items()
    return _table((name, item["description"]) for name, item in described)


def _columns(record: type) -> list[str]:
    return _table(told(record, str))


def _table(rows: Iterable[tuple[str, str]]) -> list[str]:
    return ["| column | what |", "|---|---|", *(f"| `{name}` | {what} |" for name, what in rows)]
