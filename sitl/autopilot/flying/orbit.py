"""Circles round a place, as they are flown."""

import math
from dataclasses import dataclass

import numpy as np

from flightdyn.state import Vector

DEFAULT_RADIUS_M = 10.0
_INWARDS_MPS2 = 2.0  # greatest centripetal acceleration
_LOOKS = 72  # points of a turn that the fence is asked about


def fastest(radius_m: float) -> float:
    """Return the greatest speed (m/s) on a circle, limited by centripetal acceleration."""
    return math.sqrt(_INWARDS_MPS2 * radius_m)


@dataclass(frozen=True, slots=True)
class Orbit:
    """A circle being flown, positive speed clockwise seen from above."""

    center_ned_m: tuple[float, float, float]
    radius_m: float
    speed_mps: float
    yaw: int  # ORBIT_YAW_BEHAVIOUR
    turns: float = math.inf
    heading_rad: float = math.nan  # to be kept; NaN: by the yaw behaviour

    def point(self, phase_rad: float) -> Vector:
        """Return the point (3,), NED, of the circle at `phase_rad`, clockwise from north."""
        north, east, down = self.center_ned_m
        r = self.radius_m
        return np.array([north + r * math.cos(phase_rad), east + r * math.sin(phase_rad), down])

    def after(self, phase_rad: float, turns: float) -> Vector:
        """Return the point (3,), NED, that is reached from `phase_rad` after `turns` turns."""
        return self.point(phase_rad + math.copysign(turns * math.tau, self.speed_mps))

    def points(self, phase_rad: float) -> Vector:
        """Return points (P, 3), NED, along the turns, at most one of them, for a fence check."""
        turns = min(self.turns, 1.0)
        parts = np.linspace(0.0, turns, 1 + math.ceil(turns * _LOOKS))
        return np.array([self.after(phase_rad, part) for part in parts])
