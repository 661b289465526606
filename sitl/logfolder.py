"""A folder of flight logs on disk, as the log protocol and MAVLink FTP serve it."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_PATTERN = "*.mcap"


class LogFile(NamedTuple):
    """One flight log that is complete."""

    name: str
    size: int  # bytes
    written_s: int  # seconds since 1970


class LogFolder:
    """The MCAP files of a folder, but for the one that is being written."""

    def __init__(
        self, folder: Path | None, *, being_written: Callable[[], Path | None] = lambda: None
    ) -> None:
        """Without a folder there are no logs."""
        self._folder = folder
        self._being_written = being_written

    def logs(self) -> list[LogFile]:
        """Those that are complete, the oldest first."""
        found: list[LogFile] = []
        for path in self._complete():
            with suppress(OSError):  # removed by somebody meanwhile
                about = path.stat()
                found.append(LogFile(path.name, about.st_size, int(about.st_mtime)))
        return found

    def read(self, name: str, offset: int, count: int) -> bytes:
        """`count` bytes of a log from `offset` on; fewer at its end, none of one that has gone."""
        if self._folder is None:
            return b""
        try:
            with (self._folder / name).open("rb") as file:
                file.seek(offset)
                return file.read(count)
        except OSError:
            return b""

    def erase(self) -> None:
        """Remove all that are complete."""
        for path in self._complete():
            path.unlink(missing_ok=True)

    def _complete(self) -> list[Path]:
        if self._folder is None:
            return []
        present = self._being_written()
        return [path for path in sorted(self._folder.glob(_PATTERN)) if path != present]
