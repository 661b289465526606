"""Reads a log back into values."""

import tomllib
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from fl.radio.per_grid import PerGrid
from mission.base.arrays import Floats, Ints
from mission.base.explain import Blame, explained
from mission.log import SPOILT, ForeignLogError, control, topics
from mission.log.contents import Contents, load
from mission.log.records import (
    Record,
    RoundRecord,
    TimedUplinkRecord,
    UplinkRecord,
    described,
    from_json,
)
from mission.log.signals import Signal
from mission.log.topics import Topic
from mission.log.values import (
    NS_PER_S,
    SENSORS,
    BatteryTrack,
    ControlTrack,
    Devices,
    EventRecord,
    FlightData,
    InnovationTrack,
    LearningRecord,
    MissionRecord,
    ModeRecord,
    Modes,
    PlanRecord,
    SetpointRecord,
    Track,
    WindTrack,
    Zone,
)

_FIX_3D = 3.0  # as MAVLink counts them
# The innovations that `signals.AXES` names, in that order.
_RATIOS = ("gnss_velocity", "gnss_position", "baro", "heading")


def read_log(path: Path) -> FlightData:
    """Read and decode a whole flight log.

    Raises:
        LogError: it cannot be read, is not a log of ours, or is damaged.
    """
    return decode(load(path))


def decode(contents: Contents) -> FlightData:
    """Decode the contents of a log into values.

    Raises:
        LogError: it is not a log of ours.
        InputError: its configuration is none.
    """
    area = contents.area
    _check_settings(contents.path, contents.attachments.get("config.toml", b""))
    try:
        devices, told = _devices(contents), _control(contents)
        truth, belief = _common(track(contents, topics.TRUE_POSE), track(contents, topics.EST_POSE))
        return FlightData(
            area=area,
            devices=devices,
            fence=_fence(contents),
            truth=truth,
            belief=belief,
            plans=_plans(contents),
            rounds=tuple(from_json(RoundRecord, row) for _, row in contents.decoded(topics.ROUNDS)),
            uplinks=_uplinks(contents),
            learning=_timed(LearningRecord, contents.decoded(topics.LEARNING)),
            events=_timed(EventRecord, contents.decoded(topics.EVENTS)),
            battery=_battery(contents),
            wind=WindTrack(*vectors(contents.decoded(topics.TRUE_WIND))),
            innovations=_innovations(contents),
            metadata=contents.metadata,
            attachments=contents.attachments,
            missions=_timed(MissionRecord, contents.decoded(topics.MISSION)),
            setpoints=_timed(SetpointRecord, contents.decoded(topics.SETPOINT)),
            modes=_modes(contents),
            control=told,
            signals=_signals(contents, told, belief),
            radio_believed=_grids(contents, topics.RADIO_BELIEVED),
            radio_true=next((grid for _, grid in _grids(contents, topics.RADIO_TRUE)), None),
            gnss_ns=np.array(
                [item.log_time for item in contents.messages.get(topics.GNSS.name, ())],
                dtype=np.int64,
            ),
        )
    except SPOILT as error:
        raise ForeignLogError(
            contents.path, f"a record is not what its schema says ({error!r})"
        ) from None


def _timed(record: type[Record], rows: Iterable[tuple[int, Any]]) -> tuple[Record, ...]:
    return tuple(from_json(record, row, t_ns=t_ns) for t_ns, row in rows)


def track(contents: Contents, topic: Topic) -> Track:
    """The positions of a topic of poses, which are in the plane that touches the globe at home:
    here with their heights above it."""
    t_ns, pos_m = vectors((t, message.pose.position) for t, message in contents.decoded(topic))
    east_m, north_m = (pos_m[:, :2] - contents.area.home_m).T
    pos_m[:, 2] += contents.area.frame.drop_m(north_m, east_m)
    return Track(t_ns, pos_m)


