"""What logging costs: processor time for a flown hour, with and without the live view.

    python benchmarks/flight_log.py [RUN_FOLDER]

Without a folder, a made-up flight is logged: a circle with sensor-like noise at 10 Hz. With the
folder of a run, its log's size an hour and its share of the run's wall time are printed as well.
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from flightdyn.state import BatteryState, GeodeticPoint, GnssFix, Kinematics
from mission.base.area import Area
from mission.log.inspection import info
from mission.log.live import LiveView
from mission.log.sink import Sink
from mission.log.values import Devices
from mission.log.writer import FlightLog
from sitl.observer import VehicleSample

SECONDS = 600
RATE_HZ = 10
AREA = Area.at((800.0, 800.0), (400.0, 400.0), GeodeticPoint(43.6, 7.07, 130.0))
DEVICES = Devices(np.random.default_rng(1).uniform(0, 800, (12, 2)), ("a",) * 6 + ("b",) * 6)
REPEATS = 3


def flight() -> list[VehicleSample]:
    """A circle of 200 m at 20 m/s with noisy attitude and estimate."""
    rng = np.random.default_rng(2)
    samples = []
    for index in range(SECONDS * RATE_HZ):
        t_ns = index * 1_000_000_000 // RATE_HZ
        angle = index / RATE_HZ * 20.0 / 200.0
        at = np.array([200 * np.cos(angle), 200 * np.sin(angle), -60.0])
        vel = 20.0 * np.array([-np.sin(angle), np.cos(angle), 0.0])
        q = np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]) + rng.normal(0, 0.005, 4)
        truth = Kinematics(t_ns, at + rng.normal(0, 0.05, 3), vel + rng.normal(0, 0.1, 3), q, at)
        belief = Kinematics(t_ns, at + rng.normal(0, 0.4, 3), vel + rng.normal(0, 0.1, 3), q, at)
        fix = GnssFix(t_ns, belief.pos_ned_m, belief.vel_ned_mps, 0.9, 2.0, 0.1, 14)
        battery = BatteryState(22.2 - index / 4e3, 31 + rng.normal(), index / 7.0, 1 - index / 2e4)
        gnss = fix if index % 2 == 0 else None
        samples.append(VehicleSample(t_ns, truth, belief, gnss, battery, "mission", armed=True))
    return samples


def ours(samples: Sequence[VehicleSample], path: Path, mirrors: Sequence[Sink] = ()) -> None:
    """Through `FlightLog`."""
    with FlightLog(path, area=AREA, devices=DEVICES, mirrors=mirrors) as log:
        for sample in samples:
            log.sampled(sample)


def best(work: Callable[[Path], None]) -> tuple[float, int]:
    """Least processor time of a few repeats, in s a flown hour, and the file's size."""
    times = []
    for _ in range(REPEATS):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.mcap"
            start = time.process_time()
            work(path)
            times.append(time.process_time() - start)
            size = path.stat().st_size
    return min(times) / SECONDS * 3600, size


def main() -> None:
    samples = flight()
    own, size = best(lambda path: ours(samples, path))

    def live(path: Path) -> None:
        ours(samples, path, [LiveView(port=0)])

    with_live, _ = best(live)
    hour = 3600 / SECONDS / 1e6
    print(f"log            {own:5.2f} s a flown hour, {size * hour:5.2f} MB an hour")
    print(f"log + live     {with_live:5.2f} s, nobody watching: {with_live / own:.2f} x the log")
    if len(sys.argv) > 1:
        run = Path(sys.argv[1])
        found = info(run / "flight.mcap")
        summary = json.loads((run / "summary.json").read_text())
        wall_s = own * (found.end_s - found.start_s) / 3600
        print(
            f"{run}: {found.megabytes_per_hour:.2f} MB an hour, about {wall_s:.2f} s of "
            f"{summary['wall_s']['total']:.1f} s: {wall_s / summary['wall_s']['total']:.1%} "
            f"of the run, {wall_s / summary['wall_s']['fly']:.1%} of the flight"
        )


if __name__ == "__main__":
    main()
