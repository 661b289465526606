"""From a path to the trajectory that flies it: runs along the legs, blends at the corners."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from flightdyn.config import LimitsConfig
from flightdyn.frames import Triple
from flightdyn.guidance.corners import Leg, corner_speeds, make_leg
from flightdyn.guidance.path import FlightPath
from flightdyn.guidance.trajectory import Trajectory, TrajectoryBuilder

_SAME_POINT_M = 1e-3  # closer points are one corner
_ACROSS_MPS = 4.0  # more speed across the first leg is braked off before it is begun
_ALONG_MPS = 1.0  # so is more along it than its first corner allows


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


def _parts(leg: Leg, v0: float, v1: float, length: float) -> list[Triple]:
    """(speed at first, acceleration, duration) of speeding up, cruising and slowing down, from v0
    to v1 on a straight of `length`."""
    a = leg.accel
    top = min(leg.speed, math.sqrt(max((v0 * v0 + v1 * v1) / 2 + a * length, 0.0)))
    top = max(top, v0, v1)
    up, down = (top * top - v0 * v0) / (2 * a), (top * top - v1 * v1) / (2 * a)
    cruise = max(length - up - down, 0.0)
    return [
        (v0, a, (top - v0) / a),
        (top, 0.0, cruise / top if top > 0 else 0.0),
        (top, -a, (top - v1) / a),
    ]


def _run(
    builder: TrajectoryBuilder, leg: Leg, v0: float, v1: float, length: float, end: Triple
) -> None:
    """Accelerate from v0, cruise, slow down to v1 on a straight of `length`."""
    parts = _parts(leg, v0, v1, length)
    last = max((i for i, part in enumerate(parts) if part[2] > 0), default=0)
    for i, (v, accel, duration) in enumerate(parts):
        builder.add(
            _scale(leg.u, v),
            _scale(leg.u, accel),
            duration=duration,
            end=end if i == last else None,
        )


def passing_times(path: FlightPath, limits: LimitsConfig) -> list[float]:
    """Seconds (M,) after which the trajectory of `plan_path` passes each of its points, from rest
    to rest, without making it; the last stands for its end."""
    row = path.points_ned_m[0].tolist()
    v = _vertices(path, (row[0], row[1], row[2]))
    plan = _speeds(v, limits, (0.0, 0.0, 0.0)) if len(v.points) > 1 else None
    if plan is None:
        return [0.0] + [limits.smoothing_s] * (v.counts[0] - 1)
    blends = [v * s / a for v, s, a in zip(plan.speeds, plan.sines, plan.accels, strict=True)]
    passed, now = [0.0], limits.smoothing_s / 2
    for i, leg in enumerate(plan.legs):
        v0, v1 = plan.speeds[i], plan.speeds[i + 1]
        straight = max(leg.length - v0 * blends[i] - v1 * blends[i + 1], 0.0)
        now += blends[i] + sum(part[2] for part in _parts(leg, v0, v1, straight)) + blends[i + 1]
        passed += [now] * (v.counts[i + 1] - len(passed))
    at_end = v.counts[-1] - v.counts[-2]
    return passed[:-at_end] + [now + limits.smoothing_s / 2] * at_end


class _Vertices(NamedTuple):
    """The path's points with coincident ones made one."""

    points: list[Triple]
    counts: list[int]  # path points passed once the vertex is
    radii: list[float]
    speeds: list[float]  # of the leg that ends at the next vertex


def _vertices(path: FlightPath, start: Triple) -> _Vertices:
    """Vertices of `path` when it is begun from `start` instead of its first point."""
    v = _Vertices([start], [1], [float(path.acceptance_m[0])], [])
    for i, row in enumerate(path.points_ned_m.tolist()[1:], 1):
        point = (row[0], row[1], row[2])
        acceptance = float(path.acceptance_m[i])
        if math.dist(v.points[-1], point) < _SAME_POINT_M:
            v.counts[-1] = i + 1
            v.radii[-1] = min(v.radii[-1], acceptance)
            continue
        v.points.append(point)
        v.counts.append(i + 1)
        v.radii.append(acceptance)
        v.speeds.append(float(path.speeds_mps[i - 1]))
    return v


