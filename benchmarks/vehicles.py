"""Vehicles for tests: whether a flight repeats under load, how soon one is armed, and many at once.

    python benchmarks/vehicles.py [--flights 1000] [--vehicles 20] [--load 2]

The flight is flown by setpoints at 10 Hz over UDP, in wind, beside `--load` processes that do
nothing but compute. Real-time factors are simulated seconds by wall seconds, of this machine now.
"""

import argparse
import collections
import hashlib
import math
import multiprocessing
import resource
import time
from typing import Any

from pymavlink.dialects.v20 import common as mav

import aerofed

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


def busy() -> None:
    """Compute, until killed."""
    while True:
        pass


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--vehicles", type=int, default=20)
    parser.add_argument("--load", type=int, default=2)
    options = parser.parse_args()
    flight()  # imports
    load = [multiprocessing.Process(target=busy, daemon=True) for _ in range(options.load)]
    for process in load:
        process.start()
    began_s, failures = time.perf_counter(), 0
    digests: collections.Counter[str] = collections.Counter()
    armed_s = []
    for _ in range(options.flights):
        try:
            digest, after_s = flight()
        except Exception as error:  # whatever it is, it is what is counted
            failures += 1
            print(repr(error))
            continue
        digests[digest] += 1
        armed_s.append(after_s)
    wall_s = time.perf_counter() - began_s
    print(
        f"{options.flights} flights beside {options.load} busy processes: {failures} failures, "
        f"{len(digests)} digest(s) of the truth, {wall_s / options.flights:.2f} s each"
    )
    middle_s, worst_s = sorted(armed_s)[len(armed_s) // 2], max(armed_s)
    print(f"from nothing to running motors: median {middle_s:.3f} s, worst {worst_s:.3f} s")
    for process in load:
        process.kill()
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with aerofed.vehicles(options.vehicles) as vehicles:
        for vehicle in vehicles:
            client = vehicle.mavlink()
            order(client, mav.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            climb(client, vehicle)
        began_s = time.perf_counter()
        for _ in range(20):
            for vehicle in vehicles:
                vehicle.step(1.0)
        wall_s = time.perf_counter() - began_s
        kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    print(
        f"{options.vehicles} vehicles: {20.0 * options.vehicles / wall_s:.0f} simulated seconds a "
        f"second together, {20.0 / wall_s:.1f}x real time each, {kb / 1024 / options.vehicles:.1f} "
        "MiB each"
    )


if __name__ == "__main__":
    main()
