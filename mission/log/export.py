"""Export of a log: CSV or Parquet tables, KML 2.2 (OGC 07-147r2), GeoJSON, its attachments."""

import itertools
import math
import shutil
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Literal, TypeAlias
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from mission.base.area import Area, on_globe
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.base.palette import community_colour
from mission.base.run_folder import write_atomically
from mission.base.tables import annotated, csv_lines, parquet
from mission.base.user_files import or_input_error
from mission.log import LogError
from mission.log.messages import feature, geojson
from mission.log.reader import read_log
from mission.log.records import flat
from mission.log.values import (
    BatteryTrack,
    ControlTrack,
    FlightData,
    InnovationTrack,
    LearningRecord,
    PlanRecord,
    Track,
)

Column: TypeAlias = Sequence[object] | NDArray[np.generic]
Tables: TypeAlias = dict[str, dict[str, Column]]

KML = "http://www.opengis.net/kml/2.2"
# Colour and width (px) of lines, bright: on a globe they lie over dark pictures of the ground.
_LINES = {"planned": ("#F0E442", 5), "flown": ("#56B4E9", 2), "fence": ("#FF8A80", 2)}


def tables(data: FlightData) -> Tables:
    """The log's contents as tables by name; columns carry their units.

    `track`: a row a sample; `plans`: a row a step; `devices`, `rounds`, `uplinks`, `learning`,
    `events`, `battery`, `wind`, `control`, `innovations`. Positions are area coordinates, times
    simulated seconds.
    """
    truth, belief = data.truth, data.belief
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
        "rounds": _columns(map(flat, data.rounds)),
        "uplinks": _columns(map(flat, data.uplinks)),
        "learning": _columns(map(_timed, data.learning)),
        "events": _columns(
            {
                "t_s": event.t_ns / 1e9,
                "kind": event.kind,
                "text": event.text,
                "seq": math.nan if event.seq is None else event.seq,
                "severity": event.severity,
                "true_x_m": event.true_m[0],
                "true_y_m": event.true_m[1],
                "true_alt_m": event.true_m[2],
            }
            for event in data.events
        ),
        "battery": _timed(data.battery),
        "wind": {
            "t_s": data.wind.t_ns / 1e9,
            **dict(zip(("east_mps", "north_mps", "up_mps"), data.wind.vel_mps.T, strict=True)),
        },
        "control": _control(data.control),
        "innovations": _columns(
            row for kind, track in data.innovations.items() for row in _innovation_rows(kind, track)
        ),
    }


def export_tables(path: Path, folder: Path, form: Literal["csv", "parquet"]) -> tuple[Path, ...]:
    """Write the tables to `folder`, as CSV or as Parquet (zstd), and return the files.

    `track`, `devices`, `battery` and `wind` are always written, other tables only with a row.
    In CSV a text that a spreadsheet would compute gets an apostrophe in front.

    Raises:
        LogError: the log cannot be read. InputError: the folder is used or cannot be written.
    """
    encoded = csv_table if form == "csv" else parquet
    found = tables(read_log(path)).items()
    return _write_all(folder, {f"{name}.{form}": encoded(table) for name, table in found if table})


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
    return _write_all(folder, found)


def _write_all(folder: Path, files: Mapping[str, bytes]) -> tuple[Path, ...]:
    """Write files by name into a folder that is new or empty; all of them or none."""
    with or_input_error(folder, "cannot write"):
        made = not folder.exists()
        if not made and any(folder.iterdir()):
            raise InputError(f"{folder}: the output folder is already used")
        folder.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=".partial-", dir=folder))  # it may be a mount
        try:
            for name, data in files.items():
                (partial / name).write_bytes(data)
            for name in files:
                (partial / name).replace(folder / name)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
            if made:
                with suppress(OSError):  # it is used, or was never made
                    folder.rmdir()
    return tuple(folder / name for name in files)


def csv_table(table: Mapping[str, Column]) -> bytes:
    """Return a table as CSV; text that a spreadsheet would compute gets an apostrophe in front."""
    rows = zip(*map(_harmless, table.values()), strict=True)
    return csv_lines([table, *rows]).encode()


