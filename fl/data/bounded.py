"""Reading what a file unpacks to, without believing what it says of its size.

A gzip file of 4 MB can unpack to 4 GB. Nothing is read beyond what a header has promised, and no
promise beyond `LARGEST_BYTES` is believed.
"""

import gzip
import zlib
from pathlib import Path
from typing import IO, cast

from fl.errors import DataDamagedError

LARGEST_BYTES = 2**31  # CIFAR-10 is 0.18e9, MNIST 0.05e9
_PIECE = 1 << 22


def read_exactly(stream: IO[bytes], count: int, *, path: Path | str) -> bytes:
    """Read at most `count` bytes, and what is left of them at the end; memory grows as they come.

    Raises:
        DataDamagedError: `count` is beyond `LARGEST_BYTES`.
    """
    if count > LARGEST_BYTES:
        raise DataDamagedError(path, f"promises {count} bytes; at most {LARGEST_BYTES} are read")
    pieces: list[bytes] = []
    left = count
    while left > 0 and (piece := stream.read(min(left, _PIECE))):
        pieces.append(piece)
        left -= len(piece)
    return b"".join(pieces)


def open_maybe_gzipped(path: Path) -> IO[bytes]:
    """The content of a file, unpacked on the way if its name ends in .gz.

    Raises:
        DataDamagedError: it cannot be opened.
    """
    try:
        return cast(IO[bytes], gzip.open(path)) if path.suffix == ".gz" else path.open("rb")
    except OSError as error:
        raise DataDamagedError(path, error.strerror or str(error)) from error


class Bounded:
    """A stream that can be read and sought in, but not beyond `LARGEST_BYTES`."""

    def __init__(self, stream: IO[bytes], *, path: Path) -> None:
        self._stream = stream
        self._path = path

    def read(self, count: int) -> bytes:
        """Read at most `count` bytes. Raises DataDamagedError beyond the bound."""
        self._check(self._stream.tell() + count)
        return self._stream.read(count)

    def seek(self, offset: int) -> int:
        """Go to a place counted from the beginning. Raises DataDamagedError beyond the bound."""
        self._check(offset)
        return self._stream.seek(offset)

    def tell(self) -> int:
        """The present place."""
        return self._stream.tell()

    def exhaust(self) -> None:
        """Read to the end, where compressed streams have their checksum."""
        while self.read(_PIECE):
            pass

    def _check(self, end: int) -> None:
        if end > LARGEST_BYTES + _PIECE:
            raise DataDamagedError(
                self._path, f"unpacks to more than {LARGEST_BYTES} bytes, which is not believed"
            )


UNPACKING_ERRORS = (EOFError, zlib.error, gzip.BadGzipFile)
