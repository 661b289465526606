"""The command at its edges: signals, pipes that close, disks that are full."""

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

import pytest
from drawing import UNDRAWN
from forked import Forked
from patience import HANG_S, until
from test_run import SMALL, UNFLOWN, begun

from mission.base.interrupts import ending_flights, run_flight
from mission.cli import call

AEROFED = [sys.executable, "-m", "mission"]


@pytest.mark.slow
def test_a_full_disk_behind_standard_output_ends_no_run(tmp_path: Path) -> None:
    out = tmp_path / "run"
    loud = [option for option in (*SMALL, *UNFLOWN) if option != "--quiet"]
    command = [*UNDRAWN, "run", "--rounds", "1", "--out", str(out), *loud]
    with Path("/dev/full").open("w") as full:
        process = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert process.returncode == 2
    assert process.stderr == "aerofed: cannot write to standard output: No space left on device\n"
    assert json.loads((out / "summary.json").read_text())["status"] == "finished"


@pytest.mark.slow
def test_a_reader_that_has_had_enough_is_no_error() -> None:
    command = [*AEROFED, "link-budget"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert (process.stderr.read(), process.wait()) == ("", 0)
    process.stderr.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "heard"),
    [(signal.SIGTERM, signal.default_int_handler), (signal.SIGHUP, signal.SIG_IGN)],
)
def test_a_polite_kill_is_an_interruption(
    tmp_path: Path, number: signal.Signals, heard: Any
) -> None:
    """Of a job that was started deaf to Ctrl-C as well, as scripts start theirs with `&`."""
    out = tmp_path / "run"
    process = Forked("run", "--rounds", "500", "--out", str(out), *SMALL, at_ctrl_c=heard)
    until(lambda: process.poll() is not None or begun(out))
    process.send_signal(number)
    code, _, errors = process.ended()
    assert (code, "Traceback" in errors) == (130, False)
    assert json.loads((out / "summary.json").read_text())["status"] == "interrupted"


# Within an `exec` of text, as dataclasses are made: `python -m` took that for one uncaught.
INTERRUPTS = """
import os, signal, sys

class Interrupts:
    def find_spec(self, name, *_):
        if name == os.environ["INTERRUPTED"]:
            sys.meta_path.remove(self)
            exec("os.kill(os.getpid(), signal.SIGINT)")

sys.meta_path.insert(0, Interrupts())
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "command"),
    [
        ("mission.base.errors", "run"),
        ("cyclopts", "run"),
        ("rich", "run"),
        ("pydantic", "run"),
        ("numpy", "run"),
        ("mission.run.session", "run"),
        ("mission.flight.serve.vehicle", "sitl"),
        ("mission.flight.serve.firmwares", "world --px4"),
    ],
)
def test_ctrl_c_while_the_program_loads_is_no_traceback(
    tmp_path: Path, module: str, command: str
) -> None:
    (tmp_path / "sitecustomize.py").write_text(INTERRUPTS)
    (tmp_path / "here").mkdir()
    path = os.pathsep.join([str(tmp_path), *sys.path])
    process = subprocess.run(
        [*AEROFED, *command.split()],
        cwd=tmp_path / "here",
        env={**os.environ, "PYTHONPATH": path, "INTERRUPTED": module},
        capture_output=True,
        text=True,
    )
    assert (process.returncode, process.stderr) == (130, "aerofed: interrupted\n")
    assert not list((tmp_path / "here").iterdir())


@pytest.mark.slow
def test_ctrl_c_again_and_again_ends_a_run_once(tmp_path: Path) -> None:
    """Three times within half a second took MAVSDK down under its threads: SIGABRT."""
    out = tmp_path / "run"
    process = Forked("run", "--rounds", "500", "--out", str(out), *SMALL)
    until(lambda: process.poll() is not None or begun(out))
    for _ in range(3):
        process.send_signal(signal.SIGINT)
    code, _, errors = process.ended()
    assert (code, "Traceback" in errors) == (130, False), errors
    assert json.loads((out / "summary.json").read_text())["status"] == "interrupted"


# In its second round it blocks for good: planning in a thread, or the event loop itself.
BLOCKING = """
import time
from pathlib import Path
from aerofed import Sortie

class Own:
    fairness, approach_m = False, None

    def __init__(self, context):
        self.planner, self.round = context.planner, 0

    def importance(self, info):
        self.round += 1
        self._block("importance")
        return info.p

    def sortie(self, round_index, problem):
        self._block("sortie")
        return Sortie(self.planner.plan(problem))

    def _block(self, where):
        if self.round == 2 and Path(where).exists():
            Path("blocked").touch()
            while True:
                time.sleep(0.05)
