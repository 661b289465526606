"""Flights of one world in one file: GeoJSON, KML, and an MCAP for Foxglove's 3D and map panels."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree as ET

import foxglove
import numpy as np
from foxglove import messages as fox
from foxglove.mcap import MCAPWriteOptions

from mission.base.area import Area, on_globe
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.base.run_folder import write_atomically
from mission.log import scene
from mission.log.export import KML, coordinates, feature_of, line, named, style, text
from mission.log.messages import encoded, geojson, timestamp, to_bytes
from mission.log.topics import FRAME
from mission.log.values import NS_PER_S, Track

_SHOWN_NS = NS_PER_S // 5  # between the places of an aircraft
_DISTANCE = b'{"type":"object","properties":{"away_m":{"type":"number"}}}'


@dataclass(frozen=True)
class Seen:
    """A flight: its colour, its track, and its planned paths (P, 3), in the area of the world."""

    name: str
    colour: str
    track: Track
    plans: Sequence[Floats]


@dataclass(frozen=True)
class Met:
    """Where and when (s) two came nearest, and how far apart they were over time."""

    name: str
    at_m: Floats  # (3,)
    t_s: float
    away_m: float
    times_s: Floats  # (n,)
    distances_m: Floats  # (n,) NaN where not known

    @property
    def words(self) -> str:
        """One line of text."""
        return f"{self.name}: {self.away_m:.2f} m at {self.t_s:.1f} s"


def write_world(target: Path, area: Area, seen: Sequence[Seen], met: Sequence[Met]) -> Path:
    """Write flights and where they met as .geojson, .kml or .mcap, by the file's suffix.

    Raises:
        InputError: the file exists or cannot be written.
    """
    if target.exists():
        raise InputError(f"{target}: exists already; give another name")
    form: Callable[..., str | bytes] = {".mcap": _mcap, ".kml": _kml}.get(target.suffix, _json)
    write_atomically(target, form(area, seen, met))
    return target


def _json(area: Area, seen: Sequence[Seen], met: Sequence[Met]) -> str:
    """Planned and flown paths, with the time of each position, and the nearest of each pair."""
    features: list[Mapping[str, object]] = []
    for one in seen:
        told = {"vehicle": one.name, "stroke": one.colour}
        features += [feature_of(area, points, kind="planned", **told) for points in one.plans]
        t_s = (one.track.t_ns / NS_PER_S).tolist()
        features.append(feature_of(area, one.track.pos_m, kind="flown", t_s=t_s, **told))
    for near in met:
        nearest: dict[str, object] = {"t_s": near.t_s, "separation_m": near.away_m}
        at_m = near.at_m[None]
        features.append(feature_of(area, at_m, kind="nearest", pair=near.name, **nearest))
    return geojson(features)


def _kml(area: Area, seen: Sequence[Seen], met: Sequence[Met]) -> bytes:
    root = ET.Element("kml", xmlns=KML)
    document = ET.SubElement(root, "Document")
    for n, one in enumerate(seen):
        style(document, f"flown{n}", one.colour, 2)
        style(document, f"planned{n}", one.colour, 5)
        folder = named(document, "Folder", one.name)
        for points in one.plans:
            line(folder, "planned", f"planned{n}", coordinates(area, points))
        line(folder, "flown", f"flown{n}", coordinates(area, one.track.pos_m))
    for near in met:
        point = ET.SubElement(named(document, "Placemark", near.words), "Point")
        text(point, "altitudeMode", "absolute")
        text(point, "coordinates", coordinates(area, near.at_m[None]))
    ET.indent(root)
    found: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return found


def _mcap(area: Area, seen: Sequence[Seen], met: Sequence[Met]) -> bytes:
    """A frame and a topic of its place for each aircraft, a scene of all paths and of where two
    were nearest, and a topic of the distance of each pair."""
    context, channels = foxglove.Context(), dict[str, Callable[[bytes, int], None]]()

    def write(topic: str, kind: object, t_ns: int, data: bytes) -> None:
        topic = re.sub(r"[^\w/-]+", "_", topic)  # viewers take a dot for the begin of a field
        if topic not in channels:
            schema = kind.get_schema() if hasattr(kind, "get_schema") else kind
            form = "json" if schema is kind else "protobuf"
            made = context._create_channel(topic, message_encoding=form, schema=schema)
            channels[topic] = made.log
        channels[topic](data, t_ns)

    distance = foxglove.Schema(name="aerofed.Distance", encoding="jsonschema", data=_DISTANCE)
    begin_ns = min(int(one.track.t_ns[0]) for one in seen)
    file = BytesIO()
    options = MCAPWriteOptions(disable_seeking=True)
    with foxglove.open_mcap(file, context=context, writer_options=options):
        paths = [
            (one.name, one.colour, width, points)
            for one in seen
            for width, each in ((6.0, one.plans), (2.0, [one.track.pos_m]))
            for points in each
        ]
        drawn = scene.world(begin_ns, paths, [(near.at_m, near.words) for near in met])
        write("/scene/world", fox.SceneUpdate, begin_ns, drawn)
        for one in seen:
            end_ns = int(one.track.t_ns[-1])
            t_ns = np.append(np.arange(one.track.t_ns[0], end_ns, _SHOWN_NS), end_ns)
            pos_m = one.track.at(t_ns).pos_m
            places = on_globe(area, pos_m[:, :2], pos_m[:, 2])
            for at_ns, (x, y, z), place in zip(t_ns.tolist(), pos_m.tolist(), places, strict=True):
                stamp = timestamp(at_ns)
                moved = encoded(fox.FrameTransform(timestamp=stamp, parent_frame_id=FRAME,
                    child_frame_id=one.name, translation=fox.Vector3(x=x, y=y, z=z),
                    rotation=fox.Quaternion(w=1.0),
                ))  # fmt: skip
                write("/tf", fox.FrameTransform, at_ns, moved)
                fix = encoded(fox.LocationFix(timestamp=stamp, latitude=place.lat_deg,
                    longitude=place.lon_deg, altitude=place.alt_msl_m,
                ))  # fmt: skip
                write(f"/{one.name}/location", fox.LocationFix, at_ns, fix)
        for near in met:
            known = np.isfinite(near.distances_m)
            rows = zip(near.times_s[known], near.distances_m[known], strict=True)
            for t_s, away_m in rows:
                data = to_bytes({"away_m": float(away_m)})
                write(f"/separation/{near.name}", distance, round(t_s * NS_PER_S), data)
    return file.getvalue()
