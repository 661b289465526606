"""The interface of the firmware bridges, and the sockets that they use."""

import select
import socket
import struct
from abc import ABC, abstractmethod

from flightdyn.plant import Plant
from native.errors import InputError, LinkLostError
from sitl.firmware.native.library import Stepped, Structure

# Wall time that a firmware may take for a tick. On a busy machine it takes long for one now and
# then; one that takes longer than this is stuck.
STALL_S = 10.0
LOOK_S = 0.1  # wall time after which a wait for it looks whether it is to go on
LOOPBACK = "127.0.0.1"


class Bridge(ABC):
    """A simulator link to one firmware: sends sensor readings, steps the plant by its orders."""

    def __init__(self, plant: Plant, link: Structure, port: int) -> None:
        """`link` is the C structure of what is exchanged with the firmware.

        Raises:
            InputError: the plant has no sensors.
        """
        if plant.sensors is None:
            raise InputError(
                "aircraft.sensors.kind = 'perfect': a firmware flies on sensors of its own kind "
                "and takes readings without noise for broken ones; it must be 'realistic'"
            )
        self.plant, self._sensors, self._port = plant, plant.sensors, port
        self._socket: socket.socket | None = None  # on which it listens
        self._stepped = Stepped(plant, plant.sensors.imu, link)
        self.truths = self._stepped.truths  # at the last guidance intervals, as C keeps them

    @property
    def port(self) -> int:
        """The port on which the bridge listens."""
        assert self._socket is not None
        return int(self._socket.getsockname()[1])

    @property
    @abstractmethod
    def connected(self) -> bool:
        """Whether a firmware has connected."""

    def called(self) -> bool:
        """Whether somebody has called whom `rest` would take."""
        assert self._socket is not None
        return bool(select.select([self._socket], [], [], 0.0)[0])

    def deserted(self) -> bool:
        """Whether a firmware has ended whose link does not tell."""
        return False

    @abstractmethod
    def open(self) -> None:
        """Listen for the firmware.

        Raises:
            LinkLostError: the port cannot be had.
        """

    @abstractmethod
    def run(self, ticks: int) -> int:
        """Step the plant at most `ticks` times, each time when the firmware asks for it.

        Returns:
            The number of ticks; 0 if the firmware asked for none for a moment.

        Raises:
            FirmwareError: the firmware runs on a clock of its own.
            FirmwareRestartedError: it has ended or restarted.
        """

    @abstractmethod
    def rest(self) -> None:
        """Wait a moment while time stands still; take what arrives, answer nothing."""

    @abstractmethod
    def close(self) -> None:
        """Stop; may be called twice."""


def bound(kind: socket.SocketKind, port: int) -> socket.socket:
    """A socket on the loopback interface; port 0 takes a free one.

    Raises:
        LinkLostError: the port cannot be had; the message names it.
    """
    sock = socket.socket(socket.AF_INET, kind)
    try:
        if kind is socket.SOCK_STREAM:
            # A port whose last connection has just ended is free.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((LOOPBACK, port))
    except OSError as error:
        sock.close()
        name = "TCP" if kind is socket.SOCK_STREAM else "UDP"
        why = error.strerror or error
        raise LinkLostError(f"{name} port {port}: cannot be had: {why}") from None
    return sock


def give_up_soon(sock: socket.socket) -> None:
    """Let `recv` and `send` raise BlockingIOError after `LOOK_S` without data or room.

    The kernel ends the wait: `socket.settimeout` would take two system calls a datagram.
    """
    timeval = struct.pack("ll", 0, int(LOOK_S * 1e6))
    for wait in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
        sock.setsockopt(socket.SOL_SOCKET, wait, timeval)
