"""How exactly the aircraft flies and knows where it is: the figures promised.

    python benchmarks/flight_accuracy.py

`flight_figures.py` beside it draws the flights.

Five legs of 400 m at 20 m/s with corners of 90, 90, 45 and 135 degrees, 5 m acceptance; a hover at
60 m; and a minute of rounds on default sensors. Wind is 8 m/s with turbulence of severity 4.
"""

import math
import os
from dataclasses import dataclass, field

os.environ.setdefault("OMP_NUM_THREADS", "1")
import numpy as np

from flightdyn.aircraft import Aircraft
from flightdyn.config import AircraftConfig
from flightdyn.guidance.path import FlightPath
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint, Innovation, Vector

HOME = GeodeticPoint(47.0, 8.0, 488.0)
WIND = {"speed_mps": 8.0, "from_deg": 240.0, "turbulence_severity": 4}
TURNS_DEG = (0.0, 90.0, 90.0, 45.0, 135.0)
SQUARE_DEG = (0.0, 90.0, 90.0, 90.0)
STRAIGHT_M = 20.0  # farther from every corner than its blend reaches
SEEDS = (1, 2, 3, 4)


@dataclass
class Track:
    """A path flown, at 50 Hz."""

    points: Vector  # (M, 3)
    seconds: float = 0.0
    t_s: list[float] = field(default_factory=list)
    truth: list[Vector] = field(default_factory=list)  # position and velocity (6,)
    belief: list[Vector] = field(default_factory=list)
    fixes: dict[float, Vector] = field(default_factory=dict)  # GNSS position by its instant

    @property
    def true_m(self) -> Vector:
        return np.array(self.truth)[:, :3]

    @property
    def error(self) -> Vector:
        """Belief less truth (K, 6)."""
        return np.array(self.belief) - np.array(self.truth)

    @property
    def injected_m(self) -> Vector:
        """Horizontal error (F, 2) of the GNSS positions themselves."""
        t_s = np.array([t for t in self.fixes if self.t_s[0] <= t <= self.t_s[-1]])
        truth = np.array([np.interp(t_s, self.t_s, self.true_m[:, i]) for i in range(2)]).T
        return np.array([self.fixes[t][:2] for t in t_s]) - truth


def hovering(sensors: str, *, windy: bool, seed: int = 1, height_m: float = 60.0) -> Aircraft:
    """An aircraft at rest above home."""
    data = {"sensors": {"kind": sensors}, "wind": WIND if windy else {}}
    config = AircraftConfig.model_validate(data)
    aircraft = Aircraft(config, home=HOME, streams=RandomStreams(seed))
    aircraft.arm()
    aircraft.hold(np.array([0.0, 0.0, -height_m]), 0.0)
    while not aircraft.progress.finished:
        aircraft.step()
    return aircraft


def legs(start: Vector, turns_deg: tuple[float, ...], length_m: float = 400.0) -> Vector:
    """Corners of legs that turn right by the given angles, the first from north."""
    points, course = [np.array(start)], 0.0
    for turn in turns_deg:
        course += math.radians(turn)
        points.append(points[-1] + length_m * np.array([math.cos(course), math.sin(course), 0.0]))
    return np.array(points)


def fly(aircraft: Aircraft, points: Vector, speed_mps: float = 20.0) -> Track:
    """Follow `points` to the end."""
    track, begin_ns = Track(points), aircraft.t_ns
    count = len(points)
    aircraft.follow(FlightPath(points, np.full(count - 1, speed_mps), np.full(count, 5.0)))
    while not aircraft.progress.finished:
        record(aircraft, track, begin_ns)
    track.seconds = (aircraft.t_ns - begin_ns) * 1e-9
    return track


def record(aircraft: Aircraft, track: Track, begin_ns: int) -> None:
    """A fiftieth of a second of flight."""
    for _ in range(5):
        aircraft.step()
    truth, belief = aircraft.truth, aircraft.belief
    fix = aircraft.gnss
    if fix is not None:
        track.fixes[(fix.t_ns - begin_ns) * 1e-9] = fix.pos_ned_m
    track.t_s.append((aircraft.t_ns - begin_ns) * 1e-9)
    track.truth.append(np.concatenate([truth.pos_ned_m, truth.vel_ned_mps]))
    track.belief.append(np.concatenate([belief.pos_ned_m, belief.vel_ned_mps]))


def off_track(points: Vector, at: Vector) -> tuple[Vector, Vector]:
    """Horizontal distance of each position to the polyline, and to the nearest corner."""
    best = np.full(len(at), np.inf)
    for start, end in zip(points[:-1, :2], points[1:, :2], strict=True):
        leg = end - start
        share = np.clip((at[:, :2] - start) @ leg / (leg @ leg), 0, 1)
        best = np.minimum(best, np.linalg.norm(at[:, :2] - start - share[:, None] * leg, axis=1))
    corner = np.linalg.norm(at[:, None, :2] - points[None, 1:-1, :2], axis=2).min(axis=1)
    return best, corner


