"""A path to fly, and the trajectory that flies it.

A path is points in NED about home, with a speed for each leg. A trajectory is a reference over
time: pieces of constant acceleration, averaged over a window. The averaging makes acceleration ramp
instead of jump (a jerk of acceleration over window); it is done in closed form, from the integral
of position. Both in C (`native/include/trajectory.h`, `flightdyn/native/guidance.h`).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightdyn.config import LimitsConfig
from flightdyn.frames import Triple, frozen
from flightdyn.native.library import PathProfile, Pieces, Structure, steering
from flightdyn.state import Vector
from native.errors import InputError


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


def steering_of(limits: LimitsConfig) -> Structure:
    """Convert the limits to the structure that C takes."""
    return steering(limits)


def profile_of(path: FlightPath, limits: LimitsConfig) -> PathProfile:
    """Convert a path to the structure from which C computes its trajectory."""
    return PathProfile(path.points_ned_m, path.speeds_mps, path.acceptance_m, steering_of(limits))


def passing_times(path: FlightPath, limits: LimitsConfig) -> list[float]:
    """Seconds (M,) after which the trajectory of `plan_path` passes each of its points, from rest
    to rest, without making it; the last stands for its end."""
    passed_s: list[float] = profile_of(path, limits).passing_times().tolist()
    return passed_s


def plan_path(
    path: FlightPath,
    limits: LimitsConfig,
    *,
    start_vel: Triple = (0.0, 0.0, 0.0),
    braking: bool = False,
) -> tuple[Trajectory, list[Structure]]:
    """The trajectory along `path` from its first point, and its corners in order.

    A velocity at the start that leads along the first leg is kept, unless it is `braking`; any
    other is braked off first, on the present course.
    """
    pieces, corners, end_s = profile_of(path, limits).trajectory(start_vel, braking=braking)
    return Trajectory(pieces, end_s, window_s=limits.smoothing_s), corners


def brake_and_go(start: Triple, vel: Triple, *, goal: Triple, limits: LimitsConfig) -> Trajectory:
    """Return the trajectory that brakes to a stop on course, then goes to `goal` and stops."""
    path = FlightPath(np.array([start, goal]), np.array([limits.hold_speed_mps]), np.zeros(2))
    return plan_path(path, limits, start_vel=vel, braking=True)[0]
