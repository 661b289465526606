"""ArduPilot's DataFlash log (.bin) as a flight.

Rows of a kind each, laid out as a row of the kind FMT says before the first one:
https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
"""

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint
from mission.base.errors import InputError
from mission.flight.logs.flight import LogKind, LogRows, ardupilot_mode
from mission.flight.logs.sources import DATAFLASH
from mission.log.signals import Columns, Signal, gathered, motors, while_controlled
from mission.log.values import COPTER, PLANE, ROVER
from sitl.autopilot.codec.orders import MissionItem

_MAGIC = b"\xa3\x95"
_MARK = re.compile(rb"(?s)\xa3\x95.")
_FMT = 0x80
_LETTERS = {  # of a format: the number in Python's `struct`, and what it is divided by
    **{letter: (letter, 1.0) for letter in "bBhHiIfdqQ"},
    "a": ("64s", 1.0), "n": ("4s", 1.0), "N": ("16s", 1.0), "Z": ("64s", 1.0),
    "g": ("e", 1.0), "M": ("B", 1.0), "L": ("i", 1e7),
    "c": ("h", 1e2), "C": ("H", 1e2), "e": ("i", 1e2), "E": ("I", 1e2),
}  # fmt: skip
_MISSION, _RELATIVE = mav.MAV_MISSION_TYPE_MISSION, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT
_DECLARED = ("FMT", "PARM", "FMTU", "MULT")  # of all of a log, whichever part of it is read
_READ = {
    *("POS", "MODE", "MSG", "ORGN", "CMD", "MISE", "GPS", "BAT", "CURR", "XKF2", "ERR", "ARM"),
    *("EV", "FNCE", "RALY", *_DECLARED),
}
_REGULAR = ("POS", "GPS", "ATT")  # kinds of rows by which the clock is known, the best first
_SIGNALS = {source.message.split()[0] for source in DATAFLASH} | {"RCOU"}
_INSTANCE = ("I", "C", "IMU", "Inst", "Instance")  # columns that number the sensors of a kind
_FENCE = {  # FNCE.Type: AC_PolyFenceType
    98: mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    97: mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    **dict.fromkeys((92, 94), mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION),
    **dict.fromkeys((93, 96), mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION),
    95: mav.MAV_CMD_NAV_FENCE_RETURN_POINT,
}
_VEHICLES = {  # by what the firmware calls itself
    **dict.fromkeys(("ArduCopter", "ArduSub", "Blimp"), COPTER),
    **dict.fromkeys(("ArduRover", "Rover"), ROVER),
    "ArduPlane": PLANE,
}
# Multipliers by id, in logs that lack the rows that tell them: log_Multipliers of ArduPilot.
_MULTIPLIERS = {ord(letter): 10.0**-n for n, letter in enumerate("0ABCDEFG")}
_FIX_3D, _GUIDED = 3, 4
_HUNDREDTHS = 20.0  # times what attitude turns by are no degrees
_WEEK_MS = 7 * 86_400_000
# The begin of GPS time in UTC, less the leap seconds since: 18 from 2017 on, when 3.5 came.
_GPS_NS = (315_964_800 - 18) * 1_000_000_000
_ARMED, _DISARMED = 10, 11  # EV
_HOME = 1  # ORGN.Type; 0: the origin of its filter
# ERR.Subsys of the failsafes: LogErrorSubsystem.
_FAILSAFES = {
    5: "radio", 6: "battery", 7: "GPS", 8: "ground station", 9: "fence", 17: "EKF", 19: "CPU",
    20: "ADSB", 23: "terrain", 26: "sensors", 29: "vibration", 31: "dead reckoning",
}  # fmt: skip


def _take(content: bytes, found: LogRows) -> None:
    """Keep what the rows of a DataFlash log say. InputError: it is none."""
    if not content.startswith(_MAGIC):
        raise InputError(f"{found.path}: not a DataFlash log: it does not begin as one")
    reader, raw = _Reader(found), dict[_Format, list[bytes]]()
    for kind, t_ns, row in _rows(content, found, raw):
        try:
            reader.take(kind, t_ns, row)
        except AttributeError as error:
            if error.obj is not row:
                raise
            found.skipped[f"row of {kind} without {error.name}"] += 1
    reader.close()
    tables = dict[str, Columns]()
    for form, rows in raw.items():
        tables |= form.tables(b"".join(rows), reader.multipliers(form))
    if any(form.clock != "TimeUS" for form in raw):
        found.clock += ", in whole milliseconds; rows without a time have that of the row before"
    found.signals = while_controlled(gathered(tables, DATAFLASH))
    if "units" not in tables.get("RATE", {"units": None}):
        found.signals |= _in_degrees(found.signals)
    found.signals |= motors(reader.params, tables.get("RCOU", {}), "C{}")
    reader.hold_goals()


