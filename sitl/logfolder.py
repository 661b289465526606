"""A folder of flight logs on disk, as the log protocol and MAVLink FTP serve it."""

import os
import re
import stat
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_NAME = "flight-{:04d}.mcap"
_OURS = re.compile(r"flight-([0-9]{4,})\.mcap")


class LogFile(NamedTuple):
    """One flight log that is complete."""

    name: str
    size: int  # bytes
    written_s: int  # seconds since 1970


def next_log(folder: Path) -> Path:
    """Return the path of the next log in a folder, numbered after the last one that is there."""
    taken = (_OURS.fullmatch(path.name) for path in folder.glob("*.mcap"))
    return folder / _NAME.format(1 + max((int(log[1]) for log in taken if log), default=0))


class LogFolder:
    """The flight logs of a folder, but for the one that is being written.

    They are known by their names, those of `next_log`, and are regular files: what else lies there
    is neither shown nor removed, and links are not followed.
    """

    def __init__(
        self, folder: Path | None, *, being_written: Callable[[], Path | None] = lambda: None
    ) -> None:
        """`folder`: None for no logs; `being_written` returns the log that is not complete yet."""
        self._folder = folder
        self._being_written = being_written

    def logs(self) -> list[LogFile]:
        """Return the complete logs, the oldest first."""
        return [
            LogFile(path.name, about.st_size, int(about.st_mtime))
            for path, about in self._complete()
        ]

    def read(self, name: str, offset: int, count: int) -> bytes:
        """`count` bytes of a log from `offset` on; fewer at its end, none of one that has gone."""
        if self._folder is None:
            return b""
        try:
            opened = os.open(self._folder / name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
            with os.fdopen(opened, "rb") as file:
                file.seek(offset)
                return file.read(count)
        except OSError:
            return b""

    def erase(self) -> None:
        """Remove all complete logs."""
        for path, _ in self._complete():
            with suppress(OSError):  # by somebody else, or the folder may not be written to
                path.unlink()

    def _complete(self) -> Iterator[tuple[Path, os.stat_result]]:
        if self._folder is None:
            return
        present = self._being_written()
        for path in sorted(self._folder.glob("*.mcap"), key=lambda log: (len(log.name), log.name)):
            with suppress(OSError):  # removed by somebody meanwhile
                about = path.lstat()
                if path != present and _OURS.fullmatch(path.name) and stat.S_ISREG(about.st_mode):
                    yield path, about
