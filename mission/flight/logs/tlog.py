"""A ground station's telemetry log (.tlog) as a flight: MAVLink, each message after its time."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega
from pymavlink.dialects.v20 import common as mav
from pymavlink.mavutil import interpret_px4_mode

from mission.flight.logs.flight import DAMAGE, LogKind, LogRows, ardupilot_mode
from mission.flight.logs.sources import OF_ARDUPILOT, OF_PX4, TLOG
from mission.flight.missions.mission_path import KINDS
from mission.log.signals import Columns, Signal, gathered, motors
from mission.log.values import PLANE, ROVER
from sitl.autopilot.codec.orders import MissionItem, read_item
from sitl.observer import FAILING

_HEAD = 8  # bytes of a time before each message: microseconds since 1970
_FRAME = re.compile(rb"(?s)\xfd..|\xfe.")  # mark, length, and flags of MAVLink 2
_PLANES, _ROVERS = frozenset({1, *range(19, 26)}), frozenset({10, 11})  # MAV_TYPE
_NO_VEHICLES = frozenset({5, 6, 18, *range(26, 29), *range(30, 35), *range(37, 43)})
_NO_AUTOPILOT = mav.MAV_AUTOPILOT_INVALID
_FIX_3D = 3
_SET_BACK_US = 1_000_000  # of the recorder's clock, at least
_MOST_LATE_MS = 5000  # of a packet on its way; what is later comes from another start
_REGULAR = ("GLOBAL_POSITION_INT", "ATTITUDE")  # by which the clock is known, the best first
_TRANSFERS = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ITEM")  # they go both ways
_TOLD = frozenset(  # of the autopilot; of another component it is counted
    {"GLOBAL_POSITION_INT", "HOME_POSITION", "GPS_RAW_INT", "SYS_STATUS", "WIND_COV", "STATUSTEXT"}
    | {"MISSION_CURRENT", "MISSION_ITEM_REACHED", "MISSION_ACK"}
)

_OUTPUT = "servo{}_raw"
_FIELDS: dict[str, list[str]] = {}  # of messages with signals
for _source in (*TLOG, *OF_ARDUPILOT, *OF_PX4):
    _FIELDS.setdefault(_source.message, []).extend(_source.columns.split())
_FIELDS["SERVO_OUTPUT_RAW"] = [_OUTPUT.format(number) for number in range(1, 17)]


def _take(content: bytes, found: LogRows) -> None:
    """Keep what the first autopilot says that speaks in a telemetry log."""
    reader = _Reader(found)
    for at, wall_us, message in _messages(content, found):
        reader.take(at, wall_us, message)
    reader.close()


KIND = LogKind("telemetry log", "seconds since the autopilot started", _REGULAR, _take)


def _messages(content: bytes, found: LogRows) -> Iterator[tuple[int, int, Any]]:
    """Yield byte, time (us since 1970) and message of each readable packet of the part to read, and
    of each heartbeat; count the rest as skipped."""
    parser, more = mav.MAVLink(None), ardupilotmega.MAVLink(None)

    def end_of(at: int) -> int:
        frame = _FRAME.match(content, at + _HEAD)
        if frame is None:
            return at
        more = 8 if frame[0][0] == mav.PROTOCOL_MARKER_V1 else 25 if frame[0][2] & 1 else 12
        return at + _HEAD + frame[0][1] + more  # with checksum and signature

    for at, end in found.messages(content, _FRAME, end_of, head=_HEAD):
        first = content[at + _HEAD] == mav.PROTOCOL_MARKER_V1
        number = content[at + _HEAD + 5 : at + _HEAD + 6] if first else content[at + 15 : at + 18]
        if at not in found.part and any(number):  # no heartbeat
            continue
        try:
            message: Any = parser.decode(bytearray(content[at + _HEAD : end]))
            if message.get_msgId() not in mav.mavlink_map:
                message = more.decode(bytearray(content[at + _HEAD : end]))
        except (mav.MAVError, ardupilotmega.MAVError):
            found.skipped[DAMAGE] += end - at
            continue
        if message.get_msgId() in ardupilotmega.mavlink_map:
            yield at, int.from_bytes(content[at : at + _HEAD], "big"), message
        else:
            found.skipped["message of another dialect"] += 1


def _kind(message: Any) -> str:
    """The message's name, with the number of another battery than the first."""
    name: str = message.get_type()
    return f"{name} {message.id}".removesuffix(" 0") if name == "BATTERY_STATUS" else name


def _number(message: Any, field: str) -> float:
    """A field, or one of its numbers: `q[0]`."""
    name, _, at = field.partition("[")
    value = getattr(message, name)
    return float(value[int(at[:-1])] if at else value)


