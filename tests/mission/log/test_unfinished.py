"""Runs that were killed or interrupted, and runs of different length, in compare and report."""

import json
from pathlib import Path

import pytest
from synthetic_flight import fly

from mission.analysis.load import load_run
from mission.base.errors import InputError
from mission.cli import call
from mission.log import DamagedLogError


def killed(folder: Path, *, rounds: int = 3, share: float = 0.8) -> None:
    """A run's folder as a kill leaves it: the log cut, the summary still saying "running"."""
    folder.mkdir()
    made = fly(folder, rounds=rounds)
    made.log.write_bytes(made.log.read_bytes()[: int(share * made.log.stat().st_size)])
    (folder / "checkpoint").mkdir()
    (folder / "checkpoint" / "rounds.json").write_text("[]")
    (folder / "summary.json").write_text(json.dumps({"status": "running", "resumable": True}))


@pytest.mark.slow
def test_what_is_there_of_a_killed_run_is_compared_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    killed(folder)
    assert call(["compare", str(folder), "--json"]) == 0
    printed = capsys.readouterr()
    (found,) = json.loads(printed.out)
    assert [item["round"] for item in found["rounds"]] == [1, 2]
    assert sum(item["scheduled"] for item in found["devices"]) == found["total"]["scheduled"]
    assert f"2 rounds of it are here; aerofed run --resume {folder} goes on" in printed.err
    assert call(["report", str(folder)]) == 0
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert f"aerofed run --resume {folder} goes on" in page


def test_before_the_first_round_there_is_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    killed(folder, rounds=1, share=0.5)
    for command in ("compare", "report"):
        assert call([command, str(folder)]) == 2
        assert f"aerofed run --resume {folder}" in capsys.readouterr().err


def test_a_finished_runs_log_has_to_be_whole(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    killed(folder)
    (folder / "summary.json").write_text(json.dumps({"status": "finished"}))
    with pytest.raises(DamagedLogError, match="aerofed log recover"):
        load_run(folder)
    (folder / "summary.json").write_text("[]")
    with pytest.raises(InputError, match="not a run's summary"):
        load_run(folder)


@pytest.mark.slow
def test_a_resumed_run_that_was_killed_again_shows_the_longer_log(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    killed(folder, share=0.5)
    longer = folder / "checkpoint" / "interrupted"
    longer.mkdir()
    fly(longer, rounds=3)
    assert len(load_run(folder).data.rounds) == 3


@pytest.mark.slow
def test_runs_of_different_length_are_said_to_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = []
    for name, rounds in (("long", 3), ("short", 2)):
        (tmp_path / name).mkdir()
        fly(tmp_path / name, rounds=rounds)
        paths.append(str(tmp_path / name))
    assert call(["compare", *paths]) == 0
    assert "(rounds: long 3, short 2)" in capsys.readouterr().err
    assert call(["compare", *paths, "--rounds", "2", "--json"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    first, second = json.loads(printed.out)
    # The same seed flies the same. Speeds are differences of positions, at a log's end one-sided.
    rows = ([*each["rounds"], each["total"]] for each in (first, second))
    for one, other in zip(*rows, strict=True):
        speeds = {"speed_tracking_rms_mps", "speed_tracking_max_mps"}
        assert all(one[name] == other[name] for name in one.keys() - speeds)
        assert all(one[name] == pytest.approx(other[name], rel=1e-5) for name in speeds)
    assert call(["compare", *paths, "--rounds", "0"]) == 2
    assert "--rounds 0" in capsys.readouterr().err
