"""Bytes in, messages out, and back: framing, addressing and sequence numbers."""

from collections import OrderedDict
from collections.abc import Hashable

from pymavlink.dialects.v20 import common as mav

_STREAMS_KEPT = 32  # parsers of streams that have not spoken for longest are dropped


class Wire:
    """The autopilot's end of MAVLink 2: one identity, one parser for each stream of bytes."""

    def __init__(self, system: int, component: int) -> None:
        self._system = system
        self._component = component
        self._out = mav.MAVLink(None, srcSystem=system, srcComponent=component)
        self._parsers: OrderedDict[Hashable, mav.MAVLink] = OrderedDict()

    def read(self, data: bytes, stream: Hashable = None) -> list[mav.MAVLink_message]:
        """Messages to this vehicle that `data` completes; damaged and foreign ones are dropped.

        `stream` names the byte stream that `data` goes on with. Without it `data` is a datagram:
        frames are whole in it, and what is not cannot harm the next one.
        """
        parser = self._parser(stream)
        messages = parser.parse_buffer(data) or ()
        if stream is None and parser.buf_len() > 0:
            del self._parsers[None]
        return [msg for msg in messages if self._addressed(msg)]

    def pack(self, message: mav.MAVLink_message) -> bytes:
        """The frame of a message."""
        frame = bytes(message.pack(self._out))
        self._out.seq = (self._out.seq + 1) % 256
        return frame

    def _parser(self, stream: Hashable) -> mav.MAVLink:
        parser = self._parsers.get(stream)
        if parser is None:
            parser = mav.MAVLink(None)
            parser.robust_parsing = True
            self._parsers[stream] = parser
            if len(self._parsers) > _STREAMS_KEPT:
                self._parsers.popitem(last=False)
        self._parsers.move_to_end(stream)
        return parser

    def _addressed(self, msg: mav.MAVLink_message) -> bool:
        if msg.get_type() == "BAD_DATA":
            return False
        if msg.get_srcSystem() == self._system and msg.get_srcComponent() == self._component:
            return False  # our own words, come back over another link
        if isinstance(msg, mav.MAVLink_ping_message) and msg.target_system != 0:
            return False  # an answer, and nothing here asks
        system = getattr(msg, "target_system", 0)
        component = getattr(msg, "target_component", 0)
        return system in (0, self._system) and component in (0, self._component)