KIND = LogKind("DataFlash of ArduPilot", "seconds since ArduPilot started", _REGULAR, _take)


def _in_degrees(signals: Mapping[str, Signal]) -> dict[str, Signal]:
    """Body rates of a log that tells no units: before 3.4 they are in hundredths of a degree, as
    shows beside how roll and pitch change."""
    rates, attitude = signals.get("rates_degps"), signals.get("attitude_deg")
    if rates is None or attitude is None or len(attitude.t_s) < 2:
        return {}
    turns = np.diff(attitude.values[:, :2], axis=0) / np.diff(attitude.t_s)[:, None]
    usual, turned = (float(np.nanmedian(np.abs(each))) for each in (rates.values[:, :2], turns))
    if not usual > _HUNDREDTHS * turned > 0.0:
        return {}
    both = {
        name: signals[name] for name in ("rates_degps", "wanted_rates_degps") if name in signals
    }
    return {name: Signal(of.t_s, of.values / 100.0) for name, of in both.items()}


class _Format:
    """What the rows of a kind, a number, hold: columns of a letter each."""

    def __init__(self, number: int, name: str, length: int, columns: str, letters: str) -> None:
        self.number, self.name, self.length = number, name, length
        known = [_LETTERS.get(letter, ("", 1.0)) for letter in letters]
        self._packed = struct.Struct("<3x" + "".join(code for code, _ in known))
        self._columns = list(zip(columns.split(","), (scale for _, scale in known), strict=False))
        self.sound = self._packed.size == length and columns.count(",") == len(letters) - 1
        self._codes = [re.sub(r"(\d+)s", r"S\1", code) for code, _ in known]
        # Until 3.3 milliseconds; a receiver's own are those of the week.
        names = [name for name, _ in self._columns]
        clocks = ("TimeUS",) if "TimeMS" not in names else ("T", "TimeMS")
        self.clock = next((name for name in clocks if name in names), "")
        self._clock_at = names.index(self.clock) if self.clock else 0
        ahead = "<3x" + "".join(code for code, _ in known[: self._clock_at + 1])
        self._until_clock = struct.Struct(ahead)

    def t_ns(self, content: bytes, at: int) -> int | None:
        """The time of the row that begins at a byte; None where its kind has none."""
        if not self.clock:
            return None
        t = self._until_clock.unpack_from(content, at)[-1]
        return int(t) * (1000 if self.clock == "TimeUS" else 1_000_000)

    def row(self, content: bytes, at: int) -> SimpleNamespace:
        """The row that begins at a byte, its columns as attributes."""
        found = SimpleNamespace()
        for (name, scale), value in zip(
            self._columns, self._packed.unpack_from(content, at), strict=True
        ):
            if isinstance(value, bytes):
                value = value.partition(b"\0")[0].decode(errors="replace")
            setattr(found, name, value if scale == 1 else value / scale)
        return found

    def tables(self, content: bytes, multipliers: Sequence[float]) -> Iterator[tuple[str, Columns]]:
        """Yield the name and the table of each instance of a sensor, of rows one after another; the
        first has the bare name. `multipliers` to the units of the columns; none where not told."""
        kinds = [("head", "V3"), *((str(at), f"<{code}") for at, code in enumerate(self._codes))]
        table = np.frombuffer(content, np.dtype(kinds))
        units = {"units": np.ones(1)} if len(multipliers) == len(self._columns) else {}
        columns = {
            name: table[str(at)] * (multipliers[at] if units and scale == 1.0 else 1.0 / scale)
            for at, (name, scale) in enumerate(self._columns)
            if table[str(at)].dtype.kind != "S"
        }
        if not self.clock:
            return
        columns["t_s"] = table[str(self._clock_at)] / (1e6 if self.clock == "TimeUS" else 1e3)
        instance = next((columns[name] for name in _INSTANCE if name in columns), np.zeros(1))
        for number in np.unique(instance).astype(int).tolist():
            chosen = np.broadcast_to(instance == number, len(table))
            name = f"{self.name} {number}".removesuffix(" 0")
            yield name, {**units, **{key: values[chosen] for key, values in columns.items()}}


