"""From a path to the trajectory that flies it, computed in C (`native/include/trajectory.h`)."""

import numpy as np

from flightdyn.config import LimitsConfig
from flightdyn.frames import Triple
from flightdyn.guidance.path import FlightPath
from flightdyn.guidance.trajectory import Trajectory
from flightdyn.native.library import PathProfile, Structure, steering


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