def plan_path(
    path: FlightPath, limits: LimitsConfig, *, start_vel: Triple = (0.0, 0.0, 0.0)
) -> tuple[Trajectory, list[Corner]]:
    """The trajectory along `path` from its first point, and its corners in order.

    A velocity at the start that leads along the first leg is kept; any other is braked off first,
    on the present course.
    """
    row = path.points_ned_m[0].tolist()
    start = (row[0], row[1], row[2])
    builder = TrajectoryBuilder(start)
    v = _vertices(path, start)
    if len(v.points) > 1:
        plan = _speeds(v, limits, start_vel)
        if plan is not None:
            return _fly(builder, v, plan, limits)
    _brake(builder, start_vel, limits)
    v = _vertices(path, builder.p)
    plan = _speeds(v, limits, (0.0, 0.0, 0.0)) if len(v.points) > 1 else None
    if plan is None:
        corner = Corner(v.points[0], v.counts[0], None, builder.t, 0.0)
        return builder.stop(v.points[0], window_s=limits.smoothing_s), [corner]
    return _fly(builder, v, plan, limits)


class _Plan(NamedTuple):
    legs: list[Leg]
    speeds: list[float]  # at the vertices
    sines: list[float]
    accels: list[float]


def _speeds(v: _Vertices, limits: LimitsConfig, start_vel: Triple) -> _Plan | None:
    """Legs and vertex speeds; None where the velocity at the start does not fit the path."""
    legs = [
        make_leg(v.points[i], v.points[i + 1], speed=speed, limits=limits)
        for i, speed in enumerate(v.speeds)
    ]
    along = sum(a * b for a, b in zip(start_vel, legs[0].u, strict=True))
    across = math.dist(start_vel, _scale(legs[0].u, along))
    plan = corner_speeds(legs, v.radii, share=limits.corner_cut, v_start=max(0.0, along))
    if across > _ACROSS_MPS or abs(along - plan[0][0]) > _ALONG_MPS:
        return None
    return _Plan(legs, *plan)


def _fly(
    builder: TrajectoryBuilder, v: _Vertices, plan: _Plan, limits: LimitsConfig
) -> tuple[Trajectory, list[Corner]]:
    legs, speeds, sines, accels = plan
    corners = [Corner(v.points[0], v.counts[0], None, builder.t, 0.0)]
    for i, leg in enumerate(legs):
        point, v0, v1 = v.points[i + 1], speeds[i], speeds[i + 1]
        before = v0 * v0 * sines[i] / accels[i]
        after = v1 * v1 * sines[i + 1] / accels[i + 1]
        straight = max(leg.length - before - after, 0.0)
        _run(builder, leg, v0=v0, v1=v1, length=straight, end=_step(point, leg.u, -after))
        half = v1 * sines[i + 1] / accels[i + 1]
        normal = None
        if i + 1 < len(legs):
            u, out = leg.u, legs[i + 1].u
            if half > 0:
                bend = _scale((out[0] - u[0], out[1] - u[1], out[2] - u[2]), v1 / (2 * half))
                end = _step(point, out, after)
                builder.add(_scale(u, v1), bend, duration=2 * half, end=end)
            total = (out[0] + u[0], out[1] + u[1], out[2] + u[2])
            size = math.sqrt(total[0] ** 2 + total[1] ** 2 + total[2] ** 2)
            normal = _scale(total, 1 / size) if size > 0.2 else None
        corners.append(Corner(point, v.counts[i + 1], normal, builder.t - half, half))
    return builder.stop(v.points[-1], window_s=limits.smoothing_s), corners


def _brake(builder: TrajectoryBuilder, vel: Triple, limits: LimitsConfig) -> None:
    """Slow down from `vel` to a stop on its own course."""
    speed = math.sqrt(vel[0] ** 2 + vel[1] ** 2 + vel[2] ** 2)
    if speed > 0.05:
        a = limits.acceleration_mps2
        builder.add(vel, _scale(vel, -a / speed), duration=speed / a)


def brake_and_go(start: Triple, vel: Triple, *, goal: Triple, limits: LimitsConfig) -> Trajectory:
    """Slow down from `vel` on the present course to a stop, then straight to `goal` and stop."""
    builder = TrajectoryBuilder(start)
    _brake(builder, vel, limits)
    if math.dist(builder.p, goal) > _SAME_POINT_M:
        leg = make_leg(builder.p, goal, speed=limits.hold_speed_mps, limits=limits)
        _run(builder, leg, v0=0.0, v1=0.0, length=leg.length, end=goal)
    return builder.stop(goal, window_s=limits.smoothing_s)
