"""Circles round a place."""

import math
from dataclasses import dataclass

import numpy as np

from flightdyn.state import Vector

DEFAULT_RADIUS_M = 10.0
_INWARDS_MPS2 = 2.0  # greatest centripetal acceleration


def fastest(radius_m: float) -> float:
    """The speed (m/s) on a circle from which on it would press too hard inwards."""
    return math.sqrt(_INWARDS_MPS2 * radius_m)


@dataclass(frozen=True, slots=True)
class Orbit:
    """A circle being flown, positive speed clockwise seen from above."""

    center_ned_m: tuple[float, float, float]
    radius_m: float
    speed_mps: float
    yaw: int  # ORBIT_YAW_BEHAVIOUR

    def point(self, phase_rad: float) -> Vector:
        """On the circle, in the direction `phase_rad` from its middle."""
        north, east, down = self.center_ned_m
        r = self.radius_m
        return np.array([north + r * math.cos(phase_rad), east + r * math.sin(phase_rad), down])
