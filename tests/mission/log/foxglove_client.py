"""A small viewer: enough of RFC 6455 and of Foxglove's protocol to watch the live view."""

import base64
import hashlib
import json
import os
import socket
import struct
from typing import Any, Self

from patience import HANG_S


class FoxgloveClient:
    """Connects, learns the channels, subscribes, and reads messages in order of arrival."""

    def __init__(self, port: int, *, origin: str | None = None) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=HANG_S)
        self._buffer = b""
        key = base64.b64encode(os.urandom(16)).decode()
        self._socket.sendall(
            (
                f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
                f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
                + (f"Origin: {origin}\r\n" if origin else "")
                + "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
            ).encode()
        )
        while b"\r\n\r\n" not in self._buffer:
            data = self._socket.recv(4096)
            if not data:
                raise ConnectionError(self._buffer.decode())
            self._buffer += data
        head, _, self._buffer = self._buffer.partition(b"\r\n\r\n")
        magic = (key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11").encode()
        expected = base64.b64encode(hashlib.sha1(magic).digest())
        if b" 101 " not in head.split(b"\r\n")[0]:
            self._socket.close()
            raise ConnectionRefusedError(head.decode())
        assert expected in head

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def channels(self) -> dict[str, dict[str, Any]]:
        """The channels by topic, once the server has advertised them."""
        while True:
            message = self.json()
            if message["op"] == "advertise":
                return {channel["topic"]: channel for channel in message["channels"]}

    def subscribe(self, channel_ids: list[int]) -> None:
        """Subscribe; a subscription gets the id of its channel."""
        wanted = [{"id": number, "channelId": number} for number in channel_ids]
        self._send(json.dumps({"op": "subscribe", "subscriptions": wanted}).encode(), opcode=1)

    def json(self) -> dict[str, Any]:
        """The next text message."""
        while True:
            opcode, payload = self._frame()
            if opcode == 1:
                return dict(json.loads(payload))

    def message(self) -> tuple[int, int, bytes]:
        """The next message data: subscription, time in ns, payload."""
        while True:
            opcode, payload = self._frame()
            if opcode == 2 and payload[0] == 1:
                subscription, t_ns = struct.unpack_from("<IQ", payload, 1)
                return subscription, t_ns, payload[13:]

    def server_time(self) -> int:
        """The next time that the server tells."""
        while True:
            opcode, payload = self._frame()
            if opcode == 2 and payload[0] == 2:
                return int(struct.unpack_from("<Q", payload, 1)[0])

    def _send(self, payload: bytes, *, opcode: int) -> None:
        mask = os.urandom(4)
        size = (
            bytes([0x80 | len(payload)])
            if len(payload) < 126
            else bytes([0x80 | 126]) + struct.pack(">H", len(payload))
        )
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(payload))
        self._socket.sendall(bytes([0x80 | opcode]) + size + mask + masked)

    def _take(self, count: int) -> bytes:
        while len(self._buffer) < count:
            data = self._socket.recv(1 << 16)
            if not data:
                raise ConnectionError("the server hung up")
            self._buffer += data
        taken, self._buffer = self._buffer[:count], self._buffer[count:]
        return taken

    def _frame(self) -> tuple[int, bytes]:
        first, second = self._take(2)
        length = second & 0x7F
        if length == 126:
            (length,) = struct.unpack(">H", self._take(2))
        elif length == 127:
            (length,) = struct.unpack(">Q", self._take(8))
        return first & 0x0F, self._take(length)
