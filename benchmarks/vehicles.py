"""Vehicles for tests: whether flights and crossings repeat under load, and what n at once cost.

    python benchmarks/vehicles.py [--flights 1000] [--crossings 1000] [--load 2]
    python benchmarks/vehicles.py --costs 1 2 5 20 [--turns 25]

A flight is flown by setpoints at 10 Hz over UDP, in wind, a crossing by MAVSDK from plan files,
two and three vehicles by turns, all beside `--load` processes that do nothing but compute. Costs
are CPU time of this process, by turns; real-time factors are of wall time, of this machine now.
"""

import argparse
import hashlib
import math
import multiprocessing
import os
import resource
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from flight_chain import configuration
from pymavlink.dialects.v20 import common as mav

import aerofed
from flightdyn.frames import LocalFrame
from flightdyn.guidance.path import FlightPath
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from mission.flight.serve import PX4_HOME
from sitl.vehicle import Vehicle
from sitl.world import World

VELOCITY = 0b0000_1101_1100_0111  # of a setpoint, what is left out: all but the velocity


def order(client: Any, command: int, *params: float) -> None:
    """Give an order, and see it accepted."""
    system = client.target_system
    client.mav.command_long_send(system, 1, command, 0, *params, *[0.0] * (7 - len(params)))
    answer = client.recv_match(type="COMMAND_ACK", blocking=True, timeout=60.0)
    if (answer.command, answer.result) != (command, mav.MAV_RESULT_ACCEPTED):
        raise RuntimeError(f"{answer}")


def climb(client: Any, vehicle: Any) -> None:
    """To 10 m, from the ground with motors running."""
    order(client, mav.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, math.nan, math.nan, math.nan, 498.0)
    vehicle.until(lambda v: v.height_m > 9.5)


