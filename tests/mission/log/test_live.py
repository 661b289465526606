"""The live view, watched by a viewer over a real socket."""

import json
import signal
import socket
from pathlib import Path

import foxglove
import pytest
from forked import Forked
from foxglove_client import FoxgloveClient
from patience import HANG_S, until
from serving import free_port
from synthetic_flight import fly_anew

from mission.base.errors import LinkLostError
from mission.log import topics
from mission.log.contents import load
from mission.log.live import LiveView
from mission.log.sink import Sink
from mission.log.topics import TOPICS, Topic


def test_a_viewer_gets_the_messages_that_go_into_the_file(tmp_path: Path) -> None:
    live = LiveView(port=0)
    try:
        with FoxgloveClient(live.port) as viewer:
            channels = viewer.channels()
            assert {t: c["schemaName"] for t, c in channels.items()} == {
                topic.name: topic.schema_name for topic in TOPICS if topic.schema_name
            }
            wanted = [topics.PLAN, topics.ROUNDS, topics.LEARNING, topics.MODE]
            for topic in wanted:
                live.write(topic, 0, b"{}")
            names = {channels[topic.name]["id"]: topic.name for topic in wanted}
            viewer.subscribe(list(names))
            # What was there before comes with the subscription, which is in force from then on.
            assert {names[viewer.message()[0]] for _ in wanted} == set(names.values())
            watched = _Watched(live, viewer, names)
            made = fly_anew(tmp_path, rounds=2, mirrors=[watched])
    finally:
        live.close()
    logged = load(made.log).messages
    expected = [
        (name, message.log_time, message.data)
        for name in names.values()
        for message in logged[name]
    ]
    assert sorted(watched.seen) == sorted(expected)


def test_who_comes_late_gets_plan_devices_and_rounds_at_once(tmp_path: Path) -> None:
    live = LiveView(port=0)
    try:
        made = fly_anew(tmp_path, rounds=2, mirrors=[_NotClosing(live)])
        with FoxgloveClient(live.port) as viewer:
            channels = viewer.channels()
            for topic in ("/plan", "/rounds", "/devices"):
                viewer.subscribe([channels[topic]["id"]])
                number, _, data = viewer.message()
                assert number == channels[topic]["id"]
                assert data == load(made.log).messages[topic][-1].data
            assert json.loads(data)["community"] == list(made.world.community)
    finally:
        live.close()


def test_viewers_are_told_simulated_time(tmp_path: Path) -> None:
    live = LiveView(port=0)
    try:
        with FoxgloveClient(live.port) as viewer:
            viewer.channels()
            made = fly_anew(tmp_path, rounds=1, mirrors=[_NotClosing(live)])
            times = [viewer.server_time() for _ in range(20)]
    finally:
        live.close()
    assert times == sorted(times)
    assert set(times) <= {sample.t_ns for sample in made.samples}


def test_several_aircraft_are_seen_each_under_its_name(tmp_path: Path) -> None:
    live = LiveView(port=0)
    try:
        for name in ("north", "south"):
            (tmp_path / name).mkdir()
            fly_anew(tmp_path / name, rounds=1, mirrors=[_NotClosing(live.of(name))])
        with FoxgloveClient(live.port) as viewer:
            channels = viewer.channels()
    finally:
        live.close()
    for name in ("north", "south"):
        for topic in ("/true/pose", "/flown/path", "/plan/path", "/scene/links", "/rounds"):
            assert channels[f"/{name}{topic}"]["schemaName"] == channels[topic]["schemaName"]
        for topic in ("/scene/devices", "/learning", "/tf"):
            assert f"/{name}{topic}" not in channels


def test_a_used_port_is_named() -> None:
    live = LiveView(port=0)
    try:
        with pytest.raises(LinkLostError, match=rf"127\.0\.0\.1:{live.port}: the port is in use"):
            LiveView(port=live.port)
    finally:
        live.close()
        live.close()
    # The server lets go of its port a little after it was told to stop.
    until(lambda: free(live.port), "the port is not given back")


def free(port: int) -> bool:
    try:
        LiveView(port=port).close()
    except LinkLostError:
        return False
    return True


