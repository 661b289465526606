"""A flight log of ours as PX4's ULog, for Flight Review, PlotJuggler and pyulog.

Topics and fields are those of PX4 1.14 and later, as far as our log knows them: what it does not
know is not in the file. Heights are as in our logs: above sea level, home's and the height over it.
"""

import json
import math
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import common as mav

from mission.base.area import Area, on_globe
from mission.base.errors import InputError
from mission.base.run_folder import write_atomically
from mission.flight.logs.ulog import COMMANDS, MISSIONS, MODES
from mission.flight.logs.ulog_file import Rows, rows, ulog
from mission.flight.missions.mission_path import items_of
from mission.log import topics
from mission.log.contents import Contents, load
from mission.log.control import ned_attitude
from mission.log.reader import decode, track, vectors
from mission.log.topics import Topic
from mission.log.values import NS_PER_S, ControlTrack, FlightData
from sitl.autopilot.codec.orders import GLOBAL_FRAMES
from sitl.autopilot.flying.route import item_altitude

_TYPE_OF = {command: kind for kind, command in COMMANDS.items()}
_NAV_STATES = {
    **{name: state for state, name in MODES.items()},
    "RETURN_TO_LAUNCH": 5,
    "RTL": 5,
    "AUTO": 3,
    "ALTCTL": 1,
    "POSCTL": 2,
    "FOLLOW_ME": 19,
}
_NO_STATE = 255  # a mode of another autopilot
_DISARMED, _ARMED = 1, 2
_ROTARY_WING = 1
_FIX_3D = 3
_MOTORS = 12  # that actuator_motors has room for
_SAID = ("status", "failsafe", "fault")  # events that are lines of text in a ULog

Places = dict[int, tuple[float, float, float, int]]  # lat, lon, alt, type of setpoint, by item


def export_ulog(path: Path, target: Path) -> Path:
    """Write the flight in a log of ours as a ULog.

    Raises:
        LogError: the log cannot be read. InputError: there is no flight in it, or the file exists
            or cannot be written.
    """
    contents = load(path)
    data = decode(contents)
    if target.exists():
        raise InputError(f"{target}: exists already; give another name")
    if not len(data.truth.t_ns):
        raise InputError(f"{path}: the log has no positions, so there is no flight in it")
    tables = {
        **_poses(contents, data, topics.EST_POSE, topics.EST_VELOCITY, ""),
        **({} if data.control is None else _control(data.area, data.control)),
        "vehicle_gps_position": _fixes(contents),
        "battery_status": rows(
            data.battery.t_ns,
            connected=True,
            voltage_v=data.battery.voltage_v,
            current_a=data.battery.current_a,
            discharged_mah=data.battery.consumed_mah,
            remaining=data.battery.remaining,
        ),
        "wind": rows(
            data.wind.t_ns,
            windspeed_north=data.wind.vel_mps[:, 1],
            windspeed_east=data.wind.vel_mps[:, 0],
        ),
        "home_position": rows(
            data.truth.t_ns[:1],
            lat=data.area.home.lat_deg,
            lon=data.area.home.lon_deg,
            alt=data.area.home.alt_msl_m,
            valid_alt=True,
            valid_hpos=True,
        ),
        "vehicle_status": _status(contents, data),
        **_mission(data),
    }
    if data.config.get("link", {}).get("kind") != "external":  # of others nobody knows the truth
        truth = _poses(contents, data, topics.TRUE_POSE, topics.TRUE_VELOCITY, "_groundtruth")
        tables.update(truth)
    lines = [(e.t_ns, e.severity, e.text) for e in data.events if e.kind in _SAID]
    missions = [(MISSIONS, json.dumps((m.t_ns, m.kind, m.items))) for m in data.missions]
    write_atomically(target, ulog(tables, lines, missions))
    return target


