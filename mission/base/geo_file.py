"""Places and areas out of files that other programs write: CSV tables and GeoJSON (RFC 7946).

What is read is as it stands in the file; `mission.config.world` puts it on a run's ground.
"""

import csv
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from mission.base.errors import InputError
from mission.base.explain import shown
from mission.base.tables import count
from mission.base.user_files import read_json, read_text

Pair = tuple[float, float]

# Names of columns, of which the first is the one that messages name.
_X, _Y = ("x", "x_m"), ("y", "y_m")
_LAT, _LON = ("lat", "lat_deg", "latitude"), ("lon", "lon_deg", "lng", "longitude")
MOST_CORNERS = 500  # of all outlines together: the ways around them take their cube
_METRES = 100_000.0, "m"  # from an area's corner, as for the places in a configuration
# Nearer to a pole no flight is configured.
_MOST = {"lat": (85.0, "degrees"), "lon": (180.0, "degrees"), "x": _METRES, "y": _METRES}
_HOLDS_POINTS = "a point a device (GeoJSON), or a table with columns x, y or lat, lon (CSV)"
_POLYGONS = ("Polygon", "MultiPolygon")
# Properties of a building, by OpenStreetMap's names.
_TELL = ("building", "building:part", "height", "building:levels")
_HOLDS_AREAS = "Polygons or MultiPolygons (GeoJSON)"


@dataclass(frozen=True)
class Place:
    """A point read from a CSV or GeoJSON file: a device's position, or a corner of an area."""

    where: str  # file and row, for messages
    at: Pair  # x, y in metres; of a `geodetic` one latitude, longitude in degrees
    geodetic: bool
    community: str | None = None
    share: float | None = None  # of the community's data, against its other devices


@dataclass(frozen=True)
class Ring:
    """The outline of an area in a GeoJSON file."""

    where: str
    corners_deg: tuple[Pair, ...]  # latitude, longitude; the last joins the first
    holes_deg: tuple[tuple[Pair, ...], ...]
    properties: Mapping[str, object]


def read_places(path: Path) -> tuple[Place, ...]:
    """Read the device positions in a CSV or GeoJSON file, in its order.

    Raises:
        InputError: it cannot be read, or a row or feature is no position; the message names it.
    """
    if path.suffix.lower() in (".geojson", ".json"):
        places = tuple(_geojson_places(path))
    elif path.suffix.lower() == ".csv":
        places = tuple(_table_places(path, read_text(path)))
    else:
        raise InputError(f"{path}: must end in .csv, .geojson or .json, and hold {_HOLDS_POINTS}")
    if not places:
        raise InputError(f"{path}: holds no device; it must hold {_HOLDS_POINTS}")
    return places


def read_rings(path: Path) -> tuple[Ring, ...]:
    """The outlines in a GeoJSON file; a MultiPolygon is several.

    Raises:
        InputError: it cannot be read, or something in it is no area.
    """
    rings = tuple(ring for feature in _features(path) for ring in _rings(*feature, holes=False))
    if not rings:
        raise InputError(f"{path}: holds no area; it must hold {_HOLDS_AREAS}")
    return rings


def _is_building(properties: Mapping[str, object]) -> bool:
    said = {name: value for name in _TELL if (value := properties.get(name)) is not None}
    kinds = [said[name] for name in _TELL[:2] if name in said]
    return bool(said) and (not kinds or any(kind != "no" for kind in kinds))


def read_buildings(path: Path) -> tuple[tuple[Ring, ...], int]:
    """Read outlines of buildings, with holes, in a GeoJSON file, and count the features skipped:
    points, lines, and polygons without a property of a building or which say that there is none.

    Raises:
        InputError: it cannot be read, a polygon of a building is none, or there is no building.
    """
    every = list(_features(path))
    buildings = [
        feature for feature in every if feature[1] in _POLYGONS and _is_building(feature[3])
    ]
    rings = tuple(ring for feature in buildings for ring in _rings(*feature, holes=True))
    if not rings:
        raise InputError(
            f"{path}: holds no building; it must hold Polygons or MultiPolygons (GeoJSON) with "
            "building, height or building:levels"
        )
    return rings, len(every) - len(buildings)


def _check(where: str, names: tuple[str, str], pair: Pair) -> None:
    """Refuse a coordinate out of range; say where latitude and longitude seem swapped."""
    for name, value in zip(names, pair, strict=True):
        most, unit = _MOST[name]
        if abs(value) > most:
            swapped = name == "lat" and abs(value) <= 180.0 and abs(pair[1]) <= most
            hint = "; are lat and lon swapped?" if swapped else ""
            raise InputError(
                f"{where}: {name} = {value:g}: must be from {-most:g} to {most:g} {unit}{hint}"
            )


def _table_places(path: Path, text: str) -> Iterator[Place]:
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        head = [name.strip().lower() for name in next(reader, [])]
        first, second, geodetic = _columns(path, head)
        community, share = (_at(head, (name,)) for name in ("community", "share"))
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            where = f"{path}: row {reader.line_num}"
            if len(cells) != len(head):
                raise InputError(f"{where}: has {len(cells)} cells, the header has {len(head)}")
            pair = (_number(where, head[i], cells[i].strip()) for i in (first, second))
            one, other = pair
            _check(where, ("lat", "lon") if geodetic else ("x", "y"), (one, other))
            yield Place(
                where,
                (one, other),
                geodetic,
                None if community is None else cells[community].strip() or None,
                None if share is None else _share(where, cells[share].strip()),
            )
    except csv.Error as error:
        raise InputError(f"{path}: row {reader.line_num}: no CSV: {error}") from None