def _timed(record: LearningRecord | BatteryTrack) -> dict[str, Column]:
    """The fields of a record as columns, its time in seconds."""
    fields = {**vars(record), "t_ns": record.t_ns / 1e9}
    return {"t_s" if name == "t_ns" else name: value for name, value in fields.items()}


def _control(track: ControlTrack | None) -> dict[str, Column]:
    if track is None:
        return {}
    return {
        "t_s": track.t_ns / 1e9,
        **{
            f"{name}_{axis}".removesuffix("_"): getattr(track, name)[:, index]
            for name, axes in annotated(ControlTrack, tuple)
            for index, axis in enumerate(axes)
        },
    }


def _plan_rows(plan: PlanRecord) -> Iterable[dict[str, object]]:
    for step, (x, y) in enumerate(plan.waypoints_m.tolist()):
        served = np.flatnonzero(plan.schedule[step]).tolist()
        yield {
            "round": plan.round,
            "step": step,
            "x_m": x,
            "y_m": y,
            "slot_s": float(plan.slot_s[step]),
            "devices": " ".join(map(str, served)),
        }


def _innovation_rows(kind: str, track: InnovationTrack) -> Iterable[dict[str, object]]:
    """A row for each measured value of one sensor: a position has three."""
    names = ("north", "east", "down") if track.values.shape[1] == 3 else ("",)
    for index, t_ns in enumerate(track.t_ns.tolist()):
        for axis, name in enumerate(names):
            yield {
                "t_s": t_ns / 1e9,
                "sensor": kind,
                "axis": name,
                "value": float(track.values[index, axis]),
                "std": float(track.stds[index, axis]),
                "ratio": float(track.ratio[index]),
                "accepted": bool(track.accepted[index]),
            }


def _columns(rows: Iterable[Mapping[str, object]]) -> dict[str, Column]:
    rows = list(rows)
    return {key: [row[key] for row in rows] for key in rows[0]} if rows else {}


def _axes(prefix: str, pos_m: Floats) -> dict[str, Column]:
    return {f"{prefix}_{name}_m": pos_m[:, axis] for axis, name in enumerate(("x", "y", "alt"))}


# With one of these in front a spreadsheet takes a cell for something to compute.
_COMPUTED = ("=", "+", "-", "@", "\t", "\r", "\n")


def _harmless(column: Column) -> Iterable[object]:
    values = column.tolist() if isinstance(column, np.ndarray) else column
    for value in values:
        computed = isinstance(value, str) and value.startswith(_COMPUTED)
        yield f"'{value}" if computed else value


def export_kml(path: Path, target: Path) -> Path:
    """Write devices, fence, planned and flown paths as KML, with heights above sea level.

    Raises:
        LogError: the log cannot be read. InputError: the file exists or cannot be written.
    """
    data = read_log(path)
    if target.exists():
        raise InputError(f"{target}: exists already; give another name")
    root = ET.Element("kml", xmlns=KML)
    document = ET.SubElement(root, "Document")
    text(document, "name", path.stem)
    for kind, (colour, width) in _LINES.items():
        style(document, kind, colour, width)
    folder = named(document, "Folder", "devices")
    for k, (x, y) in enumerate(data.devices.pos_m.tolist()):
        colour = community_colour(int(data.devices.community_of[k]))
        point = named(folder, "Placemark", f"{k} {data.devices.community[k]}")
        icon = ET.SubElement(ET.SubElement(point, "Style"), "IconStyle")
        text(icon, "color", kml_colour(colour))
        ground = np.array([[x, y, 0.0]])
        text(ET.SubElement(point, "Point"), "coordinates", coordinates(data.area, ground))
    if data.fence:
        lines = named(document, "Folder", "fence")
        for zone in data.fence:
            ground = np.column_stack((zone.outline_m, np.zeros(len(zone.outline_m))))
            closed = np.vstack((ground, ground[:1]))
            name = "fence" if zone.keep_in else "no-fly area"
            line(lines, name, "fence", coordinates(data.area, closed))
    planned, flown = (named(document, "Folder", name) for name in ("planned", "flown"))
    for plan in data.plans:
        line(planned, f"round {plan.round}", "planned", coordinates(data.area, plan.route_3d_m))
    for name, track in _pieces(data):
        line(flown, name, "flown", coordinates(data.area, track.pos_m))
    ET.indent(root)
    write_atomically(target, ET.tostring(root, encoding="utf-8", xml_declaration=True))
    return target