class _Reader:
    """Takes messages one after another; those without a time of the vehicle wait in `later`."""

    def __init__(self, found: LogRows) -> None:
        self.found = found
        self._autopilot: tuple[int, ...] = ()  # its system and component, once it spoke
        self._ardupilot = False
        self._number = 0  # of the last position
        # By MAV_MISSION_TYPE and the system that sends: how many it transfers, and those that came.
        self._lists: dict[tuple[int, int], tuple[int, dict[int, MissionItem]]] = {}
        # The recorder's (us), the vehicle's (ms); by positions, or where there are none by others.
        self.clock: list[tuple[int, int]] = []
        self._others: list[tuple[int, int]] = []
        self._received: list[tuple[float, ...]] = []  # places by the receiver
        self._wall_us = self._set_back_us = 0  # the recorder's clock, and by how much it was
        self.later: list[tuple[int, Any]] = []
        self._rows: dict[str, list[tuple[float, ...]]] = {}  # of signals, by message
        self._params: dict[str, float] = {}

    def close(self) -> None:
        """Take what waits for the clock of all of the log; places by the receiver where the vehicle
        tells none."""
        self.clock = self.clock or self._others
        if not self.clock:
            return
        wall_us, boot_ms = np.array(self.clock, dtype=np.float64).T
        order = np.argsort(wall_us, kind="stable")
        wall_us, boot_ms = wall_us[order], np.maximum.accumulate(boot_ms[order])
        for at_us, message in self.later:  # without a time of the vehicle's own: its neighbours'
            after_ms = max(0.0, at_us - wall_us[-1]) / 1e3
            self.take_at(int((np.interp(at_us, wall_us, boot_ms) + after_ms) * 1e6), message)
        self.found.places = self.found.places or self._received
        self.found.signals = self.signals()
        # Without its own word for it, the ground station's clock, which hears it late.
        heard = [(ms * 1_000_000, us * 1000) for us, ms in self.clock]
        self.found.utc_ns = self.found.utc_ns or heard

    def take(self, at: int, wall_us: int, message: Any) -> None:
        """Keep what a message says."""
        kind, found = message.get_type(), self.found
        sender = message.get_srcSystem(), message.get_srcComponent()
        speaks = kind == "HEARTBEAT" and message.autopilot != _NO_AUTOPILOT
        if speaks and not self._autopilot and message.type not in _NO_VEHICLES:
            self._autopilot = sender
            found.vehicle = PLANE if message.type in _PLANES else found.vehicle
            found.vehicle = ROVER if message.type in _ROVERS else found.vehicle
            self._ardupilot = message.autopilot == mav.MAV_AUTOPILOT_ARDUPILOTMEGA
            found.kind += " of ArduPilot" * self._ardupilot
        if at not in found.part:
            return
        # A recorder's clock may be set anew; what follows comes later all the same.
        if wall_us + self._set_back_us < self._wall_us - _SET_BACK_US:
            self._set_back_us = self._wall_us - wall_us
        wall_us += self._set_back_us
        self._wall_us = max(self._wall_us, wall_us)
        own_ms = getattr(message, "time_boot_ms", 0) if sender == self._autopilot else 0
        if kind in _TRANSFERS:
            self.later.append((wall_us, message))
        elif sender != self._autopilot:
            if sender[:1] == self._autopilot[:1]:
                found.skipped["message of another component"] += int(kind in _TOLD)
            elif kind == "GLOBAL_POSITION_INT":  # whose is it?
                whose = "of another vehicle" if self._autopilot else "before the first heartbeat"
                found.skipped[f"position {whose}"] += 1
        elif kind == "GLOBAL_POSITION_INT":
            # Packets may overtake each other on their way; the vehicle numbers them.
            overtaken = 0 < (self._number - message.get_seq()) % 256 < 128
            late_ms = int(self.clock[-1][1] - message.time_boot_ms) if self.clock else 0
            if overtaken and 0 < late_ms < _MOST_LATE_MS:
                found.skipped["position that came late"] += 1
                return
            self._number = message.get_seq()
            found.counts(at, kind, own_ms * 1_000_000)
            self.clock.append((wall_us, message.time_boot_ms))
            self._keep(message.time_boot_ms * 1_000_000, message)
            where = message.lat / 1e7, message.lon / 1e7, message.alt / 1e3
            found.places.append((message.time_boot_ms * 1_000_000, *where))
        else:
            if own_ms:
                found.counts(at, kind, own_ms * 1_000_000)
                self._others.append((wall_us, own_ms))
            self.later.append((wall_us, message))

    def take_at(self, t_ns: int, message: Any) -> None:
        """Keep what a message says, at a time of the vehicle's clock."""
        found = self.found
        if _kind(message) in _FIELDS:
            self._keep(t_ns, message)
        match message.get_type():
            case "HEARTBEAT" if message.autopilot != _NO_AUTOPILOT:
                if self._ardupilot:
                    name = ardupilot_mode(found.vehicle, message.custom_mode)
                else:
                    name = interpret_px4_mode(message.base_mode, message.custom_mode)
                armed = message.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED
                found.armed(t_ns, on=bool(armed))
                found.mode(t_ns, name)
                found.failing(t_ns, "failsafe", on=message.system_status in FAILING)
            case "PARAM_VALUE":
                self._params[message.param_id] = message.param_value
            case "SYSTEM_TIME" if message.time_unix_usec and message.time_boot_ms:
                told = message.time_boot_ms * 1_000_000, message.time_unix_usec * 1000
                found.utc_ns.append(told)
            case "FENCE_STATUS":
                found.failing(t_ns, "fence breached", on=bool(message.breach_status))
            case "STATUSTEXT":
                found.event(t_ns, "status", message.text, severity=message.severity)
            case "MISSION_CURRENT":
                found.heads_for(t_ns, message.seq)
            case "MISSION_ITEM_REACHED":
                found.event(t_ns, "reached", f"item {message.seq}", seq=message.seq)
            case "HOME_POSITION":
                home = message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3
                found.homes.append((t_ns, *home))
            case "GPS_RAW_INT" if message.fix_type >= _FIX_3D:
                found.fixes.append(t_ns)
                where = message.lat / 1e7, message.lon / 1e7, message.alt / 1e3
                self._received.append((t_ns, *where))
            case "SYS_STATUS" if message.battery_remaining >= 0:
                unknown, left = float("nan"), message.battery_remaining / 100
                mv, ca = message.voltage_battery, message.current_battery
                volts = unknown if mv == 65535 else mv / 1e3
                amperes = unknown if ca in (-1, -100) else ca / 1e2
                found.battery.append((t_ns, volts, amperes, unknown, left))
            case "WIND_COV":
                found.wind.append((t_ns, message.wind_y, message.wind_x))
            case "MISSION_ACK" if message.type != mav.MAV_MISSION_INVALID_SEQUENCE:  # it goes on
                self._answered(t_ns, message)
            case kind if kind in _TRANSFERS and message.mission_type in KINDS:
                if self._autopilot[:1] in ((message.get_srcSystem(),), (message.target_system,)):
                    self._transferred(t_ns, message)

    def _keep(self, t_ns: int, message: Any) -> None:
        """Keep a row of signals, at the message's own time where it has one."""
        own_ns = getattr(message, "time_boot_ms", 0) * 1_000_000
        fields = _FIELDS[_kind(message)]
        row = (_number(message, field) for field in fields)
        self._rows.setdefault(_kind(message), []).append(((own_ns or t_ns) / 1e9, *row))

    def signals(self) -> dict[str, Signal]:
        """The signals of all messages that were kept."""
        tables = {
            kind: dict(zip(("t_s", *_FIELDS[kind]), np.array(rows).T, strict=True))
            for kind, rows in self._rows.items()
        }
        own = OF_ARDUPILOT if self._ardupilot else OF_PX4
        outputs: Columns = tables.get("SERVO_OUTPUT_RAW", {})
        return gathered(tables, (*own, *TLOG)) | motors(self._params, outputs, _OUTPUT)

    def _transferred(self, t_ns: int, message: Any) -> None:
        """Keep a message of a mission transfer; a list that the vehicle sends is one it holds."""
        kind, sender = message.mission_type, message.get_srcSystem()
        if message.get_type() == "MISSION_COUNT":
            self._lists[kind, sender] = message.count, {}
        elif (kind, sender) in self._lists:
            item = read_item(message)
            if self._ardupilot and item.seq == 0 and kind == mav.MAV_MISSION_TYPE_MISSION:
                item = MissionItem(0, 0, item.frame, item.params, item.x, item.y, item.z)  # home
            count, items = self._lists[kind, sender]
            items[item.seq] = item
            told = sender, message.get_srcComponent()
            if told == self._autopilot and len(items) == count:
                self.found.add_list(t_ns, items, kind)  # it may say again what was uploaded
                del self._lists[kind, sender]

    def _answered(self, t_ns: int, ack: Any) -> None:
        """Take the vehicle's MISSION_ACK: a complete upload that it accepts becomes its list."""
        count, items = self._lists.pop((ack.mission_type, ack.target_system), (0, {}))
        if ack.type == mav.MAV_MISSION_ACCEPTED and items and len(items) == count:
            self.found.add_list(t_ns, items, ack.mission_type)
