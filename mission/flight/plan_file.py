"""Plan files of ground stations, read: QGroundControl's `.plan` and the MAVLink waypoint format.

Files are interpreted by MAVSDK's own importer (`pilot.importer`). It takes a word for a zero and a
short list for one with zeros, so the form is verified here first; the files are also read here
for what the importer leaves out, the planned home. Formats: QGroundControl developer guide,
"Plan File Format"; MAVLink guide, "Plain-text file format" (QGC WPL 110).
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flightdyn.state import GeodeticPoint
from mission.base.errors import InputError
from sitl.autopilot.codec.names import command_name
from sitl.autopilot.protocol.item_rules import PLACES
from sitl.autopilot.values.enums import GLOBAL_FRAMES, Command

HEADER = "QGC WPL 110"
MAX_BYTES = 10_000_000  # thousands of items; more is no mission
_FRAME_ABSOLUTE = 0
_NAV_WAYPOINT = 16
_COLUMNS = 12
_HERE = (Command.NAV_TAKEOFF, Command.NAV_LAND)  # need no place of their own
_RANGES = {"latitude": 90.0, "longitude": 180.0}


@dataclass(frozen=True)
class PlanFile:
    """A plan file of sound form, before its items are looked at."""

    path: Path
    text: str  # as the importer likes it: no byte-order mark, bare newlines, no blank lines
    home: GeodeticPoint | None  # altitude NaN where the file gives none; None: no home planned
    home_is_item: bool  # the importer hands the home out as item 0

    @property
    def is_qgroundcontrol(self) -> bool:
        """`.plan` (JSON) rather than waypoints (text)."""
        return self.path.suffix.lower() == ".plan"


def read_plan_file(path: Path) -> PlanFile:
    """Read a `.plan` or `.waypoints` file and verify its form.

    Raises:
        InputError: it cannot be read, is damaged or empty, or holds what nobody here can fly.
    """
    kinds = {".plan": _read_qgroundcontrol, ".waypoints": _read_waypoints}
    read = kinds.get(path.suffix.lower())
    if read is None:
        raise InputError(f"{path}: neither a .plan nor a .waypoints file")
    try:
        content = path.read_bytes()
        text = content.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot read the plan: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: damaged: not UTF-8 text") from None
    if len(content) > MAX_BYTES:
        raise InputError(f"{path}: {len(content)} bytes; a plan has {MAX_BYTES} at most")
    if not text.strip():
        raise InputError(f"{path}: the file is empty")
    return read(path, "\n".join(line for line in text.splitlines() if line.strip()) + "\n")


def _read_qgroundcontrol(path: Path, text: str) -> PlanFile:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: damaged: not valid JSON: {error}") from None
    if not isinstance(document, dict) or document.get("fileType") != "Plan":
        raise InputError(f'{path}: not a QGroundControl plan: fileType is not "Plan"')
    mission = document.get("mission")
    items = mission.get("items") if isinstance(mission, dict) else None
    if not isinstance(mission, dict) or not isinstance(items, list):
        raise InputError(f"{path}: damaged: it has no mission.items")
    if not items:
        raise InputError(f"{path}: the mission is empty")
    for index, item in enumerate(items):
        _check_json_item(path, f"mission.items[{index}]", item)
    for part in ("geoFence", "rallyPoints"):
        if not isinstance(document.get(part, {}), dict):
            raise InputError(f"{path}: damaged: {part} is no table")
    _check_rally(path, document.get("rallyPoints", {}).get("points", []))
    return PlanFile(path, text, _json_home(path, mission), home_is_item=False)


def _check_json_item(path: Path, where: str, item: object) -> None:
    if not isinstance(item, dict):
        raise InputError(f"{path}: damaged: {where} is no table")
    kind = item.get("type")
    if kind == "ComplexItem":
        name = item.get("complexItemType")
        transects = item.get("TransectStyleComplexItem")
        inner = transects.get("Items") if isinstance(transects, dict) else None
        if name != "survey" or not isinstance(inner, list):
            raise InputError(f"{path}: {where}: complex item {name!r} cannot be flown")
        for index, part in enumerate(inner):
            _check_json_item(path, f"{where}.TransectStyleComplexItem.Items[{index}]", part)
        return
    if kind != "SimpleItem":
        raise InputError(f"{path}: {where}: type is {kind!r}, neither SimpleItem nor ComplexItem")
    for key in ("command", "frame"):
        if type(item.get(key)) is not int:
            raise InputError(f"{path}: damaged: {where}.{key} = {item.get(key)!r} is no number")
    params = item.get("params")
    if not isinstance(params, list) or len(params) != 7 or not all(map(_is_param, params)):
        raise InputError(f"{path}: damaged: {where}.params are not seven numbers: {params!r}")
    if item["frame"] in GLOBAL_FRAMES and item["command"] in PLACES:
        if params[4] is params[5] is None and item["command"] in _HERE:
            return
        for index, name in enumerate(_RANGES, start=4):
            _check_degrees(f"{path}: {where}.params[{index}]", item["command"], name, params[index])


def _check_degrees(where: str, command: int, name: str, value: float | None) -> None:
    """Refuse what is no latitude or longitude of a place; the importer takes null for a zero."""
    most = _RANGES[name]
    if value is None or abs(value) > most:
        shown = "null" if value is None else f"{value:g}"
        raise InputError(
            f"{where} = {shown}: the {name} of {command_name(command)} must be from {-most:g} to "
            f"{most:g} degrees"
        )


def _check_rally(path: Path, points: object) -> None:
    if not isinstance(points, list):
        raise InputError(f"{path}: damaged: rallyPoints.points is no list")
    for index, point in enumerate(points):
        if not isinstance(point, list) or len(point) != 3 or not all(map(_is_number, point)):
            raise InputError(
                f"{path}: damaged: rallyPoints.points[{index}] = {point!r}: must be latitude, "
                "longitude and height above home"
            )


def _is_param(value: object) -> bool:
    return value is None or _is_number(value)


def _is_number(value: object) -> bool:
    """A finite number; JSON's readers take NaN and Infinity too."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _json_home(path: Path, mission: dict[str, object]) -> GeodeticPoint | None:
    values = mission.get("plannedHomePosition")
    if values is None:
        return None
    numbers = values if isinstance(values, list) else []
    if len(numbers) not in (2, 3) or not all(map(_is_number, numbers[:2])):
        raise InputError(f"{path}: damaged: mission.plannedHomePosition = {values!r}")
    altitude = numbers[2] if len(numbers) == 3 else None
    if altitude is not None and not _is_number(altitude):
        raise InputError(f"{path}: damaged: mission.plannedHomePosition = {values!r}")
    return _home(path, numbers[0], numbers[1], math.nan if altitude is None else altitude)


