"""Rounds with limits: what plans cost, how much is proven, and what a hill climber finds beyond.

    python benchmarks/planner_limits.py [--problems 6] [--climb 5] [--large] [--only deadline]

A row a kind of limits, mixed and by themselves; K = 12 and N = 10, or K = 40 and N = 20 with
`--large`; three channels in turn. CPU seconds are those of planning, the channel's tables made
before. The climber begins with the plan and has so many CPU seconds: it moves a waypoint, puts it
near a device, into another place of the order, or reverses a stretch, and keeps what is worth more
once it is made to fit, as every plan of ours is.
"""

import argparse
import dataclasses
import math
import time
from collections.abc import Callable

import numpy as np
from planner import timed

from fl.radio.channel import CHANNEL_PRESETS
from flightdyn.config import LimitsConfig
from mission.base.airspace import Airspace
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner
from mission.planner.improving import fitted
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem, Start

CHANNELS = ("suburban", "suburban+10dB", "dense-urban")
FLYING = Performance(20.0, 5.0, LimitsConfig())
KINDS = {
    "free": "",
    "areas beside": "beside",
    "areas": "areas",
    "deadline": "deadline",
    "energy": "energy",
    "deadline, altitude": "deadline altitude",
    "maze, deadline": "maze deadline",
    "deadline, upload": "deadline upload",
    "deadline, ready": "deadline ready",
    "upload, ready, no deadline": "upload ready",
    "all": "maze deadline energy altitude upload ready",
}


def rectangle(x: float, y: float, width: float, height: float) -> np.ndarray:
    """The four corners."""
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])


AREAS = {
    "beside": (rectangle(-900.0, -900.0, 300.0, 300.0), rectangle(1400.0, 200.0, 100.0, 500.0)),
    "areas": (rectangle(250.0, 250.0, 80.0, 300.0), rectangle(500.0, 300.0, 150.0, 150.0)),
    "maze": (
        rectangle(150.0, -50.0, 30.0, 600.0),
        rectangle(300.0, 200.0, 30.0, 650.0),
        rectangle(480.0, -50.0, 30.0, 380.0),
        rectangle(480.0, 450.0, 30.0, 400.0),
        rectangle(620.0, 150.0, 150.0, 30.0),
    ),
}


def problem(kind: str, seed: int, *, large: bool) -> RoundProblem:
    """A layout at random with these limits."""
    rng = np.random.default_rng([770, seed])
    devices, steps, deadline_s = (40, 20, 75.0) if large else (12, 10, 45.0)
    limited = KINDS[kind].split()
    place = next((name for name in AREAS if name in limited), None)
    upload_s, ready_in_s = rng.uniform(0.5, 6.0, devices), rng.uniform(0.0, 40.0, devices)
    devices_m, start_m = rng.uniform(0.0, 800.0, (devices, 2)), np.array([400.0, 400.0])
    importance = rng.uniform(0.2, 1.0, devices)
    needed = {"deadline", "energy", "ready"} & set(limited)
    limits = RoundLimits(
        FLYING,
        deadline_s if "deadline" in limited else math.inf,
        180.0 * deadline_s if "energy" in limited else math.inf,
    )
    start = Start(
        start_m,
        1600.0 if large else 800.0,
        limits if needed else None,
        (40.0, 120.0) if "altitude" in limited else None,
    )
    return RoundProblem(
        devices_m=devices_m,
        importance=importance,
        starts=(start,),
        steps=steps,
        per_step=3,
        channel=CHANNEL_PRESETS[CHANNELS[seed % len(CHANNELS)]],
        airspace=Airspace() if place is None else Airspace(AREAS[place], None, 10.0),
        upload_s=upload_s if "upload" in limited else None,
        ready_in_s=ready_in_s if "ready" in limited else None,
    )


def climbed(given: RoundProblem, plan: RoundPlan, seconds: float) -> float:
    """The value after so many CPU seconds of changes at random."""
    rng, best = np.random.default_rng(5), plan
    given = given.at(plan.altitude_m)
    until = time.process_time() + seconds
    while time.process_time() < until:
        way, n = best.waypoints_m.copy(), int(rng.integers(1, given.steps))
        change = rng.integers(4)
        if change == 0:
            way[n] += rng.normal(0.0, 10.0 ** rng.uniform(0.0, 2.0), 2)
        elif change == 1:
            device = given.devices_m[rng.integers(len(given.devices_m))]
            way[n] = device + rng.uniform(0.0, 1.0) * rng.uniform(0.0, 1.0) * (way[n] - device)
        elif change == 2:
            place, moved = int(rng.integers(1, given.steps)), way[n].copy()
            way = np.insert(np.delete(way, n, axis=0), place, moved, axis=0)
        else:
            m = int(rng.integers(1, given.steps))
            first, end = min(m, n), max(m, n) + 1
            way[first:end] = way[first:end][::-1].copy()
        other = fitted(given, way, above=best.value)
        best = other or best
    check_plan(given, dataclasses.replace(best.with_own(altitude_m=None), upper_bound=math.nan))
    return best.value


def row(kind: str, count: int, *, climb_s: float, large: bool, verbose: bool) -> str:
    """A line of the table."""
    planner, found = make_planner(PlannerConfig()), []
    for seed in range(count):
        given = problem(kind, seed, large=large)
        free = dataclasses.replace(given.unlimited, upload_s=None)
        make_planner(PlannerConfig(kind="sqp")).plan(free)  # tables
        plan, taken_ms = timed(planner, given)
        taken_s = taken_ms / 1e3
        gain = climbed(given, plan, climb_s) / plan.value - 1.0 if climb_s and plan.value else 0.0
        found.append((taken_s, plan.gap, gain))
        if verbose:
            print(
                f"  {kind} {seed}: {plan.value:.4f}, {taken_s:.2f} s, {plan.gap:.1%}, {gain:.2%}",
                flush=True,
            )
    taken, gaps, gains = np.array(found).T
    cells: tuple[tuple[Callable[[np.ndarray], float], np.ndarray, str], ...] = (
        (np.median, taken, ".2f"), (np.max, taken, ".2f"),
        (np.median, gaps, ".1%"), (np.max, gaps, ".1%"),
        (np.median, gains, ".2%"), (np.max, gains, ".2%"),
    )  # fmt: skip
    numbers = " | ".join(format(float(of(values)), form) for of, values, form in cells)
    return f"| {kind} | {numbers} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--problems", type=int, default=6)
    parser.add_argument("--climb", type=float, default=5.0)
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--only", choices=KINDS, nargs="*", default=list(KINDS))
    asked = parser.parse_args()
    print("| limits | CPU s, median | worst | gap, median | worst | climber, median | worst |")
    print("|---|---|---|---|---|---|---|")
    for name in asked.only:
        print(
            row(
                name, asked.problems, climb_s=asked.climb, large=asked.large, verbose=asked.verbose
            ),
            flush=True,
        )
