"""Encoding of values as log messages. NED becomes the viewers' east-north-up here and in `control`.

Numbers of high-rate topics are rounded to a binary grid far below any sensor's noise (positions
1 mm, velocities 1 mm/s, quaternions 1.5e-5, degrees 7e-9, points of paths 8 mm), which halves
the log: the zeroed bits compress. Records of plans, rounds and uplinks stay exact.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from foxglove import messages as fox
from pydantic_core import to_json

from fl.radio.per_grid import PerGrid
from flightdyn.frames import LocalFrame
from flightdyn.state import BatteryState, GeodeticPoint, GnssFix, Innovation, Kinematics, Vector
from mission.base.area import Area
from mission.log.records import as_json
from mission.log.topics import BODY_FRAME, FRAME
from mission.log.values import NS_PER_S, SENSORS, XYZ

POSITION_GRID = 2.0**10  # cells a metre
PATH_GRID = 2.0**7
VELOCITY_GRID = 2.0**10  # cells a metre per second
QUATERNION_GRID = 2.0**16
DEGREE_GRID = 2.0**27
GRID_PLACES = 81  # along the longer side of a grid: 80 kB for 12 devices, before they are packed

_ENCODER = json.JSONEncoder(separators=(",", ":"), allow_nan=False, check_circular=False)

Pose: TypeAlias = tuple[Any, Any]  # fox.Vector3 and fox.Quaternion

_LEVELS = {
    **dict.fromkeys((0, 1, 2), fox.LogLevel.Fatal),
    3: fox.LogLevel.Error,
    4: fox.LogLevel.Warning,
    **dict.fromkeys((5, 6), fox.LogLevel.Info),
    7: fox.LogLevel.Debug,
}


def encoded(message: Any) -> bytes:
    """A Foxglove message as protobuf."""
    data: bytes = message.encode()
    return data


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


def area_pose(area: Area, state: Kinematics) -> Pose:
    """Position and orientation in the area's frame, rounded.

    FRD -> NED attitude (w, x, y, z) becomes FLU -> ENU, which is what viewers expect: NED -> ENU
    turns by pi about (north + east), FLU -> FRD by pi about forward. Their product with the
    attitude written out needs sums only.
    """
    w, x, y, z = state.q_frd_to_ned.tolist()
    half, grid = math.sqrt(0.5) * QUATERNION_GRID, QUATERNION_GRID
    turn = fox.Quaternion(
        x=round((x + y) * half) / grid,
        y=round((x - y) * half) / grid,
        z=round((w - z) * half) / grid,
        w=round((w + z) * half) / grid,
    )
    return vector(area_xyz(area, state.pos_ned_m), grid=POSITION_GRID), turn


def pose(stamp: fox.Timestamp, where: Pose) -> bytes:
    """PoseInFrame in the area's frame."""
    return encoded(
        fox.PoseInFrame(
            timestamp=stamp,
            frame_id=FRAME,
            pose=fox.Pose(position=where[0], orientation=where[1]),
        )
    )


def success_grid(t_ns: int, grid: PerGrid) -> bytes:
    """Foxglove Grid of each device's packet success probability, one byte each: 255 for 1."""
    every = math.ceil(max(grid.success.shape[1:]) / GRID_PLACES)
    shares = np.moveaxis(np.rint(255.0 * grid.success[:, ::every, ::every]), 0, -1)
    _, columns, devices = shares.shape
    cell_m = grid.cell_m * every
    x, y = (first - 0.5 * cell_m for first in grid.first_m)  # a place is the middle of its cell
    byte = fox.PackedElementFieldNumericType.Uint8
    return encoded(
        fox.Grid(
            timestamp=timestamp(t_ns),
            frame_id=FRAME,
            pose=fox.Pose(position=fox.Vector3(x=x, y=y, z=0.0), orientation=fox.Quaternion(w=1.0)),
            column_count=columns,
            cell_size=fox.Vector2(x=cell_m, y=cell_m),
            row_stride=columns * devices,
            cell_stride=devices,
            fields=[
                fox.PackedElementField(name=f"device {device}", offset=device, type=byte)
                for device in range(devices)
            ],
            data=shares.astype(np.uint8).tobytes(),
        )
    )


