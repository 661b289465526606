"""Live view: the log's topics over a Foxglove WebSocket while the run goes on.

Any page in the user's browser may open a WebSocket to 127.0.0.1, and all that tells it from the
viewer is the Origin that the browser sends. Foxglove's server does not look at it, so `OriginProxy`
does, in front of it.
"""

import logging
import secrets
import socket
import socketserver
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import foxglove
from foxglove.websocket import Capability, ServerListener

from mission.base.console import RunConsole
from mission.base.errors import LinkLostError
from mission.log import topics
from mission.log.sink import Sink, channel, channels
from mission.log.topics import Topic, of_vehicle

# Foxglove's and Lichtblick's web and desktop applications; pages of this machine and programs
# that are no browser (which send no Origin) are let in, too.
ORIGINS = frozenset({"https://app.foxglove.dev", "https://studio.foxglove.dev", "file://"})
_OWN = frozenset({"localhost", "127.0.0.1", "::1"})
_HOST = "127.0.0.1"
_HEAD_BYTES = 8192
_HEAD_S = 10.0  # wall time for the first words of a visitor
_VISITORS = 16
_REFUSAL = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class LiveView:
    """A `Sink` that serves viewers; none has to be there, and a slow one only loses messages.

    Messages carry simulated time, and viewers are told of it, so that they show the run's clock
    whatever its speed.
    """

    def __init__(self, *, port: int) -> None:
        """Start serving; port 0 takes a free one.

        Raises:
            LinkLostError: the port is in use or may not be opened.
        """
        # A viewer that hangs up without a word is no error of the run's.
        logging.getLogger("foxglove.websocket").setLevel(logging.CRITICAL)
        # Kept: channels alone do not keep their context alive, and without it are never announced.
        self._context = foxglove.Context()
        self._channels = channels(self._context)
        self._latched = _Latched(self._channels)
        # Where no page finds it: only the proxy looks at who comes.
        inner = _hidden_address()
        try:
            self._server = foxglove.start_server(
                name="aerofed",
                host=inner,
                port=0,
                capabilities=[Capability.Time],
                server_listener=self._latched,
                context=self._context,
            )
        except RuntimeError as error:
            raise LinkLostError(f"live view: cannot serve on {_HOST}: {error}") from None
        try:
            self._gate = OriginProxy(_HOST, port, upstream=(inner, int(self._server.port)))
        except LinkLostError:
            self._server.stop()
            raise
        self.port = self._gate.port

    @property
    def url(self) -> str:
        """Address of the WebSocket, as Foxglove's "open connection" takes it."""
        return f"ws://{_HOST}:{self.port}"

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None:
        """Send a message to the viewers that have subscribed to its topic."""
        if topic.name not in self._channels:
            self._channels[topic.name] = channel(self._context, topic)
        if topic.latched:
            self._latched.keep(topic.name, t_ns, data)
        if topic is topics.TF:
            self.tell_time(t_ns)
        if self._channels[topic.name].has_sinks():
            self._channels[topic.name].log(data, log_time=t_ns)

    def tell_time(self, t_ns: int) -> None:
        """Tell viewers the simulated time."""
        self._server.broadcast_time(t_ns)

    def of(self, name: str) -> Sink:
        """The `Sink` of one of several aircraft, whose topics carry its name."""
        return _OfOne(self, name)

    def flush(self) -> None:
        """Do nothing: messages are sent as they are written."""

    def close(self) -> None:
        """Stop serving. Closing twice is fine."""
        self._gate.close()
        self._server.stop()


@dataclass(frozen=True)
class _OfOne:
    """One of several aircraft in a live view."""

    view: LiveView
    name: str

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None:
        if topic is topics.TF:  # of a frame that the others have, too; poses say the same
            self.view.tell_time(t_ns)
        else:
            self.view.write(of_vehicle(topic, self.name), t_ns, data)

    def flush(self) -> None:
        self.view.flush()

    def close(self) -> None:
        self.view.close()


def _hidden_address() -> str:
    """Return a loopback address: a random one of 127.0.0.0/8 on Linux, else 127.0.0.1."""
    parts = (secrets.randbelow(254) + 1 for _ in range(3))
    return "127.{}.{}.{}".format(*parts) if sys.platform == "linux" else "127.0.0.1"


