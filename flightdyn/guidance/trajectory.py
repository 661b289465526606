"""A reference over time: pieces of constant acceleration, averaged over a window.

The averaging makes acceleration ramp instead of jump (a jerk of acceleration over window); it is
done in closed form, from the integral of position, in C (`flightdyn/native/guidance.h`).
"""

from typing import NamedTuple

from flightdyn.frames import Triple
from flightdyn.native.library import Pieces
from flightdyn.state import Vector


class Reference(NamedTuple):
    """Position, velocity and acceleration of a trajectory at one instant."""

    p: Triple
    v: Triple
    a: Triple


class Trajectory:
    """Position, velocity and acceleration over time, smooth, from `start_s` to `end_s`."""

    def __init__(self, pieces: Vector, end_s: float, *, window_s: float) -> None:
        """`pieces` (n, 13) as C has them (`Piece` of `native/include/trajectory.h`)."""
        half = max(window_s / 2, 1e-3)
        # From rest the averaging begins before the start; from speed that would be a step back.
        self.start_s = 0.0 if pieces[0, 4:7].any() else -half
        self.end_s = end_s + half
        self.pieces = Pieces(pieces, half_s=half, start_s=self.start_s, end_s=self.end_s)

    def at(self, t: float) -> Reference:
        """The averaged reference at `t`."""
        px, py, pz, vx, vy, vz, ax, ay, az = self.pieces.reference(t)
        return Reference((px, py, pz), (vx, vy, vz), (ax, ay, az))
