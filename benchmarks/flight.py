"""What a simulated second of flight costs, by part, next to the physics alone.

    python benchmarks/flight.py                    # cost by part, ratios of this very run
    python benchmarks/flight.py --missions 100     # missions in a row at the highest speed
    python benchmarks/flight.py --distance 40000   # memory over one long mission

Everything runs in this process on one core: physics at 250 Hz, IMU, GNSS, filter, guidance,
autopilot, MCAP log, MAVSDK over the in-process link. Each repeat measures all layers one after
the other; a part's cost is the difference to the layer below in the same repeat, the median over
the repeats. The floor is `FGFDMExec.run()` of the very same model in the very same guided flight,
by timers within the loop on true states, their own time taken off: unguided, the model would fall
out of the regime that is flown. In the full chain the timers find JSBSim dearer, as sensors and
filter leave it less of the cache; the table books that to them. CPU time is that of all threads;
wall time depends on what else the machine does, which is printed.
"""

import argparse
import asyncio
import math
import os
import time
from collections.abc import Callable
from statistics import median
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
import numpy as np
from flight_chain import (
    WIND,
    Cost,
    flown_by_mavsdk,
    flown_unheard,
    flown_without_link,
)
from flight_endurance import long_mission, many_missions

from flightdyn.aircraft import Aircraft
from flightdyn.config import AircraftConfig
from flightdyn.guidance.path import FlightPath
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint

HOME = GeodeticPoint(47.0, 8.0, 488.0)
HZ = 250
LEG_M, LEGS = 80.0, 1200


def cruising(sensors: str) -> Aircraft:
    """An aircraft on an endless path of 80 m legs at 20 m/s, as in a round."""
    config = AircraftConfig.model_validate({"sensors": {"kind": sensors}, "wind": WIND})
    aircraft = Aircraft(config, home=HOME, streams=RandomStreams(1))
    aircraft.arm()
    aircraft.hold(np.array([0.0, 0.0, -60.0]), 0.0)
    while not aircraft.progress.finished:
        aircraft.step()
    points = [aircraft.belief.pos_ned_m]
    for k in range(LEGS):
        course = 2.4 * k
        points.append(points[-1] + LEG_M * np.array([math.cos(course), math.sin(course), 0.0]))
    aircraft.follow(FlightPath(np.array(points), np.full(LEGS, 20.0), np.full(LEGS + 1, 5.0)))
    return aircraft


def advance(aircraft: Aircraft, seconds: float) -> None:
    """So much simulated time."""
    until_ns = aircraft.t_ns + round(seconds * 1e9)
    while aircraft.t_ns < until_ns:
        aircraft.advance(HZ)


def stepped(aircraft: Aircraft, seconds: float) -> Cost:
    """The cost of so many simulated seconds."""
    cpu, wall = time.process_time(), time.perf_counter()
    advance(aircraft, seconds)
    return Cost(seconds, time.process_time() - cpu, time.perf_counter() - wall)


def physics(aircraft: Aircraft, seconds: float) -> Cost:
    """What of a guided flight is JSBSim's: half of the time by CPU, half by wall."""
    flying: Any = aircraft
    vehicle: Any = aircraft.vehicle
    run, spent = vehicle.run, []
    for clock in (time.thread_time, time.perf_counter):
        watch = Stopwatch(clock)
        vehicle.run = flying.run = watch.wrap("physics", run)
        advance(aircraft, seconds / 2)
        spent.append(watch.spent["physics"])
    vehicle.run = flying.run = run
    return Cost(seconds / 2, *spent)


def layers(seconds: float) -> dict[str, Callable[[], Cost]]:
    """What is measured, each with all that is above it."""
    inner, truth, chain = cruising("perfect"), cruising("perfect"), cruising("realistic")
    length_m = seconds * 10.6  # flown in about so many seconds: 80 m legs are mostly turns
    return {
        "JSBSim, FCS and turbulence included": lambda: physics(inner, seconds),
        "guidance, control, battery": lambda: stepped(truth, seconds),
        "IMU, GNSS, baro, magnetometer, filter": lambda: stepped(chain, seconds),
        "autopilot, samples at 10 Hz": lambda: flown_without_link(length_m, log=False),
        "MCAP log": lambda: flown_without_link(length_m, log=True),
        "event loop, link, telemetry": lambda: asyncio.run(flown_unheard(length_m)),
        "MAVSDK, pilot, upload": lambda: asyncio.run(flown_by_mavsdk(length_m)),
    }


