"""What a run leaves: files, columns and topics, from the schemas of the log."""

import json
from collections.abc import Iterable

from mission.base.tables import annotated
from mission.log import topics
from mission.log.records import (
    AircraftRecord,
    DeviceRecord,
    OfSeveral,
    TimedUplinkRecord,
    UplinkRecord,
)
from mission.log.values import ControlTrack

HEAD = """# What a run leaves

Generated from the code (`python docs/generate.py`). A run leaves one folder, with all that is
needed to look at the run, to compute with it and to fly it again.

| you want to | open |
|---|---|
| see where the drone flew and who was served | `figures/` |
| compute with rounds, transmissions or accuracies | [`rounds.csv`](#roundscsv), \
[`uplinks.csv`](#uplinkscsv), [`learning.csv`](#learningcsv), [`aircraft.csv`](#aircraftcsv), \
`devices.csv` |
| follow the flight second by second | [`flight.mcap`](#flightmcap), see \
[reading a log](reading-logs.md) |
| know how the run ended, with which versions and data | `summary.json` |
| fly the same again | `config.toml` |
| fly one of its rounds again, or see it in QGroundControl | `plans/` |

Symbols such as eps_k and psi are the paper's: [learning](learning.md#fairness-and-importance) has
the formulas, the [glossary](glossary.md) most terms.

## Conventions

- Positions are in metres: x to the east, y to the north, from the area's south-west corner. Heights
  are above home. Poses in the log are in the plane that touches the globe at home, 5 m above it at
  8 km; whoever reads it with Aerofed has heights above home on the globe.
- Times are simulated, in seconds.
- `plan_` is what was planned, `est_` what the autopilot believed (its estimate), `true_` what was
  true in the simulation.
- CSV files are UTF-8 with one header line. Numbers are written in their shortest exact form. `nan`
  stands where there is no value (`null` in the log). Tables of earlier versions are read, also
  where a column that may hold `nan` was not there yet.
- With the built-in autopilot the same configuration and seed give the same bytes in a folder of the
  same name. Only `summary.json` and `report.html` differ, by the wall times in them.

## Files

`aerofed run` leaves:

| file | what |
|---|---|
| `config.toml` | the whole configuration, defaults included; `aerofed run config.toml` flies the \
same again |
| `devices.csv` | a row for each device: community, position, samples, share of the data (`p`), \
samples of each class (`class:samples`), configured share. Where devices take time, `compute_s` \
and `upload_s` too. `positions_file` takes this file |
| `rounds.csv` | a row for each round |
| `aircraft.csv` | a row for each round and aircraft |
| `uplinks.csv` | a row for each scheduled device of each round |
| `learning.csv` | a row for each device after every round |
| `flight.mcap` | the flight log |
| `plans/` | every round as a QGroundControl `.plan`; `aerofed fly` takes it too |
| `summary.json` | how the run ended (`status`, `error`; `ended_by` where a budget ended it before \
its last round), folders of several aircraft (`vehicles`), versions, data sources, the SHA-256 \
of the code of each [plug-in](plugins.md#rules) (`plugins`), totals, \
and wall seconds by phase and in all, without the writing of `report.html` |
| `report.html` | the page of the run; `--no-report` leaves it out, `aerofed report` adds it later |
| `figures/map.png` | all rounds on one map |
| `figures/belief.png` | what was believed of a device by place as rounds 1, 2, 4 and the last \
began, and what was true; only where `radio.belief` is neither the channel nor the truth |
| `figures/rounds.png` | who was served from where, round by round, at most twelve rounds |
| `figures/learning.png` | accuracy, fairness and updates |
| `checkpoint/` | what `aerofed run --resume` needs to go on. In a resumed run `interrupted/` has \
the old log and tables until the new ones have caught up |
| `firmware/` | only with a [real firmware](autopilots.md): its files, and its console in \
`console.log` |
| `traceback.txt` | only where code of your own ended the run |

With [several aircraft](fleet.md#what-is-seen) logs are `vehicle-NAME/flight.mcap`, plans have the \
name behind their round, and `figures/timetable.png` and `figures/apart.png` are in the place of \
`figures/rounds.png` and `figures/belief.png`.

`aerofed fly` leaves:

| file | what |
|---|---|
| `config.toml`, `flight.mcap`, `summary.json`, `report.html` | as above |
| the plan file | as it was given |
| `track.csv` | a row for each sample: true and believed position |
| `figures/map.png` | the planned and the flown path |
| `figures/profile.png` | height, distance from the path, speed, error of the estimate |
| `checkpoint/` | nothing but a lock, which keeps others out while it flies |
"""


