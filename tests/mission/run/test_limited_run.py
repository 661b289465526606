"""Runs with deadlines and energy: flown as planned, ended in time, resumed to the same bytes."""

import json
import shutil
from pathlib import Path

import pytest
from drawing import outlined
from small_runs import digests, last_counts, rows
from test_run import SMALL

from mission.analysis.compare import compare_run
from mission.analysis.load import load_run
from mission.cli import call

LIMITS = (
    "--set", "mission.path_budget_m=900",
    "--set", "mission.round_deadline_s=25",
    "--set", "mission.total_deadline_s=60",
    "--set", "mission.round_energy_j=7000",
)  # fmt: skip

pytestmark = pytest.mark.slow


def fly(out: Path, *more: str) -> int:
    return call(["run", "--out", str(out), "--rounds", "5", *last_counts(*SMALL, *LIMITS, *more)])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("limited") / "run"
    with outlined():
        assert fly(out) == 0
    return out


def test_flown_as_planned_within_the_limits(run: Path) -> None:
    used_s = used_j = 0.0
    flown = rows(run / "rounds.csv")
    assert len(flown) == 2
    for row in flown:
        flown_s, flown_j = float(row["duration_s"]), float(row["energy_j"])
        assert float(row["plan_duration_s"]) <= 25.0 + 1e-6
        assert float(row["plan_energy_j"]) <= 7000.0 + 1e-6
        assert flown_s == pytest.approx(float(row["plan_duration_s"]), rel=0.05)
        assert flown_j == pytest.approx(float(row["plan_energy_j"]), rel=0.05)
        used_s, used_j = used_s + flown_s, used_j + flown_j
        assert float(row["time_used_s"]) == pytest.approx(used_s)
        assert float(row["energy_used_j"]) == pytest.approx(used_j)


def test_ends_when_the_time_pays_for_no_round(run: Path) -> None:
    flown = rows(run / "rounds.csv")
    assert len(flown) == 2
    left_s = 60.0 - float(flown[-1]["time_used_s"])
    assert left_s < 25.0
    summary = json.loads((run / "summary.json").read_text())
    assert summary["time_used_s"] == float(flown[-1]["time_used_s"])
    assert summary["status"] == "finished"
    assert summary["ended_by"].startswith("of the time of 60 s (mission.total_deadline_s)")
    assert summary["ended_by"].endswith("so the run ends before round 3")
    assert call(["report", str(run)]) == 0
    page = (run / "report.html").read_text(encoding="utf-8")
    assert "ended by" in page
    assert summary["ended_by"] in page


def test_log_and_comparison_know_the_durations(run: Path) -> None:
    loaded = load_run(run)
    table = rows(run / "rounds.csv")
    assert len(table) == 2
    for plan, record, row in zip(loaded.data.plans, loaded.data.rounds, table, strict=True):
        assert plan.duration_s == float(row["plan_duration_s"])
        assert record.energy_j == float(row["energy_j"])
    total = compare_run(loaded).total
    assert total.duration_s == pytest.approx(total.plan_duration_s, rel=0.05)
    assert abs(total.slot_late_mean_s) < 0.5
    assert total.energy_j == sum(float(row["energy_j"]) for row in table)
    assert total.plan_energy_j == sum(float(row["plan_energy_j"]) for row in table)


def test_tables_on_the_terminal_tell_the_energy(
    run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert call(["compare", str(run)]) == 0
    text = capsys.readouterr().out
    assert "energy (J)" in text
    assert "…" not in text


def test_a_resumed_run_has_the_same_bytes(run: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    shutil.copytree(run, again)
    (again / "summary.json").write_text('{"status": "running"}')
    (again / "traceback.txt").write_text("of own code that has been mended since")
    assert call(["run", "--resume", str(again), "--quiet"]) == 0
    assert not (again / "traceback.txt").exists()
    assert digests(again) == digests(run)


def test_nothing_is_left_of_a_run_that_is_refused(tmp_path: Path, capsys) -> None:
    out = tmp_path / "none"
    assert fly(out, "--set", "mission.round_deadline_s=1") == 2
    assert (
        "command line: mission.round_deadline_s = 1.0: no round can be flown"
        in capsys.readouterr().err
    )
    assert not out.exists()


@pytest.mark.parametrize("strategy", ["barycenter", "rectangular", "ideal"])
def test_every_strategy_ends_with_its_time(tmp_path: Path, strategy: str) -> None:
    out = tmp_path / "run"
    total_s = 13 if strategy == "barycenter" else 60
    keys = (f"mission.strategy={strategy}", f"mission.total_deadline_s={total_s}")
    assert fly(out, "--set", keys[0], "--set", keys[1]) == 0
    table = rows(out / "rounds.csv")
    assert len(table) == 2
    for row in table if strategy != "ideal" else ():
        assert float(row["duration_s"]) == pytest.approx(float(row["plan_duration_s"]), rel=0.05)


def test_unflown_rounds_take_what_is_planned(tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert fly(out, "--set", "mission.flight=none") == 0
    table = rows(out / "rounds.csv")
    assert len(table) == 2
    for row in table:
        assert float(row["duration_s"]) == pytest.approx(float(row["plan_duration_s"]), abs=1e-6)
        assert row["energy_j"] == "nan"
        assert float(row["energy_used_j"]) > 0.0
