"""Links and the pace of simulated time."""

import asyncio
import errno
import math
import socket
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from patience import HANG_S
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk
from sitl_mavsdk import HOME, Recorder, make_vehicle, until

from flightdyn.frames import LocalFrame
from native.errors import InputError, LinkLostError
from sitl.autopilot.codec.orders import MissionItem
from sitl.links import FORGET_S, RawLink, TcpLink, UdpLink, _packed, network_link
from sitl.pace import Runs, Simulation
from sitl.vehicle import Vehicle


@pytest.mark.parametrize(
    "url",
    ["", "udp://1.2.3.4:5", "udpin://:14550", "udpin://0.0.0.0:x", "udpin://0.0.0.0:70000",
     "udpout://127.0.0.1:0", "udpin://0.0.0.0", "127.0.0.1:14550", "udpin://a..b:14550",
     f"udpout://{'a' * 64}.org:14550", "tcpin://127.0.0.1:70000", "tcpout://127.0.0.1:0",
     "tcp://:5760", "tcpin:5760"],
)  # fmt: skip
def test_addresses_that_are_none(url: str) -> None:
    with pytest.raises(InputError, match="no address of a link"):
        network_link(url)


def test_a_port_in_use_is_named_and_nothing_stays_open() -> None:
    async def run() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind(("127.0.0.1", 0))
            port = taken.getsockname()[1]
            first = UdpLink("udpin://127.0.0.1:0")
            second = UdpLink(f"udpin://127.0.0.1:{port}")
            with pytest.raises(
                LinkLostError, match=rf"udpin://127\.0\.0\.1:{port}: cannot be opened"
            ):
                async with Simulation(Desk().vehicle, first, second):
                    pass
            with pytest.raises(LinkLostError, match="not open"):
                _ = first.port

    asyncio.run(run())


def test_a_host_without_address_is_named() -> None:
    async def run() -> None:
        link = UdpLink("udpout://no-such-host.invalid:14540")
        with pytest.raises(LinkLostError, match=r"no-such-host\.invalid"):
            link.open(lambda: None)

    asyncio.run(run())


def test_datagrams_hold_whole_frames() -> None:
    frames = [bytes([i]) * 250 for i in range(12)]
    datagrams = _packed(frames)
    assert b"".join(datagrams) == b"".join(frames)
    assert all(len(datagram) % 250 == 0 and len(datagram) <= 1400 for datagram in datagrams)
    assert _packed([]) == []
    ends = [bytes(700), bytes(700), bytes(1), bytes(1399), bytes(2), bytes(1500), bytes(1)]
    assert [len(datagram) for datagram in _packed(ends)] == [1400, 1400, 2, 1500, 1]


@pytest.mark.parametrize(
    ("url", "kind"),
    [("udpin://127.0.0.1:0", UdpLink), ("udpin://0.0.0.0:65535", UdpLink),
     ("udpout://localhost:1", UdpLink), ("udpout://10.0.0.1:65535", UdpLink),
     ("tcpin://127.0.0.1:0", TcpLink), ("tcpout://10.0.0.1:5760", TcpLink),
     ("tcp://10.0.0.1:65535", TcpLink)],
)  # fmt: skip
def test_addresses_at_the_ends_of_what_is_allowed(url: str, kind: type) -> None:
    link = network_link(url)
    assert type(link) is kind
    assert (link.url, link.newcomers()) == (url, False)
    with pytest.raises(LinkLostError, match="not open"):
        link.receive() if kind is UdpLink else link.port
    for wrong in (url.rpartition(":")[0] + ":65536", url.replace("://", ":/")):
        with pytest.raises(InputError, match="no address of a link"):
            network_link(wrong)