def _read_waypoints(path: Path, text: str) -> PlanFile:
    header, *lines = text.splitlines()
    if header.strip() != HEADER:
        raise InputError(f"{path}: not a waypoint file: the first line is not {HEADER!r}")
    rows = [_waypoint_row(path, number, line) for number, line in enumerate(lines, start=2)]
    if not rows:
        raise InputError(f"{path}: the mission is empty")
    for index, row in enumerate(rows):
        if row[0] != index:
            raise InputError(f"{path}: damaged: item {index} is missing, {row[0]:g} stands there")
    # By convention row 0 is the home; the importer hands it out like any other item.
    first = rows[0]
    has_home = first[2] == _FRAME_ABSOLUTE and first[3] == _NAV_WAYPOINT
    if has_home and len(rows) == 1:
        raise InputError(f"{path}: the mission is empty")
    home = _home(path, first[8], first[9], first[10]) if has_home else None
    return PlanFile(path, text, home, home_is_item=has_home)


def _waypoint_row(path: Path, number: int, line: str) -> Sequence[float]:
    cells = line.split()
    try:
        row = [float(cell) for cell in cells]
    except ValueError:
        row = []
    if len(row) != _COLUMNS or not all(map(math.isfinite, row)):
        raise InputError(f"{path}: damaged: line {number} does not have {_COLUMNS} numbers")
    if any(value != int(value) for value in (*row[:4], row[11])):
        raise InputError(f"{path}: damaged: line {number}: index, frame or command is no integer")
    command = int(row[3])
    if row[2] in GLOBAL_FRAMES and command in PLACES:
        for column, name in enumerate(_RANGES, start=8):
            where = f"{path}: line {number}: column {column + 1}"
            _check_degrees(where, command, name, row[column])
    return row


def _home(path: Path, lat_deg: float, lon_deg: float, alt_msl_m: float) -> GeodeticPoint:
    high_enough = math.isnan(alt_msl_m) or -400 <= alt_msl_m <= 5000
    if not (abs(lat_deg) <= 85 and abs(lon_deg) <= 180 and high_enough):
        raise InputError(
            f"{path}: planned home {lat_deg}, {lon_deg}, {alt_msl_m} m: latitude is -85..85, "
            "longitude -180..180 deg, altitude -400..5000 m"
        )
    return GeodeticPoint(float(lat_deg), float(lon_deg), float(alt_msl_m))
