"""MAVLink between a firmware whose clock is ours and ground stations that live in wall time.

Time stands still while devices train and runs many times faster in flight. A ground station sees
neither: while time stands still it goes on to hear the vehicle's last heartbeat, and in flight it
hears the newest of each message, as often as wall time has use for. The firmware in turn hears
the ground station's heartbeat with each of its own, by its own time.
"""

import asyncio
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass
from typing import TypeAlias

from pymavlink.dialects.v20 import common as mav

from flightdyn.physics.power import CELLS
from flightdyn.state import BatteryState
from sitl.autopilot.codec.orders import Fields
from sitl.block import following
from sitl.links import Link

Hear: TypeAlias = Callable[[str, Fields], None]

HEARTBEAT = mav.MAVLINK_MSG_ID_HEARTBEAT
# What a ground station says again and again, and expects no answer to.
CHATTER = frozenset(
    {
        HEARTBEAT,
        mav.MAVLINK_MSG_ID_PING,
        mav.MAVLINK_MSG_ID_TIMESYNC,
        mav.MAVLINK_MSG_ID_MANUAL_CONTROL,
        mav.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE,
        mav.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
    }
)
_EVENT = 410  # of the events interface, not in this dialect
# Of these each one counts; of all others the newest.
EACH_COUNTS = frozenset(
    {
        mav.MAVLINK_MSG_ID_COMMAND_ACK,
        mav.MAVLINK_MSG_ID_STATUSTEXT,
        mav.MAVLINK_MSG_ID_PARAM_VALUE,
        mav.MAVLINK_MSG_ID_PARAM_EXT_VALUE,
        mav.MAVLINK_MSG_ID_PARAM_EXT_ACK,
        mav.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,
        mav.MAVLINK_MSG_ID_MISSION_ITEM,
        mav.MAVLINK_MSG_ID_MISSION_ITEM_INT,
        mav.MAVLINK_MSG_ID_MISSION_REQUEST,
        mav.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        mav.MAVLINK_MSG_ID_MISSION_COUNT,
        mav.MAVLINK_MSG_ID_MISSION_ACK,
        mav.MAVLINK_MSG_ID_MISSION_ITEM_REACHED,
        mav.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
        mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
        mav.MAVLINK_MSG_ID_LOG_ENTRY,
        mav.MAVLINK_MSG_ID_LOG_DATA,
        mav.MAVLINK_MSG_ID_TIMESYNC,
        _EVENT,
    }
)
# Wall time between looks at what has come. To wake up for each datagram would cost more than all
# that is done with it; while a station waits for an answer it is worth that. And the time after
# which stations hear what is newest.
_LOOK_S, _ANSWER_LOOK_S = 0.005, 0.002
_FLUSH_S = 0.02
_LEAST_A = 0.1  # that electronics take while the motors are off
_HEARTBEAT_S = 0.8  # wall time after which the last heartbeat is said again
_ANSWER_S = 0.1  # wall time after a ground station's message that the vehicle answers in


@dataclass(frozen=True, slots=True)
class Packet:
    """One MAVLink message as it travels, whole but not checked."""

    data: bytes
    number: int  # of the message
    system: int
    component: int


def packets(datagram: bytes) -> Iterator[Packet]:
    """Yield the frames in a datagram, up to the first bytes that are no frame."""
    at = 0
    while at + 8 <= len(datagram):
        if datagram[at] == 0xFD and at + 12 <= len(datagram):
            end = at + datagram[at + 1] + (25 if datagram[at + 2] & 1 else 12)
            number = int.from_bytes(datagram[at + 7 : at + 10], "little")
            system, component = datagram[at + 5], datagram[at + 6]
        elif datagram[at] == 0xFE:
            end = at + datagram[at + 1] + 8
            system, component, number = datagram[at + 3 : at + 6]
        else:
            return
        if end > len(datagram):
            return
        yield Packet(datagram[at:end], number, system, component)
        at = end


class Writer:
    """Packs the relay's own messages to the firmware, as the battery component of its vehicle."""

    def __init__(self, system: int) -> None:
        self._mav = mav.MAVLink(None, srcSystem=system, srcComponent=mav.MAV_COMP_ID_BATTERY)

    def battery(self, state: BatteryState, capacity_mah: float) -> bytes:
        """BATTERY_STATUS of a smart battery, with the time that it lasts at the present current."""
        cell = round(state.voltage_v * 1e3 / CELLS)
        left_as = state.remaining * capacity_mah * 3.6
        return self._pack(
            mav.MAVLink_battery_status_message(
                id=0,
                battery_function=mav.MAV_BATTERY_FUNCTION_ALL,
                type=mav.MAV_BATTERY_TYPE_LIPO,
                temperature=2000,
                voltages=[cell] * CELLS + [65535] * (10 - CELLS),
                current_battery=round(state.current_a * 100),
                current_consumed=round(state.consumed_mah),
                energy_consumed=-1,
                battery_remaining=round(100 * state.remaining),
                time_remaining=round(left_as / max(state.current_a, _LEAST_A)),
            )
        )

    def parameter(self, name: str, value: float) -> bytes:
        """PARAM_SET of a number, as ArduPilot reads it."""
        return self._pack(
            mav.MAVLink_param_set_message(0, 0, name.encode(), value, mav.MAV_PARAM_TYPE_REAL32)
        )

    def _pack(self, message: mav.MAVLink_message) -> bytes:
        data = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return data


