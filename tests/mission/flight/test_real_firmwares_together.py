"""Two real PX4 and one real ArduCopter in one world, flown by `aerofed fly` over their links.

They fly where AEROFED_PX4 and AEROFED_ARDUCOPTER name them, on the ports that they have by default.
"""

import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from patience import HANG_S, until

from flightdyn.plant import Plant
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from mission.cli import call
from sitl.config import FirmwareConfig, VehicleConfig
from sitl.firmware import ardupilot, px4
from sitl.firmware.launch import LaunchOptions
from sitl.firmware.vehicle import plant_for

BINARIES = {"px4": "AEROFED_PX4", "ardupilot": "AEROFED_ARDUCOPTER"}
LAT, LON, ALT = 43.6145, 7.0715, 130.0  # the quick start's home
SPEED = "4"  # beyond which programs that count wall time lose patience on a busy machine
URLS = ("udpin://0.0.0.0:14540", "udpin://0.0.0.0:14541", "tcpout://127.0.0.1:5760")
# North and east of home, across one place that is away from where they climb.
ENDS = (((60, -40), (60, 40)), ((20, 0), (100, 0)), ((30, -30), (90, 30)))
HEIGHTS = (15, 23, 31)
ROUNDS = 3


class Crew(NamedTuple):
    world: subprocess.Popen[bytes]
    firmwares: Sequence[subprocess.Popen[bytes]]
    logs: Path
    said: Path


def binary(autopilot: str) -> Path:
    named = os.environ.get(BINARIES[autopilot], "")
    if not Path(named).is_file():
        pytest.skip(f"needs a real {autopilot} binary in {BINARIES[autopilot]}")
    return Path(named).resolve()


def parameters(autopilot: str, path: Path) -> Mapping[str, float]:
    """Those that fit a firmware to our aircraft."""
    vehicle = VehicleConfig.model_validate(
        {"autopilot": autopilot, "firmware": FirmwareConfig(path=path)}
    )
    plant = Plant(vehicle.aircraft, home=place(0, 0), streams=RandomStreams(1))
    if autopilot == "ardupilot":
        plant = plant_for(vehicle, home=place(0, 0), streams=RandomStreams(1))
    module = {"px4": px4, "ardupilot": ardupilot}[autopilot]
    options = LaunchOptions(vehicle, 0, 0, 10.0)
    found: Mapping[str, float] = module.airframe_parameters(options, plant)
    return found


def place(north_m: float, east_m: float) -> GeodeticPoint:
    north = LAT + north_m / 111_111.0
    return GeodeticPoint(north, LON + east_m / 111_111.0 / math.cos(math.radians(LAT)), ALT)


def ended(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()


def started(command: Sequence[str | Path], said: Path, **how: Any) -> subprocess.Popen[bytes]:
    with said.open("wb") as out:
        return subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT, **how
        )


def start_px4(folder: Path, instance: int) -> subprocess.Popen[bytes]:
    path = binary("px4")
    folder.mkdir()
    values = {**parameters("px4", path), "SIM_BAT_ENABLE": 1}
    lines = (f"param set {k} {int(v) if float(v).is_integer() else v}" for k, v in values.items())
    (folder / "px4-rc.params").write_text("\n".join(("#!/bin/sh", *lines, "")))
    there = {"PX4_SIM_MODEL": "none_iris", "PATH": f".{os.pathsep}{os.environ['PATH']}"}
    return started(
        [path, "-d", "-i", str(instance), str(px4.etc_of(path)), "-w", "."],
        folder / "console.log", cwd=folder,
        env={**os.environ, "PWD": "/proc/self/cwd", **there},
    )  # fmt: skip


def start_arducopter(folder: Path, east_m: float) -> subprocess.Popen[bytes]:
    path, home = binary("ardupilot"), place(0, east_m)
    folder.mkdir()
    values = parameters("ardupilot", path)
    (folder / "own.parm").write_text("".join(f"{k} {v:.9g}\n" for k, v in values.items()))
    return started(
        [path, "--model", "JSON:127.0.0.1", "-I", "0", "--sysid", "3", "--defaults", "own.parm",
         "--home", f"{home.lat_deg:.9f},{home.lon_deg:.9f},{ALT},0"],
        folder / "console.log", cwd=folder,
    )  # fmt: skip


