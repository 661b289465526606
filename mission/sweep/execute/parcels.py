"""A run's folder on its way from the machine that flies it to the sweep's: parcels of files.

What a run needs to go on travels while it is flown, all of it when it has ended.
"""

import json
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from mission.base.run_folder import RunFolder, write_atomically
from mission.run.resume import ROUNDS
from mission.sweep.execute.worker import begun

_PARCEL_BYTES = 2**23  # in memory at a time

Files = tuple[tuple[str, bytes], ...]  # names from the run's folder, in the order to write them


@dataclass(frozen=True)
class Kept:
    """What a run needs to go on after its last finished round."""

    files: Files


@dataclass(frozen=True)
class Part:
    """Some of the files of a run that has ended; a large file goes on in the next part."""

    files: Files


def kept(folder: RunFolder) -> Kept | None:
    """What a run in this folder needs to go on; None before its first checkpoint is written."""
    ledger = folder.checkpoint / ROUNDS
    try:
        rounds = ledger.read_bytes()
        learnt = folder.checkpoint / json.loads(rounds)["learning"]
        # In this order: whoever is cut off while writing them has a whole checkpoint still.
        paths = (folder.config, learnt, ledger, folder.rounds, folder.summary)
        contents = [rounds if path == ledger else path.read_bytes() for path in paths]
    except FileNotFoundError:  # or the next round took its place meanwhile
        return None
    names = (path.relative_to(folder.path).as_posix() for path in paths)
    return Kept(tuple(zip(names, contents, strict=True)))


def parts(path: Path) -> Iterator[Part]:
    """All files of a run that has ended, in parts of a few megabytes."""
    files: list[tuple[str, bytes]] = []
    size = 0
    for file in sorted(path.rglob("*")):
        if not file.is_file():
            continue
        with file.open("rb") as opened:
            data = opened.read(_PARCEL_BYTES)
            while True:  # once for an empty file, too
                files.append((file.relative_to(path).as_posix(), data))
                size += len(data)
                if size >= _PARCEL_BYTES:
                    yield Part(tuple(files))
                    files, size = [], 0
                data = opened.read(_PARCEL_BYTES)
                if not data:
                    break
    yield Part(tuple(files))


class Inbox:
    """The folder of one run at the sweep, which another machine fills."""

    def __init__(self, path: Path) -> None:
        """Make the folder, or take that of a run which was cut off, or which is `finished`.

        Raises:
            InputError: somebody flies into it.
            OSError: what is in its place cannot be removed, or it cannot be made.
        """
        self._path = path
        self._arriving = path.with_name(f".{path.name}.arriving")
        self._gone = path.with_name(f".{path.name}.gone")
        self._lock = ExitStack()
        if self._arriving.exists() and self._gone.exists() and not path.exists():
            self._arriving.rename(path)  # `complete` was cut off between its two renames
        for left in (self._arriving, self._gone):
            if left.exists():
                shutil.rmtree(left)
        folder = RunFolder(path)
        self.finished = folder.status() == "finished"
        self.begun = not self.finished and begun(path)
        if not self.finished:
            folder.checkpoint.mkdir(parents=True, exist_ok=True)
            self._lock.enter_context(folder.lock())

    def brought(self) -> Files:
        """What the machine needs that flies it; nothing for a run from its start."""
        found = kept(RunFolder(self._path)) if self.begun else None
        return found.files if found else ()

    def keep(self, parcel: Kept) -> None:
        """Take in how far the run is.

        Raises:
            InputError: it cannot be written.
        """
        folder = RunFolder(self._path)
        for name, data in parcel.files:
            write_atomically(self._path / name, data)
        names = {name for name, _ in parcel.files}
        for old in folder.checkpoint.glob("learning-*.bin"):
            if old.relative_to(self._path).as_posix() not in names:
                old.unlink()

    def add(self, part: Part) -> None:
        """Take in some of the run's files.

        Raises:
            OSError: they cannot be written.
        """
        for name, data in part.files:
            path = self._arriving / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("ab") as file:
                file.write(data)

    def complete(self) -> None:
        """All files are there: they take the folder's place at once.

        Raises:
            OSError: they cannot.
        """
        self.close()
        if self._arriving.exists():
            self._path.rename(self._gone)
            self._arriving.rename(self._path)
            shutil.rmtree(self._gone)

    def close(self) -> None:
        """Let others at the folder. Twice is fine."""
        self._lock.close()