def rms(values: Vector) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def row(name: str, value: float, limit: float, unit: str) -> None:
    """One line of the table."""
    verdict = "ok" if value <= limit else "MISSED"
    print(f"{name:78}{value:8.3f}{limit:8.2f} {unit:4}{verdict:>7}")


def accuracy_table() -> None:
    """Print measured against promised."""
    print(f"{'':78}{'found':>8}{'limit':>8}")
    for windy, name in (
        (False, "calm, perfect sensors"),
        (True, "wind, perfect sensors"),
    ):
        aircraft = hovering("perfect", windy=windy)
        track = fly(aircraft, legs(aircraft.belief.pos_ned_m, TURNS_DEG))
        off, corner = off_track(track.points, track.true_m)
        straight = off[corner > STRAIGHT_M]
        row(f"{name}: straights, cross-track rms", rms(straight), 0.15 if windy else 0.10, "m")
        if windy:
            row(f"{name}: straights, cross-track max", float(straight.max()), 0.6, "m")
        else:
            row(f"{name}: beyond 5 m of corners, max", float(off[corner > 5].max()), 1.2, "m")
            row(f"{name}: five legs", track.seconds, 115.0, "s")
    aircraft = hovering("perfect", windy=True)
    hover = Track(np.zeros((0, 3)))
    for _ in range(50 * 60):
        record(aircraft, hover, aircraft.t_ns)
    row(
        "wind, perfect sensors: hover at 60 m, rms",
        rms(_length(hover.true_m - np.array([0.0, 0.0, -60.0]))),
        0.05,
        "m",
    )
    for windy, name in ((False, "calm, default sensors"), (True, "wind, default sensors")):
        errors, offs, injected = [], [], []
        for seed in SEEDS:
            aircraft = hovering("realistic", windy=windy, seed=seed)
            track = fly(aircraft, legs(aircraft.belief.pos_ned_m, TURNS_DEG))
            errors.append(track.error)
            off, corner = off_track(track.points, np.array(track.belief)[:, :3])
            offs.append(off[corner > STRAIGHT_M])
            injected.append(track.injected_m)
        error = np.concatenate(errors)
        what = f"{name} ({len(SEEDS)} seeds)"
        row(f"{what}: velocity error, each axis rms", rms(error[:, 3:]), 0.05, "m/s")
        row(f"{what}: height error rms", rms(error[:, 2]), 0.15, "m")
        limit = 1.2 * rms(_length(np.concatenate(injected)))
        row(
            f"{what}: horizontal error rms (limit: 1.2 x GNSS)",
            rms(_length(error[:, :2])),
            limit,
            "m",
        )
        row(f"{what}: straights, believed track, rms", rms(np.concatenate(offs)), 0.15, "m")


def _length(vectors: Vector) -> Vector:
    return np.asarray(np.linalg.norm(vectors, axis=1))


@dataclass
class Outage:
    """A flight at 10 m/s through ten seconds without GNSS."""

    start_s: float
    end_s: float
    t_s: Vector
    error: Vector  # (K, 6)
    std_m: Vector  # (K, 2) north and east, the filter's own
    innovations: list[Innovation]


def outage() -> Outage:
    """Fly it."""
    from flightdyn.faults import GnssOff
    from flightdyn.navigation.inertial_navigation import InertialNavigation

    aircraft = hovering("realistic", windy=True, seed=2)
    navigation = aircraft.navigation
    assert isinstance(navigation, InertialNavigation)
    points = legs(aircraft.belief.pos_ned_m, (0.0, 90.0, 90.0), 180.0)
    aircraft.follow(FlightPath(points, np.full(3, 10.0), np.full(4, 5.0)))
    begin_ns = last_ns = aircraft.t_ns
    track, stds, innovations = Track(points), [], []
    for step in range(50 * 50):
        if step == 50 * 20:
            aircraft.inject(GnssOff(duration_s=10.0))
        record(aircraft, track, begin_ns)
        stds.append(navigation.estimator.std(slice(0, 2)))
        new = aircraft.innovations_after(last_ns)
        if new:
            last_ns = new[-1].t_ns
            innovations += new
    shifted = [
        Innovation(i.t_ns - begin_ns, i.kind, i.values, i.stds, i.nis, i.gate) for i in innovations
    ]
    return Outage(20.0, 30.0, np.array(track.t_s), track.error, np.array(stds), shifted)


if __name__ == "__main__":
    accuracy_table()