def _rows(
    content: bytes, found: LogRows, raw: dict[_Format, list[bytes]]
) -> Iterator[tuple[str, int, SimpleNamespace]]:
    """Yield kind, time and row of those that are read; rows of signals go to `raw`. A row without a
    time has that of the row before."""
    formats = {_FMT: _Format(_FMT, "FMT", 89, "Type,Length,Name,Format,Columns", "BBnNZ")}

    def end_of(at: int) -> int:
        form = formats.get(content[at + 2]) if _MARK.match(content, at) else None
        return at + form.length if form else at

    now_ns = 0
    for at, _ in found.messages(content, _MARK, end_of):
        form = formats[content[at + 2]]
        if form.name not in _SIGNALS and form.name not in _READ:
            continue
        if (own_ns := form.t_ns(content, at)) is not None:
            now_ns = own_ns
        counts = found.counts(at, form.name, now_ns)
        if form.name in _SIGNALS and counts:
            raw.setdefault(form, []).append(content[at : at + form.length])
        if form.name in _READ and (counts or form.name in _DECLARED):
            yield form.name, now_ns, form.row(content, at)
        if form.name == "FMT":
            told = form.row(content, at)
            if (told.Name, told.Columns) == ("TIME", "StartTime"):
                old = "a log of PX4 before ULog (sdlog2), which is not read"
                raise InputError(f"{found.path}: {old}")
            form = _Format(told.Type, told.Name, told.Length, told.Columns, told.Format)
            if form.sound:
                formats[told.Type] = form


