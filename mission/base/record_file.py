"""Files that grow while a run goes on, and that nobody else may touch meanwhile."""

import os
from pathlib import Path

from mission.base.errors import InputError


class RecordFile:
    """An append-only file that starts empty; what was flushed survives this process.

    It serves as a binary stream. Writing and flushing raise nothing: `check` does, for them and
    for what other programs did to the file.
    """

    def __init__(self, path: Path) -> None:
        """Start the file, replacing one that is there.

        Raises:
            InputError: it cannot be written.
        """
        self.path = path
        self.size = 0  # bytes that were written
        self._failure: OSError | None = None
        try:
            # At its end wherever that is: past the end of a file that was cut, it would be as long
            # as it should be, with a hole.
            self._file = open(path, "wb", opener=_appending)  # noqa: SIM115
        except OSError as error:
            raise self._unwritable(error) from None

    def write(self, data: bytes) -> int:
        self.size += len(data)
        try:
            self._file.write(data)
        except OSError as error:
            self._failure = self._failure or error
        return len(data)

    def flush(self) -> None:
        """Hand everything to the operating system."""
        try:
            self._file.flush()
        except OSError as error:
            self._failure = self._failure or error

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Return the position, always the end; the arguments are ignored."""
        del offset, whence
        return self.size

    def sync(self) -> None:
        """Hand everything to the disk itself, so that it survives a power loss."""
        self.flush()
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            self._failure = self._failure or error

    def check(self) -> None:
        """Make sure that all that was flushed is in the file, also after it was closed.

        Raises:
            InputError: it could not be written, or somebody else deleted or changed it.
        """
        if self._failure is not None:
            raise self._unwritable(self._failure)
        try:
            size = self.path.stat().st_size
        except OSError as error:
            raise InputError(
                f"{self.path}: deleted or moved by another program while the run wrote it "
                f"({error.strerror})"
            ) from None
        if size != self.size:
            raise InputError(
                f"{self.path}: changed by another program while the run wrote it: it has {size} "
                f"bytes, and {self.size} were written"
            )

    def close(self) -> None:
        """Close the file. Closing twice is fine."""
        try:
            self._file.close()
        except OSError as error:
            self._failure = self._failure or error

    def _unwritable(self, error: OSError) -> InputError:
        return InputError(f"{self.path}: cannot write: {error.strerror}")


def _appending(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_APPEND, 0o666)
