"""Messages of fixed shape, many at a time: Foxglove's own encoding, with other numbers put in.

An example is encoded once, with numbers that are found again among its bytes; then each message is
a copy of it with its own numbers in their places. One by one they would cost ten times as much.
"""

import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from foxglove import messages as fox

from mission.base.arrays import Floats, Ints
from mission.log.values import NS_PER_S

Instants = Ints

# Seconds and nanoseconds are varints, seven bits a byte; written with five bytes all numbers fit.
_SECONDS, _NANOSECONDS = 2**32 - 7, 2**28 + 7
_SHIFTS = np.arange(0, 35, 7)
_MORE = np.array([0x80, 0x80, 0x80, 0x80, 0])


class Template:
    """One kind of message with a timestamp and so many numbers."""

    def __init__(
        self, example: Callable[[fox.Timestamp, Sequence[float]], Any], numbers: int
    ) -> None:
        """`example` makes a message of a timestamp and numbers, each of which it uses once."""
        markers = [-1e200 * (number + 1) for number in range(numbers)]
        whole: bytes = example(fox.Timestamp(_SECONDS, _NANOSECONDS), markers).encode()
        self._example = np.frombuffer(whole, dtype=np.uint8)
        places = [whole.index(_varint(value)) for value in (_SECONDS, _NANOSECONDS)]
        self._stamp = np.concatenate([np.arange(at, at + 5) for at in places])
        starts = [whole.index(struct.pack("<d", marker)) for marker in markers]
        self._numbers = np.concatenate([np.arange(at, at + 8) for at in starts])

    def fill(self, t_ns: Instants, numbers: Floats) -> list[bytes]:
        """The messages of instants (n,) >= 0 and numbers (n, k)."""
        count, size = len(t_ns), len(self._example)
        rows = np.empty((count, size), dtype=np.uint8)
        rows[:] = self._example
        stamps = np.stack((t_ns // NS_PER_S, t_ns % NS_PER_S), axis=1)[:, :, None]
        rows[:, self._stamp] = ((stamps >> _SHIFTS) & 0x7F | _MORE).reshape(count, 10)
        rows[:, self._numbers] = np.ascontiguousarray(numbers).view(np.uint8).reshape(count, -1)
        data = rows.tobytes()
        return [data[at : at + size] for at in range(0, count * size, size)]


def _varint(value: int) -> bytes:
    return bytes(((value >> _SHIFTS) & 0x7F | _MORE).tolist())
