"""A folder of flight logs on disk, as the log protocol and MAVLink FTP serve it."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from sitl.autopilot.values.files import LogFile

_PATTERN = "*.mcap"


class DiskLogs:
    """The MCAP files of a folder, but for the one that is being written."""

    def __init__(self, folder: Path, *, being_written: Callable[[], Path | None]) -> None:
        self._folder = folder
        self._being_written = being_written

    def logs(self) -> Sequence[LogFile]:
        found: list[LogFile] = []
        for path in self._complete():
            with suppress(OSError):  # removed by somebody meanwhile
                about = path.stat()
                found.append(LogFile(path.name, about.st_size, int(about.st_mtime)))
        return found

    def read(self, name: str, offset: int, count: int) -> bytes:
        try:
            with (self._folder / name).open("rb") as file:
                file.seek(offset)
                return file.read(count)
        except OSError:
            return b""

    def erase(self) -> None:
        for path in self._complete():
            path.unlink(missing_ok=True)

    def _complete(self) -> list[Path]:
        present = self._being_written()
        return [path for path in sorted(self._folder.glob(_PATTERN)) if path != present]