"""
OWN = ("--set", "mission.strategy=own:Own")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "status"), [("sortie", "interrupted"), ("importance", "running")]
)
def test_code_that_blocks_is_ended_and_what_was_flown_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str, status: str
) -> None:
    """In a thread it is left alone; where it keeps the loop from turning, a second signal ends."""
    (tmp_path / "own.py").write_text(BLOCKING)
    (tmp_path / where).touch()
    monkeypatch.chdir(tmp_path)
    process = Forked("run", "--rounds", "2", "--out", "run", *OWN, *SMALL)
    until(lambda: process.poll() is not None or (tmp_path / "blocked").exists())
    process.send_signal(signal.SIGTERM)
    while status == "running" and process.poll() is None:
        time.sleep(0.1)
        process.send_signal(signal.SIGINT)
    code, _, errors = process.ended()
    assert (code, "Traceback" in errors) == (130, False), errors
    run = tmp_path / "run"
    assert json.loads((run / "summary.json").read_text())["status"] == status
    assert begun(run)
    (tmp_path / where).unlink()
    assert call(["run", "--resume", "run", "--quiet"]) == 0


@pytest.mark.slow
def test_ctrl_c_before_the_first_round_draws_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(BLOCKING.replace("self.round == 2", "self.round == 1"))
    (tmp_path / "sortie").touch()
    process = Forked("run", "--rounds", "2", "--out", "run", *OWN, *SMALL, pictures=True)
    until(lambda: process.poll() is not None or (tmp_path / "blocked").exists())
    process.send_signal(signal.SIGINT)
    assert process.ended()[0] == 130
    assert not (tmp_path / "run" / "figures").exists()


def test_run_flight_ends_in_order_however_often_it_is_interrupted() -> None:
    told: list[str] = []

    async def flight() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
            await asyncio.sleep(HANG_S)
        finally:
            for _ in range(3):
                signal.raise_signal(signal.SIGINT)
                await asyncio.sleep(0)
                told.append("landing")

    with pytest.raises(KeyboardInterrupt):
        run_flight(flight())
    assert told == ["landing"] * 3
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.slow
def test_an_interrupted_flight_is_written_down_undisturbed() -> None:
    async def flight() -> None:
        signal.raise_signal(signal.SIGINT)
        await asyncio.sleep(HANG_S)

    written = False
    with ending_flights():
        with pytest.raises(KeyboardInterrupt):
            run_flight(flight())
        signal.raise_signal(signal.SIGINT)
        written = True
    assert written
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_run_flight_hands_on_what_the_flight_gives() -> None:
    async def flight(outcome: Exception | int) -> int:
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    assert run_flight(flight(7)) == 7
    with pytest.raises(ZeroDivisionError):
        run_flight(flight(ZeroDivisionError()))


IN_A_CALLBACK = """
import ctypes, sys, time
from mission.base.interrupts import hear_interruptions

def interrupted():
    raise KeyboardInterrupt

hear_interruptions()
try:
    ctypes.CFUNCTYPE(None)(interrupted)()
    time.sleep(900)
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.slow
def test_ctrl_c_in_a_callback_from_c_is_not_lost() -> None:
    process = subprocess.run(
        [sys.executable, "-c", IN_A_CALLBACK], capture_output=True, text=True, timeout=HANG_S
    )
    assert (process.returncode, process.stderr) == (130, "")


def test_a_value_from_the_command_line_is_not_blamed_on_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(["run", "--rounds", "0", "--out", str(tmp_path / "x")]) == 2
    assert capsys.readouterr().err.startswith("aerofed: --rounds 0: must be")


def test_plan_overwrites_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "rounds.csv"
    mine.write_text("mine")
    assert call(["plan", "--out", str(mine)]) == 2
    assert f"{mine}: exists already" in capsys.readouterr().err
    assert mine.read_text() == "mine"


def test_an_empty_data_folder_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["data", "check", str(tmp_path)]) == 2
    assert "holds none of the data sets" in capsys.readouterr().err


@pytest.mark.slow
def test_a_round_that_reaches_nobody_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    far = ["--set", "area.home_m=[9000.0, 9000.0]", "--set", "mission.path_budget_m=100"]
    few = ["--rounds", "1", "--no-report"]
    assert call(["run", "--out", str(tmp_path / "x"), *few, *far]) == 0
    assert "no device is within reach" in capsys.readouterr().out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["--version"]) == 0
    pyproject = Path(__file__).parents[3] / "pyproject.toml"
    declared = tomllib.loads(pyproject.read_text(encoding="utf-8"))["project"]["version"]
    assert capsys.readouterr().out.strip() == declared
