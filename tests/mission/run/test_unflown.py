"""Runs without flight: what was planned is what was met, and all else stays as it is."""

import gc
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import small_runs
from cutting import cut_after

from mission.base.errors import InputError
from mission.base.run_folder import RunFolder
from mission.cli import call
from mission.config.loading import builtin_config, load_config
from mission.log import LogError
from mission.log.records import RoundRecord, UplinkRecord
from mission.log.tables import read_table
from mission.log.writer import FlightLog
from mission.run.budget import RunTotals
from mission.run.session import _warnings
from mission.scenario.scenario import Scenario

pytestmark = pytest.mark.slow

SMALL = (*small_runs.SMALL, "--set", "mission.flight=none")


def play(out: Path, *more: str, rounds: int = 3, page: bool = False) -> int:
    words = small_runs.last_counts(*SMALL, *more)
    if page:
        words.remove("--no-report")
    return call(["run", "--out", str(out), "--rounds", str(rounds), *words])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "unflown"
    assert play(out) == 0
    return out


def place(uplink: UplinkRecord, who: str) -> tuple[float, float]:
    return getattr(uplink, f"{who}_x_m"), getattr(uplink, f"{who}_y_m")


def test_every_slot_is_met_exactly_and_in_time(run: Path) -> None:
    uplinks = read_table(run / "uplinks.csv", UplinkRecord)
    rounds = read_table(run / "rounds.csv", RoundRecord)
    assert len(rounds) == 3
    for uplink in uplinks:
        assert place(uplink, "true") == pytest.approx(place(uplink, "plan"), abs=0.5)
        assert place(uplink, "est") == place(uplink, "true")
        assert uplink.true_per == pytest.approx(uplink.plan_per, abs=1e-3)
        assert uplink.true_alt_m == 30.0
    for record in rounds:
        assert record.flown_path_m == pytest.approx(record.plan_path_m, abs=2.5)
        assert record.duration_s == pytest.approx(record.flown_path_m / 20.0, abs=1e-6)


def test_a_resumption_leaves_out_the_page_that_the_run_was_to_leave_out(tmp_path: Path) -> None:
    for name, page in {"with": True, "without": False}.items():
        with cut_after(1):
            assert play(tmp_path / name, rounds=2, page=page) == 4
        (tmp_path / name / "report.html").unlink(missing_ok=True)
        assert call(["run", "--resume", str(tmp_path / name), "--quiet"]) == 0
        assert (tmp_path / name / "report.html").exists() is page


