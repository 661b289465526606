"""The reference that a path is flown by: where to be, how fast, how hard to accelerate.

The path becomes straight runs at piecewise constant acceleration, joined at the corners by
parabolic blends: constant acceleration along the bisector. A blend at speed v through the course
change phi takes the time T = 2 v s / a with s = sin(phi / 2), begins v T / 2 = v^2 s / a before the
corner and misses it by v T s / 4 = v^2 s^2 / (2 a), which bounds v by the cut allowed. The result
is averaged over a window, so that acceleration ramps instead of jumping (a jerk of a / window).
"""

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import NamedTuple

from flightdyn.config import LimitsConfig
from flightdyn.frames import Triple
from flightdyn.path import FlightPath

_SAME_POINT_M = 1e-3  # closer points are one corner
_SPILL = 0.2  # of the acceptance radius: how far off the legs a blend may be outside of it


class Piece(NamedTuple):
    """Constant acceleration from `t0`; `area` is the integral of position up to `t0`."""

    t0: float
    p: Triple
    v: Triple
    a: Triple
    area: Triple


class Reference(NamedTuple):
    """One instant of a trajectory."""

    p: Triple
    v: Triple
    a: Triple


@dataclass(frozen=True, slots=True)
class Corner:
    """A point of the path, several where they coincide."""

    point: Triple
    count: int  # path points passed once this one is
    normal: Triple | None  # of the plane of closest approach; None at a reversal
    t_s: float  # when the reference is closest
    half_s: float  # half of the blend's duration


class Trajectory:
    """Position, velocity and acceleration over time, smooth, from `start_s` to `end_s`."""

    def __init__(self, pieces: list[Piece], end_s: float, *, window_s: float) -> None:
        self._pieces = pieces
        self._starts = [piece.t0 for piece in pieces]
        self._ends = [*self._starts[1:], math.inf]
        self._half = max(window_s / 2, 1e-3)
        # From rest the averaging begins before the start; from speed that would be a step back.
        self.start_s = -self._half if pieces[0].v == (0.0, 0.0, 0.0) else 0.0
        self.end_s = end_s + self._half

    def at(self, t: float, *, lead_s: float = 0.0) -> Reference:
        """The averaged reference at `t`, its acceleration taken `lead_s` later."""
        h = self._half
        i = max(0, bisect_right(self._starts, t - h) - 1)
        piece = self._pieces[i]
        s = t - piece.t0
        if s >= h and t + h + lead_s < self._ends[i]:  # within one piece: in closed form
            _, p, v, a, _ = piece
            ux, uy, uz = v[0] + a[0] * s, v[1] + a[1] * s, v[2] + a[2] * s
            q, r = s / 2, h * h / 6
            return Reference(
                (
                    p[0] + (v[0] + ux) * q + a[0] * r,
                    p[1] + (v[1] + uy) * q + a[1] * r,
                    p[2] + (v[2] + uz) * q + a[2] * r,
                ),
                (ux, uy, uz),
                a,
            )
        return self._average(t, lead_s)

    def _average(self, t: float, lead_s: float) -> Reference:
        h = self._half
        area0, p0 = self._sample(t - h)
        area1, p1 = self._sample(t + h)
        v0, v1 = self._velocity(t + lead_s - h), self._velocity(t + lead_s + h)
        k = 0.5 / h
        return Reference(
            ((area1[0] - area0[0]) * k, (area1[1] - area0[1]) * k, (area1[2] - area0[2]) * k),
            ((p1[0] - p0[0]) * k, (p1[1] - p0[1]) * k, (p1[2] - p0[2]) * k),
            ((v1[0] - v0[0]) * k, (v1[1] - v0[1]) * k, (v1[2] - v0[2]) * k),
        )

    def _piece(self, t: float) -> Piece:
        return self._pieces[max(0, bisect_right(self._starts, t) - 1)]

    def _velocity(self, t: float) -> Triple:
        """Velocity before averaging."""
        piece = self._piece(t)
        s = max(t - piece.t0, 0.0)
        v, a = piece.v, piece.a
        return (v[0] + a[0] * s, v[1] + a[1] * s, v[2] + a[2] * s)

    def _sample(self, t: float) -> tuple[Triple, Triple]:
        """Integral of position (from 0) and position at `t`, before averaging."""
        piece = self._piece(t)
        s = t - piece.t0
        _, p, v, a, area = piece
        if s < 0:  # before the first piece: at its speed all along
            a = (0.0, 0.0, 0.0)
        s2 = s * s / 2
        s3 = s2 * s / 3
        return (
            (
                area[0] + p[0] * s + v[0] * s2 + a[0] * s3,
                area[1] + p[1] * s + v[1] * s2 + a[1] * s3,
                area[2] + p[2] * s + v[2] * s2 + a[2] * s3,
            ),
            (
                p[0] + v[0] * s + a[0] * s2,
                p[1] + v[1] * s + a[1] * s2,
                p[2] + v[2] * s + a[2] * s2,
            ),
        )