class _Reader:
    """Takes the rows of a log one after another."""

    def __init__(self, found: LogRows) -> None:
        self.found = found
        # By MAV_MISSION_TYPE: since when, how many there are, and those that came.
        self._lists: dict[int, tuple[int, int, dict[int, MissionItem]]] = {}
        self._vehicle = "ArduCopter"
        self._modes: list[tuple[int, int]] = []
        self._received: list[tuple[float, ...]] = []  # places by the receiver
        self._origin: GeodeticPoint | None = None  # of the filter's frame
        self.params: dict[str, float] = {}
        self._units: dict[int, str] = {}  # ids of a kind's multipliers
        self._multipliers = dict(_MULTIPLIERS)
        self._now_ns = 0
        self._on = self._rearming = False

    def multipliers(self, form: _Format) -> list[float]:
        """What the columns of a kind are to be multiplied by; none where the log does not say."""
        ids = self._units.get(form.number, "")
        return [self._multipliers.get(ord(each), 1.0) or 1.0 for each in ids]

    def take(self, kind: str, t_ns: int, row: Any) -> None:
        """Keep what a row of a kind says."""
        found, before_ns, self._now_ns = self.found, self._now_ns, t_ns
        if self._rearming and t_ns > before_ns:
            self._rearming = False
            found.event(t_ns, "armed", "armed")
        match kind:
            case "POS":
                found.places.append((t_ns, row.Lat, row.Lng, row.Alt))
            case "ORGN" if row.Type == _HOME:
                found.homes.append((t_ns, row.Lat, row.Lng, row.Alt))
            case "ORGN":
                self._origin = GeodeticPoint(row.Lat, row.Lng, row.Alt)
            case "MODE":
                number = int(getattr(row, "ModeNum", row.Mode))
                self._modes.append((t_ns, number))
            case "MSG":
                self._text(t_ns, row.Message)
            case "MISE" if not hasattr(row, "CId"):  # nor the rest of the item
                found.heads_for(t_ns, int(row.CNum))
            case "CMD" | "MISE":
                command = row.CId if row.CNum else 0
                # Until 3.1 of the first alone.
                one, two, three, four = (getattr(row, f"Prm{n}", 0.0) for n in range(1, 5))
                params = (one, two, three, four)
                frame = getattr(row, "Frame", _RELATIVE)
                item = MissionItem(row.CNum, command, frame, params, row.Lat, row.Lng, row.Alt)
                self._listed(t_ns, _MISSION, row.CTot, item, started=kind == "MISE")
            case "FNCE" if row.Type in _FENCE:
                size = (row.Radius or float(row.Count), 0.0, 0.0, 0.0)
                where = (_RELATIVE, size, row.Lat, row.Lng, 0.0)
                item = MissionItem(row.Seq, _FENCE[row.Type], *where)
                self._listed(t_ns, mav.MAV_MISSION_TYPE_FENCE, row.Tot, item)
            case "RALY":
                where = (_RELATIVE, (0.0,) * 4, row.Lat, row.Lng, row.Alt)
                item = MissionItem(row.Seq, mav.MAV_CMD_NAV_RALLY_POINT, *where)
                self._listed(t_ns, mav.MAV_MISSION_TYPE_RALLY, row.Tot, item)
            case "GPS" if row.Status >= _FIX_3D and getattr(row, "I", 0) == 0:
                found.fixes.append(t_ns)
                if hasattr(row, "Lat"):
                    self._received.append((t_ns, row.Lat, row.Lng, row.Alt))
                if hasattr(row, "GWk"):
                    gps_ns = (row.GWk * _WEEK_MS + row.GMS) * 1_000_000 + _GPS_NS
                    found.utc_ns.append((t_ns, round(gps_ns)))
            case "BAT" | "CURR" if getattr(row, "Inst", getattr(row, "Instance", 0)) == 0:
                left = getattr(row, "RemPct", float("nan")) / 100
                unit = 0.01 if isinstance(row.Volt, int) else 1.0  # before 3.4
                drawn = getattr(row, "CurrTot", float("nan"))
                found.battery.append((t_ns, row.Volt * unit, row.Curr * unit, drawn, left))
            case "XKF2" if getattr(row, "C", 0) == 0:
                # The wind that the filter estimates is where the air moves to.
                found.wind.append((t_ns, row.VWE, row.VWN))
            case "ERR" if row.Subsys in _FAILSAFES and row.ECode:
                found.event(t_ns, "failsafe", f"failsafe: {_FAILSAFES[row.Subsys]}", severity=4)
            case "PARM":
                self.params[row.Name] = row.Value
            case "FMTU":
                self._units[row.FmtType] = row.MultIds
            case "MULT":
                self._multipliers[row.Id] = row.Mult
            case "EV" if row.Id in (_ARMED, _DISARMED):
                on = row.Id == _ARMED
                # Logs that pause while it is disarmed need not tell since when: the row before. In
                # old ones these have no times, so that it ends with the next row.
                self._rearming = on and self._on
                if self._rearming:
                    found.event(before_ns, "armed", "disarmed")
                else:
                    found.event(t_ns, "armed", "armed" if on else "disarmed")
                self._on = on

    def _text(self, t_ns: int, text: str) -> None:
        self._vehicle = next((n for n in _VEHICLES if text.startswith(f"{n} ")), self._vehicle)
        if text == "New mission":
            self._close_mission()
        self.found.event(t_ns, "status", text)

    def _listed(
        self, t_ns: int, kind: int, total: int, item: MissionItem, *, started: bool = False
    ) -> None:
        """Add an item to its uploaded list (of a MAV_MISSION_TYPE), which begins with number 0, or
        one that is started, which becomes the current one: versions before MISE log it as another
        row of the list. Of a mission that was not listed no more is known."""
        _, size, items = self._lists.get(kind, (0, 0, {}))
        before = items.get(item.seq, item)
        other = (before.command, before.x, before.y) != (item.command, item.x, item.y)
        if item.seq == 0 or total != size or other:
            if kind == _MISSION:
                self._close_mission()
            items = {}
            self._lists[kind] = t_ns, total, items
        listed = len(items) == total or 0 not in items
        if started or (kind == _MISSION and item.seq and listed):
            self.found.heads_for(t_ns, item.seq)
        items[item.seq] = item
        if len(items) == total > (kind == _MISSION):  # whose number 0 is home, not an item
            self.found.add_list(t_ns, items, kind)

    def close(self) -> None:
        """Take what is known only at the end: whose modes they are, a mission not listed; places by
        the receiver where no others are."""
        self._close_mission()
        self.found.places = self.found.places or self._received
        self.found.vehicle = _VEHICLES[self._vehicle]
        for t_ns, number in self._modes:
            self.found.mode(t_ns, ardupilot_mode(self.found.vehicle, number))

    def hold_goals(self) -> None:
        """Each target that GUIDED was given holds until the next one, or the mode's end."""
        signals = self.found.signals
        goal, origin = signals.pop("goal_m", None), self._origin
        if goal is None or origin is None or not self._modes or not self.found.places:
            return
        places = [LocalFrame(origin).to_geodetic(np.append(ne, 0.0)) for ne in goal.values]
        deg = np.array([(place.lat_deg, place.lon_deg) for place in places])
        t_s = np.array([t_ns / 1e9 for t_ns, *_ in self.found.places])
        since_s = np.array([t_ns / 1e9 for t_ns, _ in self._modes])
        guided = np.array([number == _GUIDED for _, number in self._modes])
        at, mode = (np.searchsorted(of, t_s, side="right") - 1 for of in (goal.t_s, since_s))
        held = (at >= 0) & (mode >= 0) & guided[mode] & (goal.t_s[at] >= since_s[mode])
        signals["goal_deg"] = Signal(t_s, np.where(held[:, None], deg[at], np.nan))

    def _close_mission(self) -> None:
        """Take a mission that was not listed as far as it is known."""
        since_ns, total, items = self._lists.pop(_MISSION, (0, 0, {}))
        if items and len(items) < total:
            self.found.skipped["item of a mission"] += (total - len(items)) * (0 in items)
            self.found.add_list(since_ns, items)
