"""PX4's ULog as a flight.

A ULog of PX4 does not hold the mission, only what the navigator was heading for: its position
setpoints in the mission mode are taken for the items, as far as they were flown. Ours holds it.
"""

import json
import math
from bisect import bisect
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint
from mission.flight.logs.flight import LogKind, LogRows
from mission.flight.logs.sources import ULOG
from mission.flight.logs.ulog_file import Columns, decoded
from mission.log.records import from_json
from mission.log.signals import gathered
from mission.log.values import COPTER, OURS, PLANE, ROVER, MissionRecord
from sitl.autopilot.codec.orders import MissionItem

# vehicle_status.nav_state, as ground stations call the modes.
MODES = {
    0: "MANUAL", 1: "ALTITUDE", 2: "POSITION", 3: "MISSION", 4: "HOLD", 5: "RETURN", 10: "ACRO",
    12: "DESCEND", 13: "TERMINATED", 14: "OFFBOARD", 15: "STABILIZED", 17: "TAKEOFF", 18: "LAND",
    19: "FOLLOW", 20: "PRECISION LAND", 21: "ORBIT",
}  # fmt: skip
_VEHICLES = {2: PLANE, 3: ROVER}  # vehicle_status.vehicle_type
_ARMED = 2
COMMANDS = {  # of position_setpoint.type
    0: mav.MAV_CMD_NAV_WAYPOINT,
    2: mav.MAV_CMD_NAV_LOITER_UNLIM,
    3: mav.MAV_CMD_NAV_TAKEOFF,
    4: mav.MAV_CMD_NAV_LAND,
}
# Of mission_result, from PX4 1.15 on, before, and long before: another mission has another one.
_IDENTITIES = ("mission_id", "instance_count", "seq_total")
MISSIONS = "aerofed_missions"  # what a ULog of ours holds more
_MSL = mav.MAV_FRAME_GLOBAL
_JUMP = mav.MAV_CMD_DO_JUMP
_SETTLED_NS = 100_000_000
_FIX_3D = 3
_UNKNOWN = -1.0  # number of a battery
_REGULAR = (  # topics by which the clock is known, the best first
    *("vehicle_global_position", "vehicle_gps_position", "vehicle_local_position"),
    "vehicle_attitude",
)


def _take(content: bytes, rows: LogRows) -> None:
    """Keep what the topics of a ULog, and its texts by name, say."""
    topics, told = decoded(content, rows)
    names = "vehicle_global_position", "vehicle_gps_position", "sensor_gps"
    rows.places = list(_places(topics, names))
    if not rows.places:
        rows.places = list(_local(topics.get("vehicle_local_position")))
    rows.truth = list(_places(topics, ("vehicle_global_position_groundtruth",)))
    rows.homes = list(_homes(topics.get("home_position")))
    _status(rows, topics.get("vehicle_status"))
    rows.battery = list(_battery(topics.get("battery_status")))
    wind = topics.get("wind", topics.get("wind_estimate"))
    rows.wind = list(_rows(wind, "windspeed_east", "windspeed_north"))
    fixes = topics.get("vehicle_gps_position")
    rows.fixes = [int(row[0]) for row in _rows(fixes, "fix_type") if row[1] >= _FIX_3D]
    for name in ("vehicle_gps_position", "sensor_gps"):
        later = "timestamp_time_relative"  # by which the UTC is of another instant than the row
        columns = {later: 0 * topics[name]["timestamp"], **topics[name]} if name in topics else None
        times = _rows(columns, "time_utc_usec", later)
        rows.utc_ns += [(int(t) + _ns(by), _ns(utc)) for t, utc, by in times if utc]
    if rows.truth and told.get("sys_name") == [["Aerofed"]]:
        rows.clock = OURS.clock
    for parts in told.get(MISSIONS, ()):
        t_ns, kind, items = json.loads("".join(parts))
        row = {"kind": kind, "items": items}
        rows.missions.append(from_json(MissionRecord, row, t_ns=int(t_ns)))
    _heading_for(rows, topics)
    rows.skipped["event of PX4's events interface"] += len(
        topics.get("event", {"timestamp": ()})["timestamp"]
    )
    timed = {name: {**of, "t_s": of["timestamp"] / 1e6} for name, of in topics.items()}
    rows.signals = gathered(timed, ULOG)


KIND = LogKind("ULog of PX4", "seconds since PX4 started", _REGULAR, _take)


def _ns(timestamp_us: float) -> int:
    return int(timestamp_us) * 1000


def _rows(data: Columns | None, *names: str) -> Iterator[tuple[float, ...]]:
    """(t_ns, ...) of some columns; nothing where one is missing."""
    if data is None or any(name not in data for name in names):
        return
    columns = [data[name].tolist() for name in names]
    for t_us, *values in zip(data["timestamp"].tolist(), *columns, strict=True):
        yield (_ns(t_us), *values)