class _Builder:
    """Strings pieces together."""

    def __init__(self, start: Triple) -> None:
        self.pieces: list[Piece] = []
        self.t = 0.0
        self.p = start
        self._area: Triple = (0.0, 0.0, 0.0)

    def add(self, v: Triple, a: Triple, duration: float, end: Triple | None = None) -> None:
        """Append a piece; `end` is where it leads exactly, so that rounding does not add up."""
        if duration <= 0:
            return
        p, area, s = self.p, self._area, duration
        self.pieces.append(Piece(self.t, p, v, a, area))
        s2 = s * s / 2
        s3 = s2 * s / 3
        self._area = (
            area[0] + p[0] * s + v[0] * s2 + a[0] * s3,
            area[1] + p[1] * s + v[1] * s2 + a[1] * s3,
            area[2] + p[2] * s + v[2] * s2 + a[2] * s3,
        )
        self.p = end or (
            p[0] + v[0] * s + a[0] * s2,
            p[1] + v[1] * s + a[1] * s2,
            p[2] + v[2] * s + a[2] * s2,
        )
        self.t += duration

    def stop(self) -> None:
        """Stand still from here on."""
        zero = (0.0, 0.0, 0.0)
        self.pieces.append(Piece(self.t, self.p, zero, zero, self._area))


@dataclass(frozen=True, slots=True)
class _Leg:
    u: Triple
    length: float
    speed: float
    accel: float


def _scale(v: Triple, k: float) -> Triple:
    return (v[0] * k, v[1] * k, v[2] * k)


def _step(p: Triple, u: Triple, k: float) -> Triple:
    return (p[0] + u[0] * k, p[1] + u[1] * k, p[2] + u[2] * k)


def _leg(start: Triple, end: Triple, speed: float, limits: LimitsConfig) -> _Leg:
    d = (end[0] - start[0], end[1] - start[1], end[2] - start[2])
    length = math.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
    u = _scale(d, 1 / length)
    accel = limits.acceleration_mps2
    speed = min(speed, limits.speed_mps)
    steep = abs(u[2])
    if steep > 1e-6:
        vertical = limits.climb_mps if u[2] < 0 else limits.descent_mps
        speed = min(speed, vertical / steep)
        accel = min(accel, limits.vertical_acceleration_mps2 / steep)
    return _Leg(u, length, speed, accel)


def _blend_spill(cut: float, sine: float, radius: float) -> float:
    """Distance from the leg at which a blend that misses its corner by `cut` enters the circle of
    `radius` about the corner; 0 where the whole blend lies inside.

    With a = 1: v^2 = 2 cut / s^2; along the leg the blend is v^2 s - (v t - s t^2 / 2) before the
    corner, and off it by cos(phi / 2) t^2 / 2.
    """
    v = math.sqrt(2 * cut) / sine
    cosine = math.sqrt(max(1 - sine * sine, 0.0))
    before = v * v * sine
    if before <= radius:
        return 0.0
    low, high = 0.0, v * sine  # to the middle of the blend
    for _ in range(30):
        t = (low + high) / 2
        if math.hypot(before - v * t + sine * t * t / 2, cosine * t * t / 2) > radius:
            low = t
        else:
            high = t
    return cosine * low * low / 2


def _allowed_cut(sine: float, radius: float, share: float) -> float:
    """The largest cut, at most `share` of the acceptance radius, that strays from the legs by at
    most `_SPILL` of it outside."""
    cut = share * radius
    while cut > 1e-6 and _blend_spill(cut, sine, radius) > _SPILL * radius:
        cut *= 0.95
    return cut