@contextmanager
def live_views(console: RunConsole) -> Iterator[tuple[LiveView, ...]]:
    """Context manager: serve the live view that the console asks for, and announce its URL. Gives
    () if the console asks for none.

    Raises:
        LinkLostError: see `LiveView`.
    """
    if console.live_port is None:
        yield ()
        return
    with closing(LiveView(port=console.live_port)) as view:
        console.say(f"live view: open {view.url} in Foxglove")
        yield (view,)


class _Latched(ServerListener):  # type: ignore[misc]  # foxglove is skipped by the type checker
    """Latched topics: a new subscriber is sent their latest messages at once."""

    def __init__(self, channels: dict[str, Any]) -> None:
        self._channels = channels
        self._sent: dict[str, list[tuple[int, bytes]]] = {}
        self._lock = threading.Lock()  # callbacks come from the server's thread

    def keep(self, name: str, t_ns: int, data: bytes) -> None:
        """Store a latched topic's newest message; those of the same instant are kept together."""
        with self._lock:
            before = self._sent.get(name, [])
            self._sent[name] = [item for item in before if item[0] == t_ns] + [(t_ns, data)]

    def on_subscribe(self, _: Any, channel: Any) -> None:
        with self._lock:
            sent = tuple(self._sent.get(channel.topic, ()))
        for t_ns, data in sent:
            # To all who look at this topic: nothing tells which of the library's sinks is whose.
            self._channels[channel.topic].log(data, log_time=t_ns)


def admitted(head: bytes) -> bool:
    """Return whether the head of an HTTP request has an admitted Origin, or none (no browser)."""
    lines = head.decode("latin-1").split("\r\n")[1:]
    fields = [line.partition(":") for line in lines]
    named = [value.strip() for name, _, value in fields if name.strip().lower() == "origin"]
    if not named:
        return True
    try:
        host = urlsplit(named[0]).hostname
    except ValueError:
        return False
    return len(named) == 1 and (named[0] in ORIGINS or host in _OWN)


class OriginProxy(socketserver.ThreadingTCPServer):
    """TCP proxy, in threads, that forwards clients with an admitted Origin to `upstream`."""

    allow_reuse_address = daemon_threads = True

    def __init__(self, host: str, port: int, *, upstream: tuple[str, int]) -> None:
        """Start; port 0 takes a free one.

        Raises:
            LinkLostError: the port is in use or may not be opened.
        """
        self.upstream = upstream
        self.visits: set[socket.socket] = set()
        try:
            super().__init__((host, port), _Visit)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            if "in use" in reason:
                reason = "the port is in use"
            raise LinkLostError(f"live view: cannot serve on {host}:{port}: {reason}") from None
        self.port = int(self.server_address[1])
        threading.Thread(target=self.serve_forever, args=(0.05,), name="live", daemon=True).start()

    def close(self) -> None:
        """Stop, and disconnect all clients. Closing twice is fine."""
        self.shutdown()
        for visit in tuple(self.visits):
            with suppress(OSError):
                visit.shutdown(socket.SHUT_RDWR)
        self.server_close()


class _Visit(socketserver.BaseRequestHandler):
    """A client of the proxy. One that leaves, says nothing or talks nonsense is no error."""

    server: OriginProxy

    def handle(self) -> None:
        self.server.visits.add(self.request)
        with suppress(OSError):
            self._receive(self.request)
        self.server.visits.discard(self.request)

    def _receive(self, client: socket.socket) -> None:
        until_s, head = time.monotonic() + _HEAD_S, b""
        while b"\r\n\r\n" not in head and len(head) <= _HEAD_BYTES:
            client.settimeout(max(0.01, until_s - time.monotonic()))
            if not (data := client.recv(_HEAD_BYTES)):
                return
            head += data
        client.settimeout(None)
        fields, ended, _ = head.partition(b"\r\n\r\n")
        if not ended or not admitted(fields) or len(self.server.visits) > _VISITORS:
            client.sendall(_REFUSAL)
            return
        with socket.create_connection(self.server.upstream) as inner:
            inner.sendall(head)
            back = threading.Thread(target=_pass_on, args=(inner, client), daemon=True)
            back.start()
            _pass_on(client, inner)
            back.join()


def _pass_on(source: socket.socket, target: socket.socket) -> None:
    """Send what comes until one of the two is gone, which is the end of both."""
    with suppress(OSError):
        while data := source.recv(1 << 16):
            target.sendall(data)
    for end in (source, target):
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)
