"""Our values as log messages: the one place where NED becomes the east-north-up of the viewers.

Numbers of high-rate topics are rounded to a binary grid far below any sensor's noise (positions
1 mm, velocities 1 mm/s, quaternions 1.5e-5, degrees 7e-9, points of paths 8 mm), which halves
the log: the zeroed bits compress. Records of plans, rounds and uplinks stay exact.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from foxglove import messages as fox

from flightdyn.frames import LocalFrame
from flightdyn.state import (
    BatteryState,
    GeodeticPoint,
    GnssFix,
    Innovation,
    Kinematics,
    Vector,
)
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.log.templates import Template
from mission.log.topics import BODY_FRAME, FRAME, SENSORS
from mission.log.values import NS_PER_S, PlanRecord, Zone

POSITION_GRID = 2.0**10  # cells a metre
PATH_GRID = 2.0**7
VELOCITY_GRID = 2.0**10  # cells a metre per second
QUATERNION_GRID = 2.0**16
DEGREE_GRID = 2.0**27
_PLACE_GRID = np.array([POSITION_GRID] * 3 + [QUATERNION_GRID] * 4)

_ENCODER = json.JSONEncoder(separators=(",", ":"), allow_nan=False)

XYZ = tuple[float, float, float]

_LEVELS = {
    **dict.fromkeys((0, 1, 2), fox.LogLevel.Fatal),
    3: fox.LogLevel.Error,
    4: fox.LogLevel.Warning,
    **dict.fromkeys((5, 6), fox.LogLevel.Info),
    7: fox.LogLevel.Debug,
}


def timestamp(t_ns: int) -> fox.Timestamp:
    """Simulated nanoseconds as a Foxglove timestamp."""
    return fox.Timestamp(t_ns // NS_PER_S, t_ns % NS_PER_S)


def area_xyz(area: Area, pos_ned_m: Vector) -> XYZ:
    """NED about home -> x east, y north from the area's corner, height above home."""
    north, east, down = pos_ned_m.tolist()
    return (east + area.home_m[0], north + area.home_m[1], -down)


def vector(xyz: Sequence[float], *, grid: float) -> fox.Vector3:
    """A Foxglove vector, rounded to `grid` cells a unit."""
    x, y, z = xyz
    return fox.Vector3(x=round(x * grid) / grid, y=round(y * grid) / grid, z=round(z * grid) / grid)


def _pose(stamp: fox.Timestamp, numbers: Sequence[float]) -> fox.PoseInFrame:
    """Of an example: in the area's frame, position and orientation (x, y, z, w)."""
    x, y, z, *turn = numbers
    place = fox.Pose(
        position=fox.Vector3(x=x, y=y, z=z),
        orientation=fox.Quaternion(**dict(zip("xyzw", turn, strict=True))),
    )
    return fox.PoseInFrame(timestamp=stamp, frame_id=FRAME, pose=place)


def _transform(stamp: fox.Timestamp, numbers: Sequence[float]) -> fox.FrameTransform:
    """The same, as that from the area's frame to the aircraft's."""
    x, y, z, *turn = numbers
    return fox.FrameTransform(
        timestamp=stamp,
        parent_frame_id=FRAME,
        child_frame_id=BODY_FRAME,
        translation=fox.Vector3(x=x, y=y, z=z),
        rotation=fox.Quaternion(**dict(zip("xyzw", turn, strict=True))),
    )


POSE, TRANSFORM = Template(_pose, 7), Template(_transform, 7)


def places(area: Area, states: Sequence[Kinematics]) -> Floats:
    """Position and orientation (n, 7) as `POSE` and `TRANSFORM` take them, rounded.

    FRD -> NED attitude (w, x, y, z) becomes FLU -> ENU, which is what viewers expect: NED -> ENU
    turns by pi about (north + east), FLU -> FRD by pi about forward. Their product with the
    attitude written out needs sums only.
    """
    there = np.array([[*s.pos_ned_m.tolist(), *s.q_frd_to_ned.tolist()] for s in states]).T
    north, east, down, w, x, y, z = there
    half = math.sqrt(0.5) * QUATERNION_GRID
    numbers = np.array(
        (
            (east + area.home_m[0]) * POSITION_GRID,
            (north + area.home_m[1]) * POSITION_GRID,
            -down * POSITION_GRID,
            (x + y) * half,
            (x - y) * half,
            (w - z) * half,
            (w + z) * half,
        )
    )
    return np.asarray(np.rint(numbers).T / _PLACE_GRID)


def velocity(vel_ned_mps: Vector) -> bytes:
    """Vector3, east-north-up metres per second."""
    north, east, down = vel_ned_mps.tolist()
    data: bytes = vector((east, north, -down), grid=VELOCITY_GRID).encode()
    return data


def point(stamp: fox.Timestamp, xyz: XYZ) -> bytes:
    """Point3InFrame in the area's frame."""
    x, y, z = (round(value * POSITION_GRID) / POSITION_GRID for value in xyz)
    data: bytes = fox.Point3InFrame(
        timestamp=stamp, frame_id=FRAME, point=fox.Point3(x=x, y=y, z=z)
    ).encode()
    return data


def path(stamp: fox.Timestamp, points: bytes | bytearray) -> bytes:
    """PosesInFrame of `path_points` in the area's frame.

    Fields that are encoded one after another are one message: a path that grows is encoded once.
    """
    head: bytes = fox.PosesInFrame(timestamp=stamp, frame_id=FRAME).encode()
    return head + points