@pytest.fixture
def crew(tmp_path: Path) -> Iterator[Crew]:
    """A world, with its firmwares started, which the test may kill; Ctrl-C ends it."""
    binary("px4")
    binary("ardupilot")
    logs = tmp_path / "logs"
    command = ["world", "--px4", "--px4", "--ardupilot", "--speed", SPEED, "--logs", str(logs)]
    with ExitStack() as stack:
        said = tmp_path / "world.txt"
        world = started([sys.executable, "-u", "-m", "mission", *command], said)
        stack.callback(ended, world)
        until(lambda: "Ctrl-C ends" in said.read_text() or world.poll() is not None)
        firmwares = [start_px4(tmp_path / f"px4-{i}", i) for i in range(2)]
        firmwares.append(start_arducopter(tmp_path / "arducopter", 10.0))
        for each in firmwares:
            stack.callback(ended, each)
        yield Crew(world, firmwares, logs, said)


def plan(path: Path, number: int) -> Path:
    """Rounds from end to end, across the way of the others, from one's own home."""
    home, height = place(0, 5.0 * number), HEIGHTS[number]
    places = [home, *(place(n, e) for _ in range(ROUNDS) for n, e in ENDS[number])]
    rows = [f"0\t1\t0\t16\t0\t0\t0\t0\t{home.lat_deg:.8f}\t{home.lon_deg:.8f}\t{ALT}\t1"]
    for seq, at in enumerate(places, 1):
        command = 22 if seq == 1 else 16
        where = f"{at.lat_deg:.8f}\t{at.lon_deg:.8f}\t{height}"
        rows.append(f"{seq}\t0\t3\t{command}\t0\t0\t0\t0\t{where}\t1")
    rows.append(f"{len(rows)}\t0\t3\t20\t0\t0\t0\t0\t0\t0\t0\t1")
    path.write_text("\n".join(("QGC WPL 110", *rows, "")))
    return path


@contextmanager
def flights(folder: Path) -> Iterator[list[subprocess.Popen[bytes]]]:
    """All three are flown, each by a program of its own."""
    folder.mkdir()
    begun = []
    for number, url in enumerate(URLS):
        drawn, out = plan(folder / f"{number}.waypoints", number), folder / str(number)
        words = ["fly", str(drawn), "--vehicle", url, "--out", str(out)]
        words += ["--no-report", "--no-figures"]
        words += ["--set", "link.ready_timeout_s=300"]
        begun.append(started([sys.executable, "-m", "mission", *words], folder / f"{number}.txt"))
    try:
        yield begun
    finally:
        for each in begun:
            ended(each)


def end(crew: Crew) -> str:
    crew.world.send_signal(signal.SIGTERM)
    assert crew.world.wait(HANG_S) == 0
    return crew.said.read_text()


@pytest.mark.real
@pytest.mark.slow
def test_they_cross_three_times_and_their_distances_are_told(crew: Crew, tmp_path: Path) -> None:
    with flights(tmp_path / "flights") as begun:
        codes = [each.wait(2 * HANG_S) for each in begun]
    said = end(crew)
    assert codes == [0, 0, 0], [path.read_text() for path in (tmp_path / "flights").glob("*.txt")]
    found = json.loads((crew.logs / "separation.json").read_text())
    assert len(found["pairs"]) == 3
    assert not found["collisions"]
    for pair in found["pairs"]:
        # Their homes are 5 m apart, and they begin and end there, one after the other.
        assert 1.0 < pair["least_m"] < 12.0
        assert f"{' and '.join(pair['pair'])}: {pair['least_m']:.2f} m apart" in said
    assert len(list(crew.logs.glob("vehicle-*/flight-0001.mcap"))) == 3
    assert call(["compare", str(crew.logs)]) == 0


@pytest.mark.real
@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "said"),
    [(1, "vehicle-2: PX4 has hung up"), (2, "vehicle-3: its firmware has ended")],
)
def test_one_that_is_killed_in_flight_falls_and_the_others_land(
    crew: Crew, tmp_path: Path, number: int, said: str
) -> None:
    with flights(tmp_path / "flights") as begun:
        told = tmp_path / "flights" / f"{number}.txt"
        until(lambda: "item 3" in told.read_text())
        crew.firmwares[number].kill()
        codes = [each.wait(2 * HANG_S) for i, each in enumerate(begun) if i != number]
    told_by_world = end(crew)
    assert codes == [0, 0], [path.read_text() for path in (tmp_path / "flights").glob("*.txt")]
    assert said in told_by_world
