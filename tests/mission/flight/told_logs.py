"""A made-up flight with what it was told, as DataFlash of four versions, ULog and telemetry log.

What was wanted and what was are arrays of the test; bytes are written here.
"""

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mav
from ulog_bytes import UlogBytes

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint

HOME = GeodeticPoint(47.397742, 8.545594, 488.0)
Floats = NDArray[np.float64]
STEP_S = 0.05
GPS_BEGINS_S, LEAP_S, WEEK_MS = 315964800.0, 18.0, 604800000


@dataclass(frozen=True)
class Made:
    """What a vehicle was told, and did, at each of the times; NED, roll, pitch and yaw in deg."""

    t_s: Floats
    wanted: Floats  # (n, 3)
    actual: Floats
    attitude: tuple[Floats, Floats]  # wanted and actual (n, 3)
    vibration: Floats
    clips: Floats
    satellites: Floats
    fix: Floats  # as the kind of log counts it
    utc_s: float | None = None  # since 1970, at time 0 of the log, where it tells

    def without(self, start_s: float, end_s: float) -> "Made":
        """Cut a time out of the log."""
        kept = (self.t_s < start_s) | (self.t_s > end_s)
        names = "t_s", "wanted", "actual", "vibration", "clips", "satellites", "fix"
        arrays: dict[str, Any] = {name: getattr(self, name)[kept] for name in names}
        both = self.attitude[0][kept], self.attitude[1][kept]
        return replace(self, **arrays, attitude=both)


def way(t_s: Floats) -> Floats:
    """(n, 3) up for 10 s, then a weave at 20 m."""
    flown = np.clip(t_s - 12.0, 0.0, None)
    north, east = 60 * np.sin(0.1 * flown), 25 * (1 - np.cos(0.23 * flown))
    return np.column_stack((north, east, -np.clip(2.0 * (t_s - 2.0), 0.0, 20.0)))


def made(
    *,
    delay_s: float = 0.0,
    off_m: float = 0.0,
    when: tuple[float, float] = (40.0, 45.0),
    down_m: float = 0.0,
    tilt_deg: float = 0.0,
    path: Callable[[Floats], Floats] = way,
    until_s: float = 60.0,
) -> Made:
    """A flight that follows its path late, and in a time is off it to the east, too low, rolled."""
    t_s = np.arange(0.0, until_s, STEP_S)
    there = ((t_s >= when[0]) & (t_s <= when[1])).astype(float)
    actual = path(t_s - delay_s) + there[:, None] * np.array([0.0, off_m, down_m])
    level = np.column_stack((0 * t_s, 0 * t_s, np.full(len(t_s), 30.0)))
    rolled = level + there[:, None] * np.array([tilt_deg, 0.0, 0.0])
    quiet, twelve, three = (np.full(len(t_s), of) for of in (1.5, 12.0, 3.0))
    return Made(t_s, path(t_s), actual, (level, rolled), quiet, 0 * t_s, twelve, three)


def places(flight: Made) -> list[tuple[float, float, float]]:
    frame = LocalFrame(HOME)
    found = []
    for ned in flight.actual:
        at = frame.to_geodetic(np.array([*ned[:2], 0.0]))
        found.append((at.lat_deg, at.lon_deg, HOME.alt_msl_m - float(ned[2])))
    return found


_CODES = {"Q": "Q", "L": "i", "f": "f", "B": "B", "H": "H", "h": "h", "n": "4s", "N": "16s",
          "Z": "64s", "d": "d", "b": "b", "I": "I", "c": "h", "C": "H", "e": "i",
          "E": "I"}  # fmt: skip
_TARGETS: Mapping[str, Any] = {
    # Before 4.0: centimetres, and no word of units.
    "NTUN": ("Qffff", "TimeUS,DPosX,DPosY,PosX,PosY", 100.0),
    "PSC": ("Qffff", "TimeUS,TPX,TPY,PX,PY", 1.0),
    "PSCN": ("Qff", "TimeUS,TPN,PN", 1.0),
    "none": ("Qffff", "TimeUS,A,B,C,D", 1.0),  # is not read
    # 4.7: more columns before, and in the test's log in millimetres, as its multiplier says.
    "PSCN 4.7": ("Qfff", "TimeUS,DPN,TPN,PN", 1000.0),
}


