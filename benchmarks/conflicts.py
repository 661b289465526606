"""Flown conflicts: whether the world and `aerofed compare` find who came how near, and when.

    python benchmarks/conflicts.py [--conflicts 200] [--first SEED]

Two aircraft cross in wind, with all sensors, by a distance that is drawn from 0.1 to 20 m. The
reference is the track of each at every tick, flown again alone: until they touch they fly the same.
It is compared with what the world knew, and with what `aerofed compare --together` finds in our
logs, in those exported as ULog, and in DataFlash and telemetry logs that are made of the tracks at
10 Hz. Those that touch are judged by when. The exit code is 1 where anything was missed by more
than 1 cm, and in degrees of 1e-7 (1.1 cm) by more than their roundings besides, or by 0.5 s.
"""

import argparse
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from flight_chain import order
from numpy.typing import NDArray

import aerofed
from flightdyn.frames import LocalFrame
from mission.api.vehicles import vehicle_config
from mission.flight.logs.ulog_export import export_ulog
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.serve.vehicle import Served, make_vehicles
from mission.planner.flyable import Stop
from sitl.nearness import TOUCH_M
from sitl.world import World

sys.path.append(str(Path(__file__).parents[1] / "tests" / "mission" / "flight"))
from told_logs import HOME, WRITERS, made

READY_S, UP_S, END_S = 10.0, 24.0, 42.0
LONG_M, BEYOND_M, SPEED_MPS = 40.0, 50.0, 8.0
ROUNDING_M = {".bin": math.hypot(0.011, 0.008), ".tlog": math.hypot(0.011, 0.008)}
# Logs of those that touch end between two samples, 0.1 s apart, in which both come so much nearer.
LAST_M = 2.1 * SPEED_MPS * 0.1
NAMES = "vehicle-1", "vehicle-2"
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Conflict:
    """Two flights over places (east, north) at heights of their own."""

    seed: int
    starts_m: Floats  # (2, 2)
    headings: Floats  # (2, 2)
    heights_m: Floats  # (2,)


def drawn(seed: int) -> Conflict:
    """They start so far before the places of their least distance that they reach them at once."""
    rng = np.random.default_rng(seed)
    away_m, course = rng.uniform(0.1, 20.0), rng.uniform(0.0, 2.0 * math.pi)
    courses = np.array([course, course + rng.uniform(0.7, math.pi) * rng.choice([-1, 1])])
    headings = np.column_stack((np.cos(courses), np.sin(courses)))
    level = np.array([headings[1, 1] - headings[0, 1], headings[0, 0] - headings[1, 0]])
    tilt = rng.uniform(0.0, 2.0 * math.pi)
    there = away_m * math.cos(tilt) * level / np.linalg.norm(level)
    meets = np.array([400.0, 400.0]) + np.array([np.zeros(2), there])
    heights_m = 32.0 + np.array([0.0, away_m * math.sin(tilt)])
    return Conflict(seed, meets - LONG_M * headings, headings, heights_m)


def vehicles(conflict: Conflict, logs: Path | None) -> list[Served]:
    """Both on the ground, below where they start."""
    keys = {"vehicle.aircraft.wind.turbulence_severity": 3}
    own = {
        name: vehicle_config(
            {**keys, "area.home_m": start.tolist()}, wind_mps=3.0, seed=conflict.seed
        )
        for name, start in zip(NAMES, conflict.starts_m, strict=True)
    }
    base = vehicle_config(keys, wind_mps=3.0, seed=conflict.seed)
    return make_vehicles(base, count=2, each=own, udp=(), logs=logs, in_step=True)


def ordered(conflict: Conflict, served: list[Served], t_s: float, which: range) -> None:
    """What they are told at an instant."""
    for number in which:
        one, height_m = served[number], float(conflict.heights_m[number])
        flight = one.vehicle.autopilot.flight
        if t_s == READY_S:
            for refused in (flight.arm(), flight.take_off(one.area.home.alt_msl_m + height_m)):
                assert refused is None, refused
        elif t_s == UP_S:
            start = conflict.starts_m[number]
            end = start + (LONG_M + BEYOND_M) * conflict.headings[number]
            plan = FlightPlan((Stop(start, ()), Stop(end, ())), height_m, SPEED_MPS, 5.0)
            order(one.vehicle, CONFIG, plan)


