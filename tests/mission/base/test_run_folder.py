"""Which folder a run takes where none is named, and what is said where it cannot."""

import errno
import fcntl
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import IO

import pytest

from mission.base.errors import InputError
from mission.base.run_folder import RunFolder, alone_in, output_folder, write_atomically


def test_runs_that_begin_together_take_different_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with ExitStack() as several:
        taken = [several.enter_context(output_folder(None, "one")) for _ in range(3)]
        assert taken == [Path("runs/one"), Path("runs/one-2"), Path("runs/one-3")]
        for path in taken:
            (path / "summary.json").write_text("{}")
    with output_folder(None, "one") as path:
        assert path == Path("runs/one-4")
    with output_folder(tmp_path / "mine", "one") as path:
        assert path == tmp_path / "mine"
        assert not path.exists()


def test_nothing_is_left_of_a_run_that_never_began(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="no data"), output_folder(None, "one"):
        raise InputError("no data")
    assert not Path("runs").exists()


@pytest.mark.parametrize("make", [Path.touch, lambda path: path.symlink_to("nowhere")])
def test_a_folder_that_cannot_be_made_names_the_way_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Callable[[Path], None]
) -> None:
    monkeypatch.chdir(tmp_path)
    make(Path("runs"))
    with pytest.raises(InputError) as refused, output_folder(None, "one"):
        pass
    assert str(refused.value) == ("runs: not a folder, and so none for one; name another folder")


@pytest.mark.parametrize(("chosen", "way_out"), [(True, ", or name another"), (False, "")])
def test_a_folder_in_use_names_the_way_out(tmp_path: Path, chosen: bool, way_out: str) -> None:
    folder = RunFolder(tmp_path / "one")
    how = {"chosen": True} if chosen else {}
    with folder.lock(), pytest.raises(InputError) as refused, folder.lock(**how):
        pass
    assert str(refused.value) == (
        f"{folder.path}: another aerofed run is at work in this folder; wait until it has ended"
        + way_out
    )


def refuse_locks(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a file system without locks does."""

    def flock(file: IO[str], how: int) -> None:  # noqa: ARG001
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", flock)


@pytest.mark.parametrize("given", [None, Path("mine"), Path("new/deep/mine")])
def test_a_run_that_cannot_lock_its_folder_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: Path | None
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    refuse_locks(monkeypatch)
    with (
        pytest.raises(InputError, match=r"^\S+: cannot lock .lock: No locks available$"),
        output_folder(given, "one") as path,
        RunFolder(path).taken(),
    ):
        pass
    assert list(tmp_path.rglob("*")) == [tmp_path / "mine"]


def test_a_lock_that_was_there_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lock = tmp_path / ".lock"
    lock.touch()
    refuse_locks(monkeypatch)
    with pytest.raises(InputError, match="cannot lock"), alone_in(tmp_path, lock, who="run"):
        pass
    assert lock.exists()


@pytest.mark.parametrize("there", [Path(), Path("mine"), Path("mine/run")])
def test_a_refused_run_leaves_what_was_there_and_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    there.mkdir(exist_ok=True, parents=True)
    before = sorted(tmp_path.rglob("*"))
    with (
        pytest.raises(InputError, match="refused"),
        RunFolder(Path("mine/run")).taken(),
    ):
        raise InputError("refused")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_lock_whose_folder_was_removed_keeps_nobody_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So whoever gets it is refused: the folder is another one's now."""
    folder = RunFolder(tmp_path / "one")
    flock = fcntl.flock

    def late(file: IO[str], how: int) -> None:
        shutil.rmtree(folder.path)
        flock(file, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with pytest.raises(InputError, match="another aerofed run is at work"), folder.lock():
        pass


def test_a_folder_that_is_removed_at_the_end_is_no_bug(tmp_path: Path) -> None:
    """While the page is written, say: all has been done by then."""
    with RunFolder(tmp_path / "run").taken():
        shutil.rmtree(tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_link_stays_one_and_what_is_no_file_is_written_to(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "behind")
    write_atomically(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "behind").read_text() == "new"
    os.mkfifo(tmp_path / "pipe")  # as /dev/stdout may be one
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    write_atomically(tmp_path / "pipe", "told")
    assert os.read(reader, 100) == b"told"
    os.close(reader)
    assert (tmp_path / "pipe").is_fifo()


def test_a_stream_that_leads_to_a_file_keeps_what_others_write(tmp_path: Path) -> None:
    program = (
        "from pathlib import Path; from mission.base.run_folder import write_atomically as write\n"
        "print('before'); write(Path('/dev/stdout'), 'it\\n'); print('after')"
    )
    with (tmp_path / "log").open("w") as log:
        subprocess.run([sys.executable, "-c", program], stdout=log, check=True)
    assert (tmp_path / "log").read_text() == "before\nit\nafter\n"
    (tmp_path / "itself").symlink_to(tmp_path / "itself")
    write_atomically(tmp_path / "itself", "new")
    assert (tmp_path / "itself").read_text() == "new"