def test_a_link_within_the_process_hands_on_both_ways() -> None:
    async def run() -> None:
        wakes, sent, link = list[int](), list[bytes](), RawLink()
        link.feed(b"early")
        link.send([b"to nobody"])
        link.open(lambda: wakes.append(len(wakes)))
        assert not link.newcomers()
        link.attach(sent.append)
        assert (link.newcomers(), link.newcomers()) == (True, False)
        link.feed(b"one")
        link.feed(b"two")
        await asyncio.sleep(0)
        assert wakes == [0, 1, 2]
        assert link.receive() == [(None, b"early"), (None, b"one"), (None, b"two")]
        assert link.receive() == []
        link.send([b"a", b"b"], None)
        link.send([])
        assert sent == [b"ab"]
        for number in range(4097):
            link.feed(bytes([number % 256]))
        await asyncio.sleep(0)
        left = link.receive()
        assert (len(left), left[0]) == (4096, (None, b"\x01"))  # the oldest is lost
        link.detach()
        link.send([b"c"])
        link.close()
        woken = len(wakes)
        link.feed(b"late")
        await asyncio.sleep(0)
        assert sent == [b"ab"]
        assert len(wakes) == woken == 3 + 4097

    asyncio.run(run())


def test_udp_answers_everybody_who_speaks_and_survives_their_leaving() -> None:
    async def run() -> None:
        link = UdpLink("udpin://127.0.0.1:0")
        async with Simulation(Desk().vehicle, link):
            loop = asyncio.get_running_loop()
            station = mav.MAVLink(None, srcSystem=255, srcComponent=190)
            hello = bytes(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(station))
            sockets = []
            for _ in range(2):
                sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                sock.setblocking(False)
                sock.connect(("127.0.0.1", link.port))
                sock.send(hello)
                sockets.append(sock)
            for sock in sockets:
                data = await asyncio.wait_for(loop.sock_recv(sock, 2048), HANG_S)
                assert data[0] == 0xFD
            sockets.pop().close()
            await asyncio.sleep(0.3)
            sockets[0].send(b"\xfd" * 7)  # noise
            sockets[0].send(hello)
            while True:
                data = await asyncio.wait_for(loop.sock_recv(sockets[0], 2048), HANG_S)
                heard = mav.MAVLink(None).parse_buffer(data) or ()
                if any(m.get_type() == "HEARTBEAT" for m in heard):
                    break
            sockets[0].close()

    asyncio.run(run())


