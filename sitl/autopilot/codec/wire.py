"""Bytes in, values out, and back: framing, addressing and sequence numbers."""

from collections import OrderedDict
from collections.abc import Hashable
from typing import Any

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.decode import decode
from sitl.autopilot.codec.encode import StatusTexts, encode
from sitl.autopilot.codec.instruments import encode_instruments
from sitl.autopilot.codec.message import MavlinkMessage
from sitl.autopilot.codec.telemetry import encode_telemetry
from sitl.autopilot.values import messages as m
from sitl.autopilot.values.enums import Message
from sitl.autopilot.values.snapshot import Dials, Snapshot

_STREAMS_KEPT = 32  # parsers of streams that have not spoken for longest are dropped


class Wire:
    """The autopilot's end of MAVLink 2: one identity, one parser for each stream of bytes."""

    def __init__(self, system: int, component: int) -> None:
        self._system = system
        self._component = component
        self._out = mav.MAVLink(None, srcSystem=system, srcComponent=component)
        self._parsers: OrderedDict[Hashable, Any] = OrderedDict()
        self._texts = StatusTexts()

    def read(self, data: bytes, stream: Hashable = None) -> list[tuple[m.Peer, m.Incoming]]:
        """Messages to this vehicle that `data` completes; damaged and foreign ones are dropped.

        `stream` names the byte stream that `data` goes on with. Without it `data` is a datagram:
        frames are whole in it, and what is not cannot harm the next one.
        """
        received: list[tuple[m.Peer, m.Incoming]] = []
        parser = self._parser(stream)
        messages = parser.parse_buffer(data) or ()
        if stream is None and parser.buf_len() > 0:
            del self._parsers[None]
        for msg in messages:
            if msg.get_type() == "BAD_DATA" or not self._addressed(msg):
                continue
            body = decode(msg)
            if body is not None:
                received.append((m.Peer(msg.get_srcSystem(), msg.get_srcComponent()), body))
        return received

    def frames(self, envelope: m.Envelope) -> list[bytes]:
        """The frames of one message, in order."""
        if isinstance(envelope.body, m.StatusText):
            return [self._pack(msg) for msg in self._texts.encode(envelope.body)]
        return [self._pack(encode(envelope))]

    def telemetry(self, kind: Message, snapshot: Snapshot) -> bytes:
        """The frame of one telemetry message."""
        return self._pack(encode_telemetry(kind, snapshot))

    def instruments(self, kind: Message, snapshot: Snapshot, dials: Dials) -> bytes:
        """The frame of one telemetry message of those that need more than the snapshot."""
        return self._pack(encode_instruments(kind, snapshot, dials))

    def _parser(self, stream: Hashable) -> Any:
        parser = self._parsers.get(stream)
        if parser is None:
            parser = mav.MAVLink(None)
            parser.robust_parsing = True
            self._parsers[stream] = parser
            if len(self._parsers) > _STREAMS_KEPT:
                self._parsers.popitem(last=False)
        self._parsers.move_to_end(stream)
        return parser

    def _addressed(self, msg: MavlinkMessage) -> bool:
        if msg.get_srcSystem() == self._system and msg.get_srcComponent() == self._component:
            return False  # our own words, come back over another link
        if msg.get_msgId() == mav.MAVLINK_MSG_ID_PING and msg.target_system != 0:
            return False  # an answer, and nothing here asks
        system = getattr(msg, "target_system", 0)
        component = getattr(msg, "target_component", 0)
        return system in (0, self._system) and component in (0, self._component)

    def _pack(self, msg: MavlinkMessage) -> bytes:
        frame = bytes(msg.pack(self._out))
        self._out.seq = (self._out.seq + 1) % 256
        return frame
