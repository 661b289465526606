"""Whom a link hears, whom it answers, and how signed links tell friend from foe."""

import asyncio
import hashlib
import socket
import time
from collections.abc import Iterator
from typing import Any

import pytest
from patience import HANG_S
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk

from native.errors import InputError
from sitl.autopilot.codec.wire import Seal, key_of
from sitl.links import MOST_PEERS, UdpLink, network_link
from sitl.pace import Simulation

KEY = hashlib.sha256(b"a pass phrase").digest()


@pytest.fixture
def station() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(HANG_S)
        yield sock


def opened(url: str) -> UdpLink:
    link = UdpLink(url)
    link.open(lambda: None)
    return link


def test_a_called_link_lies_on_the_interface_of_its_peer(station: socket.socket) -> None:
    async def run() -> None:
        link = network_link(f"udpout://127.0.0.1:{station.getsockname()[1]}")
        link.open(lambda: None)
        assert link._opened().getsockname()[0] == "127.0.0.1"
        assert link.port >= 1024  # any that is free
        link.close()

    asyncio.run(run())


def test_a_stranger_cannot_speak_to_a_called_link(station: socket.socket) -> None:
    """A stranger's disarm ended a run."""

    async def run() -> None:
        link = opened(f"udpout://127.0.0.1:{station.getsockname()[1]}")
        link.send([b"frame"])
        _, vehicle = station.recvfrom(99)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(b"disarm!", ("127.0.0.1", link.port))
        station.sendto(b"arm", vehicle)
        assert [data for _, data in link.receive()] == [b"arm"]
        link.close()

    asyncio.run(run())


def test_who_answers_a_broadcast_first_is_the_peer() -> None:
    async def run() -> None:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
        ):
            station.bind(("", 0))
            station.settimeout(HANG_S)
            stranger.bind(("127.0.0.1", 0))
            stranger.setblocking(False)
            link = opened(f"udpout://127.255.255.255:{station.getsockname()[1]}")
            link.send([b"anybody?"])
            _, vehicle = station.recvfrom(99)
            station.sendto(b"I", ("127.0.0.1", vehicle[1]))
            stranger.sendto(b"me", ("127.0.0.1", vehicle[1]))
            assert [data for _, data in link.receive()] == [b"I"]
            stranger.sendto(b"me", ("127.0.0.1", vehicle[1]))
            station.sendto(b"again", ("127.0.0.1", vehicle[1]))
            assert [data for _, data in link.receive()] == [b"again"]
            link.send([b"only you"])
            assert station.recv(99) == b"only you"
            with pytest.raises(BlockingIOError):
                stranger.recv(99)
            link.close()

    asyncio.run(run())


def test_a_listening_link_hears_so_many_and_no_more() -> None:
    async def run() -> None:
        link = opened("udpin://127.0.0.1:0")
        sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(MOST_PEERS + 4)]
        for number, sock in enumerate(sockets):
            sock.sendto(bytes([number]), ("127.0.0.1", link.port))
        assert [data[0] for _, data in link.receive()] == list(range(MOST_PEERS))
        link.send([b"frame"])
        for number, sock in enumerate(sockets):
            sock.setblocking(False)
            if number < MOST_PEERS:
                assert sock.recv(99) == b"frame"
            else:
                with pytest.raises(BlockingIOError):
                    sock.recv(99)
            sock.close()
        link.close()

    asyncio.run(run())


def test_who_may_have_borrowed_an_address_is_sent_to_for_seconds_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A datagram with a made-up sender does not start a minute's stream to a victim."""
    link = UdpLink("udpin://127.0.0.1:14550")
    spoken: list[tuple[bytes, tuple[str, int]]] = []
    sent: list[tuple[str, int]] = []

    class Net:
        def recvfrom(self, _: int) -> tuple[bytes, tuple[str, int]]:
            if not spoken:
                raise BlockingIOError
            return spoken.pop()

        def sendto(self, _: bytes, peer: tuple[str, int]) -> None:
            sent.append(peer)

    near, far = ("127.0.0.1", 1), ("192.0.2.7", 1)
    monkeypatch.setattr(link, "_socket", Net())
    clock = iter([0.0, 9.99, 10.0, 59.99, 60.0])
    monkeypatch.setattr("sitl.links.time.monotonic", lambda: next(clock))
    spoken += [(b"x", near), (b"x", far)]
    told = []
    for _ in range(5):
        link.receive()
        sent.clear()
        link.send([b"frame"])
        told.append(set(sent))
    assert told == [{near, far}, {near, far}, {near}, {near}, set()]


# --- signing ------------------------------------------------------------------------------------


def signing_station() -> mav.MAVLink:
    station = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    station.robust_parsing = True
    station.signing.secret_key = KEY
    station.signing.sign_outgoing = True
    station.signing.link_id = 3
    station.signing.timestamp = 1_000 * 100_000
    return station


def hello(station: mav.MAVLink) -> bytes:
    return bytes(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(station))


def seal(*, at_s: float = 1_000.0) -> Seal:
    return Seal(KEY, link_id=1, clock=lambda: 1_420_070_400 + at_s)


