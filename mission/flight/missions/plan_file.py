"""Plan files of ground stations: QGroundControl's `.plan` and the MAVLink waypoint format.

Formats: QGroundControl developer guide, "Plan File Format"; MAVLink guide, "Plain-text file
format" (QGC WPL 110).
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError
from pymavlink.dialects.v20 import common as mav

from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.base.errors import InputError
from mission.base.run_folder import write_atomically
from mission.base.user_files import decoded, or_input_error, read_bytes, taken_by
from mission.flight.missions.geofence import airspace_rings, fence_items
from mission.flight.missions.qgroundcontrol import SCANS, Document
from mission.flight.missions.round_mission import FlightPlan, mission_items
from sitl.autopilot.codec.orders import ABSOLUTE_FRAMES, MissionItem, command_name
from sitl.autopilot.protocol.order_rules import ABSENT, COMMANDS

HEADER = "QGC WPL 110"
WAYPOINT_FILES = (".waypoints", ".txt", ".mission")
_HOME_COMMANDS = (0, mav.MAV_CMD_NAV_WAYPOINT)
_COLUMNS = 12
_PX4, _MULTIROTOR = 12, 2  # MAV_AUTOPILOT, MAV_TYPE


@dataclass(frozen=True)
class PlanFile:
    """The items of a plan file, each kind counted from 0, as they stand there."""

    path: Path
    content: bytes
    home: GeodeticPoint | None  # altitude NaN where the file gives none; None: no home planned
    items: tuple[MissionItem, ...]  # without the home that a waypoint file starts with
    fence: tuple[MissionItem, ...] = ()
    rally: tuple[MissionItem, ...] = ()


def read_plan_file(path: Path) -> PlanFile:
    """Read a `.plan` or a waypoint file (`.waypoints`, `.txt`, `.mission`).

    Raises:
        InputError: it cannot be read, is damaged or empty, or holds what nobody here can fly.
    """
    kinds = {".plan": _read_qgroundcontrol, **dict.fromkeys(WAYPOINT_FILES, _read_waypoints)}
    read = kinds.get(path.suffix.lower())
    if read is None:
        others = ", ".join(WAYPOINT_FILES)
        raise InputError(f"{path}: neither a .plan nor a waypoint file ({others}){taken_by(path)}")
    content = read_bytes(path)
    text = decoded(content, path)
    if not text.strip():
        raise InputError(f"{path}: the file is empty")
    return read(path, content, text)


def _read_qgroundcontrol(path: Path, content: bytes, text: str) -> PlanFile:
    try:
        document = Document.model_validate_json(text)
    except ValidationError as error:
        raise InputError(f"{path}: not a QGroundControl plan: {_error_text(error)}") from None
    simple = [item for part in document.mission.items for item in part.flown()]
    if not simple:
        raise InputError(f"{path}: the mission is empty")
    numbers = {part.doJumpId: seq for seq, part in reversed(list(enumerate(simple)))}
    items = []
    for seq, part in enumerate(simple):
        params = [math.nan if value is None else value for value in part.params]
        if part.command == mav.MAV_CMD_DO_JUMP:
            if params[0] not in numbers:
                raise InputError(
                    f"{path}: item {seq}, {command_name(part.command)}: jumps to doJumpId = "
                    f"{params[0]:g}, which no item has"
                )
            params[0] = numbers[int(params[0])]
        items.append(_item(seq, part.command, part.frame, params, autocontinue=part.autoContinue))
    kind, command = mav.MAV_MISSION_TYPE_RALLY, mav.MAV_CMD_NAV_RALLY_POINT
    rally = [
        _item(seq, command, 3, (0, 0, 0, 0, *point), kind=kind)
        for seq, point in enumerate(document.rallyPoints.points)
    ]
    planned = document.mission.plannedHomePosition or (None, None)
    home = _home(path, *(math.nan if value is None else value for value in planned))
    drawn = document.geoFence
    rings = [(True, drawn.polygon), *((ring.inclusion, ring.polygon) for ring in drawn.polygons)]
    circles = ((c.inclusion, c.circle.radius, c.circle.center) for c in drawn.circles)
    fence = fence_items(rings, circles)
    if drawn.breachReturn is not None:
        kind, command = mav.MAV_MISSION_TYPE_FENCE, mav.MAV_CMD_NAV_FENCE_RETURN_POINT
        fence += (_item(len(fence), command, 3, (0, 0, 0, 0, *drawn.breachReturn), kind=kind),)
    return PlanFile(path, content, home, tuple(items), fence, tuple(rally))


def _error_text(error: ValidationError) -> str:
    """What is wrong with a document, in a line: where, what, and the value."""
    wrong = error.errors()[0]
    where = ""
    for part in wrong["loc"]:
        if part not in ("SimpleItem", "ComplexItem", *SCANS):  # the branch of the union
            where += f"[{part}]" if isinstance(part, int) else f".{part}"
    value = wrong["input"]
    whole = isinstance(value, dict | list) or (isinstance(value, str) and where == "")
    shown = "" if wrong["type"] == "missing" or whole else f" = {value!r}"
    said = wrong["msg"].removeprefix("Value error, ")
    return f"{where[1:]}{shown[:80]}: {said}".removeprefix(": ")


def _item(
    seq: int,
    command: int,
    frame: int,
    params: Sequence[float],
    *,
    kind: int = mav.MAV_MISSION_TYPE_MISSION,
    autocontinue: bool = True,
) -> MissionItem:
    """An item of seven parameters; places as exact as they travel, 1e-7 degrees.

    Planners fill the columns of a place in every row: of items without one they are dropped.
    """
    one, two, three, four, x, y, z = params
    first = one, two, three, four
    if command in COMMANDS - ABSENT.keys() and not mav.enums["MAV_CMD"][command].has_location:
        x = y = z = 0.0
    return MissionItem(seq, command, frame, first, round(x, 7), round(y, 7), z, kind, autocontinue)


def _read_waypoints(path: Path, content: bytes, text: str) -> PlanFile:
    # ArduPilot's own files have comments.
    lines = enumerate((line.partition("#")[0].split() for line in text.splitlines()), start=1)
    (_, header), *numbered = [(number, cells) for number, cells in lines if cells] or [(1, [])]
    if header != HEADER.split():
        raise InputError(f"{path}: not a waypoint file: the first line is not {HEADER!r}")
    rows = [_row(path, number, cells) for number, cells in numbered]
    for index, row in enumerate(rows):
        if row[0] != index:
            raise InputError(f"{path}: damaged: item {index} is missing, {row[0]:g} stands there")
    home = None
    # By convention row 0 is the home: a waypoint at a height above the sea, or at none above home.
    # Mission Planner's has no command.
    if rows and rows[0][3] in _HOME_COMMANDS and (rows[0][2] in ABSOLUTE_FRAMES or not rows[0][10]):
        lat_deg, lon_deg, alt_m = rows[0][8:11]
        above_sea = rows[0][2] in ABSOLUTE_FRAMES
        home = _home(path, lat_deg, lon_deg, alt_m if above_sea else math.nan)
        rows = [_counted_without_home(row) for row in rows[1:]]
    if not rows:
        raise InputError(f"{path}: the mission is empty")
    items = (
        _item(seq, int(row[3]), int(row[2]), row[4:11], autocontinue=bool(row[11]))
        for seq, row in enumerate(rows)
    )
    return PlanFile(path, content, home, tuple(items))


def _counted_without_home(row: Sequence[float]) -> Sequence[float]:
    jumps = row[3] == mav.MAV_CMD_DO_JUMP
    return [*row[:4], row[4] - 1.0, *row[5:]] if jumps else row


def _row(path: Path, number: int, cells: Sequence[str]) -> Sequence[float]:
    """Parse twelve columns: index, current, frame, command, seven parameters, autocontinue."""
    try:
        row = [float(cell) for cell in cells]
    except ValueError:
        row = []
    if len(row) != _COLUMNS:
        raise InputError(f"{path}: damaged: line {number} does not have {_COLUMNS} numbers")
    if not all(value.is_integer() for value in (*row[:4], row[11])):
        raise InputError(f"{path}: damaged: line {number}: index, frame or command is no integer")
    return row


def _home(
    path: Path, lat_deg: float, lon_deg: float, alt_m: float = math.nan
) -> GeodeticPoint | None:
    """The planned home; None where zeros or nothing stand in its place."""
    if lat_deg == lon_deg == 0.0 or (math.isnan(lat_deg) and math.isnan(lon_deg)):
        return None
    return checked_home(path, lat_deg, lon_deg, alt_m)


def checked_home(
    path: Path,
    lat_deg: float,
    lon_deg: float,
    alt_msl_m: float = math.nan,
    *,
    name: str = "planned home",
) -> GeodeticPoint:
    """Return the home of a plan file (called `name` in errors); its altitude is NaN if not given.

    Raises:
        InputError: latitude, longitude or altitude is out of range.
    """
    no_height = math.isnan(alt_msl_m)
    if not (
        abs(lat_deg) <= 85 and abs(lon_deg) <= 180 and (no_height or -400 <= alt_msl_m <= 5000)
    ):
        height = "" if no_height else f", {alt_msl_m} m"
        raise InputError(
            f"{path}: {name} {lat_deg}, {lon_deg}{height}: latitude is -85..85, "
            "longitude -180..180 deg, altitude -400..5000 m"
        )
    return GeodeticPoint(lat_deg, lon_deg, alt_msl_m)


def write_round_plan(path: Path, plan: FlightPlan, area: Area) -> None:
    """Write a round's flight as a `.plan` file: the very items that are uploaded.

    Raises:
        InputError: it cannot be written.
    """
    items = []
    for item in mission_items(plan, area):
        place = item.command != mav.MAV_CMD_DO_CHANGE_SPEED
        at = item.x, item.y, item.z
        where = {"Altitude": item.z, "AltitudeMode": 1, "AMSLAltAboveTerrain": None}
        items.append(
            {
                **(where if place else {}),
                "autoContinue": True,
                "command": item.command,
                "doJumpId": item.seq + 1,
                "frame": mav.MAV_FRAME_GLOBAL_RELATIVE_ALT if place else mav.MAV_FRAME_MISSION,
                "params": [*(None if math.isnan(p) else p for p in item.params), *at],
                "type": "SimpleItem",
            }
        )
    home = area.home
    polygons = [
        {"inclusion": keep_in, "polygon": corners, "version": 1}
        for keep_in, corners in airspace_rings(area)
    ]
    document = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "Aerofed",
        "geoFence": {"circles": [], "polygons": polygons, "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {
            "version": 2,
            "firmwareType": _PX4,
            "vehicleType": _MULTIROTOR,
            "cruiseSpeed": plan.speed_mps,
            "hoverSpeed": plan.speed_mps,
            "globalPlanAltitudeMode": 1,
            "plannedHomePosition": [home.lat_deg, home.lon_deg, home.alt_msl_m],
            "items": items,
        },
    }
    with or_input_error(path, "cannot write"):
        path.parent.mkdir(exist_ok=True)
    write_atomically(path, json.dumps(document, indent=2, allow_nan=False) + "\n")
