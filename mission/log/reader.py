"""Reads a log back into values."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mission.log import topics
from mission.log.contents import Contents, Json, Row, load
from mission.log.errors import ForeignLogError
from mission.log.records import RoundRecord, TimedUplinkRecord, UplinkRecord
from mission.log.topics import Topic
from mission.log.values import (
    NS_PER_S,
    BatteryTrack,
    Devices,
    EventRecord,
    FlightData,
    InnovationTrack,
    LearningRecord,
    PlanFileRecord,
    PlanRecord,
    Track,
    WindTrack,
    Zone,
)

_NAN = math.nan


def read_log(path: Path) -> FlightData:
    """Everything that a log of ours holds.

    Raises:
        LogError: it cannot be read, is not a log of ours, or is damaged.
    """
    return decode(load(path))


def decode(contents: Contents) -> FlightData:
    """A log's contents as values.

    Raises:
        LogError: it is not a log of ours.
    """
    area = contents.area
    plan_file = contents.metadata.get(PlanFileRecord.KEY)
    try:
        devices = _devices(contents)
        truth, belief = _common(
            _track(contents, topics.TRUE_POSE), _track(contents, topics.EST_POSE)
        )
        return FlightData(
            area=area,
            devices=devices,
            fence=_fence(contents),
            truth=truth,
            belief=belief,
            plans=tuple(
                _plan(t, row, len(devices.community)) for t, row in contents.decoded(topics.PLAN)
            ),
            rounds=tuple(_round(row) for _, row in contents.decoded(topics.ROUNDS)),
            uplinks=tuple(_uplink(row) for _, row in _in_file_order(contents)),
            learning=tuple(
                LearningRecord(t_ns=t, **_with_nan(row))
                for t, row in contents.decoded(topics.LEARNING)
            ),
            events=tuple(_event(t, row) for t, row in contents.decoded(topics.EVENTS)),
            battery=_battery(contents),
            wind=_wind(contents),
            innovations=_innovations(contents),
            metadata=contents.metadata,
            attachments=contents.attachments,
            plan_file=None if plan_file is None else PlanFileRecord.from_text(plan_file),
        )
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ForeignLogError(
            contents.path, f"a record is not what its schema says ({error!r})"
        ) from None


def _track(contents: Contents, topic: Topic) -> Track:
    rows = list(contents.decoded(topic))
    pos_m = np.empty((len(rows), 3))
    for index, (_, message) in enumerate(rows):
        p = message.pose.position
        pos_m[index] = (p.x, p.y, p.z)
    return Track(np.array([t for t, _ in rows], dtype=np.int64), pos_m)


def _common(truth: Track, belief: Track) -> tuple[Track, Track]:
    """Both tracks at the same instants: a recovered log may hold one pose of a sample only."""
    _, first, second = np.intersect1d(truth.t_ns, belief.t_ns, return_indices=True)
    return (
        Track(truth.t_ns[first], truth.pos_m[first]),
        Track(belief.t_ns[second], belief.pos_m[second]),
    )


def _devices(contents: Contents) -> Devices:
    for _, row in contents.decoded(topics.DEVICES):
        pos_m = np.array(row["pos_m"], dtype=np.float64).reshape(-1, 2)
        return Devices(pos_m, tuple(row["community"]))
    raise ForeignLogError(contents.path, "an MCAP file without the devices (/devices is empty)")


def _fence(contents: Contents) -> tuple[Zone, ...]:
    """The latest that was written: all of them are the same."""
    rows = [row for _, row in contents.decoded(topics.FENCE)]
    return tuple(
        Zone(np.array(outline, dtype=np.float64).reshape(-1, 2), keep_in)
        for key, keep_in in (("keep_in_m", True), ("keep_out_m", False))
        for outline in (rows[-1][key] if rows else ())
    )


def _plan(t_ns: int, row: Json, devices: int) -> PlanRecord:
    waypoints_m = np.array(row["waypoints_m"], dtype=np.float64).reshape(-1, 2)
    schedule = np.zeros((len(waypoints_m), devices), dtype=bool)
    # Logs of version 0.2 do not know of areas to fly around.
    route_m = np.array(row.get("route_m", row["waypoints_m"]), dtype=np.float64).reshape(-1, 2)
    # They have the slots of an aircraft that is always at its planned speed.
    slot_s = np.array(row.get("slot_s", row.get("ideal_slot_s")), dtype=np.float64)
    for step, device in row["schedule"]:
        schedule[step, device] = True
    return PlanRecord(
        round=row["round"],
        t_ns=t_ns,
        waypoints_m=waypoints_m,
        schedule=schedule,
        importance=np.array(row["importance"], dtype=np.float64),
        value=_number(row["value"]),
        upper_bound=_number(row["upper_bound"]),
        path_budget_m=_number(row["path_budget_m"]),
        speed_mps=_number(row["speed_mps"]),
        altitude_m=_number(row["altitude_m"]),
        height_m=np.array(row["height_m"], dtype=np.float64),
        slot_s=slot_s,
        duration_s=_number(row.get("duration_s", slot_s[-1])),
        route_m=route_m,
        # Not written where there are no corners between.
        stops_at=np.array(row.get("stops_at", range(len(waypoints_m))), dtype=np.int64),
    )


def _round(row: Json) -> RoundRecord:
    values = _with_nan(row)
    values["accuracy"] = _with_nan(row["accuracy"])
    values["cov"] = _with_nan(row["cov"])
    values["optional"] = _with_nan(row.get("optional", {}))  # logs of version 0.2 have none
    return RoundRecord(**values)


def _uplink(row: Json) -> UplinkRecord:
    kind = TimedUplinkRecord if "late" in row else UplinkRecord
    return kind(**_with_nan(row))


def _in_file_order(contents: Contents) -> Iterator[Row]:
    """Uplinks by round and step, as they were written: slots that were never reached have no
    instant of their own, so time does not order them."""
    rows = list(contents.decoded(topics.UPLINKS))
    yield from sorted(rows, key=lambda row: (row[1]["round"], row[1]["step"], row[1]["device"]))


def _event(t_ns: int, row: Json) -> EventRecord:
    return EventRecord(
        t_ns=t_ns,
        kind=row["kind"],
        text=row["text"],
        seq=row["seq"],
        severity=row["severity"],
        true_m=tuple(row["true_m"]),
        est_m=tuple(row["est_m"]),
    )


def _battery(contents: Contents) -> BatteryTrack:
    rows = list(contents.decoded(topics.BATTERY))
    columns = {
        name: np.array([_number(row[name]) for _, row in rows])
        for name in ("voltage_v", "current_a", "consumed_mah", "remaining")
    }
    return BatteryTrack(np.array([t for t, _ in rows], dtype=np.int64), **columns)


def _wind(contents: Contents) -> WindTrack:
    rows = list(contents.decoded(topics.TRUE_WIND))
    vel_mps = np.array([(wind.x, wind.y, wind.z) for _, wind in rows]).reshape(-1, 3)
    return WindTrack(np.array([t for t, _ in rows], dtype=np.int64), vel_mps)


def _innovations(contents: Contents) -> dict[str, InnovationTrack]:
    all_rows = [row for _, row in contents.decoded(topics.INNOVATIONS)]
    found = {}
    for sensor in topics.SENSORS:
        key = sensor.replace(" ", "_")
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


def _number(value: float | None) -> float:
    return _NAN if value is None else float(value)


def _with_nan(row: Json) -> Json:
    return {key: _NAN if value is None else value for key, value in row.items()}
