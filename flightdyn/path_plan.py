"""From a path to the trajectory that flies it: runs along the legs, blends at the corners."""

import math
from dataclasses import dataclass

from flightdyn.config import LimitsConfig
from flightdyn.corners import Leg, corner_speeds, make_leg
from flightdyn.frames import Triple
from flightdyn.path import FlightPath
from flightdyn.trajectory import Trajectory, TrajectoryBuilder

_SAME_POINT_M = 1e-3  # closer points are one corner


@dataclass(frozen=True, slots=True)
class Corner:
    """A point of the path, several where they coincide."""

    point: Triple
    count: int  # path points passed once this one is
    normal: Triple | None  # of the plane of closest approach; None at a reversal
    t_s: float  # when the reference is closest
    half_s: float  # half of the blend's duration


def _scale(v: Triple, k: float) -> Triple:
    return (v[0] * k, v[1] * k, v[2] * k)


def _step(p: Triple, u: Triple, k: float) -> Triple:
    return (p[0] + u[0] * k, p[1] + u[1] * k, p[2] + u[2] * k)


def _run(
    builder: TrajectoryBuilder, leg: Leg, v0: float, v1: float, length: float, end: Triple
) -> None:
    """Accelerate from v0, cruise, slow down to v1 on a straight of `length`."""
    a = leg.accel
    top = min(leg.speed, math.sqrt(max((v0 * v0 + v1 * v1) / 2 + a * length, 0.0)))
    top = max(top, v0, v1)
    up, down = (top * top - v0 * v0) / (2 * a), (top * top - v1 * v1) / (2 * a)
    cruise = max(length - up - down, 0.0)
    parts = (
        (v0, a, (top - v0) / a),
        (top, 0.0, cruise / top if top > 0 else 0.0),
        (top, -a, (top - v1) / a),
    )
    last = max((i for i, part in enumerate(parts) if part[2] > 0), default=0)
    for i, (v, accel, duration) in enumerate(parts):
        builder.add(
            _scale(leg.u, v),
            _scale(leg.u, accel),
            duration=duration,
            end=end if i == last else None,
        )


def plan_path(
    path: FlightPath, limits: LimitsConfig, *, start_vel: Triple = (0.0, 0.0, 0.0)
) -> tuple[Trajectory, list[Corner]]:
    """The trajectory along `path` from its first point, and its corners in order.

    Of a velocity at the start, the part along the first leg is kept.
    """
    points: list[Triple] = []
    counts: list[int] = []
    radii: list[float] = []
    speeds: list[float] = []
    for i, row in enumerate(path.points_ned_m.tolist()):
        point = (row[0], row[1], row[2])
        acceptance = float(path.acceptance_m[i])
        if points and math.dist(points[-1], point) < _SAME_POINT_M:
            counts[-1] = i + 1
            radii[-1] = min(radii[-1], acceptance)
            continue
        points.append(point)
        counts.append(i + 1)
        radii.append(acceptance)
        if i:
            speeds.append(float(path.speeds_mps[i - 1]))
    if len(points) == 1:
        return stand(points[0], limits), [Corner(points[0], counts[0], None, 0.0, 0.0)]
    legs = [
        make_leg(points[i], points[i + 1], speed=speeds[i], limits=limits)
        for i in range(len(speeds))
    ]
    along = sum(v * u for v, u in zip(start_vel, legs[0].u, strict=True))
    vertex, sines, accels = corner_speeds(
        legs, radii, share=limits.corner_cut, v_start=max(0.0, along)
    )
    builder = TrajectoryBuilder(points[0])
    corners = [Corner(points[0], counts[0], None, 0.0, 0.0)]
    for i, leg in enumerate(legs):
        v0, v1 = vertex[i], vertex[i + 1]
        before = v0 * v0 * sines[i] / accels[i]
        after = v1 * v1 * sines[i + 1] / accels[i + 1]
        stop = _step(points[i + 1], leg.u, -after)
        straight = max(leg.length - before - after, 0.0)
        _run(builder, leg, v0=v0, v1=v1, length=straight, end=stop)
        half = v1 * sines[i + 1] / accels[i + 1]
        normal = None
        if i + 1 < len(legs):
            out = legs[i + 1].u
            if half > 0:
                bend = _scale(
                    (out[0] - leg.u[0], out[1] - leg.u[1], out[2] - leg.u[2]), v1 / (2 * half)
                )
                builder.add(
                    _scale(leg.u, v1),
                    bend,
                    duration=2 * half,
                    end=_step(points[i + 1], out, after),
                )
            total = (out[0] + leg.u[0], out[1] + leg.u[1], out[2] + leg.u[2])
            size = math.sqrt(total[0] ** 2 + total[1] ** 2 + total[2] ** 2)
            normal = _scale(total, 1 / size) if size > 0.2 else None
        corners.append(Corner(points[i + 1], counts[i + 1], normal, builder.t - half, half))
    return builder.stop(points[-1], window_s=limits.smoothing_s), corners


def stand(point: Triple, limits: LimitsConfig) -> Trajectory:
    """Stay at `point`."""
    return TrajectoryBuilder(point).stop(point, window_s=limits.smoothing_s)


def brake_and_go(start: Triple, vel: Triple, *, goal: Triple, limits: LimitsConfig) -> Trajectory:
    """Slow down from `vel` on the present course to a stop, then straight to `goal` and stop."""
    builder = TrajectoryBuilder(start)
    speed = math.sqrt(vel[0] ** 2 + vel[1] ** 2 + vel[2] ** 2)
    if speed > 0.05:
        a = limits.acceleration_mps2
        builder.add(vel, _scale(vel, -a / speed), duration=speed / a)
    if math.dist(builder.p, goal) > _SAME_POINT_M:
        leg = make_leg(builder.p, goal, speed=limits.hold_speed_mps, limits=limits)
        _run(builder, leg, v0=0.0, v1=0.0, length=leg.length, end=goal)
    return builder.stop(goal, window_s=limits.smoothing_s)
