"""Missions one after another in one process: do memory, descriptors and time per mission stay?

    python benchmarks/soak.py --hours 10

Prints the first and the last tenth of the missions side by side.
"""

import argparse
import os
import statistics
import sys
import time
from pathlib import Path

from pymavlink.dialects.v20 import common as mav

from flightdyn.random import RandomStreams
from sitl.autopilot.flying.modes import Mode
from sitl.config import VehicleConfig
from sitl.vehicle import Vehicle

sys.path[:0] = [str(Path(__file__).parents[1] / "tests" / name) for name in ("sitl", ".")]
from sitl_desk import Desk, item  # noqa: E402
from sitl_mavsdk import HOME  # noqa: E402

SQUARE = ((120.0, 0.0), (120.0, 120.0), (0.0, 120.0))
NEVER_S = 3600.0


class FlyingDesk(Desk):
    """A ground station's desk over the real aircraft."""

    def __init__(self) -> None:
        super().__init__(ready=False)
        self.vehicle = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1))
        self.fly()

    def fly_square(self) -> None:
        """Upload, arm, fly, land, a fresh battery."""
        self.heard.clear()
        items = [
            item(seq, mav.MAV_CMD_NAV_WAYPOINT, north=north, east=east, height=40.0)
            for seq, (north, east) in enumerate(SQUARE)
        ]
        items.append(item(len(items), mav.MAV_CMD_NAV_RETURN_TO_LAUNCH))
        assert self.upload(items) == mav.MAV_MISSION_ACCEPTED
        assert self.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0) == 0, self.texts()
        assert self.command(mav.MAV_CMD_MISSION_START) == 0, self.texts()
        aircraft = self.vehicle.aircraft
        limit_ns = self.vehicle.t_ns + round(NEVER_S * 1e9)
        while self.vehicle.moving:
            for _ in range(200):
                self.vehicle.step()
            self.now += 0.2
            self.exchange()
            assert self.vehicle.t_ns < limit_ns, "never came to an end"
        assert aircraft.on_ground
        assert self.vehicle.autopilot.mode is Mode.HOLD, self.texts()
        self.vehicle.exchange_battery()


def resident_kib() -> int:
    """Memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--hours", type=float, default=10.0)
    hours = parser.parse_args().hours
    desk = FlyingDesk()
    rows: list[tuple[float, int, int]] = []
    while desk.vehicle.t_ns < hours * 3600e9:
        began = time.process_time()
        desk.fly_square()
        open_files = len(list(Path("/proc/self/fd").iterdir()))
        rows.append((time.process_time() - began, resident_kib(), open_files))
        if len(rows) % 50 == 0:
            tell(rows, desk.vehicle.t_ns)
    tell(rows, desk.vehicle.t_ns)


def tell(rows: list[tuple[float, int, int]], t_ns: int) -> None:
    """The first tenth against the last."""
    tenth = max(1, len(rows) // 10)
    print(f"{len(rows)} missions in {t_ns / 3.6e12:.1f} simulated hours")
    for name, unit, column in (
        ("processor time a mission", "s", 0),
        ("resident memory", "KiB", 1),
        ("open descriptors", "", 2),
    ):
        first = statistics.median(row[column] for row in rows[:tenth])
        last = statistics.median(row[column] for row in rows[-tenth:])
        print(f"{name}: {first:.6g} {unit} in the first tenth, {last:.6g} in the last", flush=True)


if __name__ == "__main__":
    main()