def test_a_resumption_that_is_cut_off_says_what_is_kept(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    out = tmp_path / "cut"
    with cut_after(2):
        assert play(out) == 4
    capsys.readouterr()
    add = RunTotals.add

    def interrupted(self: RunTotals, record: RoundRecord) -> None:
        add(self, record)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(RunTotals, "add", interrupted)
        assert call(["run", "--resume", str(out)]) == 130
    said = capsys.readouterr().out
    assert "2 rounds of the run before are kept, 1 of them flown again by now" in said
    assert f"interrupted; aerofed run --resume {out} goes on" in said
    assert call(["compare", str(out)]) == 0
    assert "2 rounds of it are here" in capsys.readouterr().err
    gc.collect()
    assert not [record for record in caplog.records if record.name == "asyncio"]


@pytest.mark.parametrize("strategy", ["barycenter", "rectangular", "ideal", "no_cov"])
def test_every_strategy_does_without_flight(tmp_path: Path, strategy: str) -> None:
    assert play(tmp_path / "run", "--set", f"mission.strategy={strategy}", rounds=2) == 0
    rounds = read_table(tmp_path / "run" / "rounds.csv", RoundRecord)
    hover = 5.0 if strategy == "barycenter" else 0.0 if strategy == "ideal" else None
    assert hover is None or {record.duration_s for record in rounds} == {hover}


def test_it_repeats_and_reads_like_any_run(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert play(tmp_path / "again") == 0
    assert small_runs.digests(tmp_path / "again") == small_runs.digests(run)
    assert call(["compare", str(run)]) == 0
    assert "cross-track" in capsys.readouterr().out
    assert call(["log", "check", str(run)]) == 0


@pytest.mark.parametrize("broken", ["__enter__", "close"])
def test_a_log_that_cannot_be_opened_or_closed_is_a_run_that_failed(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    broken: str,
) -> None:
    out, close = tmp_path / "run", FlightLog.close

    def fail(log: FlightLog) -> None:
        close(log)
        raise LogError(out / "flight.mcap", "no room")

    monkeypatch.setattr(FlightLog, broken, fail)
    assert play(out, rounds=1) == LogError.exit_code
    assert capsys.readouterr().err.count("no room") == 1
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["status"], summary["error"]) == ("failed", f"{out / 'flight.mcap'}: no room")
    assert summary["rounds"] == (1 if broken == "close" else 0)


def test_a_vehicle_that_would_never_fly_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    link = ("--set", "link.kind=external", "--set", "link.url=udpin://127.0.0.1:14540")
    assert play(tmp_path / "run", *link) == 2
    assert "mission.flight = 'none' flies nothing, and so needs no link.kind = 'external'" in (
        capsys.readouterr().err
    )
    assert not (tmp_path / "run").exists()


MAST: dict[str, object] = {"polygon_m": [[10, 10], [40, 10], [40, 40]], "name": "mast"}


HOUSE: dict[str, object] = {
    "area.buildings": [{"polygon_m": MAST["polygon_m"], "height_m": 9.0}],
    "radio.truth": "buildings",
}


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"area.home_m": (0.0, 0.0)}, ""),
        ({"area.home_m": (0.0, -900.0)}, "home lies 900 m from the nearest device"),
        ({"area.no_fly": [MAST | {"to_m": 80.0}]}, ""),
        (
            {"area.no_fly": [MAST | {"to_m": 80.0}], "mission.altitude_m": [40.0, 120.0]},
            "mast (area.no_fly) is kept out of at every altitude of mission.altitude_m = [40.0, ",
        ),
        ({"area.no_fly": [MAST], "mission.altitude_m": [40.0, 120.0]}, ""),
        (
            {**HOUSE, "mission.altitude_m": [22.5, 40.0]},
            "at a height of 22.5 m, between those of m",
        ),
        ({**HOUSE, "mission.altitude_m": [23.0, 40.0]}, ""),
        ({**HOUSE, "mission.altitude_m": [15.0, 22.5]}, ""),
        ({"area.no_fly": [MAST | {"to_m": 9.0}], "mission.altitude_m": [40.0, 120.0]}, ""),
    ],
)
def test_what_is_hardly_meant_is_said(overrides: dict[str, object], said: str) -> None:
    config = load_config(builtin_config("quickstart.toml"), overrides)
    places = np.array([[0.0, 0.0], [600.0, 0.0]])
    scenario = SimpleNamespace(config=config, devices_m=places, community_of=("a", "a"))
    warnings = list(_warnings(cast(Scenario, scenario)))
    assert [said] == [warning[: len(said)] for warning in warnings] if said else not warnings


@pytest.mark.parametrize("owners", [("a", "a", "a"), ("a", "a", "b")])
def test_two_devices_of_a_community_at_one_place_are_said(owners: tuple[str, ...]) -> None:
    config = load_config(builtin_config("quickstart.toml"))
    places = np.array([[100.0, 20.5], [600.0, 0.0], [100.0, 20.5]])
    scenario = SimpleNamespace(config=config, devices_m=places, community_of=owners)
    said = "a: devices 0 and 2 stand at one place, x = 100, y = 20.5 m; is one there twice?"
    assert list(_warnings(cast(Scenario, scenario))) == [said] * (owners[2] == "a")


def test_plans_that_are_proven_less_closely_than_asked_for_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keys = ("mission.flight=none", "planner.max_nodes=1", "planner.gap=1e-4")
    few = ("--rounds", "2", "--no-report")
    assert call(["run", "--out", str(tmp_path / "run"), *few, "--set", *keys]) == 0
    said = capsys.readouterr().out
    assert re.search(
        r"\d of 2 plans (is|are) proven less closely than planner.gap = 0.0001 asks", said
    )


def test_a_page_without_room_is_made_later(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "run"

    def full(folder: Path) -> None:
        raise InputError(f"{folder / 'report.html'}: cannot write: No space left on device")

    monkeypatch.setattr("mission.report.page.write_report", full)
    assert play(out, rounds=1, page=True) == 2
    said = capsys.readouterr().err
    assert f"; aerofed report {out} makes the page once that is mended" in said
    assert "--resume" not in said
    assert RunFolder(out).status() == "finished"  # as it is
    monkeypatch.undo()
    assert call(["report", str(out)]) == 0
    assert (out / "report.html").is_file()


def test_ideal_knows_no_steps(tmp_path: Path) -> None:
    """One sweep of `ideal` is the ceiling of any N."""
    for steps in (3, 5):
        keys = ("--set", "mission.strategy=ideal", "--set", f"mission.steps={steps}")
        assert play(tmp_path / str(steps), *keys, rounds=2) == 0
    for name in ("rounds.csv", "learning.csv"):
        assert (tmp_path / "3" / name).read_bytes() == (tmp_path / "5" / name).read_bytes()