def test_whoever_stays_silent_is_forgotten_until_it_speaks(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 0.0
    monkeypatch.setattr("sitl.links.time", SimpleNamespace(monotonic=lambda: now_s))

    async def run() -> None:
        nonlocal now_s
        link, frame = UdpLink("udpin://127.0.0.1:0"), b"frame"
        link.open(lambda: None)
        stays, leaves = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        with stays, leaves:
            for sock in (stays, leaves):
                sock.settimeout(HANG_S)
                sock.connect(("127.0.0.1", link.port))
                sock.send(b"hello")
            assert len(link.receive()) == 2
            assert link.newcomers()
            link.send([frame])
            assert stays.recv(99) == leaves.recv(99) == frame
            now_s += FORGET_S
            stays.send(b"still here")
            assert len(link.receive()) == 1
            assert not link.newcomers()
            link.send([frame])
            assert stays.recv(99) == frame
            leaves.setblocking(False)
            with pytest.raises(BlockingIOError):
                leaves.recv(99)
            leaves.send(b"back")
            assert len(link.receive()) == 1
            assert link.newcomers()
            link.send([frame])
            leaves.settimeout(HANG_S)
            assert leaves.recv(99) == frame
        link.close()

    asyncio.run(run())


def test_whom_a_vehicle_calls_need_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sitl.links.FORGET_S", 0.0)

    async def run() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
            station.bind(("127.0.0.1", 0))
            station.settimeout(HANG_S)
            link = UdpLink(f"udpout://127.0.0.1:{station.getsockname()[1]}")
            link.open(lambda: None)
            assert link.receive() == []
            link.send([b"frame"])
            assert station.recv(99) == b"frame"
            link.close()

    asyncio.run(run())


def test_a_whole_network_may_be_told() -> None:
    async def run() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
            station.bind(("", 0))
            station.setblocking(False)
            link = UdpLink(f"udpout://127.255.255.255:{station.getsockname()[1]}")
            async with Simulation(Desk().vehicle, link):
                loop = asyncio.get_running_loop()
                data = await asyncio.wait_for(loop.sock_recv(station, 2048), HANG_S)
                assert data[0] == 0xFD

    asyncio.run(run())


@pytest.mark.parametrize("number", [errno.EHOSTUNREACH, errno.EACCES, errno.ECONNREFUSED])
def test_what_a_firewall_answers_ends_nothing(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    answers = [OSError(number, "rejected")]

    class Rejected(socket.socket):
        def recvfrom(self, size: int, *_: object) -> tuple[bytes, Any]:
            if answers:
                raise answers.pop()
            return super().recvfrom(size)

    monkeypatch.setattr("sitl.links.socket.socket", Rejected)

    async def run() -> None:
        link = UdpLink("udpin://127.0.0.1:0")
        link.open(lambda: None)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
            station.sendto(b"hello", ("127.0.0.1", link.port))
            assert [data for _, data in link.receive()] == [b"hello"]
        link.close()
        with pytest.raises(LinkLostError, match="not open"):
            link.receive()

    asyncio.run(run())
    assert not answers


def test_a_network_that_goes_away_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    tries = []

    class Unplugged(socket.socket):
        def sendto(self, *_: object) -> int:
            tries.append(desk.vehicle.t_ns)
            raise OSError(errno.ENETUNREACH, "Network is unreachable")

    monkeypatch.setattr("sitl.links.socket.socket", Unplugged)
    desk = Desk()

    async def run() -> None:
        async with (
            Simulation(desk.vehicle, UdpLink("udpout://127.0.0.1:14550"), runs="always"),
            asyncio.timeout(HANG_S),
        ):
            while len(set(tries)) < 3:  # noqa: ASYNC110  time goes on, and so does the talk
                await asyncio.sleep(0.01)

    asyncio.run(run())
    assert tries == sorted(tries)


def test_simulated_time_is_never_faster_than_ordered() -> None:
    async def run() -> tuple[float, float]:
        desk = Desk()
        desk.take_off()
        async with Simulation(desk.vehicle, RawLink(), speed=4.0):
            began, from_ns = time.monotonic(), desk.vehicle.t_ns
            desk.vehicle.autopilot.flight.go_to(desk.mass.frame.to_ned(47.4003, 8.5, 518.0))
            await until(lambda: not desk.vehicle.moving)
            wall = time.monotonic() - began
            sim = (desk.vehicle.t_ns - from_ns) * 1e-9
            return sim, wall

    sim, wall = asyncio.run(run())
    # One stretch of 20 ms is allowed ahead, and the pause after the last one is not waited for.
    assert wall >= sim / 4.0 - 0.045


def test_time_stands_still_unless_something_moves_or_it_runs_freely() -> None:
    async def run(runs: Runs) -> int:
        desk = Desk()
        before = desk.vehicle.t_ns
        async with Simulation(desk.vehicle, RawLink(), speed=5.0, runs=runs):
            if runs == "always":
                await until(lambda: desk.vehicle.t_ns > before)
            else:
                await asyncio.sleep(0.2)
        return desk.vehicle.t_ns - before

    assert asyncio.run(run("moving")) == 0
    assert asyncio.run(run("always")) > 0


def test_an_error_in_the_simulation_ends_whoever_waits_for_it() -> None:
    class BrokenError(Exception):
        pass

    def fail() -> None:
        raise BrokenError("physics")

    async def run() -> None:
        desk = Desk()
        desk.take_off()
        desk.mass.step = fail  # type: ignore[method-assign]
        async with Simulation(desk.vehicle, RawLink()):
            desk.vehicle.autopilot.flight.hold()
            desk.vehicle.autopilot.flight.land()
            try:
                async with asyncio.timeout(HANG_S):
                    await asyncio.Event().wait()
            except TimeoutError:
                hung.append(desk)  # the block's own error gives way to the simulation's

    hung: list[Desk] = []
    with pytest.raises(BrokenError, match="physics"):
        asyncio.run(run())
    assert not hung


def test_an_error_of_the_body_is_its_own() -> None:
    async def run() -> None:
        async with Simulation(Desk().vehicle, RawLink()):
            raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        asyncio.run(run())


def test_being_cancelled_stays_being_cancelled() -> None:
    async def run() -> None:
        async with Simulation(Desk().vehicle, RawLink()):
            await asyncio.sleep(60.0)

    async def cancel() -> None:
        task = asyncio.create_task(run())
        await asyncio.sleep(0.05)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(cancel())


def test_no_speed_but_a_positive_one() -> None:
    for speed in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="must be positive"):
            Simulation(Desk().vehicle, RawLink(), speed=speed)


def test_hovering_while_time_runs_freely() -> None:
    """With ground stations time does not stand still: the real aircraft keeps its place."""
    vehicle = make_vehicle(recorder := Recorder())
    while vehicle.moving:
        vehicle.step()
    assert vehicle.autopilot.flight.arm() is None
    assert vehicle.autopilot.flight.take_off(HOME.alt_msl_m + 12.0) is None
    while vehicle.moving:
        vehicle.step()

    async def run() -> None:
        end_ns = vehicle.t_ns + 30_000_000_000
        async with Simulation(vehicle, RawLink(), runs="always"):
            await until(lambda: vehicle.t_ns > end_ns)

    asyncio.run(run())
    off = [s.belief.pos_ned_m - [0.0, 0.0, -12.0] for s in recorder.samples[-250:]]
    assert max(float(abs(d).max()) for d in off) < 1.5
    assert recorder.samples[-1].mode == "HOLD"


@pytest.mark.parametrize("hold_s", [0.55, 0.61])
def test_strides_tell_the_same_as_step_by_step(hold_s: float) -> None:
    """Corners, waits, a turn on the spot and a landing: every sample and event at its tick."""

    def told(advance: Callable[[Vehicle], bool]) -> list[tuple[object, ...]]:
        vehicle = make_vehicle(recorder := Recorder())
        flight = vehicle.autopilot.flight
        while advance(vehicle):
            pass
        to = LocalFrame(HOME).to_geodetic
        items: list[MissionItem] = []
        for command, params, north, east in (
            (mav.MAV_CMD_NAV_TAKEOFF, (0.0,) * 4, 0.0, 0.0),
            (mav.MAV_CMD_NAV_WAYPOINT, (0.0, 5.0, 0.0, math.nan), 25.0, 0.0),
            (mav.MAV_CMD_NAV_WAYPOINT, (1.37, 5.0, 0.0, math.nan), 25.0, 20.0),
            (mav.MAV_CMD_CONDITION_YAW, (77.0, 0.0, 0.0, 0.0), 0.0, 0.0),
            (mav.MAV_CMD_NAV_WAYPOINT, (0.73, 5.0, 0.0, math.nan), 10.0, 30.0),
            (mav.MAV_CMD_NAV_WAYPOINT, (0.91, 5.0, 0.0, math.nan), 10.0, 10.0),
            (mav.MAV_CMD_NAV_WAYPOINT, (hold_s, 5.0, 0.0, math.nan), 0.0, 10.0),
            (mav.MAV_CMD_NAV_LAND, (0.0,) * 4, 0.0, 10.0),
        ):
            place = to(np.array([north, east, 0.0]))
            items.append(
                MissionItem(
                    len(items), command, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, params,
                    place.lat_deg, place.lon_deg, 15.0,
                )
            )  # fmt: skip
        assert flight.arm() is None
        flight.mission.replace(tuple(items))
        assert flight.fly_mission() is None
        while advance(vehicle):
            pass
        assert flight.mission.current == len(items) - 1
        return [
            *((s.t_ns, *s.truth.pos_ned_m, *s.belief.pos_ned_m) for s in recorder.samples),
            *((e.t_ns, e.text, *e.truth.pos_ned_m) for e in recorder.events),
        ]

    assert told(Vehicle.stride) == told(Vehicle.step)
