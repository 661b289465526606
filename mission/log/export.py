"""A log as tables (CSV, Parquet) and as KML."""

import csv
import importlib
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from mission.errors import InputError
from mission.log.errors import LogError
from mission.log.reader import read_log
from mission.log.values import FlightData, Floats, PlanRecord, Track
from mission.palette import FLOWN, PLANNED, community_colour

Column: TypeAlias = Sequence[Any] | NDArray[Any]
Tables: TypeAlias = dict[str, dict[str, Column]]

_KML = "http://www.opengis.net/kml/2.2"


def tables(data: FlightData) -> Tables:
    """The log's contents as tables by name; columns carry their units.

    `track`: a row a sample; `plans`: a row a step; `devices`, `rounds`, `uplinks`, `learning`,
    `events`, `battery`. Positions are area coordinates, times simulated seconds.
    """
    truth, belief = data.truth, data.belief
    battery = data.battery
    return {
        "track": {
            "t_s": truth.t_ns / 1e9,
            **_axes("true", truth.pos_m),
            **_axes("est", belief.pos_m),
        },
        "plans": _columns(row for plan in data.plans for row in _plan_rows(plan)),
        "devices": {
            "device": np.arange(len(data.devices.community)),
            "community": data.devices.community,
            "x_m": data.devices.pos_m[:, 0],
            "y_m": data.devices.pos_m[:, 1],
        },
        "rounds": _columns(
            {
                **{k: v for k, v in asdict(record).items() if k not in ("accuracy", "cov")},
                **{f"accuracy_{name}": value for name, value in record.accuracy.items()},
                **{f"cov_{name}": value for name, value in record.cov.items()},
            }
            for record in data.rounds
        ),
        "uplinks": _columns(asdict(record) for record in data.uplinks),
        "learning": _columns(
            {"t_s": r.t_ns / 1e9, **{k: v for k, v in asdict(r).items() if k != "t_ns"}}
            for r in data.learning
        ),
        "events": _columns(
            {
                "t_s": event.t_ns / 1e9, "kind": event.kind, "text": event.text,
                "seq": math.nan if event.seq is None else event.seq, "severity": event.severity,
                "true_x_m": event.true_m[0], "true_y_m": event.true_m[1],
                "true_alt_m": event.true_m[2],
            }
            for event in data.events
        ),
        "battery": {
            "t_s": battery.t_ns / 1e9, "voltage_v": battery.voltage_v,
            "current_a": battery.current_a, "consumed_mah": battery.consumed_mah,
            "remaining": battery.remaining,
        },
    }  # fmt: skip


def export_csv(path: Path, folder: Path) -> tuple[Path, ...]:
    """Write every table with a row to `folder` as CSV; returns the files.

    Raises:
        LogError: the log cannot be read. InputError: the folder is used or cannot be written.
    """
    found = tables(read_log(path))
    _prepare(folder)
    written = []
    for name, columns in found.items():
        rows = zip(*(_texts(column) for column in columns.values()), strict=True)
        target = folder / f"{name}.csv"
        if not columns:
            continue
        try:
            with target.open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(columns)
                writer.writerows(rows)
        except OSError as error:
            raise InputError(f"{target}: cannot write: {error.strerror}") from None
        written.append(target)
    return tuple(written)


def export_parquet(path: Path, folder: Path) -> tuple[Path, ...]:
    """Write every table with a row to `folder` as Parquet (zstd); returns the files.

    Raises:
        LogError: the log cannot be read.
        InputError: pyarrow is not installed; the folder is used or cannot be written.
    """
    try:
        arrow = importlib.import_module("pyarrow")
        parquet = importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError:
        raise InputError(
            "Parquet needs pyarrow, which is not installed: pip install 'aerofed[parquet]'"
        ) from None
    found = tables(read_log(path))
    _prepare(folder)
    written = []
    for name, columns in found.items():
        if not columns:
            continue
        target = folder / f"{name}.parquet"
        table = arrow.table({key: arrow.array(list(column)) for key, column in columns.items()})
        try:
            parquet.write_table(table, target, compression="zstd")
        except OSError as error:
            raise InputError(f"{target}: cannot write: {error}") from None
        written.append(target)
    return tuple(written)


def export_attachments(path: Path, folder: Path) -> tuple[Path, ...]:
    """Write the files inside the log to `folder`; returns the files.

    Raises:
        LogError: the log cannot be read, or an attachment's name is no plain file name.
        InputError: the folder is used or cannot be written.
    """
    found = read_log(path).attachments
    for name in found:
        if Path(name).name != name:
            raise LogError(path, f"attachment {name!r} is no plain file name")
    _prepare(folder)
    for name, data in found.items():
        try:
            (folder / name).write_bytes(data)
        except OSError as error:
            raise InputError(f"{folder / name}: cannot write: {error.strerror}") from None
    return tuple(folder / name for name in found)


