"""Flights that several tests look at."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from flightdyn.aircraft import Aircraft
from flightdyn.config import AircraftConfig, SensorsConfig, WindConfig
from flightdyn.guidance.path import FlightPath
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint, Vector

HOME = GeodeticPoint(47.0, 8.0, 488.0)
BREEZE = WindConfig(speed_mps=8.0, from_deg=240.0, turbulence_severity=4)
PERFECT = SensorsConfig(kind="perfect")


def make(
    *,
    seed: int = 1,
    wind: WindConfig | None = None,
    sensors: SensorsConfig | None = None,
    home: GeodeticPoint = HOME,
    **more: object,
) -> Aircraft:
    """An aircraft on the ground, ready to be armed."""
    config = AircraftConfig.model_validate(
        {"wind": wind or WindConfig(), "sensors": sensors or PERFECT, **more}
    )
    return Aircraft(config, home=home, streams=RandomStreams(seed))


def run(aircraft: Aircraft, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
    """Step for some time; returns whether `until` came true."""
    for _ in range(round(seconds * 1e9 / aircraft.dt_ns)):
        aircraft.step()
        if until():
            return True
    return False


def take_off(aircraft: Aircraft, height_m: float) -> None:
    """Arm, climb above home and come to rest."""
    aircraft.arm()
    aircraft.hold(np.array([0.0, 0.0, -height_m]), 0.0)
    assert run(aircraft, 20 + height_m, lambda: aircraft.progress.finished)


def legs(start: Vector, turns_deg: tuple[float, ...], length_m: float = 400.0) -> Vector:
    """Corner points (M, 3) of legs that turn right by the given angles, the first from north."""
    points, course = [np.array(start)], 0.0
    for turn in turns_deg:
        course += math.radians(turn)
        step = np.array([math.cos(course), math.sin(course), 0.0])
        points.append(points[-1] + length_m * step)
    return np.array(points)


def path_along(points: Vector, speed_mps: float = 20.0, acceptance_m: float = 5.0) -> FlightPath:
    """A path with one speed and one acceptance radius."""
    count = len(points)
    return FlightPath(points, np.full(count - 1, speed_mps), np.full(count, acceptance_m))


def cross_track(points: Vector, track: Vector) -> Vector:
    """Horizontal distance (K,) of each track point (K, 3) to the polyline, by brute force."""
    best = np.full(len(track), np.inf)
    for start, end in zip(points[:-1, :2], points[1:, :2], strict=True):
        leg = end - start
        share = np.clip((track[:, :2] - start) @ leg / (leg @ leg), 0, 1)
        best = np.minimum(best, np.linalg.norm(track[:, :2] - start - share[:, None] * leg, axis=1))
    return best


def corner_distance(points: Vector, track: Vector) -> Vector:
    """Horizontal distance (K,) of each track point to the nearest corner."""
    gaps = track[:, None, :2] - points[None, 1:-1, :2]
    return np.min(np.linalg.norm(gaps, axis=2), axis=1)


@dataclass
class Track:
    """What was recorded of a path flown, at 50 Hz."""

    points: Vector
    seconds: float
    truth: Vector  # (K, 3)
    belief: Vector  # (K, 3)
    command: Vector  # (K, 3) where the guidance wanted to be
    passed_s: list[float] = field(default_factory=list)  # when each point was passed
    passed_at: list[Vector] = field(default_factory=list)  # believed position then
    limited: bool = False  # whether the speed was ever reported as limited


def fly(aircraft: Aircraft, path: FlightPath, limit_s: float = 300.0) -> Track:
    """Follow a path to its end."""
    aircraft.follow(path)
    begin = aircraft.t_ns
    truth, belief, command = [], [], []
    none = np.empty((0, 3))
    track = Track(path.points_ned_m, 0.0, none, none, none)
    passed = 0
    while not aircraft.progress.finished:
        aircraft.step()
        assert aircraft.t_ns - begin < limit_s * 1e9, "the path was not finished in time"
        track.limited |= aircraft.progress.speed_limited
        while passed < aircraft.progress.passed:
            passed += 1
            track.passed_s.append((aircraft.t_ns - begin) * 1e-9)
            track.passed_at.append(aircraft.belief.pos_ned_m)
        if (aircraft.t_ns // aircraft.dt_ns) % 5 == 0:
            truth.append(aircraft.vehicle.position_ned())
            belief.append(aircraft.navigation.state().p)
            command.append(aircraft.cmd_pos_ned_m)
    track.seconds = (aircraft.t_ns - begin) * 1e-9
    track.truth, track.belief = np.array(truth), np.array(belief)
    track.command = np.array(command)
    return track
