"""A reference over time: pieces of constant acceleration, averaged over a window.

The averaging makes acceleration ramp instead of jump (a jerk of acceleration over window); it is
done in closed form, from the integral of position.
"""

import math
from bisect import bisect_right
from typing import NamedTuple

from flightdyn.frames import Triple


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


class TrajectoryBuilder:
    """Strings pieces together, beginning at `start`."""

    def __init__(self, start: Triple) -> None:
        self.pieces: list[Piece] = []
        self.t = 0.0
        self.p = start
        self._area: Triple = (0.0, 0.0, 0.0)

    def add(self, v: Triple, a: Triple, *, duration: float, end: Triple | None = None) -> None:
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

    def stop(self, at: Triple, *, window_s: float) -> Trajectory:
        """The trajectory of these pieces that stands still `at` their end from then on."""
        zero = (0.0, 0.0, 0.0)
        self.pieces.append(Piece(self.t, at, zero, zero, self._area))
        return Trajectory(self.pieces, self.t, window_s=window_s)