def vectors(rows: Iterable[tuple[int, Any]]) -> tuple[Ints, Floats]:
    """Return times (n,) and vectors (n, 3) of rows of t_ns and an item that has x, y and z."""
    places = [(t_ns, (item.x, item.y, item.z)) for t_ns, item in rows]
    xyz = np.array([xyz for _, xyz in places], dtype=np.float64).reshape(-1, 3)
    return np.array([t_ns for t_ns, _ in places], dtype=np.int64), xyz


def _common(truth: Track, belief: Track) -> tuple[Track, Track]:
    """Both tracks at the same instants: a recovered log may hold one pose of a sample only."""
    _, first, second = np.intersect1d(truth.t_ns, belief.t_ns, return_indices=True)
    return (
        Track(truth.t_ns[first], truth.pos_m[first]),
        Track(belief.t_ns[second], belief.pos_m[second]),
    )


def _devices(contents: Contents) -> Devices:
    for _, row in contents.decoded(topics.DEVICES):
        return from_json(Devices, row)
    raise ForeignLogError(contents.path, "an MCAP file without the devices (/devices is empty)")


def _fence(contents: Contents) -> tuple[Zone, ...]:
    """The zones of the last fence record; those before it are the same."""
    rows = [row for _, row in contents.decoded(topics.FENCE)]
    return tuple(
        Zone(np.array(outline, dtype=np.float64).reshape(-1, 2), keep_in)
        for key, keep_in in (("keep_in_m", True), ("keep_out_m", False))
        for outline in (rows[-1][key] if rows else ())
    )


def _plans(contents: Contents) -> tuple[PlanRecord, ...]:
    """Return the last plan of each round: a round may be planned anew while it is flown."""
    plans = [_plan(t, row) for t, row in contents.decoded(topics.PLAN)]
    return tuple({plan.round: plan for plan in plans}.values())


def _plan(t_ns: int, row: dict[str, Any]) -> PlanRecord:
    plan = from_json(PlanRecord, row, t_ns=t_ns)
    schedule = np.zeros((len(plan.waypoints_m), len(plan.importance)), dtype=bool)
    for step, device in row["schedule"]:
        schedule[step, device] = True
    return replace(plan, schedule=schedule)


def _uplinks(contents: Contents) -> tuple[UplinkRecord, ...]:
    """Return uplinks sorted by round, step, device; slots that were never reached have no time."""
    rows = [row for _, row in contents.decoded(topics.UPLINKS)]
    rows.sort(key=lambda row: (row["round"], row["step"], row["device"]))
    return tuple(
        from_json(TimedUplinkRecord if "late" in row else UplinkRecord, row) for row in rows
    )


def _modes(contents: Contents) -> Modes:
    rows = [(t, from_json(ModeRecord, row)) for t, row in contents.decoded(topics.MODE)]
    return Modes(np.array([t for t, _ in rows], dtype=np.int64), tuple(m.mode for _, m in rows))


def _control(contents: Contents) -> ControlTrack | None:
    rows = contents.messages.get(topics.CONTROL.name, ())
    times = np.array([row.log_time for row in rows], dtype=np.int64)
    return control.track(times, [row.data for row in rows]) if rows else None


def _signals(contents: Contents, told: ControlTrack | None, belief: Track) -> dict[str, Signal]:
    found = {} if told is None else control.signals(contents.area, told, belief)
    ratios = [
        (row["t_s"], *(row[key] and row[key]["ratio"] for key in _RATIOS))
        for _, row in contents.decoded(topics.INNOVATIONS)
    ]
    if ratios:
        rows = np.array(ratios, dtype=np.float64)
        at_s, at = np.unique(rows[:, 0], return_index=True)
        found["innovation_ratio"] = Signal(at_s, rows[at, 1:])
    fixes = [(t, m.position_covariance[0]) for t, m in contents.decoded(topics.GNSS)]
    if fixes:
        t_ns, square = np.array(fixes).T
        found["gnss_accuracy_m"] = Signal(t_ns / NS_PER_S, np.sqrt(square)[:, None])
        fix = np.full((len(t_ns), 1), _FIX_3D)  # nothing else is logged
        found["gnss_fix"] = Signal(t_ns / NS_PER_S, fix)
    return found