def _corner_speeds(
    legs: list[_Leg], radii: list[float], share: float, v_start: float
) -> tuple[list[float], list[float], list[float]]:
    """Speed at each vertex, sin(phi / 2) there, and the acceleration of its blend."""
    n = len(legs)
    sines, accels = [0.0] * (n + 1), [legs[0].accel] * (n + 1)
    speeds = [min(v_start, legs[0].speed)] + [0.0] * n
    for i in range(1, n):
        a, b = legs[i - 1], legs[i]
        s = math.dist(a.u, b.u) / 2  # |u1 - u0| = 2 sin(phi / 2)
        accel = min(a.accel, b.accel)
        v = min(a.speed, b.speed)
        if s > 1e-9:
            v = min(
                v,
                math.sqrt(2 * accel * _allowed_cut(s, radii[i], share)) / s,
                math.sqrt(accel * min(a.length, b.length) / (2 * s)),
            )
        speeds[i], sines[i], accels[i] = v, s, accel
    # What acceleration allows between corners: v1^2 <= v0^2 + 2 a (length - both half blends).
    # Lowering a speed may shorten its blend, so that one sweep there and back need not do.
    for _ in range(2 * n):
        before = list(speeds)
        for i, leg in enumerate(legs):
            _lower(speeds, sines, accels, leg, i, i + 1)
        for i in range(n - 1, -1, -1):
            _lower(speeds, sines, accels, legs[i], i + 1, i)
        if speeds == before:
            break
    return speeds, sines, accels


def _lower(
    speeds: list[float], sines: list[float], accels: list[float], leg: _Leg, here: int, there: int
) -> None:
    """Lower the speed at vertex `there` to what can be had from `here` on the leg between."""
    v2 = speeds[here] ** 2
    room = leg.length - v2 * sines[here] / accels[here]
    best = (v2 + 2 * leg.accel * room) / (1 + 2 * sines[there] * leg.accel / accels[there])
    speeds[there] = min(speeds[there], math.sqrt(max(best, 0.0)))


def _run(builder: _Builder, leg: _Leg, v0: float, v1: float, length: float, end: Triple) -> None:
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
        builder.add(_scale(leg.u, v), _scale(leg.u, accel), duration, end if i == last else None)


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
    legs = [_leg(points[i], points[i + 1], speeds[i], limits) for i in range(len(speeds))]
    along = sum(v * u for v, u in zip(start_vel, legs[0].u, strict=True))
    vertex, sines, accels = _corner_speeds(legs, radii, limits.corner_cut, max(0.0, along))
    builder = _Builder(points[0])
    corners = [Corner(points[0], counts[0], None, 0.0, 0.0)]
    for i, leg in enumerate(legs):
        v0, v1 = vertex[i], vertex[i + 1]
        before = v0 * v0 * sines[i] / accels[i]
        after = v1 * v1 * sines[i + 1] / accels[i + 1]
        stop = _step(points[i + 1], leg.u, -after)
        _run(builder, leg, v0, v1, max(leg.length - before - after, 0.0), stop)
        half = v1 * sines[i + 1] / accels[i + 1]
        normal = None
        if i + 1 < len(legs):
            out = legs[i + 1].u
            if half > 0:
                bend = _scale(
                    (out[0] - leg.u[0], out[1] - leg.u[1], out[2] - leg.u[2]), v1 / (2 * half)
                )
                builder.add(_scale(leg.u, v1), bend, 2 * half, _step(points[i + 1], out, after))
            total = (out[0] + leg.u[0], out[1] + leg.u[1], out[2] + leg.u[2])
            size = math.sqrt(total[0] ** 2 + total[1] ** 2 + total[2] ** 2)
            normal = _scale(total, 1 / size) if size > 0.2 else None
        corners.append(Corner(points[i + 1], counts[i + 1], normal, builder.t - half, half))
    builder.p = points[-1]
    builder.stop()
    return Trajectory(builder.pieces, builder.t, window_s=limits.smoothing_s), corners


def stand(point: Triple, limits: LimitsConfig) -> Trajectory:
    """Stay at `point`."""
    builder = _Builder(point)
    builder.stop()
    return Trajectory(builder.pieces, 0.0, window_s=limits.smoothing_s)


def brake_and_go(start: Triple, vel: Triple, goal: Triple, limits: LimitsConfig) -> Trajectory:
    """Slow down from `vel` on the present course to a stop, then straight to `goal` and stop."""
    builder = _Builder(start)
    speed = math.sqrt(vel[0] ** 2 + vel[1] ** 2 + vel[2] ** 2)
    if speed > 0.05:
        a = limits.acceleration_mps2
        builder.add(vel, _scale(vel, -a / speed), speed / a)
    if math.dist(builder.p, goal) > _SAME_POINT_M:
        leg = _leg(builder.p, goal, limits.hold_speed_mps, limits)
        _run(builder, leg, 0.0, 0.0, leg.length, goal)
    builder.p = goal
    builder.stop()
    return Trajectory(builder.pieces, builder.t, window_s=limits.smoothing_s)
