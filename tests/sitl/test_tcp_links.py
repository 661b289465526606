"""Links over TCP: streams cut anywhere, clients that come, go, shout and never read."""

import asyncio
import hashlib
import random
import socket
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest
from patience import HANG_S
from pymavlink.dialects.v20 import common as mav
from serving import free_port
from sitl_desk import Desk
from sitl_mavsdk import client, make_vehicle, until

from native.errors import LinkLostError
from sitl.autopilot.codec.wire import Seal, whole_frames
from sitl.links import MOST_PEERS, MOST_UNREAD, TcpLink
from sitl.pace import Simulation


def frame(number: int) -> bytes:
    station = mav.MAVLink(None, srcSystem=number, srcComponent=190)
    return bytes(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(station))


def listening(seal: Seal | None = None) -> TcpLink:
    link = TcpLink("tcpin://127.0.0.1:0", seal)
    link.open(lambda: None)
    return link


@contextmanager
def calling(link: TcpLink) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", link.port), HANG_S) as sock:
        yield sock


async def heard(link: TcpLink, count: int) -> bytes:
    """What has been received once it is so many bytes."""
    data = b""

    def enough() -> bool:
        nonlocal data
        data += b"".join(frames for _, frames in link.receive())
        return len(data) >= count

    await until(enough)
    return data


def read(sock: socket.socket, count: int, link: TcpLink) -> bytes:
    """So many bytes that a link has for somebody."""
    data = b""
    while len(data) < count:
        link.send([])
        data += sock.recv(count - len(data))
    return data


def in_loop(test: Callable[[], Coroutine[Any, Any, None]]) -> Callable[[], None]:
    """A test without arguments, run in an event loop."""

    def run() -> None:
        asyncio.run(test())

    run.__name__, run.__doc__ = test.__name__, test.__doc__
    return run


@in_loop
async def test_frames_cut_anywhere_are_put_together_for_each_client() -> None:
    link = listening()
    with calling(link) as one, calling(link) as two:
        await until(lambda: len(link._begun) == 2)
        for first, second in zip(frame(7), frame(8), strict=True):
            assert link.receive() == []
            one.sendall(bytes([first]))
            two.sendall(bytes([second]))
            await asyncio.sleep(0)
        got = await heard(link, 2 * len(frame(7)))
        assert got in (frame(7) + frame(8), frame(8) + frame(7))
        one.sendall(frame(7) * 3 + frame(7)[:5])
        assert await heard(link, 3 * len(frame(7))) == frame(7) * 3
    link.close()


def test_hostile_bytes_cost_no_more_than_the_frames_that_they_swallow() -> None:
    drawn, begun, got = random.Random(1), b"", b""
    for _ in range(300):
        noise = drawn.randbytes(drawn.randrange(400)) + drawn.choice([b"", b"\xfd\xff", b"\xfe"])
        frames, begun = whole_frames(begun + noise + frame(7) * 20)
        assert len(begun) < 300
        got += frames
    assert got.count(frame(7)) > 300 * 5
    # None that pretends to be longer than all that comes waits for ever.
    assert whole_frames(b"\xfd\xff" + frame(7) * 20)[0].endswith(frame(7) * 5)


@in_loop
async def test_clients_come_and_go_and_so_many_are_taken() -> None:
    link = listening()
    sockets = [socket.create_connection(("127.0.0.1", link.port)) for _ in range(MOST_PEERS)]
    await until(lambda: len(link._begun) == MOST_PEERS)
    assert link.newcomers()
    assert not link.newcomers()
    with calling(link) as one_more:
        one_more.setblocking(False)
        assert await asyncio.get_running_loop().sock_recv(one_more, 99) == b""  # turned away
    link.send([frame(1)])
    for sock in sockets:
        sock.settimeout(HANG_S)
        assert sock.recv(99) == frame(1)
    sockets.pop().close()
    await until(lambda: link.receive() == [] and len(link._begun) == MOST_PEERS - 1)
    link.send([frame(1)])
    with calling(link) as next_one:
        await until(link.newcomers)
        link.send([frame(2)])
        assert next_one.recv(99) == frame(2)
    for sock in sockets:
        sock.close()
    link.close()
    link.close()
    with pytest.raises(LinkLostError, match="not open"):
        _ = link.port


