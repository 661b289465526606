"""The same topics as the file, over a Foxglove WebSocket while the run goes on."""

import logging
import secrets
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from threading import Lock
from typing import Any

import foxglove
from foxglove.websocket import Capability, ServerListener

from mission.base.console import RunConsole
from mission.base.errors import LinkLostError
from mission.log import topics
from mission.log.live.gatekeeper import Gatekeeper
from mission.log.topics import TOPICS, Topic

# What somebody who connects in mid-run needs to see at once.
_LATCHED = frozenset(
    topic.name
    for topic in (
        *(topics.DEVICES, topics.PLAN, topics.PLAN_PATH, topics.PLAN_MAP, topics.MODE),
        *(topics.SCENE_GROUND, topics.SCENE_DEVICES, topics.ROUNDS, topics.LEARNING),
        topics.FENCE,
    )
)


class LiveView:
    """A `Sink` that serves viewers; none has to be there, and a slow one only loses messages.

    Messages carry simulated time, and viewers are told of it, so that they show the run's clock
    whatever its speed.
    """

    def __init__(self, *, port: int, host: str = "127.0.0.1") -> None:
        """Start serving; port 0 takes a free one.

        Raises:
            LinkLostError: the port is in use or may not be opened.
        """
        # A viewer that hangs up without a word is no error of the run's.
        logging.getLogger("foxglove.websocket").setLevel(logging.CRITICAL)
        # Kept: channels alone do not keep their context alive, and without it are never announced.
        self._context = foxglove.Context()
        self._channels = {
            topic.name: foxglove.Channel(
                topic.name,
                message_encoding=topic.encoding,
                schema=foxglove.Schema(
                    name=topic.schema_name, encoding=topic.schema_encoding, data=topic.schema
                ),
                context=self._context,
            )
            for topic in TOPICS
        }
        self._latest = _Latest(self._channels)
        # Where no page finds it: only the gatekeeper looks at who comes.
        inner = _hidden_address()
        try:
            self._server = foxglove.start_server(
                name="aerofed",
                host=inner,
                port=0,
                capabilities=[Capability.Time],
                server_listener=self._latest,
                context=self._context,
            )
        except RuntimeError as error:
            raise LinkLostError(f"live view: cannot serve on {host}: {error}") from None
        try:
            self._gate = Gatekeeper(host, port, upstream=(inner, int(self._server.port)))
        except LinkLostError:
            self._server.stop()
            raise
        self.host, self.port = host, self._gate.port

    @property
    def url(self) -> str:
        """What to give Foxglove's "open connection"."""
        return f"ws://{self.host}:{self.port}"

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None:
        """Send to whoever has subscribed."""
        channel = self._channels[topic.name]
        if topic.name in _LATCHED:
            self._latest.keep(topic.name, t_ns, data)
        if topic is topics.TF:
            self._server.broadcast_time(t_ns)
        if channel.has_sinks():
            channel.log(data, log_time=t_ns)

    def flush(self) -> None:
        """Messages go out as they come."""

    def close(self) -> None:
        """Stop serving. Closing twice is fine."""
        self._gate.close()
        self._server.stop()


def _hidden_address() -> str:
    """One of this machine's own addresses; Linux has sixteen million, others one."""
    parts = (secrets.randbelow(254) + 1 for _ in range(3))
    return "127.{}.{}.{}".format(*parts) if sys.platform == "linux" else "127.0.0.1"


@contextmanager
def live_views(console: RunConsole) -> Iterator[tuple[LiveView, ...]]:
    """The view that the console asked for, told to it, while the block runs; none where it asked
    for none.

    Raises:
        LinkLostError: see `LiveView`.
    """
    if console.live_port is None:
        yield ()
        return
    with closing(LiveView(port=console.live_port)) as view:
        console.say(f"live view: open {view.url} in Foxglove")
        yield (view,)


class _Latest(ServerListener):  # type: ignore[misc]  # foxglove is skipped by the type checker
    """Gives a new subscriber what was sent before it came."""

    def __init__(self, channels: dict[str, Any]) -> None:
        self._channels = channels
        self._sent: dict[str, list[tuple[int, bytes]]] = {}
        self._lock = Lock()  # callbacks come from the server's thread

    def keep(self, name: str, t_ns: int, data: bytes) -> None:
        """Keep a message in place of those of an earlier instant; a round has some at one."""
        with self._lock:
            before = self._sent.get(name, [])
            self._sent[name] = [item for item in before if item[0] == t_ns] + [(t_ns, data)]

    def on_subscribe(self, client: Any, channel: Any) -> None:
        with self._lock:
            sent = tuple(self._sent.get(channel.topic, ()))
        for t_ns, data in sent:
            self._channels[channel.topic].log(data, log_time=t_ns, sink_id=client.id)