CONFIG = vehicle_config()


def alone(conflict: Conflict, number: int) -> tuple[Floats, Floats]:
    """Times (n,) and places (n, 3), NED from `HOME`, at every tick of one that flies alone."""
    served = vehicles(conflict, None)
    vehicle, frame = served[number].vehicle, LocalFrame(HOME)
    t_s, places = [], []
    for end_s in (READY_S, UP_S, END_S):
        while vehicle.t_ns < end_s * 1e9:
            vehicle.stride(vehicle.t_ns + vehicle.aircraft.dt_ns)
            t_s.append(vehicle.t_ns * 1e-9)
            places.append(vehicle.aircraft.pos_ned_m)
        ordered(conflict, served, end_s, range(number, number + 1))
    return np.array(t_s), vehicle.aircraft.frame.in_frame(np.array(places), frame)


def together(conflict: Conflict, logs: Path) -> World:
    """Both in one world, logged."""
    served = vehicles(conflict, logs)
    world = World({one.name: one.vehicle for one in served})
    for end_s in (READY_S, UP_S, END_S):
        while world.t_ns < end_s * 1e9:
            world.stride(end_s * 1e9)
        ordered(conflict, served, end_s, range(2))
    for one in served:
        assert one.logs is not None
        one.logs.close()
    return world


def tried(seed: int, folder: Path) -> dict[str, tuple[float, float]]:
    """By how much each source misses the distance (m) and the time (s); NaN of a distance that
    nobody can know, as they touched."""
    conflict = drawn(seed)
    (t_s, one), (_, two) = alone(conflict, 0), alone(conflict, 1)
    apart = np.linalg.norm(one - two, axis=1)
    world = together(conflict, folder)
    (least,) = world.least
    touching = np.flatnonzero(apart < TOUCH_M)
    hit = len(touching) > 0
    true_s = float(t_s[touching[0] if hit else apart.argmin()])
    true_m = math.nan if hit else float(apart.min())
    assert bool(world.collisions) == hit, (seed, world.collisions, apart.min())
    found = {"world": (least.distance_m, (world.collisions[0][0] if hit else least.t_ns) * 1e-9)}
    ours = [folder / name / "flight-0001.mcap" for name in NAMES]
    logs = {"our logs": ours, "exported .ulg": [path.with_suffix(".ulg") for path in ours]}
    for path, target in zip(ours, logs["exported .ulg"], strict=True):
        export_ulog(path, target)
    kept = t_s <= (true_s if hit else END_S)  # as a log ends that is lost with its aircraft
    for kind in (".bin", ".tlog"):
        logs[kind] = [folder / f"{name}{kind}" for name in NAMES]
        for path, track in zip(logs[kind], (one, two), strict=True):

            def way(at_s: Floats, track: Floats = track) -> Floats:
                return np.column_stack([np.interp(at_s, t_s[kept], axis) for axis in track[kept].T])

            flight = made(path=way, until_s=float(t_s[kept][-1]))
            WRITERS[kind](path, replace(flight, utc_s=1.7e9))
    for kind, paths in logs.items():
        row = aerofed.compare(*paths, together=True).pairs.iloc[0]
        found[kind] = float(row.separation_min_m), float(row.separation_min_t_s)
    assert not hit or all(abs(m - TOUCH_M) < LAST_M for m, _ in found.values()), (seed, found)
    return {kind: (m - true_m, at_s - true_s) for kind, (m, at_s) in found.items()}


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--conflicts", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    options = parser.parse_args()
    missed: dict[str, list[tuple[float, float]]] = {}
    for seed in range(options.first, options.first + options.conflicts):
        with TemporaryDirectory() as folder:
            for kind, miss in tried(seed, Path(folder)).items():
                missed.setdefault(kind, []).append(miss)
    failed = False
    print(f"{options.conflicts} conflicts   worst m   worst s   touched")
    for kind, misses in missed.items():
        both = np.abs(misses)
        worst_m, worst_s = np.nanmax(both[:, 0]), both[:, 1].max()
        failed |= bool(worst_m > 0.01 + ROUNDING_M.get(kind, 0.0) or worst_s > 0.5)
        print(f"{kind:15}{worst_m:10.4f}{worst_s:10.3f}{int(np.isnan(both[:, 0]).sum()):10}")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
