"""How MAVLink bytes reach the vehicle: in this process, over UDP or over TCP."""

import asyncio
import math
import socket
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import ClassVar, Protocol, TypeAlias

from native.errors import InputError, LinkLostError
from sitl.autopilot.codec.wire import Seal, whole_frames

Wake: TypeAlias = Callable[[], None]
_DATAGRAM = 1400  # bytes; whole frames are packed up to this, below the usual MTU
_BACKLOG = 4096  # datagrams that wait, or are read at a time, at most
_RECEIVE_BYTES = 2048
# Wall time of silence after which a peer is forgotten; MAVLink has everybody speak each second.
# One on another machine, whose address may be made up, is sent to for a few seconds a word only.
FORGET_S = 60.0
FORGET_REMOTE_S = 10.0
MOST_PEERS = 16
_STREAM_BYTES = 65536  # read from a client at a time
MOST_UNREAD = 2**20  # bytes that a client may leave unread
_CALL_S = 1.0  # wall time between calls to an address where nobody is

Address: TypeAlias = tuple[str, int]
Sender: TypeAlias = Address | socket.socket | None  # on a link; None where there is one only


class Link(Protocol):
    """A transport for MAVLink bytes, in and out. Only `open` may block."""

    def open(self, wake: Wake) -> None:
        """Start; `wake` is called in the event loop whenever something has arrived."""

    def receive(self) -> list[tuple[Sender, bytes]]:
        """Return the datagrams, or the whole frames of a stream, that have arrived, and of whom."""

    def newcomers(self) -> bool:
        """Whether somebody has joined since this was asked last."""

    def send(self, frames: Sequence[bytes], to: Sender = None) -> None:
        """Send whole MAVLink frames to everybody on the link, or to one if that is still there."""

    def close(self) -> None:
        """Stop; may be called twice."""