def _grids(contents: Contents, topic: Topic) -> tuple[tuple[int, PerGrid], ...]:
    found = []
    for t_ns, grid in contents.decoded(topic):
        shape = -1, grid.column_count, grid.cell_stride
        shares = np.frombuffer(grid.data, dtype=np.uint8).reshape(shape) / 255.0
        cell_m, at = grid.cell_size.x, grid.pose.position
        first_m = at.x + 0.5 * cell_m, at.y + 0.5 * cell_m
        found.append((t_ns, PerGrid(np.moveaxis(shares, -1, 0), first_m, cell_m)))
    return tuple(found)


def _battery(contents: Contents) -> BatteryTrack:
    rows = list(contents.decoded(topics.BATTERY))
    columns = {
        name: np.array([row[name] for _, row in rows], dtype=np.float64)
        for name, _, _ in described(BatteryTrack)
    }
    return BatteryTrack(np.array([t for t, _ in rows], dtype=np.int64), **columns)


def _innovations(contents: Contents) -> dict[str, InnovationTrack]:
    all_rows = [row for _, row in contents.decoded(topics.INNOVATIONS)]
    found = {}
    for key, sensor in SENSORS.items():
        rows = [(row["t_s"], row[key]) for row in all_rows if row[key] is not None]
        if rows:
            found[sensor] = InnovationTrack(
                t_ns=np.array([round(t_s * NS_PER_S) for t_s, _ in rows], dtype=np.int64),
                values=np.array([item["values"] for _, item in rows], dtype=np.float64),
                stds=np.array([item["stds"] for _, item in rows], dtype=np.float64),
                ratio=np.array([item["ratio"] for _, item in rows], dtype=np.float64),
                accepted=np.array([item["accepted"] for _, item in rows], dtype=np.bool_),
            )
    return found


_Ring = Annotated[
    list[Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)]], Field(min_length=3)
]


class _Read(BaseModel):
    """A table of the configuration that a log holds: what is read back from it has to be of its
    kind. Of another version keys may be missing or unknown; nobody reads those."""

    model_config = ConfigDict(strict=True)


class _Area(_Read):
    class NoFly(_Read):
        name: str
        polygon_m: _Ring
        from_m: FiniteFloat = 0.0
        to_m: FiniteFloat | None = None

    class Building(_Read):
        model_config = ConfigDict(extra="forbid")
        polygon_m: _Ring
        height_m: FiniteFloat
        from_m: FiniteFloat = 0.0
        holes_m: list[_Ring] = []

    no_fly: list[NoFly] = []
    buildings: list[Building] = []


class _Wind(_Read):
    speed_mps: FiniteFloat = 0.0
    from_deg: FiniteFloat = 0.0
    turbulence_severity: int = 0
    gusts: list[Any] = []


class _Aircraft(_Read):
    wind: _Wind = _Wind()


class _Vehicle(_Read):
    aircraft: _Aircraft = _Aircraft()


class _Settings(_Read):
    mission: dict[str, Any] = {}
    link: dict[str, Any] = {}
    radio: dict[str, Any] = {}
    area: _Area = _Area()
    vehicle: _Vehicle = _Vehicle()


def _check_settings(path: Path, text: bytes) -> None:
    """Check the configuration that the log `path` holds.

    Raises:
        InputError: it is no TOML, or what is read back of it is not of its kind.
    """
    try:
        values = tomllib.loads(text.decode())
    except ValueError as error:
        raise ForeignLogError(path, f"its config.toml is not valid TOML: {error}") from None
    with explained(_Settings, values, Blame(f"{path}: config.toml")):
        _Settings.model_validate(values)
