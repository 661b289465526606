"""How MAVLink bytes reach the vehicle: in this process or over UDP."""

import asyncio
import math
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Protocol, TypeAlias

from sitl.autopilot.codec.wire import Seal
from sitl.errors import LinkError

Wake: TypeAlias = Callable[[], None]
_DATAGRAM = 1400  # bytes; whole frames are packed up to this, below the usual MTU
_BACKLOG = 4096  # datagrams that wait, or are read at a time, at most
_RECEIVE_BYTES = 2048
# Wall time of silence after which a peer is forgotten; MAVLink has everybody speak each second.
# One on another machine, whose address may be made up, is sent to for a few seconds a word only.
FORGET_S = 60.0
FORGET_REMOTE_S = 10.0
MOST_PEERS = 16

Address: TypeAlias = tuple[str, int]


class Link(Protocol):
    """A way for bytes in and out. All but `open` never block and never wait."""

    def open(self, wake: Wake) -> None:
        """Start; `wake` is called in the event loop whenever something has arrived."""

    def receive(self) -> list[bytes]:
        """The datagrams that have arrived."""

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

    def receive(self) -> list[bytes]:
        return [self._arrived.popleft() for _ in range(len(self._arrived))]

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

    `udpout://host:port` sends to that address from a free port of the interface that leads there,
    and hears nobody else. If it is a broadcast address, whoever answers first is the peer.
    `udpin://host:port` listens there and sends to those who have spoken lately, `MOST_PEERS` at
    most; others are not heard.
    """

    def __init__(self, url: str, seal: Seal | None = None, *, own_port: int = 0) -> None:
        """Check the address; nothing is opened yet. With a `seal` all is signed, both ways.

        One that sends does so from `own_port`, or from a free one.

        Raises:
            LinkError: `url` is neither of the two forms.
        """
        scheme, separator, address = url.partition("://")
        host, colon, port = address.rpartition(":")
        valid = separator and colon and _named(host) and port.isdecimal() and int(port) < 65536
        if scheme not in ("udpin", "udpout") or not valid or (scheme == "udpout" and port == "0"):
            raise LinkError(f"{url}: no UDP address; udpin://HOST:PORT or udpout://HOST:PORT")
        self.url = url
        self._seal, self._own_port = seal, own_port
        self._listens = scheme == "udpin"
        self._address: Address = (host, int(port))
        self._peers: dict[Address, float] = {}  # wall time at which each was heard
        self._socket: socket.socket | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._joined = False
        self._broadcasts = False  # and nobody has answered yet

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
            if self._listens:
                sock.bind(self._address)
            else:
                peer = (socket.gethostbyname(self._address[0]), self._address[1])
                self._peers[peer] = math.inf
                if self._own_port:
                    sock.bind(("", self._own_port))
                self._broadcasts = not _connected(sock, peer)
        except OSError as error:
            sock.close()
            raise LinkError(f"{self.url}: cannot be opened: {error.strerror or error}") from None
        self._socket = sock
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(sock.fileno(), wake)

    def receive(self) -> list[bytes]:
        sock, now = self._opened(), time.monotonic()
        datagrams: list[bytes] = []
        for _ in range(_BACKLOG):
            try:
                data, peer = sock.recvfrom(_RECEIVE_BYTES)
            except BlockingIOError:
                break
            except OSError:
                continue  # somebody we sent to is not there (any more), or a firewall's answer
            if self._seal is not None:
                data = self._seal.opened(data)
            if data and self._admits(peer, now):
                datagrams.append(data)
        self._peers = {p: at for p, at in self._peers.items() if now - at < _kept_s(p)}
        return datagrams

    def _admits(self, peer: Address, now: float) -> bool:
        """Whether `peer` is on the link; one that listens is joined by a first datagram."""
        if self._listens:
            new = peer not in self._peers
            if new and len(self._peers) >= MOST_PEERS:
                return False
            self._joined |= new
            self._peers[peer] = now
        elif self._broadcasts:
            self._broadcasts = not _connected(self._opened(), peer)
            self._peers = {peer: math.inf}
        # The system drops strangers once a socket has its peer; those who came before it are left.
        return peer in self._peers

    def newcomers(self) -> bool:
        joined, self._joined = self._joined, False
        return joined

    def send(self, frames: Sequence[bytes]) -> None:
        sock = self._opened()
        if self._seal is not None and self._peers:
            frames = [self._seal.sealed(frame) for frame in frames]
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
            raise LinkError(f"{self.url}: not open")
        return self._socket


def _connected(sock: socket.socket, peer: Address) -> bool:
    """Give a socket its peer, if that is one and not everybody.

    Its own address is then that of the interface which leads there, and it hears nobody else.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 0)
    try:
        sock.connect(peer)
    except PermissionError:  # what the system says to a broadcast address
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        return False
    return True


def _kept_s(peer: Address) -> float:
    return FORGET_S if peer[0].startswith("127.") else FORGET_REMOTE_S


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
