"""What travels between the sweep's folder and the machines that fly, without any cluster."""

import itertools
import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from mission.base.errors import InputError
from mission.base.run_folder import RunFolder
from mission.config.loading import load_config
from mission.sweep.execute import luggage, parcels
from mission.sweep.execute.luggage import own_code, put_together
from mission.sweep.execute.parcels import Inbox, kept, parts
from mission.sweep.execute.worker import begun


@pytest.fixture
def flown(tmp_path: Path) -> RunFolder:
    """A run after its second round, as far as a parcel is concerned."""
    folder = RunFolder(tmp_path / "there" / "cov-seed1")
    folder.checkpoint.mkdir(parents=True)
    for path, text in (
        (folder.config, "c"), (folder.rounds, "r"), (folder.log, "m" * 50),
        (folder.summary, '{"status": "running", "resumable": true}'),
        (folder.checkpoint / "learning-00002.bin", "l"),
        (folder.checkpoint / "rounds.json", '{"learning": "learning-00002.bin"}'),
    ):  # fmt: skip
        path.write_text(text)
    (folder.path / "empty").write_bytes(b"")
    return folder


def test_what_is_kept_is_a_whole_checkpoint_at_every_instant(
    flown: RunFolder, tmp_path: Path
) -> None:
    found = kept(flown)
    assert found is not None
    names = [name for name, _ in found.files]
    assert names.index("checkpoint/learning-00002.bin") < names.index("checkpoint/rounds.json")
    inbox = Inbox(tmp_path / "here" / "cov-seed1")
    assert inbox.brought() == ()
    old = tmp_path / "here" / "cov-seed1" / "checkpoint" / "learning-00001.bin"
    old.write_text("of the round before")
    inbox.keep(found)
    assert not old.exists()
    assert kept(RunFolder(tmp_path / "here" / "cov-seed1")) == found
    (flown.checkpoint / "learning-00002.bin").unlink()  # as while the next round is written
    assert kept(flown) is None


def test_all_files_arrive_and_take_the_place_at_once(
    flown: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parcels, "_PARCEL_BYTES", 7)
    here = tmp_path / "here" / "cov-seed1"
    inbox = Inbox(here)
    for part in parts(flown.path):
        inbox.add(part)
        assert sum(len(data) for _, data in part.files) < 14
        assert not (here / "flight.mcap").exists()
    inbox.complete()
    arrived = {p.relative_to(here): p.read_bytes() for p in here.rglob("*") if p.is_file()}
    sent = {p.relative_to(flown.path): p for p in flown.path.rglob("*") if p.is_file()}
    assert arrived == {name: path.read_bytes() for name, path in sent.items()}
    assert [path.name for path in here.parent.iterdir()] == ["cov-seed1"]


@pytest.mark.parametrize("status", ["finished", "interrupted"])
def test_what_had_all_arrived_takes_the_place_later(
    flown: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, status: str
) -> None:
    """The sweep was killed after the run's old folder was out of the way."""
    flown.summary.write_text(json.dumps({"status": status, "resumable": False}))
    here = tmp_path / "here" / "cov-seed1"
    inbox = Inbox(here)
    for part in parts(flown.path):
        inbox.add(part)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", _killed_after_one())
        with pytest.raises(KeyboardInterrupt):
            inbox.complete()
    assert not here.exists()
    again = Inbox(here)
    again.close()
    assert [path.name for path in here.parent.iterdir()] == ["cov-seed1"]
    assert again.finished == (here / "flight.mcap").exists() == (status == "finished")
    assert not again.begun


def test_a_run_that_was_thrown_away_begins_anew(tmp_path: Path) -> None:
    """By hand, with what a sweep that was killed later had left of it."""
    (tmp_path / ".run.gone").mkdir()
    inbox = Inbox(tmp_path / "run")
    assert not inbox.finished
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    inbox.close()


def _killed_after_one() -> Callable[[Path, Path], Path]:
    rename, calls = Path.rename, itertools.count()

    def once(path: Path, target: Path) -> Path:
        if next(calls):
            raise KeyboardInterrupt
        return rename(path, target)

    return once


def test_nobody_else_flies_into_a_folder_that_is_filled(tmp_path: Path) -> None:
    inbox = Inbox(tmp_path / "run")
    with pytest.raises(InputError, match="another aerofed run is at work"):
        Inbox(tmp_path / "run")
    inbox.close()


@pytest.mark.parametrize(
    "summary", [{"status": "failed", "resumable": True}, {"status": "running", "resumable": False}]
)
def test_what_cannot_go_on_begins_anew(flown: RunFolder, summary: dict[str, object]) -> None:
    flown.summary.write_text(json.dumps(summary))
    inbox = Inbox(flown.path)
    assert not inbox.begun
    assert not flown.log.exists()
    inbox.close()


def test_nobody_flies_into_a_folder_that_is_removed(
    flown: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown.summary.write_text(json.dumps({"status": "failed"}))

    def while_removed(_: Path) -> None:
        with pytest.raises(InputError, match="another aerofed run is at work"), flown.lock():
            pass
        raise OSError("seen")

    monkeypatch.setattr("mission.sweep.execute.worker.shutil.rmtree", while_removed)
    with pytest.raises(OSError, match="seen"):
        begun(flown.path)


def test_code_that_plug_ins_need_goes_along(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "here"
    for name in ("mine/__init__.py", "mine/table.csv", "mine/__pycache__/x.pyc", "other/a.py"):
        (here / name).parent.mkdir(parents=True, exist_ok=True)
        (here / name).write_text("")
    (here / "mine" / "rule.py").write_text("def make(context): ...\n")
    (here / "per.csv").write_text("1\n")
    (here / ".secret").write_text("")
    (here / ".#rule.py").symlink_to("user@host.1234")  # Emacs' lock
    (here / "dangling").symlink_to("nowhere")
    monkeypatch.chdir(here)
    monkeypatch.setattr(sys, "path", [*sys.path])
    plain = load_config(Path("quickstart"))
    mine = load_config(Path("quickstart"), {"mission.strategy": "mine.rule:make"})
    assert own_code([plain], here) == ()
    files = own_code([plain, mine], here)
    put_together(files, here, tmp_path / "there")
    names = {p.relative_to(tmp_path / "there").as_posix() for p in (tmp_path / "there").rglob("*")}
    assert names == {"mine", "mine/__init__.py", "mine/table.csv", "mine/rule.py", "per.csv"}
    monkeypatch.setattr(luggage, "_MOST_BYTES", 10)
    with pytest.raises(InputError, match=r"the largest file is mine/rule\.py"):
        own_code([mine], here)
