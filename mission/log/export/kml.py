"""A log as KML 2.2 (OGC 07-147r2), for Google Earth and maps."""

from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.base.palette import FENCE, FLOWN, PLANNED, community_colour
from mission.base.run_folder import write_atomically
from mission.log.read.reader import read_log
from mission.log.values import FlightData, Track

_KML = "http://www.opengis.net/kml/2.2"


def export_kml(path: Path, target: Path) -> Path:
    """Write devices, planned and flown paths as KML, heights above sea level.

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
    if data.fence:
        _style(document, "fence", FENCE, 2)
        lines = _folder(document, "fence")
        for zone in data.fence:
            ground = np.column_stack((zone.outline_m, np.zeros(len(zone.outline_m))))
            closed = np.vstack((ground, ground[:1]))
            name = "fence" if zone.keep_in else "no entry"
            _line(lines, name, "fence", _coordinates(data, closed))
    planned, flown = _folder(document, "planned"), _folder(document, "flown")
    for plan in data.plans:
        points = np.column_stack((plan.route_m, plan.route_height_m))
        _line(planned, f"round {plan.round}", "planned", _coordinates(data, points))
    for name, track in _pieces(data):
        _line(flown, name, "flown", _coordinates(data, track.pos_m))
    ET.indent(root)
    write_atomically(target, ET.tostring(root, encoding="utf-8", xml_declaration=True))
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