def export_kml(path: Path, target: Path) -> Path:
    """Write devices, planned and flown paths as KML 2.2 (OGC 07-147r2), heights above sea level.

    Raises:
        LogError: the log cannot be read. InputError: the file exists or cannot be written.
    """
    data = read_log(path)
    if target.exists():
        raise InputError(f"{target}: exists already; give another name")
    root = ET.Element("kml", xmlns=_KML)
    document = ET.SubElement(root, "Document")
    _text(document, "name", path.stem)
    _style(document, "planned", PLANNED, 2)
    _style(document, "flown", FLOWN, 3)
    folder = _folder(document, "devices")
    for k, (x, y) in enumerate(data.devices.pos_m.tolist()):
        colour = community_colour(int(data.devices.community_of[k]))
        point = _placemark(folder, f"{k} {data.devices.community[k]}", colour=colour)
        ground = np.array([[x, y, 0.0]])
        _text(ET.SubElement(point, "Point"), "coordinates", _coordinates(data, ground))
    planned, flown = _folder(document, "planned"), _folder(document, "flown")
    for plan in data.plans:
        height = np.full((len(plan.waypoints_m), 1), plan.altitude_m)
        points = np.hstack((plan.waypoints_m, height))
        _line(planned, f"round {plan.round}", "planned", _coordinates(data, points))
    for name, track in _pieces(data):
        _line(flown, name, "flown", _coordinates(data, track.pos_m))
    try:
        ET.indent(root)
        ET.ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise InputError(f"{target}: cannot write: {error.strerror}") from None
    return target


def _pieces(data: FlightData) -> Iterable[tuple[str, Track]]:
    """The true track, cut at the starts and ends of the rounds."""
    at = 0
    for record in data.rounds:
        start = round(record.start_t_s * 1e9)
        end = round((record.start_t_s + record.duration_s) * 1e9)
        before = data.truth.between(at, start)
        if len(before.t_ns) > 1:
            yield f"to round {record.round}", before
        piece = data.truth.between(start, end)
        if len(piece.t_ns) > 1:
            yield f"round {record.round}", piece
        at = end
    rest = data.truth.between(at, int(data.truth.t_ns[-1]) if len(data.truth.t_ns) else 0)
    if len(rest.t_ns) > 1:
        yield "after the last round", rest


def _plan_rows(plan: PlanRecord) -> Iterable[dict[str, Any]]:
    for step, (x, y) in enumerate(plan.waypoints_m.tolist()):
        served = np.flatnonzero(plan.schedule[step]).tolist()
        yield {
            "round": plan.round,
            "step": step,
            "x_m": x,
            "y_m": y,
            "ideal_slot_s": float(plan.ideal_slot_s[step]),
            "devices": " ".join(map(str, served)),
        }


def _columns(rows: Iterable[dict[str, Any]]) -> dict[str, Column]:
    rows = list(rows)
    return {key: [row[key] for row in rows] for key in rows[0]} if rows else {}


def _axes(prefix: str, pos_m: Floats) -> dict[str, Column]:
    return {f"{prefix}_{name}_m": pos_m[:, axis] for axis, name in enumerate(("x", "y", "alt"))}


def _texts(column: Column) -> Iterable[str]:
    values = column.tolist() if isinstance(column, np.ndarray) else column
    for value in values:
        if isinstance(value, bool):
            yield "true" if value else "false"
        else:
            yield repr(value) if isinstance(value, float) else str(value)


def _prepare(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InputError(f"{folder}: the output folder is already used")
    except OSError as error:
        raise InputError(f"{folder}: cannot write the output folder: {error.strerror}") from None


def _coordinates(data: FlightData, points_m: Floats) -> str:
    """KML's `lon,lat,height` list; 1e-8 degrees is a millimetre."""
    frame = data.area.frame
    ned = np.column_stack(
        (
            points_m[:, 1] - data.area.home_m[1],
            points_m[:, 0] - data.area.home_m[0],
            -points_m[:, 2],
        )
    )
    where = [frame.to_geodetic(row) for row in ned]
    return " ".join(f"{p.lon_deg:.8f},{p.lat_deg:.8f},{p.alt_msl_m:.3f}" for p in where)


def _text(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text


def _folder(parent: ET.Element, name: str) -> ET.Element:
    folder = ET.SubElement(parent, "Folder")
    _text(folder, "name", name)
    return folder


def _kml_colour(colour: str) -> str:
    """KML writes aabbggrr."""
    return f"ff{colour[5:7]}{colour[3:5]}{colour[1:3]}".lower()


def _style(parent: ET.Element, name: str, colour: str, width: int) -> None:
    line = ET.SubElement(ET.SubElement(parent, "Style", id=name), "LineStyle")
    _text(line, "color", _kml_colour(colour))
    _text(line, "width", str(width))


def _placemark(parent: ET.Element, name: str, *, colour: str) -> ET.Element:
    placemark = ET.SubElement(parent, "Placemark")
    _text(placemark, "name", name)
    icon = ET.SubElement(ET.SubElement(placemark, "Style"), "IconStyle")
    _text(icon, "color", _kml_colour(colour))
    return placemark


def _line(parent: ET.Element, name: str, style: str, coordinates: str) -> None:
    placemark = ET.SubElement(parent, "Placemark")
    _text(placemark, "name", name)
    _text(placemark, "styleUrl", f"#{style}")
    line = ET.SubElement(placemark, "LineString")
    _text(line, "altitudeMode", "absolute")
    _text(line, "coordinates", coordinates)
