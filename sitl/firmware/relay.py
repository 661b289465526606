"""MAVLink between a firmware whose clock is ours and ground stations that live in wall time.

Time stands still while devices train and runs many times faster in flight. A ground station sees
neither: while time stands still it goes on to hear the vehicle's last heartbeat, and in flight it
hears the newest of each message, as often as wall time has use for. The firmware in turn hears
the ground station's heartbeat once a second of its own time.
"""

import asyncio
import socket
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack, suppress
from typing import TypeAlias

from sitl.autopilot.codec.orders import Fields
from sitl.block import following
from sitl.firmware.frames import CHATTER, EACH_COUNTS, HEARTBEAT, Frame, Reader, frames
from sitl.links import Link

Hear: TypeAlias = Callable[[str, Fields], None]

# Wall time between looks at what has come. To wake up for each datagram would cost more than all
# that is done with it; while a station waits for an answer it is worth that.
_FLUSH_S, _ANSWER_FLUSH_S = 0.02, 0.002
_HEARTBEAT_S = 0.8  # wall time after which the last heartbeat is said again
_ANSWER_S = 0.1  # wall time after a ground station's message that the vehicle answers in


class Relay:
    """Between one firmware behind a UDP socket and the links of ground stations.

    An asynchronous context manager, in whose loop `hear` gets each message of `heard`.
    """

    def __init__(
        self,
        sock: socket.socket,
        links: Sequence[Link],
        *,
        asked: Callable[[float], None],
        each_second: Callable[[], bytes],
        hear: Hear,
        heard: frozenset[int],
    ) -> None:
        """`asked` is told for how long (wall s) a ground station waits for answers; what
        `each_second` returns goes to the firmware once a second of its time.
        """
        sock.setblocking(False)
        self._socket = sock
        self._links = links
        self._asked, self._each_second = asked, each_second
        self._hear, self._heard = hear, heard
        self._reader = Reader()
        self._firmware: tuple[str, int] | None = None
        self._newest: dict[tuple[int, int], bytes] = {}  # by component and message
        self._vehicle_heartbeat = self._station_heartbeat = b""
        self._beat_at = 0.0  # wall time of the last one handed on
        self._answer_until = 0.0  # wall time up to which a station waits for an answer
        self._open = AsyncExitStack()
        self.vehicle: Frame | None = None  # its first heartbeat

    async def __aenter__(self) -> "Relay":
        """Open the links and begin.

        Raises:
            LinkError: one cannot be opened; none is left open.
        """
        async with AsyncExitStack() as opened:
            opened.callback(self._socket.close)
            for link in self._links:
                opened.callback(link.close)
                link.open(self._from_stations)
            await opened.enter_async_context(following(self._flush_for_ever(), name="relay"))
            self._open = opened.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close all; an error of the relay ends the block that it failed in."""
        await self._open.aclose()

    def to_firmware(self, data: bytes) -> None:
        """Send to the firmware, once it has spoken; UDP may lose it, and the kernel be full."""
        if self._firmware is not None:
            with suppress(BlockingIOError, ConnectionError):
                self._socket.sendto(data, self._firmware)

    def _from_firmware(self) -> None:
        at_once = []
        while True:
            try:
                datagram, self._firmware = self._socket.recvfrom(65536)
            except (BlockingIOError, ConnectionError):
                break
            for frame in frames(datagram):
                if frame.number in self._heard:
                    message = self._reader.read(frame)
                    if message is not None:
                        self._hear(*message)
                if frame.number == HEARTBEAT and frame.component == 1:
                    self._beat(frame)
                if frame.number in EACH_COUNTS:
                    at_once.append(frame.data)
                else:
                    self._newest[frame.component, frame.number] = frame.data
        if at_once:
            self._to_stations(at_once)

    def _beat(self, frame: Frame) -> None:
        self.vehicle = self.vehicle or frame
        self._vehicle_heartbeat = frame.data
        self.to_firmware(self._station_heartbeat + self._each_second())

    def _from_stations(self) -> None:
        for link in self._links:
            for data, _ in link.receive():
                for frame in frames(data):
                    if frame.number == HEARTBEAT:
                        self._station_heartbeat = frame.data
                    if frame.number not in CHATTER:
                        self._asked(_ANSWER_S)
                        self._answer_until = asyncio.get_running_loop().time() + _ANSWER_S
                self.to_firmware(data)

    def _to_stations(self, data: Sequence[bytes]) -> None:
        for link in self._links:
            link.send(data)

    async def _flush_for_ever(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self._from_stations()
            self._from_firmware()
            newest, self._newest = list(self._newest.values()), {}
            now = loop.time()
            if any(data == self._vehicle_heartbeat for data in newest):
                self._beat_at = now
            elif self._vehicle_heartbeat and now - self._beat_at > _HEARTBEAT_S:
                newest.append(self._vehicle_heartbeat)
                self._beat_at = now
            if newest:
                self._to_stations(newest)
            await asyncio.sleep(_ANSWER_FLUSH_S if now < self._answer_until else _FLUSH_S)
