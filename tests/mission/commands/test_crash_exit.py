"""A crash ends a flight at once: one line, exit code 4, whatever was being waited for."""

import re
from pathlib import Path

import pytest
from test_external import SMALL
from test_plan_flight import CORNERS, RETURN, TAKE_OFF, summary, written

from mission.cli import call

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("at_s", [10.0, 40.0, 98.0], ids=["take-off", "mission", "landing"])
def test_a_crash_is_a_failed_flight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], at_s: float
) -> None:
    plan, out = written(tmp_path, TAKE_OFF, *CORNERS, RETURN), tmp_path / "out"
    faults = ", ".join(f'{{kind="motor_loss", motor={i}, at_s={at_s}}}' for i in range(4))
    code = call(
        ["fly", str(plan), "--out", str(out), "--set", f"vehicle.aircraft.faults=[{faults}]"]
    )
    assert code == 4  # the watchdog would say a link lost, 5
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    (lost_s,) = re.findall(r"^aerofed: t (\S+) s: the aircraft is lost; it said: Crashed", error)
    assert at_s < float(lost_s) < at_s + 10.0
    assert f"the files are in {out}" in error
    assert "Crashed: hit the ground at" in error
    found = summary(out)
    assert found["status"] == "failed"
    assert "Crashed" in found["error"]


def test_a_crash_in_a_run_names_its_round(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    faults = ", ".join(f'{{kind="motor_loss", motor={i}, at_s=34.0}}' for i in range(4))
    crash = ("--set", f"vehicle.aircraft.faults=[{faults}]")
    assert call(["run", "--out", str(out), *SMALL, *crash]) == 4
    (error,) = capsys.readouterr().err.splitlines()
    assert re.match(r"aerofed: round 1, t (3[4-9]|4\d)\.\d s: the aircraft is lost", error)
    assert error.endswith(f"the files are in {out}")
