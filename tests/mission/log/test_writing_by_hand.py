"""When the log writes what it was told, and whom the live view lets in."""

import socket
import socketserver
import threading
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from patience import HANG_S
from synthetic_flight import AREA, devices

from flightdyn.state import BatteryState, Kinematics
from mission.log import live, writer
from mission.log.topics import Topic
from mission.log.writer import FlightLog
from sitl.observer import VehicleSample


class Spy:
    """A file of a log, or somebody who watches: all that is done with it, in order."""

    def __init__(self, path: Path) -> None:
        self.file = path
        self.done: list[Any] = []

    def write(self, topic: Topic, t_ns: int, _: bytes) -> None:
        if topic.name == "/true/pose":
            self.done.append(t_ns)

    def flush(self) -> None:
        self.done.append("flush")

    def sync(self) -> None:
        self.done.append("sync")

    def close(self) -> None:
        self.done.append("close")

    def attach(self, *_: object) -> None:
        self.done.append("attach")

    def metadata(self, name: str, _: Mapping[str, str]) -> None:
        self.done.append(name)

    def new(self) -> list[Any]:
        done, self.done = self.done, []
        return done


def sample(t_ns: int) -> VehicleSample:
    zero = np.zeros(3)
    state = Kinematics(t_ns, zero, zero, np.array([1.0, 0.0, 0.0, 0.0]), zero)
    return VehicleSample(
        t_ns, state, state, None, BatteryState(22.0, 30.0, 100.0, 0.9), "hold", armed=True
    )


def opened(
    monkeypatch: pytest.MonkeyPatch, wall: SimpleNamespace, **more: Any
) -> tuple[FlightLog, Spy]:
    monkeypatch.setattr(writer, "McapSink", Spy)
    monkeypatch.setattr(writer, "time", SimpleNamespace(monotonic=lambda: wall.s))
    log = FlightLog(Path("x"), area=AREA, devices=devices(np.random.default_rng(1)), **more)
    file = log._mcap
    assert isinstance(file, Spy)
    assert file.new() == ["aerofed", "flush", "attach", "flush"]
    return log, file


S = 10**9


def test_samples_wait_nine_seconds_or_one_of_wall_time(monkeypatch: pytest.MonkeyPatch) -> None:
    wall = SimpleNamespace(s=50.0)
    log, file = opened(monkeypatch, wall, start_ns=4 * S)
    times = [4 * S, 8 * S, 13 * S - 1]
    for t_ns in times:
        log.sampled(sample(t_ns))
    assert file.new() == []
    log.sampled(sample(13 * S))
    assert [each for each in file.new() if each != "flush"] == [*times, 13 * S]
    log.sampled(sample(14 * S))
    wall.s = 50.999
    log.sampled(sample(15 * S))
    assert file.new() == []
    wall.s = 51.0
    log.sampled(sample(16 * S))
    assert [each for each in file.new() if each != "flush"] == [14 * S, 15 * S, 16 * S]
    wall.s = 60.0
    log.sampled(sample(17 * S))
    assert file.new() == []  # the next wait begins with its own first sample
    log.metadata("told", {})
    assert file.new() == [17 * S, "flush", "flush", "told", "flush"]
    log.sampled(sample(18 * S))
    log.close()
    assert file.new() == [18 * S, "flush", "close"]


def test_who_watches_waits_for_nobody_and_a_chunk_is_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    viewer = Spy(Path("y"))
    log, file = opened(monkeypatch, SimpleNamespace(s=0.0), mirrors=[viewer], start_ns=S)
    viewer.new()
    for t_ns, flushed in (
        (S, 0), (2 * S - 1, 0), (2 * S, 1), (3 * S - 1, 0), (5 * S, 1), (5 * S + 1, 0), (6 * S, 1),
    ):  # fmt: skip
        log.sampled(sample(t_ns))
        found = file.new()
        assert found == viewer.new()
        assert t_ns in found
        assert found.count("flush") == flushed


@pytest.mark.parametrize(
    ("head", "admitted"),
    [
        ("GET / HTTP/1.1\r\nHost: x", True),  # no browser
        ("Origin: https://evil.example\r\nHost: x", True),  # the first line is no field
        *(
            (f"GET / HTTP/1.1\r\nHost: x\r\n{field}", True)
            for field in (
                "Origin: https://app.foxglove.dev", "origin:https://studio.foxglove.dev ",
                "ORIGIN : file://", "Origin: http://localhost:8080", "Origin: https://127.0.0.1",
                "Origin: http://[::1]:5000", "X-Origin: https://evil.example",
            )
        ),
        *(
            (f"GET / HTTP/1.1\r\nHost: x\r\n{field}", False)
            for field in (
                "Origin: https://evil.example", "Origin: null", "Origin:", "Origin: http://[bad",
                "Origin: https://localhost.evil.example", "Origin: https://app.foxglove.dev:8",
                "Origin: file://\r\nOrigin: file://", "Origin: https://app.foxglove.dev/",
            )
        ),
    ],
)  # fmt: skip
def test_which_pages_are_let_in(head: str, admitted: bool) -> None:
    assert live.admitted(head.encode("latin-1")) is admitted


class Echo(socketserver.BaseRequestHandler):
    def handle(self) -> None:
        while data := self.request.recv(4096):
            self.request.sendall(data)


def test_sixteen_visitors_and_no_more() -> None:
    said = b"GET / HTTP/1.1\r\n\r\n"
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Echo) as inner:
        inner.daemon_threads = True
        threading.Thread(target=inner.serve_forever, args=(0.01,), daemon=True).start()
        proxy = live.OriginProxy("127.0.0.1", 0, upstream=("127.0.0.1", inner.server_address[1]))
        visitors = []
        for number in range(17):
            visitor = socket.create_connection(("127.0.0.1", proxy.port), timeout=HANG_S)
            visitors.append(visitor)
            visitor.sendall(said)
            answer = visitor.recv(4096)
            assert answer == said if number < 16 else answer.startswith(b"HTTP/1.1 403 Forbidden")
        proxy.close()
        for visitor in visitors:
            while visitor.recv(4096):
                pass  # to the end, which comes for all
            visitor.close()
        inner.shutdown()
