"""A run's folder: refused when it is used or cannot be written, and its summary, always whole."""

import hashlib
import json
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from itertools import count
from pathlib import Path
from typing import Self, TypedDict

from mission.base.errors import InputError
from mission.base.folder_lock import alone_in, without_traces
from mission.base.user_files import DATA_BYTES, read_bytes, read_json

# The libraries that a run's results depend on.
LIBRARIES = (
    *("aerofed", "mavsdk", "pymavlink", "jsbsim", "filterpy", "numpy", "scipy"),
    *("cvxpy-base", "clarabel", "osqp", "torch", "mcap", "foxglove-sdk"),
)


RUNS = Path("runs")  # of folders that nobody named
_LOCK = ".lock"


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
    uplinks = _Inside("uplinks.csv")
    learning = _Inside("learning.csv")
    log = _Inside("flight.mcap")
    plans = _Inside("plans")
    summary = _Inside("summary.json")
    checkpoint = _Inside("checkpoint")
    figures = _Inside("figures")
    report = _Inside("report.html")

    @classmethod
    @contextmanager
    def taken(cls, path: Path) -> Iterator[Self]:
        """Context manager: `create` the folder, and keep others out of it while the block runs.

        Where the block fails and left nothing in it, the lock goes, and a folder that is new.

        Raises:
            InputError: see `create` and `lock`.
        """
        with without_traces(path):
            folder = cls.create(path)
            with folder.lock(chosen=True):
                cls.check(path)  # before we were alone, another run may have ended in it
                try:
                    yield folder
                except BaseException:
                    with suppress(OSError):
                        only_lock = {folder.checkpoint, folder.checkpoint / _LOCK}
                        if set(path.rglob("*")) == only_lock:
                            shutil.rmtree(folder.checkpoint)
                    raise

    @classmethod
    def create(cls, path: Path) -> Self:
        """Make the folder, or take one that is empty or `stillborn`.

        Raises:
            InputError: it holds something else, is a file, or cannot be written.
        """
        cls.check(path)
        try:
            path.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=path):
                pass
        except (FileExistsError, NotADirectoryError):
            raise InputError(f"{path}: the output folder is not a folder") from None
        except OSError as error:
            raise _unwritable(path, error) from None
        return cls(path)

    @staticmethod
    def check(path: Path) -> None:
        """Refuse a folder that is used or no folder, as `create` does, without making anything.

        Raises:
            InputError: it is neither empty nor `stillborn`, is a file, or cannot be read.
        """
        folder = RunFolder(path)
        try:
            str(path).encode()
            if path.exists() and any(path.iterdir()) and not folder.stillborn:
                summary = folder.read_summary()
                goes_on = folder.resumable and summary.get("resumable", True)
                goes_on = goes_on and summary.get("status") != "finished"
                hint = f", or go on with it: aerofed run --resume {path}" if goes_on else ""
                raise InputError(
                    f"{path}: the output folder is already used; give a new or empty one{hint}"
                )
        except NotADirectoryError:
            raise InputError(f"{path}: the output folder is not a folder") from None
        except UnicodeEncodeError:
            raise InputError(f"{path}: the output folder's name is not UTF-8") from None
        except OSError as error:
            raise InputError(f"{path}: cannot read the output folder: {error.strerror}") from None

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
        lock = self.checkpoint / _LOCK
        if self.resumable or not lock.is_file():
            return False
        left = {p.name for p in self.path.iterdir()} | {p.name for p in self.checkpoint.iterdir()}
        return all(
            name in (self.config.name, self.checkpoint.name, _LOCK)
            or name.endswith(".partial")
            or fnmatch(name, "learning-*.bin")
            for name in left
        )

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

    def digests(self) -> dict[str, str]:
        """SHA-256 of the configuration and of each table, by file name."""
        files = self.config, self.devices, self.rounds, self.uplinks, self.learning
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
    if given is not None:
        yield given
        return
    there = RUNS.exists()
    for number in count(1):
        path = RUNS / (name if number == 1 else f"{name}-{number}")
        try:
            RUNS.mkdir(exist_ok=True)
            path.mkdir()
            made = os.open(path, os.O_RDONLY)  # while it is open, no other gets its number
        except FileExistsError:
            if not RUNS.is_dir():  # a file, or a link to what is not there
                raise InputError(
                    f"{RUNS}: not a folder, and so none for {path.name}; name another folder"
                ) from None
            continue
        except OSError as error:
            with suppress(OSError):
                path.rmdir()  # it cannot be opened
            raise _unwritable(path, error) from None
        break
    try:
        yield path
    except BaseException:
        with suppress(OSError):
            if os.path.samestat(os.fstat(made), path.stat()):
                path.rmdir()
        raise
    finally:
        os.close(made)
        if not there:
            with suppress(OSError):  # not empty, as mostly
                RUNS.rmdir()


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(
        f"{path}: cannot write the output folder: {error.strerror}; name another folder"
    )


class RunSummary(TypedDict, total=False):
    """What `summary.json` says that is read again; an older one may lack some of it."""

    name: str
    status: str
    error: str
    resumable: bool
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
    from importlib.metadata import PackageNotFoundError, version  # a sixth of `aerofed --help`

    found = {}
    for name in LIBRARIES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
