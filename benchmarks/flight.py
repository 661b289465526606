"""What a simulated second of flight costs, by part, next to bare stepping of the physics.

Ratios of one run on one core, CPU time of this thread: what other work the machine does is left
out. The floor is `FGFDMExec.run()` of the very same model, at the same rate, with nothing around
it. `--seconds` sets the simulated time of each row.
"""

import argparse
import math
import os
import time
from collections.abc import Callable
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
import numpy as np

from flightdyn.aircraft import Aircraft
from flightdyn.config import AircraftConfig
from flightdyn.path import FlightPath
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint

HOME = GeodeticPoint(47.0, 8.0, 488.0)
WIND = {"speed_mps": 5.0, "turbulence_severity": 4}


def cruising(sensors: str) -> Aircraft:
    """An aircraft on an endless path of 80 m legs at 20 m/s, as in a round."""
    config = AircraftConfig.model_validate({"sensors": {"kind": sensors}, "wind": WIND})
    aircraft = Aircraft(config, home=HOME, streams=RandomStreams(1))
    aircraft.arm()
    aircraft.hold(np.array([0.0, 0.0, -60.0]), 0.0)
    while not aircraft.progress.finished:
        aircraft.step()
    points = [aircraft.belief.pos_ned_m]
    for k in range(600):
        course = 2.4 * k
        points.append(points[-1] + 80 * np.array([math.cos(course), math.sin(course), 0.0]))
    aircraft.follow(FlightPath(np.array(points), np.full(600, 20.0), np.full(601, 5.0)))
    return aircraft


def cost_ms(call: Callable[[], object], seconds: float) -> float:
    """CPU milliseconds per simulated second of 250 calls; the best of five stretches."""
    best = math.inf
    for _ in range(5):
        count = round(seconds * 50)
        start = time.thread_time()
        for _ in range(count):
            call()
        best = min(best, (time.thread_time() - start) / count * 250e3)
    return best


class Stopwatch:
    """Adds up the time spent in the calls it wraps, less its own."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        probe = self.wrap("probe", lambda: None)
        for _ in range(20_000):
            probe()
        self._own = self.spent.pop("probe") / 20_000

    def wrap(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """`call`, timed under `name`."""
        clock, spent = time.thread_time, self.spent
        spent[name] = 0.0

        def timed(*args: Any, **more: Any) -> Any:
            start = clock()
            result = call(*args, **more)
            spent[name] += clock() - start - getattr(self, "_own", 0.0)
            return result

        return timed


def parts(seconds: float) -> dict[str, float]:
    """CPU milliseconds per simulated second of the parts of the full chain."""
    aircraft = cruising("realistic")
    watch = Stopwatch()
    objects: Any = aircraft
    objects._run = watch.wrap("physics", aircraft._run)
    navigation: Any = aircraft.navigation
    navigation.tick = watch.wrap("sensors: IMU every tick, others when due", navigation.tick)
    navigation.update = watch.wrap("estimator: increments, filter, replay", navigation.update)
    guidance: Any = objects._guidance
    guidance.step = watch.wrap("guidance and outer loop, 50 Hz", guidance.step)
    objects._housekeep = watch.wrap("battery, faults, ground", objects._housekeep)
    count = round(seconds * 250)
    for _ in range(count):
        aircraft.step()
    return {name: spent / seconds * 1e3 for name, spent in watch.spent.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=40.0, help="simulated, each row")
    seconds = parser.parse_args().seconds
    truth, chain = cruising("perfect"), cruising("realistic")
    rows = {
        "truth loop: physics, guidance, control": cost_ms(truth.step, seconds),
        "full chain: sensors and filter as well": cost_ms(chain.step, seconds),
    }
    floor = cost_ms(chain.vehicle.run, seconds)
    print(f"{'':44}{'ms per s':>10}{'x real time':>13}{'x floor':>9}")
    for name, cost in {"floor: bare JSBSim, FCS included": floor, **rows}.items():
        print(f"{name:44}{cost:10.2f}{1e3 / cost:13.0f}{cost / floor:9.2f}")
    print("\nparts of the full chain (the timers taken off)")
    for name, cost in parts(seconds).items():
        print(f"  {name:42}{cost:10.2f}{'':13}{cost / floor:9.2f}")


if __name__ == "__main__":
    main()
