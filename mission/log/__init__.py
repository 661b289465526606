"""The flight log, an MCAP file: writing, reading, verification, recovery, export, live view.

`writer` records a run, `reader` gives it back as values, `contents` saves what a
killed run had flushed, `live` serves the same topics to Foxglove while the run goes on.
"""

import struct
import zlib
from pathlib import Path

from mission.base.errors import InputError

# What values that are not what they should be make decoders, Python and NumPy raise.
SPOILT = (
    *(ValueError, TypeError, LookupError, AttributeError, AssertionError, ArithmeticError),
    *(EOFError, struct.error, zlib.error, RecursionError),
)


class LogError(InputError):
    """The file is not a log that this program can use."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: {reason}")


class ForeignLogError(LogError):
    """The file is not an MCAP file, or not a flight log that this version can decode."""


class DamagedLogError(LogError):
    """Cut short or altered; `offset` is the first byte that is not sound."""

    def __init__(self, path: Path, reason: str, offset: int) -> None:
        super().__init__(
            path,
            f"damaged at byte {offset}: {reason} "
            f"(`aerofed log recover {path}` keeps everything that is sound)",
        )
