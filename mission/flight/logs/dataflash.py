"""ArduPilot's DataFlash log (.bin) as a flight."""

import io
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any

from pymavlink.DFReader import DFReader_binary
from pymavlink.dialects.v20 import common as mav
from pymavlink.mavutil import mode_mapping_acm

from mission.base.errors import InputError
from mission.base.user_files import check_regular
from mission.flight.logs.flight import MOST_BYTES, Found
from mission.log.values import FlightData
from sitl.autopilot.codec.orders import MissionItem

_MAGIC = b"\xa3\x95"
_MISSION, _RELATIVE = mav.MAV_MISSION_TYPE_MISSION, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT
_READ = (
    *("POS", "MODE", "MSG", "ORGN", "CMD", "MISE", "GPS", "BAT", "XKF2", "ERR", "ARM", "EV"),
    *("FNCE", "RALY"),
)
_FENCE = {  # FNCE.Type: AC_PolyFenceType
    98: mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    97: mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    **dict.fromkeys((92, 94), mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION),
    **dict.fromkeys((93, 96), mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION),
    95: mav.MAV_CMD_NAV_FENCE_RETURN_POINT,
}
_VEHICLES = ("ArduPlane", "ArduRover", "Rover", "ArduSub", "AntennaTracker", "Blimp")
_FIX_3D = 3
_ARMED, _DISARMED = 10, 11  # EV
_HOME = 1  # ORGN.Type; 0: the origin of its filter
# ERR.Subsys of the failsafes: LogErrorSubsystem.
_FAILSAFES = {
    5: "radio", 6: "battery", 7: "GPS", 8: "ground station", 9: "fence", 17: "EKF", 19: "CPU",
    20: "ADSB", 23: "terrain", 26: "sensors", 29: "vibration", 31: "dead reckoning",
}  # fmt: skip


def read_dataflash(path: Path) -> FlightData:
    """The flight in a DataFlash log.

    Raises:
        InputError: it cannot be read, has no positions, or another kind of vehicle flew. Whatever
            the library raises of a damaged one passes through.
    """
    check_regular(path, most=MOST_BYTES)
    with path.open("rb") as file:
        if file.read(2) != _MAGIC:
            raise InputError(f"{path}: not a DataFlash log: it does not begin as one")
    reader = _Reader(Found(path, "DataFlash of ArduPilot", "seconds since ArduPilot started"))
    said = io.StringIO()  # by the library, a line for each byte that begins nothing
    with redirect_stderr(said):
        log = DFReader_binary(str(path))
        try:
            while (row := log.recv_match(type=list(_READ))) is not None:
                reader.take(row)
            lengths = ((log.offsets[kind], form.len) for kind, form in log.formats.items())
            end = max((found[-1] + length for found, length in lengths if found), default=0)
            reader.found.skipped["message that the end cut off"] += int(end != log.data_len)
        finally:
            log.close()
    reader.found.skipped["byte with damage"] += said.getvalue().count("bad header")
    return reader.found.flight()


class _Reader:
    """Takes the rows of a log one after another."""

    def __init__(self, found: Found) -> None:
        self.found = found
        self._lists: dict[int, dict[int, MissionItem]] = {}  # by MAV_MISSION_TYPE

    def take(self, row: Any) -> None:
        """Keep what a row says."""
        found, kind, t_ns = self.found, row.get_type(), int(row.TimeUS) * 1000
        match kind:
            case "POS":
                found.places.append((t_ns, row.Lat, row.Lng, row.Alt))
            case "ORGN" if row.Type == _HOME:
                found.homes.append((t_ns, row.Lat, row.Lng, row.Alt))
            case "MODE":
                number = int(getattr(row, "ModeNum", row.Mode))
                found.mode(t_ns, mode_mapping_acm.get(number, f"MODE {number}"))
            case "MSG":
                self._text(t_ns, row.Message)
            case "CMD":
                command = row.CId if row.CNum else 0
                params = (row.Prm1, row.Prm2, row.Prm3, row.Prm4)
                frame = getattr(row, "Frame", _RELATIVE)
                item = MissionItem(row.CNum, command, frame, params, row.Lat, row.Lng, row.Alt)
                self._listed(t_ns, _MISSION, row.CTot, item)
            case "FNCE" if row.Type in _FENCE:
                size = (row.Radius or float(row.Count), 0.0, 0.0, 0.0)
                where = (_RELATIVE, size, row.Lat, row.Lng, 0.0)
                item = MissionItem(row.Seq, _FENCE[row.Type], *where)
                self._listed(t_ns, mav.MAV_MISSION_TYPE_FENCE, row.Tot, item)
            case "RALY":
                where = (_RELATIVE, (0.0,) * 4, row.Lat, row.Lng, row.Alt)
                item = MissionItem(row.Seq, mav.MAV_CMD_NAV_RALLY_POINT, *where)
                self._listed(t_ns, mav.MAV_MISSION_TYPE_RALLY, row.Tot, item)
            case "MISE":
                found.heads_for(t_ns, int(row.CNum))
            case "GPS" if row.Status >= _FIX_3D and getattr(row, "I", 0) == 0:
                found.fixes.append(t_ns)
            case "BAT" if getattr(row, "Inst", getattr(row, "Instance", 0)) == 0:
                left = getattr(row, "RemPct", float("nan")) / 100
                found.battery.append((t_ns, row.Volt, row.Curr, row.CurrTot, left))
            case "XKF2" if getattr(row, "C", 0) == 0:
                # The wind that the filter estimates is where the air moves to.
                found.wind.append((t_ns, row.VWE, row.VWN))
            case "ERR" if row.Subsys in _FAILSAFES and row.ECode:
                found.event(t_ns, "failsafe", f"failsafe: {_FAILSAFES[row.Subsys]}", severity=4)
            case "EV" if row.Id in (_ARMED, _DISARMED):
                found.event(t_ns, "armed", "armed" if row.Id == _ARMED else "disarmed")

    def _text(self, t_ns: int, text: str) -> None:
        vehicle = next((name for name in _VEHICLES if text.startswith(f"{name} ")), None)
        if vehicle is not None:
            raise InputError(
                f"{self.found.path}: the log of {vehicle}: only multicopters' are compared"
            )
        if text == "New mission":
            self._lists.pop(_MISSION, None)
        self.found.event(t_ns, "status", text)

    def _listed(self, t_ns: int, kind: int, total: int, item: MissionItem) -> None:
        """Add an item to its uploaded list (of a MAV_MISSION_TYPE). Versions before MISE also log
        each item that is started as such a row: it becomes the current one."""
        items = self._lists.setdefault(kind, {})
        if item.seq and len(items) == total:
            self.found.heads_for(t_ns, item.seq)
            return
        if item.seq == 0:
            items.clear()
        items[item.seq] = item
        if len(items) == total > (kind == _MISSION):  # whose number 0 is home, not an item
            self.found.add_list(t_ns, items, kind)