@in_loop
async def test_who_never_reads_is_dropped_and_holds_nobody_up() -> None:
    link = listening()
    with calling(link) as deaf, calling(link) as reads:
        await until(lambda: len(link._begun) == 2)
        said, most = b"".join(frame(1) for _ in range(2000)), 0
        for _ in range(1000):  # 42 MB, more than the system takes for somebody
            link.send([said])
            most = max(most, *map(len, link._unsent.values()))
            if len(link._begun) == 1:
                break
            assert read(reads, len(said), link) == said
        assert MOST_UNREAD - len(said) < most <= MOST_UNREAD
        assert read(reads, len(said), link) == said
        with suppress(ConnectionError):  # what it had not read is lost with the link
            while deaf.recv(2**20):
                pass
    link.close()


@in_loop
async def test_who_reads_late_gets_all() -> None:
    link, said = listening(), b""
    with calling(link) as late:
        await until(lambda: bool(link._begun))
        for number in range(1000):
            told = bytes([number % 256]) * 50_000
            link.send([told])
            said += told
            if any(link._unsent.values()):
                break
        assert any(link._unsent.values())
        assert read(late, len(said), link) == said
    link.close()


@in_loop
async def test_who_is_called_may_come_late_and_come_back() -> None:
    with socket.socket() as place:
        place.bind(("127.0.0.1", 0))
        link = TcpLink(f"tcp://127.0.0.1:{place.getsockname()[1]}")
        link.open(lambda: None)
        await asyncio.sleep(0.05)  # nobody takes the first call
        assert not link._begun
        place.listen()
        place.setblocking(False)
        loop = asyncio.get_running_loop()
        for number in (1, 2):
            sock, _ = await asyncio.wait_for(loop.sock_accept(place), HANG_S)
            with sock:
                await until(link.newcomers)
                link.send([frame(number)])
                assert await loop.sock_recv(sock, 99) == frame(number)
                await loop.sock_sendall(sock, frame(9))
                assert await heard(link, len(frame(9))) == frame(9)
            await until(lambda: link.receive() == [] and not link._begun)
        link.close()
        assert link._calls is not None
        with pytest.raises(asyncio.CancelledError):
            await link._calls


@in_loop
async def test_a_signed_link_hears_only_who_has_the_key() -> None:
    key = hashlib.sha256(b"a pass phrase").digest()
    link, ours = listening(Seal(key, link_id=1)), Seal(key, link_id=2)
    with calling(link) as station:
        await until(lambda: bool(link._begun))
        signed = ours.sealed(frame(7))
        station.sendall(frame(7) + signed[:20])
        station.sendall(signed[20:])
        assert await heard(link, len(signed)) == signed
        link.send([frame(1)])
        assert Seal(key, link_id=3).opened(station.recv(99)) != b""
    link.close()


@in_loop
async def test_clients_hear_that_a_link_is_closed() -> None:
    link = listening()
    with calling(link) as sock:
        await until(lambda: bool(link._begun))
        sock.settimeout(HANG_S)
        link.close()
        assert sock.recv(1) == b""


@in_loop
async def test_a_port_in_use_is_named() -> None:
    link = listening()
    other = TcpLink(f"tcpin://127.0.0.1:{link.port}")
    with pytest.raises(
        LinkLostError, match=rf"^tcpin://127\.0\.0\.1:{link.port}: cannot be opened: "
    ):
        other.open(lambda: None)
    link.close()


@in_loop
async def test_time_goes_on_for_a_vehicle_whose_client_never_reads() -> None:
    link = TcpLink("tcpin://127.0.0.1:0")
    desk = Desk()
    async with Simulation(desk.vehicle, link, runs="always"):
        with calling(link):
            await until(lambda: bool(link._begun))
            end_ns = desk.vehicle.t_ns + 60 * 10**9
            await until(lambda: desk.vehicle.t_ns > end_ns)
    assert desk.vehicle.t_ns > end_ns


@pytest.mark.slow
@pytest.mark.parametrize("listens", [True, False])
def test_mavsdk_flies_over_tcp(listens: bool) -> None:
    async def run() -> None:
        vehicle = make_vehicle()
        port = free_port(socket.SOCK_STREAM)
        link = TcpLink(f"{'tcpin' if listens else 'tcpout'}://127.0.0.1:{port}")
        async with client() as mavsdk:
            if not listens:
                await mavsdk.add_any_connection(f"tcpin://127.0.0.1:{port}")
            async with Simulation(vehicle, link, runs="always", speed=20.0):
                if listens:
                    await mavsdk.add_any_connection(f"tcpout://127.0.0.1:{port}")
                assert await mavsdk.first_autopilot(timeout_s=HANG_S) is not None

    asyncio.run(run())
