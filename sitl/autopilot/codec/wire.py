"""The MAVLink wire format: framing, addressing, sequence numbers and signatures.

Signing: https://mavlink.io/en/guide/message_signing.html. Not by pymavlink: it records a frame's
time stamp before it checks the signature, so that one forged frame from the far future locks out
the station that it imitates; and it accepts unsigned frames of message types it does not know.
"""

import hashlib
import hmac
import time
from collections.abc import Callable

from pymavlink.dialects.v20 import common as mav

from native.errors import InputError

_MARK, _SIGNED = 0xFD, 0x01
_HEADER, _CHECKSUM, _SIGNATURE = 10, 2, 13  # bytes
_LEAST_CHARACTERS = 8
_EPOCH_S = 1_420_070_400  # 1 January 2015, from which signatures count
_TICKS_PER_S = 100_000
_LATE = 60 * _TICKS_PER_S  # a station heard for the first time may be behind by so much


class Wire:
    """Reads and packs MAVLink 2 messages as one system and component."""

    def __init__(self, system: int, component: int) -> None:
        self._system = system
        self._component = component
        self._out = mav.MAVLink(None, srcSystem=system, srcComponent=component)
        self._in = _parser()

    def read(self, datagram: bytes) -> list[mav.MAVLink_message]:
        """Messages to this vehicle in a datagram; damaged and foreign ones are dropped."""
        messages = self._in.parse_buffer(datagram) or ()
        if self._in.buf_len() > 0:
            self._in = _parser()  # what is not whole cannot harm the next one
        return [message for message in messages if self._addressed(message)]

    def pack(self, message: mav.MAVLink_message) -> bytes:
        """The frame of a message, with the vehicle's identity and the next sequence number."""
        frame = bytes(message.pack(self._out))
        self._out.seq = (self._out.seq + 1) % 256
        return frame

    def _addressed(self, msg: mav.MAVLink_message) -> bool:
        if msg.get_type() == "BAD_DATA":
            return False
        if msg.get_srcSystem() == self._system and msg.get_srcComponent() == self._component:
            return False  # our own words, come back over another link
        if isinstance(msg, mav.MAVLink_ping_message) and msg.target_system != 0:
            return False  # an answer, and nothing here asks
        # MANUAL_CONTROL is alone in calling it `target`.
        system = getattr(msg, "target_system", getattr(msg, "target", 0))
        component = getattr(msg, "target_component", 0)
        return system in (0, self._system) and component in (0, self._component)


def whole_frames(data: bytes) -> tuple[bytes, bytes]:
    """Split bytes of a stream into its whole, undamaged frames and the start of the next one."""
    parser = _parser()
    messages = parser.parse_buffer(data) or ()
    frames = [bytes(m.get_msgbuf()) for m in messages if m.get_type() != "BAD_DATA"]
    return b"".join(frames), bytes(parser.buf[parser.buf_index :])


def _parser() -> mav.MAVLink:
    parser = mav.MAVLink(None)
    parser.robust_parsing = True
    return parser


class Seal:
    """Signs the frames sent over one link, and lets in frames signed with the same key."""

    def __init__(self, key: bytes, *, link_id: int, clock: Callable[[], float] = time.time) -> None:
        """`key`: 32 bytes; `clock`: seconds since 1970, for the time stamps that prevent replay."""
        self._key = key
        self._link_id = link_id
        self._clock = clock
        self._last = 0  # time stamp, of ours or believed
        self._heard: dict[tuple[int, int, int], int] = {}  # last time stamp of each stream

    def sealed(self, frame: bytes) -> bytes:
        """A whole MAVLink 2 frame, signed."""
        body = bytearray(frame[: _HEADER + frame[1]])
        body[2] |= _SIGNED
        extra = mav.mavlink_map[int.from_bytes(body[7:10], "little")].crc_extra
        body += mav.x25crc([*body[1:], extra]).crc.to_bytes(2, "little")
        self._last = max(self._last + 1, self._now())
        body += bytes((self._link_id,)) + self._last.to_bytes(6, "little")
        return bytes(body) + self._digest(body)

    def opened(self, data: bytes) -> bytes:
        """Return the frames with a valid signature and a newer time stamp; drop all other bytes."""
        believed: list[bytes] = []
        at = data.find(_MARK)
        while 0 <= at <= len(data) - _HEADER:
            end = at + _HEADER + data[at + 1] + _CHECKSUM + _SIGNATURE
            frame = data[at:end]
            if frame[2] == _SIGNED and end <= len(data) and self._believed(frame):
                believed.append(frame)
                at = data.find(_MARK, end)
            else:
                at = data.find(_MARK, at + 1)
        return b"".join(believed)

    def _believed(self, frame: bytes) -> bool:
        if not hmac.compare_digest(self._digest(frame[:-6]), frame[-6:]):
            return False
        stream = (frame[5], frame[6], frame[-13])
        stamp = int.from_bytes(frame[-12:-6], "little")
        if stamp <= self._heard.get(stream, max(self._last, self._now()) - _LATE):
            return False
        self._heard[stream] = stamp
        self._last = max(self._last, stamp)
        return True

    def _digest(self, content: bytes | bytearray) -> bytes:
        return hashlib.sha256(self._key + content).digest()[:6]

    def _now(self) -> int:
        return round((self._clock() - _EPOCH_S) * _TICKS_PER_S)


def key_of(phrase: str) -> bytes:
    """Derive the signing key from a pass phrase, as ground stations do: its SHA-256.

    Raises:
        InputError: the phrase has fewer than 8 characters.
    """
    if len(phrase) < _LEAST_CHARACTERS:
        raise InputError(f"a signing key of {len(phrase)} characters; at least {_LEAST_CHARACTERS}")
    return hashlib.sha256(phrase.encode()).digest()
