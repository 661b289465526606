"""What the log and the live view cost a whole run, on the quick-start mission.

    python benchmarks/log_in_a_run.py [REPEATS]

The mission is flown without samples in its log, with the log but for the control's 50 rows a
second, with all of it, with a live view that nobody watches, and with one viewer subscribed to
everything; in turn, each a process of its own.
Every repeat compares each kind with the run without a log beside it, and the medians are printed,
so that a machine that slows down does not count. On a busy machine even such differences are noise,
so the processor time in the calls of the log itself is given too, as a share of its own run. Other
processor times are of all threads, while the mission is flown and logged; wall time has the pauses
that MAVSDK needs in it. Shares are of the whole run, with planning and training.
"""

import json
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

from mission.log.vehicle import RATES_HZ
from sitl.config import VehicleConfig

REPEATS = 5
CALLS = ("__init__", "sampled", "happened", "plan", "uplinks", "round", "learning", "close")
KINDS = ("no log", "log without control", "log", "log + live", "log + live, a viewer")
# The paper's planner, so that planning does not drown what is measured.
SETTINGS = {"planner.kind": "paper"}


def fly(kind: str, folder: Path) -> dict[str, float]:
    """One run in this process; its times in seconds."""
    from rich.console import Console

    from mission.base.console import RunConsole, Stopwatch
    from mission.config.loading import builtin_config, load_config
    from mission.log.writer import FlightLog
    from mission.run import recorder, session
    from mission.run.recorded import Around
    from sitl.observer import VehicleEvent, VehicleSample

    class Silent(FlightLog):
        """Plans, rounds and attachments only."""

        def sampled(self, sample: VehicleSample) -> None:
            self._now_ns = sample.t_ns

        def happened(self, event: VehicleEvent) -> None:
            self._now_ns = event.t_ns

    class Timed(FlightLog):
        """Adds up the processor time of this thread in the calls that a run makes."""

    def timed(name: str) -> Callable[..., object]:
        call = getattr(FlightLog, name)

        def measured(self: FlightLog, *arguments: object, **named: object) -> object:
            start = time.thread_time()
            try:
                return call(self, *arguments, **named)
            finally:
                in_log_s[0] += time.thread_time() - start

        return measured

    for name in CALLS:
        setattr(Timed, name, timed(name))
    in_log_s = [0.0]

    class CpuToo(Stopwatch):
        """Processor time of all threads beside wall time."""

        @contextmanager
        def __call__(self, name: str) -> Iterator[None]:
            start = time.process_time()
            with super().__call__(name):
                yield
            cpu_s[name] = cpu_s.get(name, 0.0) + time.process_time() - start

    cpu_s: dict[str, float] = {}
    port = free_port() if "live" in kind else None
    received = [0]
    if "viewer" in kind:
        threading.Thread(target=watch, args=(port, received), daemon=True).start()
    settings = SETTINGS | ({"vehicle.control_rate_hz": 0} if "without" in kind else {})
    config = load_config(builtin_config("quickstart.toml"), settings)
    writer = Silent if kind == KINDS[0] else Timed
    with mock.patch.object(recorder, "FlightLog", writer):
        console = RunConsole(Console(quiet=True), live_port=port)
        session.fly_session(config, folder, Around(console, CpuToo()), data_dir=None)
    summary = json.loads((folder / "summary.json").read_text())
    wall_s = summary["wall_s"]
    return {
        "log_s": in_log_s[0],
        "cpu_flight_s": cpu_s["fly"] + cpu_s["log"],
        "cpu_total_s": sum(cpu_s.values()),
        "wall_flight_s": wall_s["fly"] + wall_s["log"],
        "wall_total_s": wall_s["total"],
        "sim_s": summary["simulated_s"],
        "bytes": (folder / "flight.mcap").stat().st_size,
        "viewed_bytes": received[0],
    }


def watch(port: int | None, received: list[int]) -> None:
    """Start a viewer in a process of its own, and count what it says it has received."""
    viewer = subprocess.Popen(
        [sys.executable, __file__, "--watch", str(port)], stdout=subprocess.PIPE, text=True
    )
    assert viewer.stdout is not None
    for line in viewer.stdout:
        received[0] = int(line)