def _places(topics: dict[str, Columns], names: tuple[str, ...]) -> Iterator[tuple[float, ...]]:
    """Yield (t_ns, latitude, longitude, altitude) of the first of the topics that is present."""
    data = next((topics[name] for name in names if name in topics), None)
    if data is None:
        return
    if "latitude_deg" in data:
        yield from _rows(data, "latitude_deg", "longitude_deg", "altitude_msl_m")
        return
    for t_ns, lat, lon, alt in _rows(data, "lat", "lon", "alt"):
        # A receiver's are whole numbers in the logs of old versions.
        whole = abs(lat) > 90 or abs(lon) > 180
        scale, tall = (1e-7, 1e-3) if whole else (1.0, 1.0)
        yield int(t_ns), lat * scale, lon * scale, alt * tall


def _homes(data: Columns | None) -> Iterator[tuple[float, ...]]:
    """Yield the home positions that PX4 marks as valid, where it does; the others are zeros."""
    says = [name for name in ("valid_hpos", "valid_alt") if data and name in data]
    for t_ns, lat, lon, alt, *valid in _rows(data, "lat", "lon", "alt", *says):
        if all(valid):
            yield t_ns, lat, lon, alt


def _battery(data: Columns | None) -> Iterator[tuple[float, ...]]:
    """Rows of the battery; PX4 writes -1 for what it does not know."""
    names = ("voltage_v", "current_a", "discharged_mah", "remaining")
    for t_ns, *values in _rows(data, *names):
        yield t_ns, *(math.nan if value == _UNKNOWN else value for value in values)


def _local(data: Columns | None) -> Iterator[tuple[float, ...]]:
    """Yield (t_ns, latitude, longitude, altitude) of local positions with a known reference."""
    for t_ns, x, y, z, lat, lon, alt, valid in _rows(
        data, "x", "y", "z", "ref_lat", "ref_lon", "ref_alt", "xy_global"
    ):
        if valid and math.isfinite(lat + lon + alt):
            place = LocalFrame(GeodeticPoint(lat, lon, alt)).to_geodetic(np.array([x, y, z]))
            yield int(t_ns), place.lat_deg, place.lon_deg, alt - z


def _status(found: LogRows, data: Columns | None) -> None:
    """Kind of vehicle, modes, arming, failsafes."""
    kinds = {int(row[1]) for row in _rows(data, "vehicle_type")}
    if 1 not in kinds:  # a rotary wing, as a VTOL is part of the time
        found.vehicle = _VEHICLES.get(max(kinds, default=0), COPTER)
    # The topic comes twice a second; when the mode changed it says exactly, where it says so.
    since = "nav_state_timestamp" if data and "nav_state_timestamp" in data else "timestamp"
    names = "nav_state", since, "arming_state", "failsafe"
    for t, state, since_us, arming, lost in _rows(data, *names):
        t_ns = int(t)
        found.armed(t_ns, on=arming == _ARMED)
        found.mode(min(t_ns, _ns(since_us)), MODES.get(int(state), f"MODE {state:g}"))
        found.failing(t_ns, "failsafe", on=bool(lost))


def _heading_for(found: LogRows, topics: dict[str, Columns]) -> None:
    """Collect the missions as far as they were flown: position setpoints in mission mode, by item.
    An item without a place of its own, such as a change of speed, is left open."""
    result = topics.get("mission_result", {})
    identity = next((name for name in _IDENTITIES if name in result), _IDENTITIES[-1])
    told = list(_rows(result, "seq_current", "finished", identity))
    for t, seq, *_ in told:
        found.heads_for(int(t), int(seq))
    if found.missions or not told:
        return
    since = [told[0][0], *(now[0] for last, now in pairwise(told) if now[3] != last[3])]
    missions: list[dict[int, MissionItem]] = [{} for _ in since]
    jumps = ("item_do_jump_changed", "item_changed_index", "item_do_jump_remaining")
    for t, target, jumped, seq, left in _rows(result, "seq_current", *jumps):
        if jumped:  # of a DO_JUMP's times the first one leaves the most
            times = (float(target), left + 1.0, 0.0, 0.0)
            item = MissionItem(int(seq), _JUMP, mav.MAV_FRAME_MISSION, times, 0.0, 0.0, 0.0)
            missions[max(bisect(since, t) - 1, 0)].setdefault(int(seq), item)
    modes, at = [t for t, _ in found.modes], [row[0] for row in told]
    names = ("current.valid", "current.type", "current.lat", "current.lon", "current.alt")
    for t, valid, kind, lat, lon, alt in _rows(topics.get("position_setpoint_triplet"), *names):
        # An item that changes the mode is told before it does, with the place of the last one.
        mode = found.modes[max(bisect(modes, t + _SETTLED_NS) - 1, 0)][1] if modes else ""
        if not valid or mode != "MISSION" or int(kind) not in COMMANDS:
            continue
        _, seq, finished, _ = told[max(bisect(at, t) - 1, 0)]
        if not finished:  # then it hovers where it is
            item = MissionItem(int(seq), COMMANDS[int(kind)], _MSL, (0.0,) * 4, lat, lon, alt)
            missions[max(bisect(since, t) - 1, 0)][int(seq)] = item
    for since_ns, items in zip(since, missions, strict=True):
        if items:
            found.add_list(int(since_ns), items)