def _poses(
    contents: Contents, data: FlightData, poses: Topic, velocities: Topic, suffix: str
) -> dict[str, Rows]:
    """Local and global position, and attitude; velocities between those of the log."""
    samples = list(contents.decoded(poses))
    where = track(contents, poses)
    t_ns, xyz = where.t_ns, where.pos_m
    ned = data.area.to_ned(xyz[:, :2], xyz[:, 2])
    turns = [message.pose.orientation for _, message in samples]
    q = ned_attitude(np.array([(q.x, q.y, q.z, q.w) for q in turns], dtype=np.float64))
    known, enu = vectors(contents.decoded(velocities))
    axes = (enu[:, 1], enu[:, 0], -enu[:, 2])
    vel = [
        np.interp(t_ns, known, axis) if len(known) else np.full(len(t_ns), np.nan) for axis in axes
    ]
    w, x, y, z = q.T
    home = data.area.home
    places = on_globe(data.area, xyz[:, :2], xyz[:, 2])
    local = rows(
        t_ns,
        **dict.fromkeys(("xy_valid", "z_valid"), True),
        **dict.fromkeys(("v_xy_valid", "v_z_valid"), len(known) > 0),
        **dict(zip("xyz", ned.T, strict=True)),
        **dict(zip(("vx", "vy", "vz"), vel, strict=True)),
        heading=np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        **dict.fromkeys(("xy_global", "z_global"), True),
        ref_lat=home.lat_deg,
        ref_lon=home.lon_deg,
        ref_alt=home.alt_msl_m,
    )
    globe = rows(
        t_ns,
        lat=[place.lat_deg for place in places],
        lon=[place.lon_deg for place in places],
        alt=home.alt_msl_m - ned[:, 2],
    )
    return {
        f"vehicle_local_position{suffix}": local,
        f"vehicle_global_position{suffix}": globe,
        f"vehicle_attitude{suffix}": rows(t_ns, q=q),
    }


def _control(area: Area, track: ControlTrack) -> dict[str, Rows]:
    """Attitude, rates, motors and setpoints at the rate of the control."""
    t_ns, frd, ned = track.t_ns, np.array([1.0, -1.0, -1.0]), np.array([1.0, 1.0, -1.0])
    thrust = np.column_stack((np.zeros((len(t_ns), 2)), -track.thrust_setpoint))
    roll, pitch, yaw = (track.rates_setpoint_radps * frd).T
    motors = np.full((len(t_ns), _MOTORS), math.nan)
    motors[:, : track.motors.shape[1]] = track.motors
    place = track.position_setpoint_m
    vel, accel = track.velocity_setpoint_mps, track.acceleration_setpoint_mps2
    return {
        "vehicle_attitude": rows(t_ns, q=ned_attitude(track.attitude)),
        "vehicle_angular_velocity": rows(t_ns, xyz=track.rates_radps * frd),
        "vehicle_attitude_setpoint": rows(
            t_ns, q_d=ned_attitude(track.attitude_setpoint), thrust_body=thrust
        ),
        "vehicle_rates_setpoint": rows(t_ns, roll=roll, pitch=pitch, yaw=yaw, thrust_body=thrust),
        "actuator_motors": rows(t_ns, control=motors),
        "vehicle_local_position_setpoint": rows(
            t_ns,
            **dict(zip("xyz", area.to_ned(place[:, :2], place[:, 2]).T, strict=True)),
            **dict(zip(("vx", "vy", "vz"), (vel[:, [1, 0, 2]] * ned).T, strict=True)),
            acceleration=accel[:, [1, 0, 2]] * ned,
            yaw=math.pi / 2 - track.yaw_setpoint_rad[:, 0],
            yawspeed=-track.yaw_rate_setpoint_radps[:, 0],
        ),
    }