def _columns(path: Path, head: list[str]) -> tuple[int, int, bool]:
    """Find the columns of x and y, or of latitude and longitude (then True): their indices."""
    if twice := next((name for name in head if name and head.count(name) > 1), None):
        raise InputError(f"{path}: row 1: the column {twice} is there twice")
    found = []
    for pair, geodetic in (((_X, _Y), False), ((_LAT, _LON), True)):
        first, second = (_at(head, names) for names in pair)
        if first is not None and second is not None:
            found.append((first, second, geodetic))
    if len(found) > 1:
        raise InputError(f"{path}: row 1: has metres and degrees; leave x and y, or lat and lon")
    if found:
        return found[0]
    needed = (
        "there must be x and y (metres east and north of the area's south-west corner), or lat and "
        "lon (degrees)"
    )
    if not any(head):
        raise InputError(f"{path}: row 1: has no names of columns; {needed}")
    # What spreadsheets write where the comma is the decimal sign.
    commas = "; commas separate columns" if len(head) == 1 and ";" in head[0] else ""
    raise InputError(f"{path}: row 1: the columns are {', '.join(head)}{commas}; {needed}")


def _at(head: list[str], names: tuple[str, ...]) -> int | None:
    return next((head.index(name) for name in names if name in head), None)


def _number(where: str, name: str, value: object) -> float:
    """A finite number, from a cell or from JSON."""
    try:
        number = math.nan
        if isinstance(value, str | int | float) and not isinstance(value, bool):
            number = float(value)
    except (ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{where}: {name} = {shown(value)}: must be a number")
    return number


def _share(where: str, value: object) -> float | None:
    """Parse a device's data share; None for an empty cell, as a run without shares writes it."""
    if value in (None, ""):
        return None
    share = _number(where, "share", value)
    if not 0.0 < share <= 1e6:
        raise InputError(
            f"{where}: share = {share:g}: must be above 0 and at most 1000000; it counts against "
            "the shares of the community's other devices"
        )
    return share


def _geojson_places(path: Path) -> Iterator[Place]:
    for where, kind, coordinates, properties in _features(path):
        if kind != "Point":
            raise InputError(f"{where}: geometry is {shown(kind)}: must be 'Point', one a device")
        lat, lon = _position(where, coordinates)
        name, share = properties.get("community"), properties.get("share")
        if name is not None and not isinstance(name, str):
            raise InputError(f"{where}: community = {shown(name)}: must be text")
        yield Place(where, (lat, lon), True, name or None, _share(where, share))


def _features(path: Path) -> Iterator[tuple[str, object, object, Mapping[str, object]]]:
    """Place in the file, kind, coordinates and properties of every geometry."""
    data = read_json(path)
    if not isinstance(data, dict) or "type" not in data:
        raise InputError(f"{path}: not GeoJSON: a FeatureCollection is wanted")
    listed = data.get("features") if data["type"] == "FeatureCollection" else [data]
    if not isinstance(listed, list):
        raise InputError(f"{path}: features = {shown(listed)}: must be a list")
    for index, item in enumerate(listed):
        where = f"{path}: features[{index}]" if listed is data.get("features") else str(path)
        feature = item if isinstance(item, dict) else {}
        geometry = feature.get("geometry") if feature.get("type") == "Feature" else feature
        if not isinstance(geometry, dict) or "coordinates" not in geometry:
            raise InputError(f"{where}: no Feature with a geometry that has coordinates")
        properties = feature.get("properties")
        yield (
            where,
            geometry.get("type"),
            geometry["coordinates"],
            properties if isinstance(properties, dict) else {},
        )


def _position(where: str, coordinates: object) -> Pair:
    """Convert a GeoJSON position [lon, lat] to (latitude, longitude) in degrees."""
    if not isinstance(coordinates, list) or len(coordinates) not in (2, 3):
        raise InputError(f"{where}: coordinates = {shown(coordinates)}: must be [lon, lat]")
    lon, lat = (
        _number(where, name, value)
        for name, value in zip(("lon", "lat"), coordinates, strict=False)
    )
    _check(where, ("lat", "lon"), (lat, lon))
    return lat, lon


def _rings(
    where: str, kind: object, coordinates: object, properties: Mapping[str, object], *, holes: bool
) -> Iterator[Ring]:
    if kind not in _POLYGONS:
        raise InputError(f"{where}: geometry is {shown(kind)}: must be 'Polygon' or 'MultiPolygon'")
    polygons = [coordinates] if kind == "Polygon" else coordinates
    for rings in polygons if isinstance(polygons, list) else [None]:
        if not isinstance(rings, list) or not rings or not all(isinstance(r, list) for r in rings):
            raise InputError(f"{where}: coordinates = {shown(rings)}: must be a list of rings")
        if len(rings) > 1 and not holes:
            found = count(len(rings) - 1, "hole")
            raise InputError(f"{where}: has {found}: an area must have none")
        outline, *inner = [_corners(where, ring) for ring in rings]
        yield Ring(where, outline, tuple(inner), properties)


def _corners(where: str, ring: list[object]) -> tuple[Pair, ...]:
    if len(ring) > MOST_CORNERS + 1:
        raise InputError(
            f"{where}: a ring of {len(ring)} positions: an area has {MOST_CORNERS} corners "
            "at most; simplify it"
        )
    corners = [_position(where, position) for position in ring]
    if len(corners) < 4 or corners[0] != corners[-1]:
        raise InputError(
            f"{where}: a ring of {len(corners)} positions: there must be 4 at least, the last "
            "the same as the first"
        )
    return tuple(corners[:-1])
