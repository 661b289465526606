"""The relay between a firmware's time and a ground station's."""

import asyncio
import socket
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from patience import HANG_S
from pymavlink.dialects.v20 import common as mav

from sitl.firmware.bridge import bound
from sitl.firmware.relay import Packet, Relay, Writer, packets
from sitl.links import RawLink


class Ends:
    """A firmware's UDP end and a ground station's raw end, with the relay between."""

    def __init__(self) -> None:
        self.firmware = bound(socket.SOCK_DGRAM, 0)
        self.firmware.setblocking(False)
        self.link = RawLink()
        self.station: list[Packet] = []
        self.asked: list[float] = []
        self.heard: list[tuple[str, dict[str, Any]]] = []
        ours = bound(socket.SOCK_DGRAM, 0)
        self._to = ours.getsockname()
        self.relay = Relay(
            ours,
            [self.link],
            asked=self.asked.append,
            each_beat=lambda: b"tick",
            hear=lambda name, fields: self.heard.append((name, fields)),
            heard=frozenset({33}),
        )
        self._vehicle = mav.MAVLink(None, srcSystem=1, srcComponent=1)
        self._ground = mav.MAVLink(None, srcSystem=245, srcComponent=190)

    def say(self, *messages: Any) -> None:
        """From the firmware, in one datagram."""
        data = b"".join(bytes(message.pack(self._vehicle)) for message in messages)
        self.firmware.sendto(data, self._to)

    def order(self, message: Any) -> None:
        """From the ground station."""
        self.link.feed(bytes(message.pack(self._ground)))

    def at_firmware(self) -> bytes:
        """What the firmware has been sent since this was asked last."""
        data = b""
        while True:
            try:
                data += self.firmware.recv(65536)
            except BlockingIOError:
                return data

    def numbers(self) -> list[int]:
        return [frame.number for frame in self.station]


HEARTBEAT = mav.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3)


def position(ms: int) -> Any:
    return mav.MAVLink_global_position_int_message(ms, 1, 2, 3, 4, 5, 6, 7, 8)


async def until(met: Callable[[], bool]) -> None:
    while not met():  # noqa: ASYNC110
        await asyncio.sleep(0.005)


def relayed(body: Callable[[Ends], Coroutine[Any, Any, None]]) -> None:
    async def run() -> None:
        ends = Ends()
        ends.link.attach(lambda data: ends.station.extend(packets(data)))
        with ends.firmware:
            async with asyncio.timeout(HANG_S), ends.relay:
                await body(ends)

    asyncio.run(run())


def test_the_vehicle_is_heard_while_its_time_stands_still() -> None:
    async def body(ends: Ends) -> None:
        ends.say(HEARTBEAT)
        await until(lambda: ends.numbers().count(0) >= 3)  # and nothing more was said
        assert len({frame.data for frame in ends.station}) == 1

    relayed(body)


def test_a_station_gets_the_newest_of_telemetry_and_all_of_the_rest() -> None:
    async def body(ends: Ends) -> None:
        texts = [mav.MAVLink_statustext_message(6, f"line {n}".encode()) for n in range(5)]
        ends.say(*(position(ms) for ms in range(100)), *texts, position(100))
        await until(lambda: 33 in ends.numbers())
        assert ends.numbers().count(253) == 5
        assert ends.numbers().count(33) == 1
        assert [fields["time_boot_ms"] for _, fields in ends.heard] == list(range(101))

    relayed(body)


def test_the_firmware_hears_the_station_once_a_second_of_its_own() -> None:
    async def body(ends: Ends) -> None:
        ends.say(HEARTBEAT)
        await until(lambda: bool(ends.at_firmware()))
        ends.order(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        await until(lambda: len(ends.at_firmware()) > 4)
        for _ in range(3):
            ends.say(HEARTBEAT)
            await until(lambda: ends.at_firmware().count(b"tick") == 1)
        assert b"tick" not in ends.at_firmware()  # its second has not passed

    relayed(body)


def test_a_station_that_asks_is_noticed_and_its_chatter_is_not() -> None:
    async def body(ends: Ends) -> None:
        ends.say(HEARTBEAT)
        await until(lambda: bool(ends.at_firmware()))
        ends.order(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        ends.order(mav.MAVLink_ping_message(0, 0, 0, 0))
        await until(lambda: len(ends.at_firmware()) > 0)
        assert len(ends.asked) == 1  # the vehicle is new
        ends.order(mav.MAVLink_mission_count_message(1, 1, 10))
        await until(lambda: len(ends.asked) == 2)

    relayed(body)


def test_time_slows_down_for_stations_to_hear_of_another_mode() -> None:
    async def body(ends: Ends) -> None:
        for mode, told in ((3, 1), (3, 1), (4, 2)):
            ends.say(mav.MAVLink_heartbeat_message(2, 12, 81, mode << 16, 4, 3))
            await until(lambda: b"tick" in ends.at_firmware())
            assert len(ends.asked) == told

    relayed(body)


def test_junk_between_frames_is_dropped() -> None:
    out = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    whole = bytes(HEARTBEAT.pack(out))
    assert [frame.number for frame in packets(whole + b"junk")] == [0]
    assert list(packets(b"\xfd")) == []
    assert list(packets(whole[:-1])) == []


def parsed(data: bytes) -> Any:
    return mav.MAVLink(None).parse_buffer(data)


def test_the_battery_is_said_as_a_part_of_the_vehicle() -> None:
    from flightdyn.state import BatteryState

    data = Writer(7).battery(BatteryState(15.2, 11.0, 1234.0, 0.61), 5000.0)
    (message,) = parsed(data)
    assert (message.get_srcSystem(), message.get_srcComponent()) == (7, 180)
    assert message.voltages[:5] == [3800] * 4 + [65535]
    assert (message.current_battery, message.current_consumed) == (1100, 1234)
    assert message.battery_remaining == 61
    assert message.time_remaining == 998  # 3050 mAh at 11 A; 0 would be read as none left


def test_a_relay_that_fails_ends_the_flight() -> None:
    """Nobody would be told anything any more."""

    def broken(*_: object) -> None:
        raise ZeroDivisionError

    async def body(ends: Ends) -> None:
        ends.relay._hear = broken
        ends.say(position(0))
        await asyncio.Event().wait()

    with pytest.raises(ZeroDivisionError):
        relayed(body)