class RawLink:
    """A link within the process, for MAVSDK's raw:// connection.

    `feed` may be called from any thread; the attached `send` is called in the event loop.
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
        """Drop what is sent from now on, because the other side is gone."""
        self._send = None

    def feed(self, data: bytes) -> None:
        """Pass bytes to the vehicle; may be called from any thread."""
        self._arrived.append(data)
        self._notify()

    def _notify(self) -> None:
        loop, wake = self._loop, self._wake
        if loop is not None and wake is not None and not loop.is_closed():
            loop.call_soon_threadsafe(wake)

    def open(self, wake: Wake) -> None:
        self._loop = asyncio.get_running_loop()
        self._wake = wake

    def receive(self) -> list[tuple[Sender, bytes]]:
        return [(None, self._arrived.popleft()) for _ in range(len(self._arrived))]

    def newcomers(self) -> bool:
        joined, self._joined = self._joined, False
        return joined

    def send(self, frames: Sequence[bytes], to: Sender = None) -> None:
        del to  # there is one only
        send = self._send
        if send is not None and frames:
            send(b"".join(frames))

    def close(self) -> None:
        self._wake = None
        self._loop = None


class _NetworkLink:
    """Base of UDP and TCP links: a checked address, a socket, and who has joined."""

    _SCHEMES: ClassVar[tuple[str, ...]]
    _KIND: ClassVar[socket.SocketKind]

    def __init__(self, url: str, seal: Seal | None = None) -> None:
        """Check the address; nothing is opened yet. With a `seal` all is signed, both ways.

        Raises:
            InputError: `url` is not an address of this kind of link.
        """
        scheme, separator, address = url.partition("://")
        host, colon, port = address.rpartition(":")
        valid = separator and colon and _named(host) and port.isdecimal() and int(port) < 65536
        self._listens = scheme.endswith("in")
        if scheme not in self._SCHEMES or not valid or not (self._listens or int(port)):
            raise InputError(f"{url}: no address of a link")
        self.url = url
        self._seal = seal
        self._address: Address = (host, int(port))
        self._socket: socket.socket | None = None
        self._joined = False

    def open(self, wake: Wake) -> None:
        """Listen or begin to connect; LinkLostError if the address is in use or not available."""
        self._loop, self._wake = asyncio.get_running_loop(), wake
        sock = socket.socket(socket.AF_INET, self._KIND)
        try:
            sock.setblocking(False)
            self._start(sock)
        except OSError as error:
            sock.close()
            why = error.strerror or error
            raise LinkLostError(f"{self.url}: cannot be opened: {why}") from None
        self._socket = sock

    @abstractmethod
    def _start(self, sock: socket.socket) -> None:
        """Bind or connect the socket by the address, and watch it; OSError if that fails."""

    @property
    def port(self) -> int:
        """The local port.

        Raises:
            LinkLostError: the link is not open.
        """
        return int(self._opened().getsockname()[1])

    def newcomers(self) -> bool:
        joined, self._joined = self._joined, False
        return joined

    def close(self) -> None:
        if self._socket is not None:
            self._closed(self._socket)
            self._socket = None

    def _closed(self, sock: socket.socket) -> None:
        """Close a socket that the event loop may watch."""
        if not self._loop.is_closed():
            self._loop.remove_reader(sock.fileno())
        sock.close()

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise LinkLostError(f"{self.url}: not open")
        return self._socket


class UdpLink(_NetworkLink):
    """MAVLink over UDP.

    `udpout://host:port` sends to that address from a free port of the interface that leads there,
    or from `own_port`, and hears nobody else. If it is a broadcast address, whoever answers first
    is the peer. `udpin://host:port` listens there and sends to those who have spoken lately,
    `MOST_PEERS` at most; others are not heard.
    """

    _SCHEMES = ("udpin", "udpout")
    _KIND = socket.SOCK_DGRAM

    def __init__(self, url: str, seal: Seal | None = None, *, own_port: int = 0) -> None:
        super().__init__(url, seal)
        self._own_port = own_port
        self._peers: dict[Address, float] = {}  # wall time at which each was heard
        self._broadcasts = False  # and nobody has answered yet

    def _start(self, sock: socket.socket) -> None:
        if self._listens:
            sock.bind(self._address)
        else:
            peer = (socket.gethostbyname(self._address[0]), self._address[1])
            self._peers[peer] = math.inf
            if self._own_port:
                sock.bind(("", self._own_port))
            self._broadcasts = not _connected(sock, peer)
        self._loop.add_reader(sock.fileno(), self._wake)

    def receive(self) -> list[tuple[Sender, bytes]]:
        sock, now = self._opened(), time.monotonic()
        datagrams: list[tuple[Sender, bytes]] = []
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
                datagrams.append((peer, data))
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

    def send(self, frames: Sequence[bytes], to: Sender = None) -> None:
        sock, peers = self._opened(), [p for p in self._peers if to in (None, p)]
        if self._seal is not None and peers:
            frames = [self._seal.sealed(frame) for frame in frames]
        for datagram in _packed(frames):
            for peer in peers:
                # UDP may lose, also where a network goes away; the protocols above cope.
                with suppress(OSError):
                    sock.sendto(datagram, peer)


class TcpLink(_NetworkLink):
    """MAVLink over TCP.

    `tcpin://host:port` listens there, to `MOST_PEERS` clients at most. `tcpout://host:port`, which
    ArduPilot's tools call `tcp://`, calls that address, each second while nobody is there. Whoever
    leaves `MOST_UNREAD` bytes unread is dropped.
    """

    _SCHEMES = ("tcpin", "tcpout", "tcp")
    _KIND = socket.SOCK_STREAM

    def __init__(self, url: str, seal: Seal | None = None) -> None:
        super().__init__(url, seal)
        self._begun: dict[socket.socket, bytes] = {}  # frames of which more is to come
        self._unsent: dict[socket.socket, bytes] = {}
        self._calls: asyncio.Task[None] | None = None

    def _start(self, sock: socket.socket) -> None:
        if self._listens:
            # Else the port of a vehicle that has just ended is taken for a minute.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind(self._address)
            sock.listen()
            self._loop.add_reader(sock.fileno(), self._accept)
        else:
            peer = (socket.gethostbyname(self._address[0]), self._address[1])
            self._calls = self._loop.create_task(self._call(peer))

    def _accept(self) -> None:
        with suppress(OSError):  # whoever called has gone already
            sock, _ = self._opened().accept()
            if len(self._begun) < MOST_PEERS:
                self._join(sock)
            else:
                sock.close()

    async def _call(self, peer: Address) -> None:
        while True:
            if not self._begun:
                with socket.socket(socket.AF_INET, self._KIND) as sock, suppress(OSError):
                    sock.setblocking(False)
                    await self._loop.sock_connect(sock, peer)
                    self._join(sock.dup())
            await asyncio.sleep(_CALL_S)

    def _join(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._begun[sock] = self._unsent[sock] = b""
        self._loop.add_reader(sock.fileno(), self._wake)
        self._joined = True
        self._wake()

    def _drop(self, sock: socket.socket) -> None:
        del self._begun[sock], self._unsent[sock]
        self._closed(sock)

    def receive(self) -> list[tuple[Sender, bytes]]:
        arrived: list[tuple[Sender, bytes]] = []
        for sock, begun in list(self._begun.items()):
            try:
                data = sock.recv(_STREAM_BYTES)
            except BlockingIOError:
                continue
            except OSError:
                data = b""
            frames, self._begun[sock] = whole_frames(begun + data)
            arrived.append((sock, frames if self._seal is None else self._seal.opened(frames)))
            if not data:
                self._drop(sock)
        return [(sock, frames) for sock, frames in arrived if frames]

    def send(self, frames: Sequence[bytes], to: Sender = None) -> None:
        unsent_of = [(sock, rest) for sock, rest in self._unsent.items() if to in (None, sock)]
        if self._seal is not None and unsent_of:
            frames = [self._seal.sealed(frame) for frame in frames]
        data = b"".join(frames)
        for sock, unsent in unsent_of:
            unsent += data
            with suppress(OSError):  # who has left is told by receiving
                unsent = unsent[sock.send(unsent) :]
            self._unsent[sock] = unsent
            if len(unsent) > MOST_UNREAD:
                self._drop(sock)

    def close(self) -> None:
        if self._calls is not None:
            self._calls.cancel()
        for sock in list(self._begun):
            self._drop(sock)
        super().close()


def network_link(url: str, seal: Seal | None = None, *, own_port: int = 0) -> UdpLink | TcpLink:
    """Create the link for an address; InputError if it is invalid. `own_port`: for UDP only."""
    return TcpLink(url, seal) if url.startswith("tcp") else UdpLink(url, seal, own_port=own_port)


def _connected(sock: socket.socket, peer: Address) -> bool:
    """Connect a UDP socket to its peer; return False if that is a broadcast address.

    Once connected it has the address of the interface that leads there, and hears nobody else.
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
    """Whether `host` can be a host name or address: not empty, and each label valid."""
    try:
        return bool(host.encode("idna"))
    except UnicodeError:
        return False


def _packed(frames: Sequence[bytes]) -> list[bytes]:
    """Join whole frames into datagrams below the usual MTU."""
    datagrams: list[bytes] = []
    pending = b""
    for frame in frames:
        if pending and len(pending) + len(frame) > _DATAGRAM:
            datagrams.append(pending)
            pending = b""
        pending += frame
    return [*datagrams, pending] if pending else datagrams