def _fixes(contents: Contents) -> Rows:
    fixes = list(contents.decoded(topics.GNSS))
    measured = [m.timestamp.seconds * NS_PER_S + m.timestamp.nanos for _, m in fixes]
    return rows(
        np.array([t for t, _ in fixes], dtype=np.int64),
        timestamp_sample=np.array(measured, dtype=np.int64) // 1000,
        latitude_deg=[m.latitude for _, m in fixes],
        longitude_deg=[m.longitude for _, m in fixes],
        altitude_msl_m=[m.altitude for _, m in fixes],
        eph=[math.sqrt(m.position_covariance[0]) for _, m in fixes],
        epv=[math.sqrt(m.position_covariance[8]) for _, m in fixes],
        fix_type=_FIX_3D,
    )


def _status(contents: Contents, data: FlightData) -> Rows:
    """Return rows of `vehicle_status`, each second and at changes; a failsafe is a pulse, for
    nothing says when it is over."""
    modes = list(contents.decoded(topics.MODE))
    if not modes:
        return rows(np.zeros(0, dtype=np.int64))
    changes = np.array([t for t, _ in modes], dtype=np.int64)
    pulses = np.array([e.t_ns for e in data.events if e.kind == "failsafe"], dtype=np.int64)
    regular = np.arange(changes[0], data.truth.t_ns[-1], NS_PER_S)
    # A pulse ends a microsecond, the least that a ULog tells apart, after it began.
    t_ns = np.unique(np.concatenate((regular, changes, pulses, pulses + 1000)) // 1000) * 1000
    t_ns = t_ns[t_ns >= changes[0] // 1000 * 1000]
    at = np.searchsorted(changes // 1000 * 1000, t_ns, side="right") - 1
    states = np.array([_NAV_STATES.get(row["mode"], _NO_STATE) for _, row in modes])[at]
    armed = np.array([row["armed"] for _, row in modes], dtype=bool)[at]
    return rows(
        t_ns,
        nav_state_timestamp=changes[at] // 1000,
        nav_state=states,
        arming_state=np.where(armed, _ARMED, _DISARMED),
        failsafe=np.isin(t_ns // 1000, pulses // 1000),
        vehicle_type=_ROTARY_WING,
        system_type=mav.MAV_TYPE_QUADROTOR,
    )


def _mission(data: FlightData) -> dict[str, Rows]:
    """The items reached and headed for, and their places where the log has them."""
    reached = [(e.t_ns, e.seq) for e in data.events if e.kind == "reached" and e.seq is not None]
    modes = zip(data.modes.t_ns.tolist(), data.modes.names, strict=True)
    starts = [(t, -1) for t, name in modes if name == "MISSION" and reached]
    last, found, headed = -1, [], []
    for t_ns, seq in sorted(starts + reached):
        last = seq if seq >= 0 else last
        current = next((after for t, after in reached if t > t_ns), last + 1)
        total, places = _items(data, t_ns)
        found.append((t_ns, last, current, total))
        if current in places:
            headed.append((t_ns, *places[current]))
    times, last_ones, currents, totals = np.array(found, dtype=np.int64).reshape(-1, 4).T
    numbers = {"seq_reached": last_ones, "seq_current": currents, "seq_total": totals}
    result = rows(times, **numbers, valid=True, finished=last_ones + 1 == totals)
    t_ns_of, lat, lon, alt, kinds = np.array(headed, dtype=np.float64).reshape(-1, 5).T
    t = t_ns_of.astype(np.int64)
    part = rows(t, valid=True, type=kinds.astype(np.uint8), lat=lat, lon=lon, alt=alt)
    return {"mission_result": result, "position_setpoint_triplet": rows(t, current=part)}


def _items(data: FlightData, t_ns: int) -> tuple[int, Places]:
    """Return how many items the mission in force at `t_ns` has, and the places of its items."""
    home = data.area.home
    for record in reversed(data.missions):
        if record.kind == "mission" and record.t_ns <= t_ns:
            return len(record.items), {
                item.seq: (item.x, item.y, item_altitude(item, home), _TYPE_OF.get(item.command, 0))
                for item in items_of(record)
                if item.frame in GLOBAL_FRAMES and (item.x, item.y) != (0.0, 0.0)
                if math.isfinite(item.x + item.y + item.z)
            }
    return 0, {}