def chain_table(seconds: float, repeats: int) -> None:
    """Print the cost of the full chain by part."""
    work = layers(seconds)
    found: dict[str, list[Cost]] = {name: [] for name in work}
    for _ in range(repeats):
        for name, measure in work.items():
            found[name].append(measure())
    cpu = {name: [c.cpu_s / c.sim_s * 1e3 for c in costs] for name, costs in found.items()}
    wall = {name: [c.wall_s / c.sim_s * 1e3 for c in costs] for name, costs in found.items()}
    names = list(work)
    floor = median(cpu[names[0]])
    columns = ("CPU", "sum", "x real", "x floor", "wall")
    print(f"{'ms per simulated second':42}" + "".join(f"{column:>9}" for column in columns))
    below = None
    for name in names:
        part = _difference(cpu, name, below)
        wall_part = _difference(wall, name, below)
        total = median(cpu[name])
        share = f"{1e3 / total:9.0f}{total / floor:9.2f}"
        print(f"{name:42}{part:9.2f}{total:9.2f}{share}{wall_part:9.2f}")
        below = name
    last = names[-1]
    cpu_ms, wall_ms = median(cpu[last]), median(wall[last])
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    print(
        f"full chain: {1e3 / cpu_ms:.0f}x real time by CPU (best {1e3 / min(cpu[last]):.0f}x), "
        f"{1e3 / wall_ms:.0f}x by wall (best {1e3 / min(wall[last]):.0f}x) on one core;\n"
        f"truth loop {1e3 / median(cpu[names[1]]):.0f}x; load of the machine ({os.cpu_count()} "
        f"cores): {load}"
    )


def _difference(costs: dict[str, list[float]], name: str, below: str | None) -> float:
    """What `name` costs beyond the layer below it, pair by pair."""
    if below is None:
        return median(costs[name])
    return median(a - b for a, b in zip(costs[name], costs[below], strict=True))


class Stopwatch:
    """Adds up the time spent in the calls it wraps, less its own."""

    def __init__(self, clock: Callable[[], float] = time.thread_time) -> None:
        self._clock = clock
        self.spent: dict[str, float] = {}
        probe = self.wrap("probe", lambda: None)
        for _ in range(20_000):
            probe()
        self._own = self.spent.pop("probe") / 20_000

    def wrap(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """`call`, timed under `name`."""
        clock, spent = self._clock, self.spent
        spent[name] = 0.0

        def timed(*args: Any, **more: Any) -> Any:
            start = clock()
            result = call(*args, **more)
            spent[name] += clock() - start - getattr(self, "_own", 0.0)
            return result

        return timed


def aircraft_table(seconds: float) -> None:
    """Print where the aircraft's own time goes."""
    aircraft: Any = cruising("realistic")
    watch = Stopwatch()
    vehicle: Any = aircraft.vehicle
    vehicle.run = aircraft.run = watch.wrap("physics", vehicle.run)
    navigation: Any = aircraft.navigation
    navigation.fly = watch.wrap("the same with IMU and guidance steps in C", navigation.fly)
    navigation.sense = watch.wrap("the other sensors, when due", navigation.sense)
    navigation.update = watch.wrap("estimator: filter", navigation.update)
    guidance: Any = aircraft._guidance
    guidance.step = watch.wrap("guidance steps after what is due", guidance.step)
    aircraft._update_surroundings = watch.wrap(
        "battery, faults, ground", aircraft._update_surroundings
    )
    advance(aircraft, seconds)
    print("\ninside the aircraft, by timers (their own time taken off)")
    for name, spent in watch.spent.items():
        print(f"{name:42}{spent / seconds * 1e3:8.2f}")


def main() -> None:
    """Measure what was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=120.0, help="simulated, each measurement")
    parser.add_argument("--repeats", type=int, default=7, help="of all layers")
    parser.add_argument("--missions", type=int, metavar="COUNT", help="so many in a row instead")
    parser.add_argument("--distance", type=float, metavar="METRES", help="one long mission instead")
    options = parser.parse_args()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    if options.missions:
        asyncio.run(many_missions(options.missions))
    elif options.distance:
        asyncio.run(long_mission(options.distance))
    else:
        chain_table(options.seconds, options.repeats)
        aircraft_table(options.seconds)


if __name__ == "__main__":
    main()
