"""One made-up flight of a square, as ULog, DataFlash and telemetry log: bytes written here."""

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mav
from ulog_bytes import UlogBytes

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint

HOME = GeodeticPoint(47.397742, 8.545594, 488.0)
CORNERS = ((0.0, 0.0), (0.0, 100.0), (120.0, 100.0), (120.0, -60.0))  # north, east
HEIGHT_M, SPEED_MPS, CLIMB_MPS = 30.0, 8.0, 2.0
STEP_S = 0.1
START_S, HOVER_S = 5.0, 6.0


@dataclass(frozen=True)
class Sample:
    t_s: float
    lat_deg: float
    lon_deg: float
    alt_msl_m: float
    toward: int  # the item, from 0: take-off, then the corners after the first
    mission: bool


def samples(*, off_m: float = 0.0, returns: bool = False, pause_s: float = 0.0) -> Iterator[Sample]:
    """On the ground, up, around, and hover or return, 15 m higher and past the first corner, from
    8 m before the last one on; `off_m` to the side in the middle of the second leg, where it also
    pauses."""
    frame = LocalFrame(HOME)
    path = [(*CORNERS[0], 0.0), *((*corner, HEIGHT_M) for corner in CORNERS)]
    t_s = 0.0

    def sample(place: Any, toward: int, *, mission: bool) -> Sample:
        at = frame.to_geodetic(np.array([place[0], place[1], 0.0]))
        return Sample(t_s, at.lat_deg, at.lon_deg, HOME.alt_msl_m + place[2], toward, mission)

    while t_s < START_S:
        yield sample(path[0], 0, mission=False)
        t_s += STEP_S
    for toward, (a, b) in enumerate(pairwise(path)):
        length = math.dist(a, b)
        steps = round(length / (CLIMB_MPS if toward == 0 else SPEED_MPS) / STEP_S)
        for step in range(steps):
            share = step / steps
            if returns and toward == 3 and share >= 0.95:
                break
            place = np.array(a) + share * (np.array(b) - np.array(a))
            place[1] += off_m * (toward == 2 and 0.4 < share < 0.6)
            for _ in range(round(pause_s / STEP_S) * (toward == 2 and step == steps // 2)):
                yield sample(place, toward, mission=False)
                t_s += STEP_S
            yield sample(place, toward, mission=True)
            t_s += STEP_S
    back = [(120.0, -52.0, HEIGHT_M), (100.0, -30.0, HEIGHT_M + 15.0), (0.0, 90.0, HEIGHT_M + 15.0)]
    for a, b in pairwise(back) if returns else ():
        for share in np.linspace(0.0, 1.0, round(math.dist(a, b) / SPEED_MPS / STEP_S)):
            yield sample(np.array(a) + share * (np.array(b) - np.array(a)), 4, mission=False)
            t_s += STEP_S
    for _ in range(0 if returns else round(HOVER_S / STEP_S)):
        yield sample(path[-1], len(path) - 2, mission=False)
        t_s += STEP_S


def places() -> list[tuple[int, float, float]]:
    """Command, latitude, longitude of each item."""
    frame = LocalFrame(HOME)
    found = []
    for index, corner in enumerate(CORNERS):
        at = frame.to_geodetic(np.array([*corner, 0.0]))
        command = mav.MAV_CMD_NAV_TAKEOFF if index == 0 else mav.MAV_CMD_NAV_WAYPOINT
        found.append((command, at.lat_deg, at.lon_deg))
    return found


def around() -> list[tuple[int, int]]:
    """Corners of a fence, in 1e-7 degrees: 300 m from home to the south, west, north and east."""
    frame = LocalFrame(HOME)
    corners = (
        np.array([300.0 * n, 300.0 * e, 0.0]) for n, e in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    )
    return [
        (round(at.lat_deg * 1e7), round(at.lon_deg * 1e7)) for at in map(frame.to_geodetic, corners)
    ]


def write_ulog(
    path: Path,
    *,
    kind: int = 1,
    off_m: float = 0.0,
    returns: bool = False,
    pause_s: float = 0.0,
    instead: Mapping[str, tuple[str, str, Sequence[tuple[Any, ...]]]] | None = None,
) -> Path:
    """As PX4 writes it: what it headed for, not the mission. It takes off where it stands, on its
    way to item 0, and hovers where it is after the last one. `instead`: topics of the test's own,
    each its fields, their format for `struct`, and its rows, which begin with a time in seconds."""
    setpoint = "bool current.valid;uint8_t current.type;double current.lat;double current.lon;float current.alt"  # noqa: E501
    topics = {
        "vehicle_global_position": ("double lat;double lon;float alt", "ddf"),
        "home_position": ("double lat;double lon;float alt", "ddf"),
        "vehicle_status": (
            "uint8_t nav_state;uint8_t arming_state;bool failsafe;uint8_t vehicle_type", "BB?B",
        ),
        "position_setpoint_triplet": (setpoint, "?Bddf"),
        "mission_result": ("uint32_t mission_id;uint16_t seq_current;bool finished", "IH?"),
    }  # fmt: skip
    own = instead or {}
    topics |= {name: (fields, form) for name, (fields, form, _) in own.items()}
    out = UlogBytes(topics)

    def made(name: str, t_s: float, *values: Any) -> None:
        if name not in own:
            out.row(name, t_s, *values)

    made("home_position", 0.0, HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m)
    toward = -1
    up_m = HOME.alt_msl_m + HEIGHT_M
    for s in samples(off_m=off_m, returns=returns, pause_s=pause_s):
        made("vehicle_global_position", s.t_s, s.lat_deg, s.lon_deg, s.alt_msl_m)
        made("vehicle_status", s.t_s, 3 if s.mission else 5 if returns else 4, 2, False, kind)
        if s.mission and s.toward != toward:
            toward = s.toward
            _, lat, lon = places()[toward]
            made("mission_result", s.t_s, 7, toward + (toward > 1), False)  # 2 has no place
            if toward == 0:
                made("position_setpoint_triplet", s.t_s, True, 3, lat + 1e-5, lon, up_m)
            made("position_setpoint_triplet", s.t_s, True, 0, lat, lon, up_m)
        elif s.t_s > 60.0 + pause_s and toward == 3:
            toward = 4
            made("mission_result", s.t_s, 7, 4, True)
            made("position_setpoint_triplet", s.t_s, True, 2, lat + 1e-5, lon, up_m)
    for name, (_, _, rows) in own.items():
        for row in rows:
            out.row(name, *row)
    out.message(b"L", b"4" + struct.pack("<Q", 1_000_000) + b"low battery")
    path.write_bytes(out.content)
    return path


_FORMATS = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "POS": (1, "QLLf", "TimeUS,Lat,Lng,Alt"),
    "ORGN": (2, "QBLLf", "TimeUS,Type,Lat,Lng,Alt"),
    "MODE": (3, "QBBB", "TimeUS,Mode,ModeNum,Rsn"),
    "MSG": (4, "QZ", "TimeUS,Message"),
    "CMD": (5, "QHHHffffLLfB", "TimeUS,CTot,CNum,CId,Prm1,Prm2,Prm3,Prm4,Lat,Lng,Alt,Frame"),
    "MISE": (6, "QHHHffffLLfB", "TimeUS,CTot,CNum,CId,Prm1,Prm2,Prm3,Prm4,Lat,Lng,Alt,Frame"),
    "FNCE": (7, "QBBBLLBf", "TimeUS,Tot,Seq,Type,Lat,Lng,Count,Radius"),
    "RALY": (8, "QBBLLhB", "TimeUS,Tot,Seq,Lat,Lng,Alt,Flags"),
}
_PACKED = {
    "Q": "Q",
    "L": "i",
    "f": "f",
    "B": "B",
    "H": "H",
    "h": "h",
    "Z": "64s",
    "n": "4s",
    "N": "16s",
}


def write_dataflash(
    path: Path,
    *,
    vehicle: str = "ArduCopter",
    off_m: float = 0.0,
    returns: bool = False,
    pause_s: float = 0.0,
    listed: bool = True,
    started: str = "MISE",
    before: Sequence[tuple[int, int, int]] = (),
    new: bytes = b"New mission",
) -> Path:
    """As ArduCopter writes it: item 0 is home, and a return leaves the mode as it is. The mission
    is `listed`, or only its items as they are `started`, in rows of that name; `before` it there
    was another, of commands and places (1e-7 degrees), and then a text `new`."""
    out = bytearray()

    def row(name: str, *values: Any) -> None:
        number, form, _ = _FORMATS[name]
        packed = "<" + "".join(_PACKED[letter] for letter in form)
        out.extend(b"\xa3\x95" + bytes([number]) + struct.pack(packed, *values))

    for name, (number, form, columns) in _FORMATS.items():
        size = 3 + struct.calcsize("<" + "".join(_PACKED[letter] for letter in form))
        row("FMT", number, size, name.encode(), form.encode(), columns.encode())
    lat, lon = round(HOME.lat_deg * 1e7), round(HOME.lon_deg * 1e7)
    row("MSG", 1000, f"{vehicle} V4.7.0".encode())
    row("ORGN", 1000, 1, lat, lon, HOME.alt_msl_m)
    for number, (command, x, y) in enumerate(before):
        row("CMD", 900, len(before), number, command, 0, 0, 0, 0, x, y, HEIGHT_M, 3)
    row("MSG", 1000, new)
    total = 6 if returns else 5
    if listed:
        row("CMD", 1000, total, 0, 16, 0, 0, 0, 0, lat, lon, HOME.alt_msl_m, 0)
    items: list[tuple[Any, ...]] = [
        (command, 0, 0, 0, 0, round(lat_deg * 1e7), round(lon_deg * 1e7), HEIGHT_M, 3)
        for command, lat_deg, lon_deg in places()
    ]
    items += [(20, 0, 0, 0, 0, 0, 0, 0, 0)] * returns
    for number, item in enumerate(items if listed else (), start=1):
        row("CMD", 1000, total, number, *item)
    fence = around()
    row("FNCE", 1000, len(fence) + 2, 0, 95, lat, lon, 0, 0)  # to return to
    for index, (at_lat, at_lon) in enumerate(fence):
        row("FNCE", 1000, len(fence) + 2, index + 1, 98, at_lat, at_lon, len(fence), 0)
    row("FNCE", 1000, len(fence) + 2, len(fence) + 1, 93, lat, lon, 0, 12.5)
    for at_us in (1000, 9000):
        row("RALY", at_us, 1, 0, *fence[0], 20, 0)
    mission, toward = None, -1
    for s in samples(off_m=off_m, returns=returns, pause_s=pause_s):
        t_us = round(s.t_s * 1e6)
        auto = s.mission or (returns and s.toward > 0)
        if auto != mission:
            mission = auto
            row("MODE", t_us, *((3, 3) if mission else (5, 5)), 2)
        if auto and s.toward != toward:
            toward = s.toward
            row(started, t_us, total, toward + 1, *items[toward])
        row("POS", t_us, round(s.lat_deg * 1e7), round(s.lon_deg * 1e7), s.alt_msl_m)
    path.write_bytes(out)
    return path


def write_tlog(
    path: Path,
    *,
    kind: int = 2,
    reboot: bool = False,
    back_s: float = 30.0,
    off_m: float = 0.0,
    returns: bool = False,
    pause_s: float = 0.0,
    before: Sequence[tuple[Any, int]] = (),
    current: Sequence[tuple[float, int]] = (),
    ardupilot: bool = False,
) -> Path:
    """As a ground station of PX4 writes it, or of ArduPilot, whose item 0 is home, with the upload
    of the mission. `before` it takes off more messages come, each from a system. `current`: times
    in s at which another item is told to be the current one than that which is flown to."""
    out = bytearray()
    vehicle, station = mav.MAVLink(None, 1, 1), mav.MAVLink(None, 255, 190)

    def told(t_s: float, message: Any, by: mav.MAVLink = vehicle) -> None:
        out.extend(struct.pack(">Q", round((1e9 + t_s) * 1e6)) + bytes(message.pack(by)))

    def heartbeat(t_s: float, mission: bool) -> None:
        custom = (4 << 16) | ((4 if mission else 3) << 24)
        if ardupilot:
            custom = 3 if mission else 5
        told(t_s, mav.MAVLink_heartbeat_message(kind, 3 if ardupilot else 12, 157, custom, 4, 3))

    heartbeat(0.0, False)
    home = round(HOME.lat_deg * 1e7), round(HOME.lon_deg * 1e7), round(HOME.alt_msl_m * 1e3)
    told(0.0, mav.MAVLink_home_position_message(*home, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))
    items = [(16, HOME.lat_deg, HOME.lon_deg)] * ardupilot + places()
    told(0.0, mav.MAVLink_mission_count_message(1, 1, len(items), 0), station)
    for seq, (command, lat, lon) in enumerate(items):
        at = round(lat * 1e7), round(lon * 1e7), HEIGHT_M
        told(0.1, mav.MAVLink_mission_item_int_message(
            1, 1, seq, 3, command, 0, 1, 0, 0, 0, 0, *at, 0), station)  # fmt: skip
    told(0.1, mav.MAVLink_mission_ack_message(255, 190, 0, 0))
    fence, (lat, lon, _) = around(), home
    drawn = [(5001, len(fence), *corner) for corner in fence] + [(5004, 12.5, lat, lon)]
    for kind_of, rows in ((1, drawn), (2, [(5100, 0, *fence[0])])):
        told(0.2, mav.MAVLink_mission_count_message(1, 1, len(rows), kind_of), station)
        for seq, (command, size, x, y) in enumerate(rows):
            told(0.2, mav.MAVLink_mission_item_int_message(
                1, 1, seq, 3, command, 0, 1, size, 0, 0, 0, x, y, 20, kind_of
            ), station)  # fmt: skip
        told(0.2, mav.MAVLink_mission_ack_message(255, 190, 0, kind_of))
    for message, system in before:
        told(0.3, message, mav.MAVLink(None, system, 1))
    mission, toward = False, -1
    for s in samples(off_m=off_m, returns=returns, pause_s=pause_s):
        if s.mission != mission:
            mission = s.mission
            heartbeat(s.t_s, mission)
        if s.mission and s.toward != toward:
            toward = s.toward
            told(s.t_s, mav.MAVLink_mission_current_message(toward + ardupilot))
        for t_s, seq in current:
            if t_s <= s.t_s < t_s + STEP_S:
                told(s.t_s, mav.MAVLink_mission_current_message(seq))
        boot_ms = round(1e3 * (s.t_s - back_s * (reboot and s.t_s > 40.0)))
        where = round(s.lat_deg * 1e7), round(s.lon_deg * 1e7), round(s.alt_msl_m * 1e3)
        told(s.t_s, mav.MAVLink_global_position_int_message(boot_ms, *where, 0, 0, 0, 0, 0))
    path.write_bytes(out)
    return path