def flight() -> tuple[str, float]:
    """Digest of the truth of a flight of some 15 s, and wall seconds until the motors ran."""
    began_s = time.perf_counter()
    with aerofed.vehicle(wind_mps=6.0) as vehicle:
        client = vehicle.mavlink()
        order(client, mav.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        armed_s = time.perf_counter() - began_s
        climb(client, vehicle)
        for number in range(80):
            velocity = math.cos(0.1 * number), math.sin(0.1 * number), 0.0
            client.mav.set_position_target_local_ned_send(
                0, 1, 1, mav.MAV_FRAME_LOCAL_NED, VELOCITY, 0, 0, 0, *velocity, 0, 0, 0, 0, 0
            )
            if number == 1:
                order(client, mav.MAV_CMD_DO_SET_MODE, 129.0, 6.0)
            vehicle.step(0.1)
        return hashlib.sha256(vehicle.truth().to_csv().encode()).hexdigest(), armed_s


def plans(folder: Path) -> list[Path]:
    """Three that cross over one place, 3 m above each other, from homes 5 m apart."""
    home, found = aerofed_home(), []
    for k, (begin, end) in enumerate(
        (((-12, 20), (22, 20)), ((5, 3), (5, 37)), ((-7, 8), (17, 32)))
    ):
        places = [home.to_geodetic(np.array([y, x, 0.0])) for x, y in ((5 * k, 0), begin, end)]
        spots = [f"{each.lat_deg:.9f}\t{each.lon_deg:.9f}" for each in places]
        up = 10 + 3 * k
        rows = [
            f"0\t1\t0\t16\t0\t0\t0\t0\t{spots[0]}\t488\t1",
            f"1\t0\t3\t22\t0\t0\t0\t0\t{spots[0]}\t{up}\t1",
            f"2\t0\t3\t16\t0\t0\t0\t0\t{spots[1]}\t{up}\t1",
            f"3\t0\t3\t16\t0\t0\t0\t0\t{spots[2]}\t{up}\t1",
            f"4\t0\t3\t21\t0\t0\t0\t0\t{spots[2]}\t0\t1",
        ]
        found.append(folder / f"{k}.waypoints")
        found[-1].write_text("\n".join(["QGC WPL 110", *rows, ""]))
    return found


def aerofed_home() -> LocalFrame:
    """Where vehicles stand unless told otherwise."""
    return LocalFrame(GeodeticPoint(*PX4_HOME.values()))


def crossing(sources: Sequence[Path]) -> str:
    """Digest of all true paths and distances of a crossing."""
    with aerofed.vehicles(len(sources), wind_mps=4.0) as fleet:
        fleet.fly(sources)
        tables = [fleet.separation(), *(vehicle.truth() for vehicle in fleet)]
    return hashlib.sha256("".join(table.to_csv() for table in tables).encode()).hexdigest()


def airborne(count: int) -> World:
    """So many aircraft in one world, each on an endless zigzag of legs of 80 m at 20 m/s."""
    config, fleet = configuration(), {}
    frame = config.area.build().frame
    for number in range(count):
        streams = RandomStreams(config.seed)
        home = frame.to_geodetic(np.array([0.0, 30.0 * number, 0.0]))
        vehicle = Vehicle(
            config.vehicle, home=home,
            streams=streams.of_vehicle(number),
        )  # fmt: skip
        fleet[f"vehicle-{number + 1}"] = vehicle
    world = World(fleet)
    while world.t_ns < 3e9:
        world.stride(3_000_000_000)
    for vehicle in fleet.values():
        aircraft = vehicle.aircraft
        aircraft.arm()
        points = [np.array([0.0, 0.0, -50.0])]
        for k in range(1200):
            course = 2.4 * k
            points.append(points[-1] + 80.0 * np.array([math.cos(course), math.sin(course), 0.0]))
        aircraft.follow(FlightPath(np.array(points), np.full(1200, 20.0), np.full(1201, 5.0)))
    run(world, 20.0)
    return world


def run(world: World, seconds: float) -> tuple[float, float]:
    """Let simulated time pass; CPU and wall seconds that it took."""
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    until_ns = world.t_ns + round(seconds * 1e9)
    while world.t_ns < until_ns:
        world.stride(until_ns)
    return time.process_time() - cpu_s, time.perf_counter() - wall_s


def costs(counts: Sequence[int], turns: int) -> None:
    """Print what worlds of so many vehicles cost, beside a world of one in the same turn."""
    worlds, memory = {}, {}
    for count in sorted({1, *counts}):
        before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        worlds[count] = airborne(count)
        after_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        memory[count] = (after_kb - before_kb) / 1024 / count
    took: dict[int, list[tuple[float, float]]] = {count: [] for count in worlds}
    of_each = math.lcm(*worlds)  # vehicle seconds in a turn, so that all are measured as long
    for _ in range(turns):
        for count, world in worlds.items():
            took[count].append(run(world, of_each / count))
    print("vehicles   CPU ms/s   x n of one   each by wall   MiB more each")
    for count, found in took.items():
        ratio = median(c / one for (c, _), (one, _) in zip(found, took[1], strict=True))
        cpu_ms = median(c for c, _ in found) / of_each * count * 1e3
        pace = of_each / count / median(w for _, w in found)
        print(f"{count:8}{cpu_ms:11.2f}{ratio:13.3f}{pace:13.1f}x{memory[count]:16.1f}")


def busy() -> None:
    """Compute, until killed."""
    while True:
        pass


def repeated(what: str, count: int, fly: Callable[[int], str], load: int) -> None:
    """Print how often something failed, and how many digests there are of the rest."""
    began_s, failures = time.perf_counter(), 0
    digests: dict[int, set[str]] = {0: set(), 1: set()}
    for number in range(count):
        try:
            digests[number % 2].add(fly(number))
        except Exception as error:  # whatever it is, it is what is counted
            failures += 1
            print(repr(error))
    found = " and ".join(", ".join(one[:8] for one in each) for each in digests.values())
    wall_s = (time.perf_counter() - began_s) / max(count, 1)
    print(
        f"{count} {what} beside {load} busy processes: {failures} failures; digests of those of "
        f"even and of odd number: {found}; {wall_s:.2f} s each, load {os.getloadavg()[0]:.0f}"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--flights", type=int, default=0)
    parser.add_argument("--crossings", type=int, default=0)
    parser.add_argument("--load", type=int, default=2)
    parser.add_argument("--costs", type=int, nargs="*", default=())
    parser.add_argument("--turns", type=int, default=25)
    options = parser.parse_args()
    if options.costs:
        costs(options.costs, options.turns)
    flight()  # imports
    armed_s: list[float] = []

    def timed(_: int) -> str:
        digest, after_s = flight()
        armed_s.append(after_s)
        return digest

    load = [multiprocessing.Process(target=busy, daemon=True) for _ in range(options.load)]
    for process in load:
        process.start()
    if options.flights:
        repeated("flights", options.flights, timed, options.load)
        print(
            f"from nothing to running motors: {median(armed_s):.3f} s, {max(armed_s):.3f} at most"
        )
    if options.crossings:
        with TemporaryDirectory() as folder:
            sources = plans(Path(folder))
            fly = lambda number: crossing(sources[: 2 + number % 2])  # noqa: E731
            repeated("crossings of two and three", options.crossings, fly, options.load)
    for process in load:
        process.kill()


if __name__ == "__main__":
    main()
