"""From a path to the trajectory that flies it, drawn in C (`native/include/trajectory.h`)."""

from dataclasses import dataclass

import numpy as np

from flightdyn.config import LimitsConfig
from flightdyn.frames import Triple
from flightdyn.guidance.path import FlightPath
from flightdyn.guidance.trajectory import Trajectory
from flightdyn.native.library import Drawn, Steering, Vertex


@dataclass(frozen=True, slots=True)
class Corner:
    """A point of the path, several where they coincide."""

    point: Triple
    count: int  # path points passed once this one is
    normal: Triple | None  # of the plane of closest approach; None at a reversal
    t_s: float  # when the reference is closest
    half_s: float  # half of the blend's duration


def steering_of(limits: LimitsConfig) -> Steering:
    """The limits as C takes them."""
    return Steering(*(getattr(limits, name) for name, *_ in Steering._fields_))


def drawn(path: FlightPath, limits: LimitsConfig) -> Drawn:
    """The path as C draws it."""
    return Drawn(path.points_ned_m, path.speeds_mps, path.acceptance_m, steering_of(limits))


def passing_times(path: FlightPath, limits: LimitsConfig) -> list[float]:
    """Seconds (M,) after which the trajectory of `plan_path` passes each of its points, from rest
    to rest, without making it; the last stands for its end."""
    passed_s: list[float] = drawn(path, limits).passing_times().tolist()
    return passed_s


def plan_path(
    path: FlightPath, limits: LimitsConfig, *, start_vel: Triple = (0.0, 0.0, 0.0)
) -> tuple[Trajectory, list[Corner]]:
    """The trajectory along `path` from its first point, and its corners in order.

    A velocity at the start that leads along the first leg is kept; any other is braked off first,
    on the present course.
    """
    return _planned(path, limits, start_vel, braking=False)


def brake_and_go(start: Triple, vel: Triple, *, goal: Triple, limits: LimitsConfig) -> Trajectory:
    """Slow down from `vel` on the present course to a stop, then straight to `goal` and stop."""
    path = FlightPath(np.array([start, goal]), np.array([limits.hold_speed_mps]), np.zeros(2))
    return _planned(path, limits, vel, braking=True)[0]


def _planned(
    path: FlightPath, limits: LimitsConfig, velocity: Triple, *, braking: bool
) -> tuple[Trajectory, list[Corner]]:
    pieces, vertices, end_s = drawn(path, limits).trajectory(velocity, braking=braking)
    return Trajectory(pieces, end_s, window_s=limits.smoothing_s), [_corner(v) for v in vertices]


def _corner(vertex: Vertex) -> Corner:
    x, y, z = vertex.p
    north, east, down = normal = tuple(vertex.normal)
    plane = (north, east, down) if any(normal) else None
    return Corner((x, y, z), vertex.passed, plane, vertex.t, vertex.half)
