"""How MAVLink bytes reach the vehicle: in this process or over UDP."""

import asyncio
import math
import socket
import time
from collections import deque
from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from typing import Protocol, TypeAlias

from sitl.errors import LinkError

Wake: TypeAlias = Callable[[], None]
Chunk: TypeAlias = tuple[bytes, Hashable]  # bytes, and the stream they belong to; None: a datagram
_DATAGRAM = 1400  # bytes; whole frames are packed up to this, below the usual MTU
_BACKLOG = 4096  # chunks or datagrams that wait, or are read at a time, at most
_RECEIVE_BYTES = 2048
# Wall time of silence after which a peer is forgotten; MAVLink has everybody speak each second.
FORGET_S = 60.0


class Link(Protocol):
    """A way for bytes in and out. All but `open` never block and never wait."""

    def open(self, wake: Wake) -> None:
        """Start; `wake` is called in the event loop whenever something has arrived."""

    def receive(self) -> list[Chunk]:
        """What has arrived."""

    def newcomers(self) -> bool:
        """Whether somebody has joined since this was asked last."""

    def send(self, frames: Sequence[bytes]) -> None:
        """Send whole MAVLink frames to everybody on the link."""

    def close(self) -> None:
        """Stop; may be called twice."""


class RawLink:
    """Bytes handed over within the process, for MAVSDK's raw:// connection.

    `feed` may be called from any thread; `send` of the other side is called in the event loop.
    """

    def __init__(self) -> None:
        self._arrived: deque[bytes] = deque(maxlen=_BACKLOG)
        self._send: Callable[[bytes], object] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._wake: Wake | None = None
        self._joined = False

    def attach(self, send: Callable[[bytes], object]) -> None:
        """Hand the vehicle's bytes to `send` from now on."""
        self._send = send
        self._joined = True
        self._notify()

    def detach(self) -> None:
        """The other side is gone; what is sent is dropped."""
        self._send = None

    def feed(self, data: bytes) -> None:
        """Bytes for the vehicle; from any thread."""
        self._arrived.append(data)
        self._notify()

    def _notify(self) -> None:
        loop, wake = self._loop, self._wake
        if loop is not None and wake is not None and not loop.is_closed():
            loop.call_soon_threadsafe(wake)

    def open(self, wake: Wake) -> None:
        self._loop = asyncio.get_running_loop()
        self._wake = wake

    def receive(self) -> list[Chunk]:
        chunks: list[Chunk] = []
        while self._arrived:
            chunks.append((self._arrived.popleft(), None))
        return chunks

    def newcomers(self) -> bool:
        joined, self._joined = self._joined, False
        return joined

    def send(self, frames: Sequence[bytes]) -> None:
        send = self._send
        if send is not None and frames:
            send(b"".join(frames))

    def close(self) -> None:
        self._wake = None
        self._loop = None


class UdpLink:
    """MAVLink over UDP.

    `udpout://host:port` sends to that address, which may be a broadcast one, from a free port;
    `udpin://host:port` listens there and sends to everybody who has spoken in the last minute.
    """

    def __init__(self, url: str) -> None:
        """Check the address; nothing is opened yet.

        Raises:
            LinkError: `url` is neither of the two forms.
        """
        scheme, separator, address = url.partition("://")
        host, colon, port = address.rpartition(":")
        valid = separator and colon and _named(host) and port.isdecimal() and int(port) < 65536
        if scheme not in ("udpin", "udpout") or not valid or (scheme == "udpout" and port == "0"):
            raise LinkError(f"{url}: no UDP address; udpin://HOST:PORT or udpout://HOST:PORT")
        self._url = url
        self._listens = scheme == "udpin"
        self._address = (host, int(port))
        self._peers: dict[tuple[str, int], float] = {}  # wall time at which each was heard
        self._socket: socket.socket | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._joined = False

    @property
    def port(self) -> int:
        """The local port.

        Raises:
            LinkError: the link is not open.
        """
        return int(self._opened().getsockname()[1])

    def open(self, wake: Wake) -> None:
        """Bind and listen.

        Raises:
            LinkError: the address is in use or cannot be had; the message names it.
        """
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.setblocking(False)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            if self._listens:
                sock.bind(self._address)
            else:
                sock.bind(("", 0))
                self._peers[socket.gethostbyname(self._address[0]), self._address[1]] = math.inf
        except OSError as error:
            sock.close()
            raise LinkError(f"{self._url}: cannot be opened: {error.strerror or error}") from None
        self._socket = sock
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(sock.fileno(), wake)

    def receive(self) -> list[Chunk]:
        sock, now = self._opened(), time.monotonic()
        chunks: list[Chunk] = []
        while len(chunks) < _BACKLOG:
            try:
                data, peer = sock.recvfrom(_RECEIVE_BYTES)
            except BlockingIOError:
                break
            except ConnectionError:
                continue  # somebody we sent to is not there (any more)
            if self._listens:
                self._joined |= peer not in self._peers
                self._peers[peer] = now
            chunks.append((data, None))
        self._peers = {p: heard for p, heard in self._peers.items() if now - heard < FORGET_S}
        return chunks

    def newcomers(self) -> bool:
        joined, self._joined = self._joined, False
        return joined

    def send(self, frames: Sequence[bytes]) -> None:
        sock = self._opened()
        for datagram in _packed(frames):
            for peer in self._peers:
                # UDP may lose, also where a network goes away; the protocols above cope.
                with suppress(OSError):
                    sock.sendto(datagram, peer)

    def close(self) -> None:
        if self._socket is not None:
            if self._loop is not None and not self._loop.is_closed():
                self._loop.remove_reader(self._socket.fileno())
            self._socket.close()
            self._socket = None

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise LinkError(f"{self._url}: not open")
        return self._socket


def _named(host: str) -> bool:
    """Whether `host` can be looked up at all: neither empty nor with a label that no name has."""
    try:
        return bool(host.encode("idna"))
    except UnicodeError:
        return False


def _packed(frames: Sequence[bytes]) -> list[bytes]:
    """Whole frames joined into datagrams."""
    datagrams: list[bytes] = []
    pending = b""
    for frame in frames:
        if pending and len(pending) + len(frame) > _DATAGRAM:
            datagrams.append(pending)
            pending = b""
        pending += frame
    return [*datagrams, pending] if pending else datagrams