def view(port: int) -> None:
    """Subscribe to every channel and print how many bytes have come, now and then."""
    tests = Path(__file__).parents[1] / "tests"
    sys.path[:0] = [str(tests), str(tests / "mission" / "log")]
    from foxglove_client import FoxgloveClient  # type: ignore[import-not-found]  # of the tests

    while True:
        try:
            client = FoxgloveClient(port)
            break
        except OSError:
            time.sleep(0.05)
    with client:
        client.subscribe([channel["id"] for channel in client.channels().values()])
        total, told = 0, time.monotonic()
        while True:
            try:
                total += len(client.message()[2])
            except OSError:
                print(total, flush=True)
                return
            if time.monotonic() - told > 0.2:
                told = time.monotonic()
                print(total, flush=True)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def run(kind: str) -> dict[str, float]:
    """One run in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, __file__, "--fly", kind, folder],
            check=True, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )  # fmt: skip
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else REPEATS
    rounds = []
    for repeat in range(repeats):
        # Another kind first each time, so that what slows down meanwhile slows none more often.
        order = [KINDS[(index + repeat) % len(KINDS)] for index in range(len(KINDS))]
        found = {kind: run(kind) for kind in order}
        rounds.append({kind: found[kind] for kind in KINDS})

    def median(kind: str, value: Callable[[dict[str, float], dict[str, float]], float]) -> float:
        """Over the repeats, of a kind beside the run without a log of the same repeat."""
        return statistics.median(value(found[kind], found[KINDS[0]]) for found in rounds)

    print("processor time in the calls of the log, in one run: quiet where the machine is not")
    for kind in KINDS[1:]:
        in_log = median(kind, lambda own, _: own["log_s"])
        share = median(kind, lambda own, _: own["log_s"] / own["cpu_total_s"])
        of_flight = median(kind, lambda own, _: own["log_s"] / own["cpu_flight_s"])
        of_wall = median(kind, lambda own, _: own["log_s"] / own["wall_total_s"])
        print(
            f"{kind:22} {in_log:7.2f} s: of processor time {of_flight:.1%} of the flight and "
            f"{share:.1%} of the run, {of_wall:.1%} of the run's wall time"
        )
    print(f"median of {repeats} repeats, each kind against the run without a log beside it")
    print(f"{'':22} {'processor time':>31}   {'wall time':>31}")
    print(f"{'':22} {'in flight':>9} {'more':>8} {'of the run':>12}   "
          f"{'in flight':>9} {'more':>8} {'of the run':>12}")  # fmt: skip
    for kind in KINDS:
        cells = []
        for name in ("cpu", "wall"):
            in_flight = median(kind, lambda own, _, name=name: own[f"{name}_flight_s"])
            more = median(
                kind,
                lambda own, none, name=name: own[f"{name}_flight_s"] - none[f"{name}_flight_s"],
            )
            share = median(
                kind,
                lambda own, none, name=name: (
                    (own[f"{name}_flight_s"] - none[f"{name}_flight_s"]) / none[f"{name}_total_s"]
                ),
            )
            cells.append(f"{in_flight:7.2f} s {more:+6.2f} s {share:+12.1%}")
        print(f"{kind:22} {'   '.join(cells)}")
    bare, log = (
        median(kind, lambda own, _: own["bytes"] * 3600 / own["sim_s"] / 1e6) for kind in KINDS[1:3]
    )
    ratio = statistics.median(
        found[KINDS[2]]["cpu_total_s"] / found[KINDS[1]]["cpu_total_s"] for found in rounds
    )
    print(f"a run with the control in its log takes {ratio:.3f} of the processor time without it")
    viewed = median(KINDS[-1], lambda own, _: own["viewed_bytes"] * 3600 / own["sim_s"] / 1e6)
    print(
        f"{log:.2f} MB a flown hour, {bare:.2f} without the control; the viewer got "
        f"{viewed:.2f} MB of messages an hour"
    )
    rates = ", ".join(f"{kind} {hz:g}" for kind, hz in RATES_HZ.items())
    print(f"rates in Hz: poses {VehicleConfig().sample_rate_hz:g}, {rates}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--fly"]:
        print(json.dumps(fly(sys.argv[2], Path(sys.argv[3]))))
    elif sys.argv[1:2] == ["--watch"]:
        view(int(sys.argv[2]))
    else:
        main()
