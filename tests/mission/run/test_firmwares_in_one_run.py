"""Experiments of several aircraft under real firmwares, beside one of our own.

They fly where AEROFED_PX4 and AEROFED_ARDUCOPTER name the binaries.
"""

import json
import os
import signal
import subprocess
from functools import partial
from pathlib import Path

import pytest
import small_runs
from drawing import UNDRAWN
from patience import HANG_S, until
from small_runs import rows

from mission.cli import call

BINARIES = {"px4": "AEROFED_PX4", "ardupilot": "AEROFED_ARDUCOPTER"}
TRIO = 'vehicles=[{name="px", autopilot="px4"}, {name="ardu", autopilot="ardupilot"}, {name="own"}]'
NAMES, XY = ("px", "ardu", "own"), ("x_m", "y_m")
SMALL = (*small_runs.OF_ANY_VEHICLE, "--set", "mission.steps=6", "--set", TRIO)


def binary(autopilot: str) -> str:
    if not Path(named := os.environ.get(BINARIES[autopilot], "")).is_file():
        pytest.skip(f"needs a real {autopilot} binary in {BINARIES[autopilot]}")
    return named


def test_one_that_does_not_start_ends_the_run_with_both_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A script that is taken for PX4, beside one of our own."""
    (tmp_path / "bin").mkdir()
    rcs = tmp_path / "etc" / "init.d-posix" / "rcS"
    rcs.parent.mkdir(parents=True)
    rcs.write_text("")
    px4, out = tmp_path / "bin" / "px4", tmp_path / "out"
    px4.write_text("#!/bin/sh\necho no gyroscope; exit 3\n")
    px4.chmod(0o755)
    two = f'vehicles=[{{name="px", autopilot="px4", firmware={{path="{px4}"}}}}, {{name="own"}}]'
    assert call(["run", "--out", str(out), *small_runs.OF_ANY_VEHICLE, "--set", two]) == 5
    error = capsys.readouterr().err
    assert error.startswith(
        "aerofed: px: PX4 at its start: px4 has ended with exit code 3; its console "
        f"({out}/vehicle-px/firmware/console.log) ended with: no gyroscope; "
    )
    assert "flights of PX4 do not repeat to the last bit: it cannot be resumed" in error
    assert error.count("\n") == 1


@pytest.mark.real
@pytest.mark.slow
def test_three_autopilots_fly_together_and_go_on_without_one_that_is_killed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    binary("px4")
    binary("ardupilot")
    out = tmp_path / "out"
    words = small_runs.last_counts(*(word for word in SMALL if word != "--quiet"))
    command = [*UNDRAWN, "run", "--out", str(out), "--rounds", "3", *words]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as run:
        try:
            # The second round is uploaded to all, so all are in the air.
            plans = [out / "plans" / f"round-002-{name}.plan" for name in NAMES]
            while run.poll() is None and not all(plan.exists() for plan in plans):
                until(partial(goes_on, run, out, written(out)))
            os.kill(process_in(out / "vehicle-ardu" / "firmware", "arducopter"), signal.SIGKILL)
            said, _ = run.communicate(timeout=2 * HANG_S)
        finally:
            run.kill()
    assert run.returncode == 0, said
    assert json.loads((out / "summary.json").read_text())["status"] == "finished"
    aircraft = rows(out / "aircraft.csv")
    first, second, third = (
        {row["aircraft"]: row for row in aircraft if row["round"] == str(n)} for n in (1, 2, 3)
    )
    assert set(first) == {"px", "ardu", "own"}
    assert {"px", "own"} <= set(second)
    assert set(third) == {"px", "own"}
    begun = [float(row["start_t_s"]) for row in first.values()]
    assert max(begun) - min(begun) < 0.2
    lasted = [float(row["duration_s"]) for row in first.values()]
    assert max(lasted) - min(lasted) < 0.3  # who waits hovers
    for row in rows(out / "uplinks.csv"):
        if row["round"] == "1":
            away = [float(row[f"true_{axis}"]) - float(row[f"plan_{axis}"]) for axis in XY]
            assert abs(complex(*away)) < 15.0
    (lost,) = [line for line in said.splitlines() if "go on" in line]
    assert lost.startswith("round 2: ardu: ")
    assert lost.endswith("; px, own go on")
    capsys.readouterr()
    assert call(["run", "--resume", str(out), "--rounds", "4"]) == 2
    small_runs.refused(capsys, "flights of PX4 do not repeat", "flights of ArduPilot do not repeat")


def written(out: Path) -> int:
    """Bytes of logs so far, which tell that a run goes on."""
    logs = *out.glob("vehicle-*/flight.mcap"), *out.glob("vehicle-*/firmware/console.log")
    return sum(log.stat().st_size for log in logs)


def goes_on(run: "subprocess.Popen[str]", out: Path, before: int) -> bool:
    return run.poll() is not None or written(out) != before


def process_in(folder: Path, name: str) -> int:
    """The number of the program that runs in a folder."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            here = (process / "cwd").readlink() == folder
            if here and (process / "comm").read_text().strip() == name:
                return int(process.name)
        except OSError:
            continue
    raise AssertionError(f"no {name} in {folder}")