def path_points(points_m: Iterable[XYZ]) -> bytes:
    """Points (x, y, z) of a path, without orientation."""
    level = fox.Quaternion(w=1.0)
    poses = [fox.Pose(position=vector(p, grid=PATH_GRID), orientation=level) for p in points_m]
    data: bytes = fox.PosesInFrame(poses=poses).encode()
    return data


def _fix(stamp: fox.Timestamp, numbers: Sequence[float]) -> fox.LocationFix:
    """Of an example: where, and the variances north, east and down."""
    lat, lon, alt, north, east, down = numbers
    return fox.LocationFix(
        timestamp=stamp,
        frame_id="gnss",
        latitude=lat,
        longitude=lon,
        altitude=alt,
        position_covariance=[north, 0.0, 0.0, 0.0, east, 0.0, 0.0, 0.0, down],
        position_covariance_type=fox.LocationFixPositionCovarianceType.DiagonalKnown,
    )


_FIX = Template(_fix, 6)


def gnss(frame: LocalFrame, fixes: Sequence[GnssFix]) -> list[bytes]:
    """LocationFix of each of a receiver's solutions, stamped with the instant that it describes."""
    # A receiver's first solutions may describe instants before the clock's zero.
    t_ns = np.array([max(fix.t_ns, 0) for fix in fixes])
    numbers = []
    for fix in fixes:
        h, v = fix.std_horizontal_m**2, fix.std_vertical_m**2
        where = _geodetic(frame.to_geodetic(fix.pos_ned_m))
        numbers.append([*where.values(), h, h, v])
    return _FIX.fill(t_ns, np.array(numbers))


def location(stamp: fox.Timestamp, where: GeodeticPoint) -> bytes:
    """LocationFix of a position without error."""
    data: bytes = fox.LocationFix(timestamp=stamp, frame_id=BODY_FRAME, **_geodetic(where)).encode()
    return data


def geojson(features: Sequence[Mapping[str, object]]) -> bytes:
    """GeoJson of a collection of features (RFC 7946)."""
    text = json.dumps(
        {"type": "FeatureCollection", "features": list(features)}, separators=(",", ":")
    )
    data: bytes = fox.GeoJson(geojson=text).encode()
    return data


def log_line(t_ns: int, text: str, *, severity: int, source: str) -> bytes:
    """Log with the level of a MAV_SEVERITY."""
    data: bytes = fox.Log(
        timestamp=timestamp(t_ns), level=_LEVELS[severity], message=text, name=source
    ).encode()
    return data


def plan(written: PlanRecord) -> bytes:
    """Our record of a round's plan; the schedule as pairs of step and device."""
    at = written.stops_at
    return record(
        {
            "round": written.round,
            "waypoints_m": written.waypoints_m.tolist(),
            "schedule": np.argwhere(written.schedule).tolist(),
            "importance": written.importance.tolist(),
            "value": float(written.value),
            "upper_bound": float(written.upper_bound),
            "path_budget_m": float(written.path_budget_m),
            "speed_mps": float(written.speed_mps),
            "altitude_m": float(written.altitude_m),
            "height_m": written.height_m.tolist(),
            "slot_s": written.slot_s.tolist(),
            "duration_s": float(written.duration_s),
            "route_m": written.route_m.tolist(),
            # Only where there are corners between, so that other runs' logs stay as they were.
            **({} if len(at) == len(written.route_m) else {"stops_at": at.tolist()}),
        }
    )


def fence(zones: Sequence[Zone]) -> bytes:
    """Our record of the fence."""
    return record(
        {
            "keep_in_m": [zone.outline_m.tolist() for zone in zones if zone.keep_in],
            "keep_out_m": [zone.outline_m.tolist() for zone in zones if not zone.keep_in],
        }
    )


def battery(state: BatteryState) -> bytes:
    """Our battery record, rounded to what a meter would show."""
    return record(
        {
            "voltage_v": round(state.voltage_v, 3),
            "current_a": round(state.current_a, 3),
            "consumed_mah": round(state.consumed_mah, 2),
            "remaining": round(state.remaining, 6),
        }
    )


def innovations(items: Sequence[Innovation]) -> bytes:
    """Our record of one instant's innovations, to four significant digits."""
    values: dict[str, object] = {"t_s": items[0].t_ns / NS_PER_S}
    values |= dict.fromkeys(sensor.replace(" ", "_") for sensor in SENSORS)
    for item in items:
        values[item.kind.replace(" ", "_")] = {
            "values": [_brief(value) for value in item.values],
            "stds": [_brief(value) for value in item.stds],
            "ratio": _brief(item.ratio),
            "accepted": item.accepted,
        }
    return record(values)


def _brief(value: float) -> float:
    return float(f"{value:.4g}")


def record(values: Mapping[str, object]) -> bytes:
    """One of our own records as JSON; numbers in their shortest exact form, NaN as null."""
    try:
        text = _ENCODER.encode(values)
    except ValueError:  # a NaN or an infinity, which few records have
        text = _ENCODER.encode(_finite(values))
    return text.encode()


def _finite(value: object) -> object:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def _geodetic(where: GeodeticPoint) -> dict[str, float]:
    return {
        "latitude": round(where.lat_deg * DEGREE_GRID) / DEGREE_GRID,
        "longitude": round(where.lon_deg * DEGREE_GRID) / DEGREE_GRID,
        "altitude": round(where.alt_msl_m * POSITION_GRID) / POSITION_GRID,
    }
