"""Blocking sockets of a bridge, with time-outs that cost no system call of their own."""

import socket
import struct

from sitl.errors import LinkError

LOOPBACK = "127.0.0.1"


def bound(kind: socket.SocketKind, port: int) -> socket.socket:
    """A socket on the loopback interface; port 0 takes a free one.

    Raises:
        LinkError: the port cannot be had; the message names it.
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
        raise LinkError(f"{name} port {port}: cannot be had: {error.strerror or error}") from None
    return sock


def give_up_after(sock: socket.socket, seconds: float) -> None:
    """Let `recv` and `send` raise BlockingIOError after `seconds` without data or room.

    By the kernel: `socket.settimeout` would ask it twice for every datagram.
    """
    whole = int(seconds)
    timeval = struct.pack("ll", whole, int((seconds - whole) * 1e6))
    for wait in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
        sock.setsockopt(socket.SOL_SOCKET, wait, timeval)