def export_geojson(data: FlightData, target: Path) -> Path:
    """Write planned and flown paths as GeoJSON (RFC 7946): longitude, latitude, height above sea
    level; of flown ones `t_s` has the time of each position.

    Raises:
        InputError: the file exists or cannot be written.
    """
    if target.exists():
        raise InputError(f"{target}: exists already; give another name")
    only = data.source.only
    if not data.source.on_globe:
        raise InputError(f"{target}: not written: the log has no places on the globe")
    flown = [("true", data.truth), ("believed", data.belief)]
    features = [
        feature_of(data.area, p.route_3d_m, kind="planned", round=p.round) for p in data.plans
    ]
    features += [
        feature_of(data.area, track.pos_m, kind=kind, t_s=(track.t_ns / 1e9).tolist())
        for kind, track in flown
        if (only is None or kind == only) and len(track.t_ns) > 1
    ]
    write_atomically(target, geojson(features))
    return target


def feature_of(area: Area, points_m: Floats, **properties: object) -> dict[str, object]:
    """A feature of GeoJSON: a line through (n, 3) places in an area, or a point."""
    places = _places(area, points_m)
    if len(places) == 1:
        return feature("Point", places[0], **properties)
    return feature("LineString", places, **properties)


def _pieces(data: FlightData) -> Iterable[tuple[str, Track]]:
    """The true track, cut at the starts and ends of the rounds."""
    cuts = [("", 0)]
    for record in data.rounds:
        cuts.append((f"to round {record.round}", round(record.start_t_s * 1e9)))
        end_s = record.start_t_s + record.duration_s
        cuts.append((f"round {record.round}", round(end_s * 1e9)))
    rest = "after the last round" if data.rounds else "flight"
    cuts.append((rest, int(data.truth.t_ns.max(initial=0))))
    for (_, start_ns), (name, end_ns) in itertools.pairwise(cuts):
        piece = data.truth.between(start_ns, end_ns)
        if len(piece.t_ns) > 1:
            yield name, piece


def coordinates(area: Area, points_m: Floats) -> str:
    """KML's `lon,lat,height` list of (n, 3) places in an area."""
    where = _places(area, points_m)
    return " ".join(f"{lon:.8f},{lat:.8f},{height:.3f}" for lon, lat, height in where)


def _places(area: Area, points_m: Floats) -> list[tuple[float, float, float]]:
    """Longitude, latitude, height above sea level, to a millimetre."""
    where = on_globe(area, points_m[:, :2], points_m[:, 2])
    return [(round(p.lon_deg, 8), round(p.lat_deg, 8), round(p.alt_msl_m, 3)) for p in where]


def text(parent: ET.Element, tag: str, words: str) -> None:
    """Add an element of text."""
    ET.SubElement(parent, tag).text = words


def style(document: ET.Element, name: str, colour: str, width: int) -> None:
    """Add a style of lines: a `#rrggbb` colour, and a width in pixels."""
    look = ET.SubElement(ET.SubElement(document, "Style", id=name), "LineStyle")
    text(look, "color", kml_colour(colour))
    text(look, "width", str(width))


def named(parent: ET.Element, tag: str, name: str) -> ET.Element:
    """Add an element with a name, and return it."""
    made = ET.SubElement(parent, tag)
    text(made, "name", name)
    return made


def kml_colour(colour: str) -> str:
    """A `#rrggbb` colour as KML writes it: aabbggrr."""
    return f"ff{colour[5:7]}{colour[3:5]}{colour[1:3]}".lower()


def line(parent: ET.Element, name: str, style: str, places: str) -> None:
    """Add a line in one of the document's styles."""
    placemark = named(parent, "Placemark", name)
    text(placemark, "styleUrl", f"#{style}")
    drawn = ET.SubElement(placemark, "LineString")
    text(drawn, "altitudeMode", "absolute")
    text(drawn, "coordinates", places)
