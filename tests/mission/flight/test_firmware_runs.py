"""Runs flown by a firmware: what is refused, what a bad firmware ends in, and real ones.

Real binaries fly where AEROFED_PX4 or AEROFED_ARDUCOPTER names one.
"""

import asyncio
import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import small_runs
from patience import until
from scipy.spatial.transform import Rotation

from mission.base.errors import FlightError
from mission.cli import call
from mission.config.loading import load_config
from mission.flight.flyers.firmware import _check_program
from mission.flight.pilot.dialects import PX4
from mission.log.reader import read_log
from sitl.firmware.launch import FirmwareProcess, Launch

SMALL = (*small_runs.OF_ANY_VEHICLE, "--set", "mission.steps=6")
REAL = {"px4": "AEROFED_PX4", "ardupilot": "AEROFED_ARDUCOPTER"}


def fly(out: Path, autopilot: str, binary: Path, *more: str) -> int:
    firmware = (f"vehicle.autopilot={autopilot}", f"vehicle.firmware.path={binary}")
    keys = [word for key in firmware for word in ("--set", key)]
    return call(["run", "--out", str(out), *small_runs.last_counts(*SMALL, *keys, *more)])


def stand_in(folder: Path, text: str) -> Path:
    """A shell script that is taken for PX4's binary."""
    (folder / "bin").mkdir()
    rcs = folder / "etc" / "init.d-posix" / "rcS"
    rcs.parent.mkdir(parents=True)
    rcs.write_text("")
    binary = folder / "bin" / "px4"
    binary.write_text(f"#!/bin/sh\n{text}\n")
    binary.chmod(0o755)
    return binary


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (("vehicle.autopilot=px4",), "the firmware's binary, or AEROFED_PX4 in the environment"),
        (("vehicle.firmware.path=px4",), "autopilot = 'built-in' flies"),
        (
            ("vehicle.autopilot=px4", "vehicle.firmware.path=px4",
             "vehicle.parameters.NAV_ACC_RAD=3"),
            "under firmware.parameters",
        ),
        (
            ("vehicle.autopilot=px4", "vehicle.firmware.path=px4",
             "vehicle.aircraft.sensors.kind=perfect"),
            "must be 'realistic'",
        ),
        (
            ("vehicle.autopilot=px4", "vehicle.firmware.path=px4", "link.kind=external"),
            "flies another vehicle than vehicle.autopilot = 'px4' does: leave one of them out",
        ),
        (("vehicle.autopilot=betaflight",), "must be 'built-in', 'px4' or 'ardupilot'"),
    ],
)  # fmt: skip
def test_settings_that_do_not_fit_are_refused(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    keys: tuple[str, ...],
    said: str,
) -> None:
    monkeypatch.delenv("AEROFED_PX4", raising=False)
    assert call(["run", "--out", str(tmp_path / "out"), "--set", *keys]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_vehicle_alone_takes_no_firmware(capsys: pytest.CaptureFixture[str]) -> None:
    keys = ("--set", "vehicle.autopilot=px4", "--set", "vehicle.firmware.path=px4")
    assert call(["sitl", *keys]) == 2
    assert "the built-in autopilot flies" in capsys.readouterr().err


def test_a_missing_binary_ends_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fly(tmp_path / "out", "px4", tmp_path / "px4") == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_folder_is_no_binary(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert fly(tmp_path / "out", "ardupilot", tmp_path) == 2
    assert "is a folder; the firmware's binary is needed" in capsys.readouterr().err


def test_another_program_is_no_arducopter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fly(tmp_path / "out", "ardupilot", Path(sys.executable)) == 2
    small_runs.refused(capsys, "this is not ArduCopter")
    assert not (tmp_path / "out").exists()


def test_a_binary_without_its_scripts_is_no_px4(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    binary = stand_in(tmp_path, "exit 0")
    (tmp_path / "etc" / "init.d-posix" / "rcS").unlink()
    assert fly(tmp_path / "out", "px4", binary) == 2
    error = capsys.readouterr().err
    assert "this is not PX4" in error
    assert "rcS is missing" in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_firmware_that_dies_is_reported_with_its_last_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], autopilot: str
) -> None:
    binary, out = stand_in(tmp_path, "echo cannot find the gyroscope; exit 3"), tmp_path / "out"
    name = {"px4": "PX4", "ardupilot": "ArduPilot"}[autopilot]
    assert fly(out, autopilot, binary) == 5
    assert capsys.readouterr().err == (
        f"aerofed: {name} at its start: px4 has ended with exit code 3; its console "
        f"({out}/firmware/console.log) ended with: cannot find the gyroscope; the files "
        f"are in {out}; flights of {name} do not repeat to the last bit: it cannot "
        "be resumed\n"
    )
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "failed"
    assert (out / "firmware" / "console.log").is_file()
    assert fly(out, autopilot, binary) == 2
    assert capsys.readouterr().err.endswith("already used; give a new or empty one\n")


def test_a_firmware_that_dies_without_a_word_is_said_to(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fly(tmp_path / "out", "px4", stand_in(tmp_path, "exit 3"))
    assert "firmware/console.log) is empty; the files are in" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/proc/self/cwd").exists(), reason="needs /proc")
def test_a_start_script_that_does_not_quote_its_folder_works_in_one_with_a_space(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    binary = stand_in(tmp_path, "sh -c 'tail -n 1 $(pwd)/px4-rc.params'; exit 3")
    fly(tmp_path / "a run", "px4", binary)
    assert "console.log) ended with: param set" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("says", "told"), [("", "is empty"), ("no simulator", "ended with: no simulator")]
)
def test_a_program_that_never_answers_ends_the_run_in_time(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    says: str,
    told: str,
) -> None:
    start = Launch.start

    def started(*args: Any, **options: Any) -> FirmwareProcess:
        process = start(*args, **options)
        until(lambda: process.last_words() == says)
        return process

    monkeypatch.setattr(Launch, "start", started)
    binary = stand_in(tmp_path, f"{'echo ' * bool(says)}{says}\nexec sleep 900")
    short = ("--set", "link.connect_timeout_s=1")
    assert fly(tmp_path / "out", "px4", binary, *short) == 5
    error = capsys.readouterr().err
    assert error.startswith(
        "aerofed: PX4 at its start: it has not answered in 1 s (link.connect_timeout_s); its "
        f"console ({tmp_path}/out/firmware/console.log) {told}; the files are in "
    )
    assert "cannot be resumed" in error


def real(autopilot: str) -> Path:
    named = os.environ.get(REAL[autopilot])
    if not named:
        pytest.skip(f"needs a real {autopilot} binary in {REAL[autopilot]}")
    return Path(named)


SLOW_LOOPS = ("--set", "vehicle.firmware.parameters.SCHED_LOOP_RATE=200")


@pytest.mark.real
@pytest.mark.parametrize(
    ("autopilot", "more"), [("ardupilot", ()), ("ardupilot", SLOW_LOOPS), ("px4", ())]
)
def test_a_real_firmware_flies_rounds(
    tmp_path: Path, autopilot: str, more: tuple[str, ...]
) -> None:
    out = tmp_path / "a run"
    assert fly(out, autopilot, real(autopilot), "--rounds", "2", *more) == 0
    uplinks = small_runs.rows(out / "uplinks.csv")
    assert uplinks
    places = {
        kind: np.array([[float(u[f"{kind}_x_m"]), float(u[f"{kind}_y_m"])] for u in uplinks])
        for kind in ("plan", "est", "true")
    }
    apart = np.linalg.norm(places["true"] - places["est"], axis=1)
    assert 0.01 < apart.mean() < 5.0  # belief is not the truth, and not far from it
    assert np.linalg.norm(places["true"] - places["plan"], axis=1).max() < 15.0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "finished"
    assert not [p for p in Path("/proc").glob("[0-9]*") if str(out) in _cwd(p)]


@pytest.mark.real
@pytest.mark.parametrize("autopilot", sorted(REAL))
def test_a_real_firmware_flies_a_survey_as_it_was_drawn(tmp_path: Path, autopilot: str) -> None:
    survey, out = Path(__file__).parents[3] / "examples" / "survey.plan", tmp_path / "out"
    keys = (f"vehicle.autopilot={autopilot}", f"vehicle.firmware.path={real(autopilot)}")
    words = ("--no-report", "--no-figures", "--set", *keys)
    assert call(["fly", str(survey), "--out", str(out), *words]) == 0
    found = json.loads((out / "summary.json").read_text())["planned_and_flown"]
    assert (found["slots"], found["slots_missed"]) == (18, 0)
    assert found["straight_max_m"] < 3.0
    assert 9.0 < found["speed_max_mps"] < 11.5  # as it was planned, where no speed is ordered
    log = read_log(out / "flight.mcap")
    assert log.control is not None
    tells_motion, t_ns = autopilot == "px4", log.control.t_ns
    assert set(np.diff(t_ns)) == {20_000_000}
    where = np.array([np.interp(t_ns, log.belief.t_ns, x) for x in log.belief.pos_m.T]).T
    air = where[:, 2] > 45.0
    assert 0.3 < log.control.motors[air].mean() < 0.6
    turned, ordered = (
        Rotation.from_quat(part[air])
        for part in (log.control.attitude, log.control.attitude_setpoint)
    )
    assert np.degrees((turned.inv() * ordered).magnitude()).mean() < 6.0
    assert np.isfinite(log.control.rates_setpoint_radps).all() == tells_motion
    offset = (log.control.position_setpoint_m - where)[air]
    assert np.isnan(offset).all() if not tells_motion else abs(offset.mean(axis=0)).max() < 0.5


@pytest.mark.real
@pytest.mark.parametrize("autopilot", sorted(REAL))
@pytest.mark.parametrize("after", [7, "take-off"])
def test_a_fault_comes_after_what_a_real_firmware_tells(
    tmp_path: Path, autopilot: str, after: int | str
) -> None:
    survey, out = Path(__file__).parents[3] / "examples" / "survey.plan", tmp_path / "out"
    burst = f'{{kind="wind_burst", after={after!r}, at_s=1, duration_s=4, north_mps=6}}'
    keys = (
        *(f"vehicle.autopilot={autopilot}", f"vehicle.firmware.path={real(autopilot)}"),
        f"vehicle.aircraft.faults=[{burst}]",
    )
    words = ("--no-report", "--no-figures", "--set", *keys)
    assert call(["fly", str(survey), "--out", str(out), *words]) == 0
    log = read_log(out / "flight.mcap")
    blows = log.wind.t_ns[log.wind.vel_mps[:, 1] > 3.0]
    lifted = log.truth.t_ns[log.truth.pos_m[:, 2] > 0.5][0]
    told = [e.t_ns for e in log.events if e.text == f"item {after}: reported"] or [lifted]
    assert 0.9e9 < blows[0] - told[0] < 2.6e9  # the wind is logged once a second
    assert blows[-1] - blows[0] < 5e9
    begun, ended = (event for event in log.events if event.kind == "fault")
    assert [begun.text, ended.text] == ["Fault begins: wind_burst", "Fault ends: wind_burst"]
    assert abs(ended.t_ns - begun.t_ns - 4e9) < 0.2e9


@pytest.mark.real
@pytest.mark.parametrize(("autopilot", "code"), [("px4", 0), ("ardupilot", 4)])
def test_a_failsafe_of_a_real_firmware_is_counted(
    tmp_path: Path, autopilot: str, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without GNSS both descend: PX4 goes on with the mission after it, ArduPilot does not."""
    survey, out = Path(__file__).parents[3] / "examples" / "survey.plan", tmp_path / "out"
    keys = (
        *(f"vehicle.autopilot={autopilot}", f"vehicle.firmware.path={real(autopilot)}"),
        'vehicle.aircraft.faults=[{kind="gnss_off", after=7, duration_s=20}]',
    )
    words = ("--no-report", "--no-figures", "--set", *keys)
    assert call(["fly", str(survey), "--out", str(out), *words]) == code
    assert call(["compare", str(out), "--limit", "failsafes=0", "--limit", "faults=0"]) == 6
    said = capsys.readouterr().err
    assert "failsafes = 1: must be at most 0; first at" in said
    assert "faults = 1: must be at most 0; first at" in said


@pytest.mark.real
@pytest.mark.parametrize("autopilot", sorted(REAL))
def test_a_real_firmware_takes_about_the_energy_that_was_planned(
    tmp_path: Path, autopilot: str
) -> None:
    """Motors that a control loop shakes take several times as much."""
    out = tmp_path / "out"
    limits = ("mission.round_energy_j=10000", "mission.total_energy_j=10000")
    words = [word for key in limits for word in ("--set", key)]
    assert fly(out, autopilot, real(autopilot), "--rounds", "1", *words) == 0
    (flown,) = small_runs.rows(out / "rounds.csv")
    assert 0.7 < float(flown["energy_j"]) / float(flown["plan_energy_j"]) < 1.4


@pytest.mark.real
@pytest.mark.parametrize("autopilot", sorted(REAL))
@pytest.mark.parametrize("config", ["city", "town"])
def test_a_real_firmware_lands_where_areas_have_to_be_flown_around(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], config: str, autopilot: str
) -> None:
    """With buildings, and with a fence and no-fly areas, in wind; the battery is changed once."""
    out = tmp_path / "out"
    keys = (
        *(f"vehicle.autopilot={autopilot}", f"vehicle.firmware.path={real(autopilot)}"),
        *("mission.rounds=4", "mission.battery_reserve=0.9"),
    )
    assert call(["run", config, "--out", str(out), "--no-report", "--set", *keys]) == 0
    assert len(small_runs.rows(out / "rounds.csv")) == 4
    armed = [event for event in read_log(out / "flight.mcap").events if event.text == "armed"]
    assert len(armed) >= 2
    assert "no take-off before it is charged" not in capsys.readouterr().out


@pytest.mark.real
def test_where_px4_is_planned_for_again_it_hovers_no_longer_than_the_order_takes(
    tmp_path: Path,
) -> None:
    """It was several seconds, and on a busy machine up to a minute."""
    out = tmp_path / "out"
    keys = (
        *("vehicle.autopilot=px4", f"vehicle.firmware.path={real('px4')}"),
        *("mission.rounds=1", "mission.replan=stop"),
    )
    assert call(["run", "city", "--out", str(out), "--no-report", "--set", *keys]) == 0
    log = read_log(out / "flight.mcap")
    texts = [(event.t_ns, event.text) for event in log.events]
    begins = [t_ns for t_ns, text in texts if text == "MISSION"]
    ends = [t_ns for t_ns, text in texts if text == "HOLD" and t_ns > begins[0]]
    pauses_s = [(begin - end) / 1e9 for end, begin in zip(ends, begins[1:], strict=False)]
    assert len(pauses_s) > 3
    assert max(pauses_s) < 3.0, pauses_s


def _cwd(process: Path) -> str:
    try:
        return str((process / "cwd").readlink())
    except OSError:
        return ""


@pytest.mark.parametrize(
    ("has", "said"),
    [
        (12.5, ""), (12.501, ""), (12.499, ""),  # nearly: parameters travel as 32-bit floats
        (12.5014, "it has 12.5014"), (0.0, "it has 0"), (None, "it knows no such parameter"),
    ],
)  # fmt: skip
def test_a_parameter_that_a_firmware_did_not_take_is_named(has: float | None, said: str) -> None:
    async def get(name: str) -> float | None:
        return {"MPC_XY_CRUISE": has, "NOTHING": 0.0}[name]

    keys = {
        "vehicle.autopilot": "px4", "vehicle.firmware.path": "px4",
        "vehicle.firmware.parameters": {"NOTHING": 0, "MPC_XY_CRUISE": 12.5},
    }  # fmt: skip
    pilot: Any = SimpleNamespace(dialect=PX4, parameters=SimpleNamespace(get=get))
    checked = _check_program(pilot, load_config(Path("quickstart"), keys))
    if not said:
        asyncio.run(checked)
        return
    with pytest.raises(FlightError, match=f"MPC_XY_CRUISE = 12.5: .* not take it: {said}$"):
        asyncio.run(checked)


@pytest.mark.real
@pytest.mark.parametrize("autopilot", sorted(REAL))
def test_a_real_firmware_that_does_not_know_a_parameter_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], autopilot: str
) -> None:
    unknown = ("--set", "vehicle.firmware.parameters.NO_SUCH=1")
    assert fly(tmp_path / "out", autopilot, real(autopilot), *unknown) == 4
    assert "NO_SUCH = 1: the firmware did not take it" in capsys.readouterr().err


@pytest.mark.real
@pytest.mark.parametrize("autopilot", sorted(REAL))
def test_a_real_firmware_is_not_taken_for_the_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], autopilot: str
) -> None:
    (other,) = REAL.keys() - {autopilot}
    assert fly(tmp_path / "out", autopilot, real(other)) == 2
    assert "this is not " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