@pytest.mark.parametrize(
    "origin",
    [None, "https://app.foxglove.dev", "file://", "http://localhost:8080", "http://127.0.0.1"],
)
def test_the_viewer_is_let_in(origin: str | None) -> None:
    live = LiveView(port=0)
    try:
        with FoxgloveClient(live.port, origin=origin) as viewer:
            assert "/plan" in viewer.channels()
    finally:
        live.close()


@pytest.mark.parametrize(
    "origin",
    ["https://evil.example", "null", "https://app.foxglove.dev.evil.example", "http://[",
     "http://localhost.evil.example", "https://app.foxglove.dev\r\nOrigin: https://evil.example"],
)  # fmt: skip
def test_a_page_of_the_web_is_not(origin: str) -> None:
    live = LiveView(port=0)
    try:
        with pytest.raises(ConnectionRefusedError, match="403 Forbidden"):
            FoxgloveClient(live.port, origin=origin)
    finally:
        live.close()


def test_foxglove_s_own_server_lets_every_page_in() -> None:
    """Why it is hidden, and somebody in front of it looks: once this fails, both can go."""
    context = foxglove.Context()
    server = foxglove.start_server(host="127.0.0.1", port=0, context=context)
    try:
        with FoxgloveClient(int(server.port), origin="https://evil.example") as page:
            assert page is not None
    finally:
        server.stop()


@pytest.mark.parametrize("said", [b"", b"\r\n\r\n", b"x" * 20_000, b"GET / HTTP/1.1\r\nOrigin"])
def test_who_talks_nonsense_harms_nobody(said: bytes) -> None:
    live = LiveView(port=0)
    try:
        with socket.create_connection(("127.0.0.1", live.port), timeout=HANG_S) as visitor:
            visitor.sendall(said)
        with FoxgloveClient(live.port) as viewer:
            assert "/plan" in viewer.channels()
    finally:
        live.close()


@pytest.mark.slow
def test_a_flight_is_watched_live(tmp_path: Path) -> None:
    plan, out = tmp_path / "north.waypoints", tmp_path / "out"
    plan.write_text("QGC WPL 110\n" + "0 0 3 16 0 5 0 0 47.402 8.5 50 1\n".replace(" ", "\t"))
    port = free_port(socket.SOCK_STREAM)
    live = ("--live", "--live-port", str(port), "--set", "link.speed=4")
    process = Forked("fly", str(plan), "--out", str(out), *live)
    try:
        until(lambda: process.poll() is not None or answers(port), "nobody serves the live view")
        with FoxgloveClient(port) as viewer:
            channels = viewer.channels()
            names = {channels[name]["id"]: name for name in ("/plan", "/plan/path", "/true/pose")}
            viewer.subscribe(list(names))
            seen: dict[str, bytes] = {}
            while len(seen) < len(names):
                number, _, data = viewer.message()
                seen.setdefault(names[number], data)
        process.send_signal(signal.SIGINT)
        code, printed, _ = process.ended()
    finally:
        process.send_signal(signal.SIGKILL)
    assert code == 130
    first, *_, results, last = printed.splitlines()
    assert first == f"live view: open ws://127.0.0.1:{port} in Foxglove"
    assert (results, last) == (f"results in {out}", "interrupted")
    logged = load(out / "flight.mcap").messages
    assert seen["/plan"] == logged["/plan"][0].data
    assert seen["/plan/path"] == logged["/plan/path"][0].data
    assert seen["/true/pose"] in {message.data for message in logged["/true/pose"]}


def answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


class _Watched:
    """Looks at each message as soon as it was sent: a viewer that falls behind loses some."""

    def __init__(self, live: LiveView, viewer: FoxgloveClient, names: dict[int, str]) -> None:
        self.seen: list[tuple[str, int, bytes]] = []
        self.flush = live.flush
        self._live, self._viewer, self._names = live, viewer, names

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None:
        self._live.write(topic, t_ns, data)
        if topic.name in self._names.values():
            number, seen_ns, seen = self._viewer.message()
            self.seen.append((self._names[number], seen_ns, seen))

    def close(self) -> None:
        """Left to the test."""


class _NotClosing:
    """Lets the log write to the live view, and leaves it open for the test."""

    def __init__(self, live: Sink) -> None:
        self.write = live.write
        self.flush = live.flush

    def close(self) -> None:
        """Left to the test."""
