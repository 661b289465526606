"""What the log and the live view cost a whole run, on the quick-start mission.

    python benchmarks/log_in_a_run.py [REPEATS]

The mission is flown without samples in its log, with the log, with the log and a live view that
nobody watches, and with one viewer subscribed to everything; in turn, so that a machine that slows
down slows all of them. Each is a process of its own, and the least of the repeats counts: processor
time of all threads while it is flown and logged, beside the wall time of the flights, which
includes the pauses that MAVSDK needs. Shares are also given of the whole run's wall time, with
planning and training.
"""

import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

REPEATS = 3
KINDS = ("no log", "log", "log + live", "log + live, a viewer")
# The paper's planner, so that planning does not drown what is measured.
SETTINGS = {"planner.kind": "paper"}


def fly(kind: str, folder: Path) -> dict[str, float]:
    """One run in this process; its times in seconds."""
    from rich.console import Console

    from mission import recorder, session
    from mission.audience import Audience
    from mission.config import builtin_config, load_config
    from mission.log.writer import FlightLog
    from mission.stopwatch import Stopwatch
    from sitl.observer import VehicleEvent, VehicleSample

    class Silent(FlightLog):
        """Plans, rounds and attachments only."""

        def sampled(self, sample: VehicleSample) -> None:
            self._now_ns = sample.t_ns

        def happened(self, event: VehicleEvent) -> None:
            self._now_ns = event.t_ns

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
    config = load_config(builtin_config("quickstart.toml"), SETTINGS)
    writer = Silent if kind == KINDS[0] else FlightLog
    with (
        mock.patch.object(recorder, "FlightLog", writer),
        mock.patch.object(session, "Stopwatch", CpuToo),
    ):
        session.fly_session(
            config,
            folder,
            data_dir=None,
            audience=Audience(Console(quiet=True), quiet=True, live_port=port),
        )
    summary = json.loads((folder / "summary.json").read_text())
    return {
        "cpu_s": cpu_s["fly"] + cpu_s["log"],
        "fly_s": summary["wall_s"]["fly"],
        "total_s": summary["wall_s"]["total"],
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
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "log"))
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


def main() -> None:
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else REPEATS
    best: dict[str, dict[str, float]] = {}
    for _ in range(repeats):
        for kind in KINDS:
            with tempfile.TemporaryDirectory() as folder:
                done = subprocess.run(
                    [sys.executable, __file__, "--fly", kind, folder],
                    check=True, stdout=subprocess.PIPE, text=True,
                    env={**os.environ, "OMP_NUM_THREADS": "1"},
                )  # fmt: skip
            found = json.loads(done.stdout.splitlines()[-1])
            before = best.setdefault(kind, found)
            best[kind] = {key: min(before[key], value) for key, value in found.items()}
    none = best["no log"]
    for kind, found in best.items():
        cpu = found["cpu_s"] - none["cpu_s"]
        print(
            f"{kind:22} {found['cpu_s']:6.2f} s of processor time in flight ({cpu:+.2f} s: "
            f"{cpu / none['cpu_s']:+.1%} of the flight, {cpu / best['log']['total_s']:+.1%} of the "
            f"run), {found['fly_s']:5.2f} s of wall time "
            f"({found['fly_s'] / none['fly_s'] - 1:+.1%})"
        )
    log, viewed = best["log"], best[KINDS[-1]]
    hour = 3600 / log["sim_s"] / 1e6
    print(f"{log['bytes'] * hour:.2f} MB a flown hour; the viewer got "
          f"{viewed['viewed_bytes'] * hour:.2f} MB of messages an hour")  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1:2] == ["--fly"]:
        print(json.dumps(fly(sys.argv[2], Path(sys.argv[3]))))
    elif sys.argv[1:2] == ["--watch"]:
        view(int(sys.argv[2]))
    else:
        main()