def test_what_is_sealed_is_what_pymavlink_believes() -> None:
    desk, station, sealing = Desk(), signing_station(), seal()
    believed: Any = station.parse_buffer
    frames = [frame for _, frame in desk.vehicle.outgoing(desk.now + 10.0)]
    assert len(frames) > 5
    for frame in frames:
        (message,) = believed(sealing.sealed(frame))
        assert message.get_type() != "BAD_DATA"
        assert message.get_signed()
        plain = mav.MAVLink(None).decode(bytearray(frame))
        assert str(message) == str(plain)


def test_what_pymavlink_signs_is_let_in_once() -> None:
    sealing, frame = seal(), hello(signing_station())
    assert sealing.opened(b"noise\xfd" + frame + b"\xfd\xff") == frame
    assert sealing.opened(frame) == b""  # played back


@pytest.mark.parametrize("place", [2, 5, 12, -14, -13, -9, -1])
def test_what_was_altered_or_not_signed_stays_out(place: int) -> None:
    frame = bytearray(hello(signing_station()))
    frame[place] ^= 1
    assert seal().opened(bytes(frame)) == b""
    unsigned = mav.MAVLink(None, srcSystem=255)
    assert seal().opened(hello(unsigned)) == b""
    old = bytes(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(unsigned, force_mavlink1=True))
    assert seal().opened(old) == b""


def test_each_stream_has_a_time_of_its_own() -> None:
    """By system, component and link: what one has sent shuts out no other, nor itself later."""
    sealing, at = seal(), 1_000 * 100_000

    def said(system: int, component: int, link: int, stamp: int) -> bytes:
        station = mav.MAVLink(None, srcSystem=system, srcComponent=component)
        station.signing.secret_key, station.signing.sign_outgoing = KEY, True
        station.signing.link_id, station.signing.timestamp = link, stamp
        return hello(station)

    streams = [(255, 190, 3), (254, 190, 3), (255, 191, 3), (255, 190, 4)]
    for number, stream in enumerate(streams):
        frame = said(*stream, at - number)
        assert sealing.opened(frame) == frame
        assert sealing.opened(said(*stream, at - number)) == b""  # no newer than the last
        later = said(*stream, at - number + 1)
        assert sealing.opened(later) == later


def test_stamps_are_ten_microseconds_and_always_newer() -> None:
    now_s = 1_420_070_400 + 12.34567
    sealing = Seal(KEY, link_id=9, clock=lambda: now_s)
    plain = bytes(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mav.MAVLink(None)))
    stamps = []
    for _ in range(3):
        sealed = sealing.sealed(plain)
        assert (sealed[2], sealed[-13], len(sealed)) == (1, 9, len(plain) + 13)
        stamps.append(int.from_bytes(sealed[-12:-6], "little"))
    assert stamps == [1_234_567, 1_234_568, 1_234_569]


def test_a_forged_frame_of_the_future_shuts_nobody_out() -> None:
    sealing, station = seal(), signing_station()
    forged = bytearray(hello(station))
    forged[-12:-6] = b"\xff" * 6
    assert sealing.opened(bytes(forged)) == b""
    genuine = hello(station)
    assert sealing.opened(genuine) == genuine


def test_a_recording_of_long_ago_is_not_let_in() -> None:
    assert seal(at_s=1_061.0).opened(hello(signing_station())) == b""
    assert seal(at_s=1_059.0).opened(hello(signing_station())) != b""


def test_a_signed_link_obeys_and_answers_by_the_key(station: socket.socket) -> None:
    async def run() -> None:
        desk = Desk()
        url = f"udpout://127.0.0.1:{station.getsockname()[1]}"
        station.setblocking(False)
        link, loop, ours = UdpLink(url, Seal(KEY, link_id=1)), asyncio.get_running_loop(), None
        async with Simulation(desk.vehicle, link):
            ours = signing_station()
            ours.signing.timestamp = seal(at_s=time.time() - 1_420_070_400)._now()
            order = mav.MAVLink_command_long_message(1, 1, mav.MAV_CMD_COMPONENT_ARM_DISARM,
                                                     0, 1, 0, 0, 0, 0, 0, 0)  # fmt: skip
            vehicle = ("127.0.0.1", link.port)
            station.sendto(bytes(order.pack(mav.MAVLink(None, srcSystem=255))), vehicle)
            await asyncio.sleep(0)
            station.sendto(bytes(order.pack(ours)), vehicle)
            acks: list[object] = []
            while not acks:
                data = await asyncio.wait_for(loop.sock_recv(station, 2048), HANG_S)
                heard = ours.parse_buffer(data) or []
                assert all(message.get_signed() for message in heard)
                acks += [m for m in heard if m.get_type() == "COMMAND_ACK"]
            assert len(acks) == 1
            assert desk.mass.armed

    asyncio.run(run())


def test_keys_are_pass_phrases() -> None:
    with pytest.raises(InputError, match="of 5 characters; at least 8"):
        key_of("short")
    assert key_of("a pass phrase") == KEY
