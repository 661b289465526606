"""A path to fly: points in NED about home, a speed for each leg."""

from dataclasses import dataclass

import numpy as np

from aerofed_errors import InputError
from flightdyn.frames import frozen
from flightdyn.state import Vector


@dataclass(frozen=True, slots=True)
class FlightPath:
    """Straight legs through `points_ned_m`, flown without stopping and to a stop at the last.

    The first point is where the aircraft is. Corners may be cut by up to the acceptance radius of
    their point; points may coincide.
    """

    points_ned_m: Vector  # (M, 3)
    speeds_mps: Vector  # (M - 1,) speed on the leg that ends at point i + 1
    acceptance_m: Vector  # (M,)

    def __post_init__(self) -> None:
        points = np.asarray(self.points_ned_m, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
            raise InputError(f"path points have shape {points.shape}: (M, 3) with M >= 2 is needed")
        legs = len(points) - 1
        for name, array, length, lowest in (
            ("speeds_mps", self.speeds_mps, legs, 0.1),
            ("acceptance_m", self.acceptance_m, legs + 1, 0.0),
        ):
            values = np.asarray(array, dtype=np.float64)
            if values.shape != (length,):
                raise InputError(f"path {name} has shape {values.shape}: ({length},) is needed")
            if not np.all(values >= lowest):
                raise InputError(f"path {name} = {values.min():g}: at least {lowest:g} is needed")
            object.__setattr__(self, name, frozen(values))
        if not np.all(np.isfinite(points)):
            raise InputError("path points hold numbers that are not finite")
        object.__setattr__(self, "points_ned_m", frozen(points))


@dataclass(slots=True)
class PathProgress:
    """How far a path has been flown."""

    passed: int = 0  # points passed; 1 = the start; 0 = no path
    finished: bool = False  # stopped at the last point
    stalled: bool = False  # the reference waits for an aircraft that does not come
    missed_m: float = 0.0  # how far from the last point it was when it was given up to come closer
    speed_limited: bool = False  # the ordered speed cannot be held (wind, limits)
