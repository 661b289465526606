"""A run's folder: refused when it is used or cannot be written; one process at a time in it; its
summary, always whole; and the files of a run that is resumed, kept until the new ones hold as much.
"""

import fcntl
import hashlib
import json
import os
import platform
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from itertools import count
from pathlib import Path
from typing import TypedDict

from mission.base.errors import InputError
from mission.base.user_files import DATA_BYTES, or_input_error, read_bytes, read_json

# The libraries that a run's results depend on.
LIBRARIES = (
    *("aerofed", "mavsdk", "pymavlink", "jsbsim", "filterpy", "numpy", "scipy"),
    *("cvxpy-base", "clarabel", "osqp", "torch", "mcap", "foxglove-sdk"),
)


RUNS = Path("runs")  # of folders that nobody named
VEHICLE = "vehicle-"  # and a name, or a number: the folder of one of several in a world
_LOCK, _GONE = ".lock", ".interrupted-gone"


class _Inside:
    """Descriptor: the path of a file or folder of that name in a run's folder."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, folder: "RunFolder", owner: object) -> Path:
        return folder.path / self._name


@dataclass(frozen=True)
class RunFolder:
    """Folder of one run: its files by name, its lock and its status."""

    path: Path

    config = _Inside("config.toml")
    devices = _Inside("devices.csv")
    rounds = _Inside("rounds.csv")
    aircraft = _Inside("aircraft.csv")
    uplinks = _Inside("uplinks.csv")
    learning = _Inside("learning.csv")
    log = _Inside("flight.mcap")
    plans = _Inside("plans")
    summary = _Inside("summary.json")
    checkpoint = _Inside("checkpoint")
    figures = _Inside("figures")
    report = _Inside("report.html")

    def of_vehicle(self, name: str) -> "RunFolder":
        """The folder of what only one of several aircraft has."""
        return RunFolder(self.path / f"{VEHICLE}{name}")

    @contextmanager
    def taken(self) -> Iterator[None]:
        """Context manager: make the folder, or take one that is empty or `stillborn`, and keep
        others out of it while the block runs.

        The lock goes at its end, unless it is beside a checkpoint. Where the block fails it goes
        only if nothing else was left, as does a folder that is new.

        Raises:
            InputError: see `check` and `lock`.
        """
        self.check()
        with without_traces(self.path), self.lock(chosen=True):
            self.check()  # before we were alone, another run may have ended in it
            try:
                yield
            except BaseException:
                if set(self.path.rglob("*")) == {self.checkpoint, self.checkpoint / _LOCK}:
                    shutil.rmtree(self.checkpoint, ignore_errors=True)
                raise
            if list(self.checkpoint.glob("*")) == [self.checkpoint / _LOCK]:
                shutil.rmtree(self.checkpoint, ignore_errors=True)

    def check(self) -> None:
        """Refuse a folder that is used or no folder, without making anything.

        Raises:
            InputError: it is neither empty nor `stillborn`, is a file, or cannot be read.
        """
        path = self.path
        try:
            str(path).encode()
            if path.exists() and any(path.iterdir()) and not self.stillborn:
                summary = self.read_summary()
                goes_on = self.resumable and summary.get("resumable", True)
                goes_on = goes_on and summary.get("status") != "finished"
                hint = f", or go on with it: aerofed run --resume {path}" if goes_on else ""
                raise InputError(
                    f"{path}: the output folder is already used; give a new or empty one{hint}"
                )
        except UnicodeEncodeError:
            raise InputError(f"{path}: the output folder's name is not UTF-8") from None
        except OSError as error:
            reason = f"the output folder cannot be read: {error.strerror}"
            raise InputError(f"{path}: {reason}; name another folder") from None

    def lock(self, *, chosen: bool = False) -> AbstractContextManager[None]:
        """Context manager: keep other processes from flying into this folder; see `alone_in`."""
        return alone_in(self.path, self.checkpoint / _LOCK, who="aerofed run", chosen=chosen)

    @property
    def resumable(self) -> bool:
        """Whether there is a checkpoint to go on from."""
        return (self.checkpoint / "rounds.json").exists()

    @property
    def stillborn(self) -> bool:
        """Whether the folder holds only the remains of a run killed before its first checkpoint.

        The lock comes first, so that nobody's own `config.toml` is taken for a run's.
        """
        ours = {self.config.name, self.checkpoint.name}
        left = {p.name for p in self.path.iterdir() if not p.name.endswith(".partial")}
        return (self.checkpoint / _LOCK).is_file() and not self.resumable and left <= ours

    def status(self) -> str | None:
        """Return the status in the summary, such as "finished"; None without a readable one."""
        summary = self.read_summary()
        return str(summary.get("status")) if summary else None

    def read_summary(self) -> "RunSummary":
        """Read `summary.json`; empty where it is missing or damaged."""
        try:
            summary: RunSummary = read_json(self.summary)
        except InputError:
            return {}
        return summary if isinstance(summary, dict) else {}

    @property
    def tables(self) -> tuple[Path, ...]:
        """Tables that grow with the rounds."""
        return self.rounds, self.aircraft, self.uplinks, self.learning

    def digests(self) -> dict[str, str]:
        """SHA-256 of the configuration and of each table, by file name."""
        files = self.config, self.devices, *self.tables
        return {
            file.name: hashlib.sha256(read_bytes(file, most=DATA_BYTES)).hexdigest()
            for file in files
            if file.exists()
        }

    def check_unchanged(self) -> None:
        """Refuse the folder of a finished run in which a file is not as the run left it.

        Raises:
            InputError: one is altered or gone.
        """
        now = self.digests()
        for name, then in self.read_summary().get("sha256", {}).items():
            if now.get(name) != then:
                raise InputError(
                    f"{self.path / name}: {'altered' if name in now else 'gone'} since the run "
                    "ended; remove the run's folder to have it flown anew"
                )

    def write_summary(self, values: Mapping[str, object]) -> None:
        """Replace `summary.json` as a whole: a reader sees the old one or the new one."""
        write_atomically(self.summary, json.dumps(values, indent=2) + "\n")

    @property
    def kept(self) -> Path:
        """Where log and tables of a run are while a resumption, which flies its finished rounds
        again and writes its files from the beginning, has not caught up with them."""
        return self.checkpoint / "interrupted"

    def set_aside(self) -> None:
        """Move log and tables to `kept`; those of an earlier, longer flight that are there stay.

        Killed in between, what was not moved yet is moved the next time: nothing is written
        before all of them are away.

        Raises:
            InputError: they cannot be moved.
        """
        with or_input_error(self.kept, "cannot keep the old files"):
            shutil.rmtree(self.checkpoint / _GONE, ignore_errors=True)
            self.kept.mkdir(parents=True, exist_ok=True)
            logs = self.path.glob(f"{VEHICLE}*/{self.log.name}")
            for file in (self.log, *self.tables, *logs):
                kept = self.kept / file.relative_to(self.path)
                if file.exists() and not kept.exists():
                    kept.parent.mkdir(exist_ok=True)
                    file.replace(kept)

    def discard_kept(self) -> None:
        """Remove the old files, all at once; for when the new ones hold as much. Twice is fine."""
        if self.kept.exists():
            # Removed one by one under their name, a kill would leave some of them.
            self.kept.replace(self.checkpoint / _GONE)
            shutil.rmtree(self.checkpoint / _GONE, ignore_errors=True)


@contextmanager
def without_traces(folder: Path) -> Iterator[None]:
    """Context manager: if the block fails, remove those of a folder and its parents that are new
    and empty.
    """
    new = [one for one in (folder, *folder.parents) if not os.access(one, os.F_OK)]
    try:
        yield
    except BaseException:
        for one in new:
            with suppress(OSError):  # not empty, as mostly, or never made
                one.rmdir()
        raise


@contextmanager
def alone_in(folder: Path, lock: Path, *, who: str, chosen: bool = False) -> Iterator[None]:
    """Context manager: keep every other `who` out of a folder, by a lock on the file `lock`.

    The lock's folder is made where it is missing, and removed again where the lock is refused. The
    lock ends with the process; its holder may remove the folder. `who` names the kind of process
    in messages. `chosen`: the message suggests another folder.

    Raises:
        InputError: another one is at work there, or the file cannot be written or locked.
    """
    with without_traces(lock.parent):
        another = "; name another folder" if chosen else ""
        try:
            new = not lock.exists()
            lock.parent.mkdir(parents=True, exist_ok=True)
            file = lock.open("a")
        except OSError as error:
            reason = f"cannot write the output folder: {error.strerror}{another}"
            raise InputError(f"{folder}: {reason}") from None
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                # A file that was removed keeps nobody out who makes a new one.
                if not os.path.samestat(os.fstat(file.fileno()), lock.stat()):
                    raise BlockingIOError
            except (BlockingIOError, FileNotFoundError):
                another = another and ", or name another"
                raise InputError(
                    f"{folder}: another {who} is at work in this folder; "
                    f"wait until it has ended{another}"
                ) from None
            except OSError as error:  # a file system without locks
                if new:
                    lock.unlink(missing_ok=True)
                raise InputError(f"{folder}: cannot lock {lock.name}: {error.strerror}") from None
            yield


_STREAMS = {"/dev/stdout": 1, "/dev/stderr": 2}


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write a file atomically: whole or not at all, also after a power cut. A symbolic link is
    followed; a device such as /dev/stdout is written to directly.

    Raises:
        InputError: it cannot be written.
    """
    content = content.encode() if isinstance(content, str) else content
    target = path
    with suppress(RuntimeError):  # a link to itself is replaced
        target = path.resolve() if path.is_symlink() else path
    partial = target.with_name(f".{target.name}.partial")
    try:
        stream = _STREAMS.get(str(path))  # it may lead to a file, to which others write, too
        if stream is not None or (target.exists() and not target.is_file()):
            sys.stdout.flush()
            with open(path if stream is None else stream, "wb", closefd=stream is None) as file:
                file.write(content)
            return
        with partial.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(target)
    except OSError as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot write: {error.strerror}") from None


