"""Data files: read within bounds, and recognised by the MD5 sums of the official ones.

A gzip file of 4 MB can unpack to 4 GB. Nothing is read beyond what a header has promised, and no
promise beyond `LARGEST_BYTES` is believed. The sums of IDX files are of their content, so that a
recompressed or unpacked file is the same.
"""

import gzip
import hashlib
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from fl.errors import DataDamagedError

LARGEST_BYTES = 2**31  # CIFAR-10 is 0.18e9, MNIST 0.05e9
_PIECE = 1 << 22
UNPACKING_ERRORS = (EOFError, zlib.error, gzip.BadGzipFile)


# MNIST (LeCun, Cortes, Burges) and Fashion-MNIST (Zalando Research).
IDX_MD5: Mapping[str, Mapping[str, str]] = {
    "mnist": {
        "train-images-idx3-ubyte": "6bbc9ace898e44ae57da46a324031adb",
        "train-labels-idx1-ubyte": "a25bea736e30d166cdddb491f175f624",
        "t10k-images-idx3-ubyte": "2646ac647ad5339dbf082846283269ea",
        "t10k-labels-idx1-ubyte": "27ae3e4e09519cfbb04c329615203637",
    },
    "fashion-mnist": {
        "train-images-idx3-ubyte": "f4a8712d7a061bf5bd6d2ca38dc4d50a",
        "train-labels-idx1-ubyte": "9018921c3c673c538a1fc5bad174d6f9",
        "t10k-images-idx3-ubyte": "8181f5470baa50b63fa0f6fddb340f0a",
        "t10k-labels-idx1-ubyte": "15d484375f8d13e6eb1aabb0c3f46965",
    },
}

# CIFAR-10 (Krizhevsky): the two archives, and the batches inside the Python one.
CIFAR_ARCHIVE_MD5: Mapping[str, str] = {
    "cifar-10-python.tar.gz": "c58f30108f718f92721af3b95e74349a",
    "cifar-10-binary.tar.gz": "c32a1d4ab5d03f1284b67883e8d87530",
}
CIFAR_BATCH_MD5: Mapping[str, str] = {
    "data_batch_1": "c99cafc152244af753f735de768cd75f",
    "data_batch_2": "d4bba439e000b95fd0a9bffe97cbabec",
    "data_batch_3": "54ebc095f3ab1f0389bbae665268c751",
    "data_batch_4": "634d18415352ddfa80567beed471001a",
    "data_batch_5": "482c414d41f54cd18b22e5b47cb7c3cb",
    "test_batch": "40351d587109b95175f43aff81a1287e",
}


def md5(data: bytes) -> str:
    """The MD5 sum as published beside data sets; it identifies files, it protects nothing."""
    return hashlib.md5(data, usedforsecurity=False).hexdigest()


def read_up_to(stream: IO[bytes], count: int, *, path: Path | str) -> bytes:
    """Read `count` bytes, or fewer at the end of the stream; memory grows as they come.

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


@contextmanager
def reading(
    path: Path, what: str = "", *damage: type[Exception], how: Callable[[Exception], str] = str
) -> Iterator[None]:
    """Context manager: raise DataDamagedError for errors in the block; `damage` are the format's.

    Raises:
        DataDamagedError: `path` is damaged (`what: how(error)`), unreadable, or exceeds the memory.
    """
    try:
        yield
    except damage as error:
        raise DataDamagedError(path, f"{what}: {how(error)}") from error
    except OSError as error:
        raise DataDamagedError(path, error.strerror or str(error)) from error
    except MemoryError:
        raise DataDamagedError(path, "takes more memory than there is") from None


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
        """The present place, in bytes from the beginning."""
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