def transform(stamp: fox.Timestamp, where: Pose) -> bytes:
    """FrameTransform from the area's frame to the aircraft's."""
    return encoded(
        fox.FrameTransform(
            timestamp=stamp,
            parent_frame_id=FRAME,
            child_frame_id=BODY_FRAME,
            translation=where[0],
            rotation=where[1],
        )
    )


def velocity(vel_ned_mps: Vector) -> bytes:
    """Vector3, east-north-up metres per second."""
    north, east, down = vel_ned_mps.tolist()
    x, y, z = (round(value * VELOCITY_GRID) / VELOCITY_GRID for value in (east, north, -down))
    return encoded(fox.Vector3(x=x, y=y, z=z))


def path(stamp: fox.Timestamp, points_m: Iterable[Sequence[float]]) -> bytes:
    """PosesInFrame of points (x, y, z) in the area's frame, without orientation."""
    level = fox.Quaternion(w=1.0)
    poses = [fox.Pose(position=vector(p, grid=PATH_GRID), orientation=level) for p in points_m]
    return encoded(fox.PosesInFrame(timestamp=stamp, frame_id=FRAME, poses=poses))


def gnss(frame: LocalFrame, fix: GnssFix) -> bytes:
    """LocationFix of a receiver's solution, stamped with the instant that it describes."""
    h, v = fix.std_horizontal_m**2, fix.std_vertical_m**2
    return encoded(
        fox.LocationFix(
            timestamp=timestamp(max(fix.t_ns, 0)),  # the first may describe instants before zero
            frame_id="gnss",
            position_covariance=[h, 0.0, 0.0, 0.0, h, 0.0, 0.0, 0.0, v],
            position_covariance_type=fox.LocationFixPositionCovarianceType.DiagonalKnown,
            **_geodetic(frame.to_geodetic(fix.pos_ned_m)),
        )
    )


def location(stamp: fox.Timestamp, where: GeodeticPoint) -> bytes:
    """LocationFix of a position without error."""
    return encoded(fox.LocationFix(timestamp=stamp, frame_id=BODY_FRAME, **_geodetic(where)))


def feature(geometry: str, coordinates: object, /, **properties: object) -> dict[str, object]:
    """A feature of GeoJSON (RFC 7946)."""
    drawn = {"type": geometry, "coordinates": coordinates}
    return {"type": "Feature", "geometry": drawn, "properties": properties}


def geojson(features: Sequence[Mapping[str, object]]) -> str:
    """A collection of features (RFC 7946)."""
    collection = {"type": "FeatureCollection", "features": features}
    return json.dumps(collection, separators=(",", ":"))


def log_line(t_ns: int, text: str, *, severity: int, source: str) -> bytes:
    """Foxglove Log message of the level that matches a MAV_SEVERITY."""
    return encoded(
        fox.Log(timestamp=timestamp(t_ns), level=_LEVELS[severity], message=text, name=source)
    )


def battery(state: BatteryState) -> bytes:
    """Our battery record, rounded to what a meter would show."""
    return to_bytes(
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
    measured = {item.kind: item for item in items}
    for name, sensor in SENSORS.items():
        item = measured.get(sensor)
        values[name] = item and {
            "values": [_brief(value) for value in item.values],
            "stds": [_brief(value) for value in item.stds],
            "ratio": _brief(item.ratio),
            "accepted": item.accepted,
        }
    return to_bytes(values)


def _brief(value: float) -> float:
    return float(f"{value:.4g}")


def record(item: object) -> bytes:
    """One of our own records as JSON."""
    return to_bytes(as_json(item))


def to_bytes(values: Mapping[str, object]) -> bytes:
    """Encode values as JSON: numbers in their shortest exact form, NaN and infinity as null."""
    try:
        text = _ENCODER.encode(values)
    except ValueError:  # a NaN or an infinity, which few records have
        text = _ENCODER.encode(json.loads(to_json(values, inf_nan_mode="null")))
    return text.encode()


def _geodetic(where: GeodeticPoint) -> dict[str, float]:
    return {
        "latitude": round(where.lat_deg * DEGREE_GRID) / DEGREE_GRID,
        "longitude": round(where.lon_deg * DEGREE_GRID) / DEGREE_GRID,
        "altitude": round(where.alt_msl_m * POSITION_GRID) / POSITION_GRID,
    }