_TIMELESS = ("MODE", "EV", "MSG", "PARM")  # rows without a time, in old logs


def write_bin(
    path: Path,
    flight: Made,
    *,
    version: str = "PSCN",
    motors: bool = True,
    multipliers: bool = True,
    old: bool = False,
    places_at: bool = True,
    more: Sequence[tuple[str, str, str, Sequence[Sequence[Any]]]] = (),
) -> Path:
    """As ArduCopter writes it; `version` is the kind of row that holds positions. Logs may lack the
    rows of `multipliers`. `old`: as before 3.3, in milliseconds, where some rows have no time and
    a receiver tells the only places; logs without `places_at` tell none. `more`: name, format and
    columns of kinds of the test's own, and rows."""
    out = bytearray()
    formats: dict[str, tuple[int, str]] = {}

    def row(name: str, *values: Any) -> None:
        if not places_at and name == "POS":
            return
        number, form = formats[name]
        if old and values and form[:1] == "I" and name not in ("FMT", "GPS"):
            values = (values[0] // 1000, *values[1:])
        elif old and name in _TIMELESS:
            values = values[1:]
        packed = "<" + "".join(_CODES[letter] for letter in form)
        out.extend(b"\xa3\x95" + bytes([number]) + struct.pack(packed, *values))

    def declare(name: str, form: str, columns: str) -> None:
        if old and columns.startswith("TimeUS,"):
            form, columns = form[1:], columns[7:]
            if name not in _TIMELESS:
                form, columns = f"I{form}", f"TimeMS,{columns}"
        formats[name] = (len(formats) + 1 if formats else 0x80, form)
        size = 3 + struct.calcsize("<" + "".join(_CODES[letter] for letter in form))
        row("FMT", formats[name][0], size, name.encode(), form.encode(), columns.encode())

    declare("FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    declare("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    declare("MULT", "Qbd", "TimeUS,Id,Mult")
    for letter, factor in (("F", 1e-6), ("0", 1.0), ("C", 1e-3), ("-", 0.0)):
        if multipliers:
            row("MULT", 1, ord(letter), factor)
    form, columns, scale = _TARGETS[version]
    kind, names = version.split()[0], [version.split()[0]]
    if kind == "PSCN":
        names = ["PSCN", "PSCE", "PSCD"]
    for name in names:
        declare(name, form, columns.replace("PN", f"P{name[3]}") if kind == "PSCN" else columns)
        if kind != "NTUN":
            mult = "C" if scale == 1000.0 else "0"
            row(
                "FMTU",
                1,
                formats[name][0],
                b"s" * len(form),
                ("F" + mult * (len(form) - 1)).encode(),
            )
    declare("CTUN", "Qff", "TimeUS,DAlt,Alt")
    declare("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    declare("VIBE", "QBfffI", "TimeUS,IMU,VibeX,VibeY,VibeZ,Clip")
    if old:
        columns = "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T"
        declare("GPS", "BIHBcLLeeEefI", columns)
    elif flight.utc_s is None:
        declare("GPS", "QBBBC", "TimeUS,I,Status,NSats,HDop")
    else:
        declare("GPS", "QBBBCIH", "TimeUS,I,Status,NSats,HDop,GMS,GWk")
    declare("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    declare("POS", "QLLf", "TimeUS,Lat,Lng,Alt")
    declare("MODE", "QBBB", "TimeUS,Mode,ModeNum,Rsn")
    declare("PARM", "QNf", "TimeUS,Name,Value")
    declare("MSG", "QZ", "TimeUS,Message")
    declare("EV", "QB", "TimeUS,Id")
    row("MSG", 1, b"ArduCopter V4.5.0")
    for servo in range(1, 5) if motors else ():
        row("PARM", 1, f"SERVO{servo}_FUNCTION".encode(), 32 + servo)
    row("MODE", 1, 4, 4, 1)
    row("EV", 1, 10)
    wanted_att, att = flight.attitude
    for n, (lat, lon, alt) in enumerate(places(flight)):
        t_us = round(flight.t_s[n] * 1e6)
        w, a = flight.wanted[n] * scale, flight.actual[n] * scale
        if kind == "PSCN":
            for axis, name in enumerate(names):
                row(name, t_us, *([7.0] if len(form) > 3 else []), w[axis], a[axis])
        else:
            row(kind, t_us, w[0], w[1], a[0], a[1])
        row("CTUN", t_us, -flight.wanted[n, 2], -flight.actual[n, 2])
        row("ATT", t_us, *np.column_stack((wanted_att[n], att[n])).ravel())
        for imu in range(2):
            row("VIBE", t_us, imu, 0.5, 0.6, flight.vibration[n], round(flight.clips[n]) * imu)
        gps_ms = round(1e3 * ((flight.utc_s or 0.0) + flight.t_s[n] - GPS_BEGINS_S + LEAP_S))
        told = [] if flight.utc_s is None else [gps_ms % WEEK_MS, gps_ms // WEEK_MS]
        if old and places_at:
            where = round(lat * 1e7), round(lon * 1e7), 0, round(alt * 100)
            row("GPS", 3, 1000 * n, 1811, 12, 120, *where, 0, 0, 0.0, t_us // 1000)
        elif not old:
            row("GPS", t_us, 0, round(flight.fix[n]), round(flight.satellites[n]), 120, *told)
        row("RCOU", t_us, 1500, 1500, 1600, 1400)
        if not old:
            row("POS", t_us, round(lat * 1e7), round(lon * 1e7), alt)
    row("EV", round(flight.t_s[-1] * 1e6) + 1, 11)
    for name, form, columns, rows in more:
        if name not in formats:
            declare(name, form, columns)
        for values in rows:
            row(name, *values)
    path.write_bytes(out)
    return path


def quaternions(attitude_deg: Floats) -> Floats:
    half = np.radians(attitude_deg) / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos(half).T, np.sin(half).T
    return np.column_stack((
        cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy,
    ))  # fmt: skip


def write_ulg(
    path: Path, flight: Made, *, dropout_ms: int = 0, xy_valid: bool | None = None
) -> Path:
    """As PX4 writes it, in OFFBOARD; a dropout is told of at half of the log. With `xy_valid`
    without GNSS: positions are known, or only heights."""
    topics = {
        "vehicle_global_position": ("double lat;double lon;float alt", "ddf"),
        "vehicle_status": ("uint8_t nav_state;uint8_t arming_state;bool failsafe", "BB?"),
        "vehicle_local_position_setpoint": ("float x;float y;float z", "fff"),
        "vehicle_local_position": ("float x;float y;float z", "fff"),
        "vehicle_attitude_setpoint": ("float[4] q_d", "ffff"),
        "vehicle_attitude": ("float[4] q", "ffff"),
        "vehicle_imu_status": ("float accel_vibration_metric;uint32_t[3] accel_clipping", "fIII"),
        "vehicle_gps_position": (
            "uint64_t time_utc_usec;uint8_t fix_type;uint8_t satellites_used", "QBB",
        ),
    }  # fmt: skip
    local = () if xy_valid is None else (xy_valid,)
    if local:
        del topics["vehicle_global_position"], topics["vehicle_gps_position"]
        topics["vehicle_local_position"] = ("float x;float y;float z;bool xy_valid", "fff?")
    out = UlogBytes(topics)
    turns = [quaternions(each) for each in flight.attitude]
    for n, where in enumerate(places(flight)):
        utc_us = 0 if flight.utc_s is None else round((flight.utc_s + flight.t_s[n]) * 1e6)
        values = {
            "vehicle_global_position": where,
            "vehicle_status": (14, 2, False),
            "vehicle_local_position_setpoint": flight.wanted[n],
            "vehicle_local_position": (*flight.actual[n], *local),
            "vehicle_attitude_setpoint": turns[0][n],
            "vehicle_attitude": turns[1][n],
            "vehicle_imu_status": (flight.vibration[n], round(flight.clips[n]), 0, 0),
            "vehicle_gps_position": (utc_us, round(flight.fix[n]), round(flight.satellites[n])),
        }
        for name in topics:
            out.row(name, flight.t_s[n], *values[name])
        if dropout_ms and n == len(flight.t_s) // 2:
            out.message(b"O", struct.pack("<H", dropout_ms))
    path.write_bytes(out.content)
    return path


def write_tlog(
    path: Path, flight: Made, *, places_at: bool = True, more: Sequence[tuple[float, Any]] = ()
) -> Path:
    """As a ground station of PX4 writes it, in OFFBOARD; without `places_at` only heights are
    known. `more`: messages, each with its time."""
    rows: list[bytes] = []
    vehicle = mav.MAVLink(None, 1, 1)

    def told(t_s: float, message: Any) -> None:
        rows.append(struct.pack(">Q", round((1e9 + t_s) * 1e6)) + bytes(message.pack(vehicle)))

    told(0.0, mav.MAVLink_heartbeat_message(2, 12, 157, 6 << 16, 4, 3))
    turns = quaternions(flight.attitude[0])
    for n, (lat, lon, alt) in enumerate(places(flight)):
        t_s, ms = flight.t_s[n], round(flight.t_s[n] * 1e3)
        where = round(lat * 1e7), round(lon * 1e7), round(alt * 1e3)
        actual, wanted, rolled = (
            (float(v[0]), float(v[1]), float(v[2]))
            for v in (flight.actual[n], flight.wanted[n], np.radians(flight.attitude[1][n]))
        )
        if flight.utc_s is not None:
            told(t_s, mav.MAVLink_system_time_message(round((flight.utc_s + t_s) * 1e6), ms))
        up_mm = round(-1e3 * actual[2])
        at = where if places_at else (0, 0, up_mm)
        told(t_s, mav.MAVLink_global_position_int_message(ms, *at, up_mm, 0, 0, 0, 0))
        if places_at:
            told(t_s, mav.MAVLink_local_position_ned_message(ms, *actual, 0, 0, 0))
            told(t_s, mav.MAVLink_position_target_local_ned_message(
                ms, 1, 0b111000, *wanted, 9, 9, 9, 0, 0, 0, 0, 0))  # fmt: skip
        else:
            off_m = actual[2] - wanted[2]
            told(t_s, mav.MAVLink_nav_controller_output_message(0, 0, 0, 0, 0, off_m, 0, 0))
        told(t_s, mav.MAVLink_attitude_target_message(ms, 0, turns[n].tolist(), 0, 0, 0, 0.5))
        told(t_s, mav.MAVLink_attitude_message(ms, *rolled, 0, 0, 0))
        count = round(flight.clips[n])
        told(t_s, mav.MAVLink_vibration_message(ms * 1000, 0, 0, flight.vibration[n], count, 0, 0))
        told(t_s, mav.MAVLink_gps_raw_int_message(
            ms * 1000, round(flight.fix[n]), *where, 80, 90, 0, 0,
            round(flight.satellites[n])))  # fmt: skip
    for t_s, message in more:
        told(t_s, message)
    rows.sort(key=lambda row: int.from_bytes(row[:8], "big"))  # as they come
    path.write_bytes(b"".join(rows))
    return path


WRITERS: Mapping[str, Callable[[Path, Made], Path]] = {
    ".bin": write_bin,
    ".ulg": write_ulg,
    ".tlog": write_tlog,
}


def step_response(t_s: Floats, *, at_s: float, damping: float, omega: float) -> Floats:
    """Of a second-order system to a unit step (underdamped)."""
    t = np.clip(t_s - at_s, 0.0, None)
    fast = omega * math.sqrt(1 - damping**2)
    sway = np.cos(fast * t) + damping / math.sqrt(1 - damping**2) * np.sin(fast * t)
    return np.where(t > 0, 1 - np.exp(-damping * omega * t) * sway, 0.0)
