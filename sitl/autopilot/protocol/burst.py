"""Long answers, a few messages at a time."""

import math
from collections.abc import Iterator
from itertools import islice

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import Outbox


class Burst:
    """Sends messages as they are made, so many every so often: no receiver's buffer overflows.

    None stands for as much work as a message is, with nothing to be sent.
    """

    def __init__(self, outbox: Outbox, *, at_once: int, every_s: float) -> None:
        self._outbox = outbox
        self._at_once, self._every_s = at_once, every_s
        self._messages: Iterator[mav.MAVLink_message | None] = iter(())
        self._next = math.inf

    def start(self, messages: Iterator[mav.MAVLink_message | None], now: float) -> None:
        """Send these from now on, and no others."""
        self._messages, self._next = messages, now

    def stop(self) -> None:
        """Drop the messages that are left."""
        self._messages, self._next = iter(()), math.inf

    def poll(self, now: float) -> None:
        """Send what is due."""
        if now >= self._next:
            made = list(islice(self._messages, self._at_once))
            self._outbox += [message for message in made if message is not None]
            self._next = now + self._every_s if len(made) == self._at_once else math.inf

    def due(self) -> float:
        """When `poll` has something to do; infinite for never."""
        return self._next