def page() -> str:
    return HEAD + "\n".join(_body()) + "\n"


def _body() -> list[str]:
    """The tables' columns, then every topic of the log."""
    every, every_uplink = topics.TOPICS, list(annotated(UplinkRecord, str))
    lines = [
        *("", "## rounds.csv", "", "One row for each round.", "", *_round_columns()),
        *("", "`COMMUNITY` is the name of one: there is a column for each."),
        *("", "## aircraft.csv", "", "One row for each round and aircraft."),
        *("", *_columns(AircraftRecord)),
        *("", "With several aircraft five columns more, and `aircraft` in `uplinks.csv`:"),
        *("", *_table((name, told.words) for name, told in annotated(AircraftRecord, OfSeveral))),
        *("", "## uplinks.csv", "", "One row for each scheduled device of each round."),
        *("", *_fields(topics.UPLINKS)),
        *(
            "",
            "Where [devices take time](learning.md#devices-that-take-time), four columns more, in",
        ),
        "the log as well. A late device sends nothing: its PERs are 1.",
        *("", *_table(row for row in annotated(TimedUplinkRecord, str) if row not in every_uplink)),
        *("", "## learning.csv", "", "One row for each device after every round."),
        *("", *_columns(DeviceRecord)),
        *("", "## flight.mcap", ""),
        "The flight log, for Foxglove, Lichtblick, PlotJuggler, rerun and every MCAP library.",
        "[Reading a log](reading-logs.md) says how to open it, and how to make a",
        "[ULog](reading-logs.md#flight-review-pyulog) of it. It is an MCAP file with zstd",
        "chunks, indexes and statistics; `log_time` is in simulated nanoseconds. Topics with a",
        "Foxglove schema are protobuf, and so is `/control`; the others are JSON with a JSON",
        "schema.",
        *("", "| topic | schema | encoding | what |", "|---|---|---|---|"),
        *(f"| `{t.name}` | `{t.schema_name}` | {t.encoding} | {t.description} |" for t in every),
    ]
    about = " ".join((ControlTrack.__doc__ or "").split())
    named = [
        (name, f"{' '.join(axes).strip() or 'number'}: {dict(annotated(ControlTrack, str))[name]}")
        for name, axes in annotated(ControlTrack, tuple)
    ]
    lines += ["", "### /control", "", about, "", *_table(named, "field")]
    for topic in every:
        if topic.encoding == "json" and topic not in (topics.ROUNDS, topics.UPLINKS):
            about = json.loads(topic.schema)["description"]
            lines += ["", f"### {topic.name}", "", f"{about}.", "", *_fields(topic, "field")]
    return lines


def _round_columns() -> list[str]:
    """Those that every run has; the log's topic holds several in one."""
    several = {"accuracy": "accuracy_COMMUNITY", "cov": "cov_COMMUNITY"}
    described = topics.fields(topics.ROUNDS.schema).items()
    return _table((several.get(name, name), item["description"]) for name, item in described)


def _fields(topic: topics.Topic, head: str = "column") -> list[str]:
    described = topics.fields(topic.schema).items()
    return _table(((name, item["description"]) for name, item in described), head)


def _columns(record: type) -> list[str]:
    return _table(annotated(record, str))


def _table(rows: Iterable[tuple[str, str]], head: str = "column") -> list[str]:
    return [f"| {head} | what |", "|---|---|", *(f"| `{name}` | {what} |" for name, what in rows)]
