"""A reference over time: pieces of constant acceleration, averaged over a window.

The averaging makes acceleration ramp instead of jump (a jerk of acceleration over window); it is
done in closed form, from the integral of position, in C (`flightdyn/native/guidance.h`).
"""

from typing import NamedTuple

import numpy as np

from flightdyn.frames import Triple
from flightdyn.native.library import Pieces
from flightdyn.state import Vector


class Piece(NamedTuple):
    """Constant acceleration from `t0`; `area` is the integral of position up to `t0`."""

    t0: float
    p: Triple
    v: Triple
    a: Triple
    area: Triple


class Reference(NamedTuple):
    """Position, velocity and acceleration of a trajectory at one instant."""

    p: Triple
    v: Triple
    a: Triple


class Trajectory:
    """Position, velocity and acceleration over time, smooth, from `start_s` to `end_s`."""

    def __init__(self, pieces: list[Piece], end_s: float, *, window_s: float) -> None:
        half = max(window_s / 2, 1e-3)
        # From rest the averaging begins before the start; from speed that would be a step back.
        self.start_s = -half if pieces[0].v == (0.0, 0.0, 0.0) else 0.0
        self.end_s = end_s + half
        self._half_s = half
        self._rows = rows = np.array([[t0, *p, *v, *a, *area] for t0, p, v, a, area in pieces])
        self.pieces = Pieces(
            rows,
            half_s=half,
            start_s=self.start_s,
            end_s=self.end_s,
        )

    def at(self, t: float, *, lead_s: float = 0.0) -> Reference:
        """The averaged reference at `t`, its acceleration taken `lead_s` later."""
        px, py, pz, vx, vy, vz, ax, ay, az = self.pieces.reference(t, lead_s)
        return Reference((px, py, pz), (vx, vy, vz), (ax, ay, az))

    def motion(self, times_s: Vector) -> tuple[Vector, Vector]:
        """Velocity and acceleration (n, 3) at many times: as `at`, all at once."""
        h = self._half_s
        before, after = self._unsmoothed(times_s - h), self._unsmoothed(times_s + h)
        return (after[0] - before[0]) / (2 * h), (after[1] - before[1]) / (2 * h)

    def _unsmoothed(self, times_s: Vector) -> tuple[Vector, Vector]:
        """Position and velocity (n, 3) before averaging."""
        rows = self._rows
        piece = rows[np.maximum(np.searchsorted(rows[:, 0], times_s, side="right") - 1, 0)]
        s = (times_s - piece[:, 0])[:, None]
        p, v, a = piece[:, 1:4], piece[:, 4:7], np.where(s < 0, 0.0, piece[:, 7:10])
        return p + v * s + a * s * s / 2, v + a * s


class TrajectoryBuilder:
    """Builds a trajectory of polynomial pieces, beginning at `start`."""

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
