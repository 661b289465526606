"""The old log and tables of a resumed run are there until the new ones hold more."""

import signal
from pathlib import Path

import pytest
from forked import Forked
from patience import until
from test_checkpoint import killed

from mission.base.run_folder import RunFolder
from mission.cli import call
from mission.log.contents import recover
from mission.log.reader import read_log
from mission.log.records import RoundRecord
from mission.log.tables import read_table

NAMES = ("flight.mcap", "rounds.csv", "aircraft.csv", "uplinks.csv", "learning.csv")


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    (tmp_path / "checkpoint").mkdir()
    for name in NAMES:
        (tmp_path / name).write_text(f"old {name}")
    return RunFolder(tmp_path)


def kept(folder: RunFolder) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.kept.iterdir()}


def test_all_are_moved_and_then_gone(folder: RunFolder) -> None:
    folder.discard_kept()  # nothing there yet
    folder.set_aside()
    assert kept(folder) == {name: f"old {name}" for name in NAMES}
    assert not any((folder.path / name).exists() for name in NAMES)
    folder.discard_kept()
    folder.discard_kept()
    assert list(folder.checkpoint.iterdir()) == []


def test_a_second_kill_keeps_the_older_longer_ones(folder: RunFolder) -> None:
    folder.set_aside()
    for name in NAMES:
        (folder.path / name).write_text("begun anew")
    folder.set_aside()
    assert kept(folder) == {name: f"old {name}" for name in NAMES}


@pytest.mark.parametrize("moved", range(len(NAMES) + 1))
def test_killed_between_two_moves(folder: RunFolder, moved: int) -> None:
    folder.kept.mkdir()
    for name in NAMES[:moved]:
        (folder.path / name).replace(folder.kept / name)
    folder.set_aside()
    assert kept(folder) == {name: f"old {name}" for name in NAMES}


def test_killed_while_the_old_ones_are_removed(folder: RunFolder) -> None:
    folder.set_aside()
    folder.kept.replace(folder.checkpoint / ".interrupted-gone")
    for name in NAMES:
        (folder.path / name).write_text("new")
    folder.set_aside()
    assert kept(folder) == dict.fromkeys(NAMES, "new")
    assert [path.name for path in folder.checkpoint.iterdir()] == ["interrupted"]


@pytest.mark.slow
def test_killed_while_it_flies_again_nothing_is_lost(tmp_path: Path) -> None:
    out = tmp_path / "killed"
    killed(out, after_rounds=1, delay_s=0.0)
    before = {name: (out / name).read_bytes() for name in NAMES}
    aside = out / "checkpoint" / "interrupted"
    process = Forked("run", "--resume", str(out), "--quiet")
    until(lambda: process.poll() is not None or (aside / NAMES[-1]).exists(), poll_s=0.005)
    process.send_signal(signal.SIGKILL)
    process.ended()
    assert {name: (aside / name).read_bytes() for name in NAMES} == before
    saved = recover(aside / "flight.mcap", tmp_path / "saved.mcap")
    assert [record.round for record in read_log(saved.target).rounds][:1] == [1]
    assert call(["run", "--resume", str(out), "--quiet"]) == 0
    assert [record.round for record in read_table(out / "rounds.csv", RoundRecord)] == [1, 2]
    assert not aside.exists()