class Relay:
    """MAVLink relay between a firmware behind a UDP socket and the links of ground stations.

    An asynchronous context manager; its event loop calls `hear` for each message of `heard`.
    """

    def __init__(
        self,
        sock: socket.socket,
        links: Sequence[Link],
        *,
        asked: Callable[[float], None],
        each_beat: Callable[[], bytes],
        hear: Hear,
        heard: frozenset[int],
    ) -> None:
        """`asked(seconds)` is called when a ground station waits that long (wall time) for answers;
        what `each_beat` returns is sent to the firmware with each heartbeat of its own.
        """
        sock.setblocking(False)
        self._socket = sock
        self._links = links
        self._asked, self._each_beat = asked, each_beat
        self._hear, self._heard = hear, heard
        self._parser = mav.MAVLink(None)
        self._firmware: tuple[str, int] | None = None
        self._newest: dict[tuple[int, int], bytes] = {}  # by component and message
        self._vehicle_heartbeat = self._station_heartbeat = b""
        self._beat_at = 0.0  # wall time of the last one handed on
        self._answer_until = 0.0  # wall time up to which a station waits for an answer
        self._open = AsyncExitStack()
        self.vehicle: Packet | None = None  # its first heartbeat

    async def __aenter__(self) -> "Relay":
        """Open the links and begin.

        Raises:
            LinkLostError: one cannot be opened; none is left open.
        """
        async with AsyncExitStack() as opened:
            opened.callback(self._socket.close)
            for link in self._links:
                opened.callback(link.close)
                link.open(self.take_orders)
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

    def listen(self) -> None:
        """Take what the firmware has sent."""
        at_once = []
        while True:
            try:
                datagram, self._firmware = self._socket.recvfrom(65536)
            except (BlockingIOError, ConnectionError):
                break
            for packet in packets(datagram):
                if packet.number in self._heard:
                    self._tell(packet)
                if packet.number == HEARTBEAT and packet.component == 1:
                    self._beat(packet)
                if packet.number in EACH_COUNTS:
                    at_once.append(packet.data)
                else:
                    self._newest[packet.component, packet.number] = packet.data
        if at_once:
            self._to_stations(at_once)

    def _tell(self, packet: Packet) -> None:
        """Hand over a message by its name and fields; a damaged one is dropped."""
        try:
            message = self._parser.decode(bytearray(packet.data))
        except mav.MAVError:
            return
        fields = message.to_dict()
        del fields["mavpackettype"]
        self._hear(message.get_type(), fields)

    def _beat(self, packet: Packet) -> None:
        self.vehicle = self.vehicle or packet
        if packet.data[5:-2] != self._vehicle_heartbeat[5:-2]:  # all but its number: another mode
            self._await_answer()
        self._vehicle_heartbeat = packet.data
        self.to_firmware(self._station_heartbeat + self._each_beat())

    def _await_answer(self) -> None:
        """Be no faster than wall time for a while, so that stations learn what is new."""
        self._asked(_ANSWER_S)
        self._answer_until = asyncio.get_running_loop().time() + _ANSWER_S

    def take_orders(self) -> None:
        """Hand on what ground stations have sent."""
        for link in self._links:
            for _, data in link.receive():
                for packet in packets(data):
                    if packet.number == HEARTBEAT:
                        self._station_heartbeat = packet.data
                    if packet.number not in CHATTER:
                        self._await_answer()
                self.to_firmware(data)

    def _to_stations(self, data: Sequence[bytes]) -> None:
        for link in self._links:
            link.send(data)

    async def _flush_for_ever(self) -> None:
        loop, due = asyncio.get_running_loop(), 0.0
        while True:
            self.take_orders()
            self.listen()
            now = loop.time()
            answers = now < self._answer_until
            if answers or now >= due:
                due = now + _FLUSH_S
                self._flush(now)
            await asyncio.sleep(_ANSWER_LOOK_S if answers else _LOOK_S)

    def _flush(self, now: float) -> None:
        """Tell stations the newest of each message."""
        newest, self._newest = list(self._newest.values()), {}
        if any(data == self._vehicle_heartbeat for data in newest):
            self._beat_at = now
        elif self._vehicle_heartbeat and now - self._beat_at > _HEARTBEAT_S:
            newest.append(self._vehicle_heartbeat)
            self._beat_at = now
        if newest:
            self._to_stations(newest)