@contextmanager
def output_folder(given: Path | None, name: str) -> Iterator[Path]:
    """Context manager: the given folder, or the first free of `runs/name`, `runs/name-2`, ...

    The latter is made at once, so that two that begin together do not take the same, and removed
    where the block fails and leaves nothing in it.

    Raises:
        InputError: it cannot be made.
    """
    for number in count(1):
        path = given or RUNS / (name if number == 1 else f"{name}-{number}")
        with without_traces(path):
            try:
                if given is None:
                    RUNS.mkdir(exist_ok=True)
                    path.mkdir()
            except FileExistsError:
                if not RUNS.is_dir():  # a file, or a link to what is not there
                    raise InputError(
                        f"{RUNS}: not a folder, and so none for {path.name}; name another folder"
                    ) from None
                continue
            except OSError as error:
                raise InputError(
                    f"{path}: cannot write the output folder: {error.strerror}; name another folder"
                ) from None
            yield path
            return


class RunSummary(TypedDict, total=False):
    """What `summary.json` says that is read again; an older one may lack some of it."""

    name: str
    status: str
    error: str
    resumable: bool
    vehicles: list[str]  # the folders of several aircraft
    plugins: dict[str, str | None]  # digests of their code
    sha256: dict[str, str]  # of a finished run's configuration and tables
    flown_in_rounds_m: float
    budget_used_m: float
    simulated_s: float
    real_time_factor: float
    untrained_accuracy: dict[str, float]
    wall_s: dict[str, float]  # by phase


def environment() -> dict[str, object]:
    """Versions of Python and libraries, and the machine: a part of `summary.json`."""
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cpus": os.cpu_count(),
        "libraries": library_versions(),
    }


def library_versions() -> dict[str, str]:
    """Return the versions of `LIBRARIES` by name, without those that are not installed."""
    return {name: version for name in LIBRARIES if (version := _version(name)) is not None}


@cache
def _version(library: str) -> str | None:
    """Looked up once: a run asks three times, which took as long as two simulated seconds."""
    from importlib.metadata import PackageNotFoundError, version  # a sixth of `aerofed --help`

    try:
        return version(library)
    except PackageNotFoundError:
        return None
