"""Rate-limited sending of long answers, a few messages at a time."""

import math
from collections.abc import Iterator
from itertools import islice

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import Outbox


class Burst:
    """Sends `at_once` messages of an iterator every `every_s` (s), to spare receive buffers.

    None in place of a message counts as one, and sends nothing: it stands for work done.
    """

    def __init__(self, outbox: Outbox, *, at_once: int, every_s: float) -> None:
        self._outbox = outbox
        self._at_once, self._every_s = at_once, every_s
        self._messages: Iterator[mav.MAVLink_message | None] = iter(())
        self._next = math.inf

    def start(self, messages: Iterator[mav.MAVLink_message | None], now: float) -> None:
        """Send these messages from `now` (s) on, in place of those left."""
        self._messages, self._next = messages, now

    def stop(self) -> None:
        """Drop the messages that are left."""
        self._messages, self._next = iter(()), math.inf

    def poll(self, now: float) -> None:
        """Send the messages that are due at `now` (s)."""
        if now >= self._next:
            made = list(islice(self._messages, self._at_once))
            self._outbox += [message for message in made if message is not None]
            self._next = now + self._every_s if len(made) == self._at_once else math.inf

    def due(self) -> float:
        """Return the time (s) at which `poll` has something to do; infinite for never."""
        return self._next
