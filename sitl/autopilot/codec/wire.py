"""Bytes in, messages out, and back: framing, addressing and sequence numbers."""

from pymavlink.dialects.v20 import common as mav


class Wire:
    """The autopilot's end of MAVLink 2: one identity."""

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
        """The frame of a message."""
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
        system = getattr(msg, "target_system", 0)
        component = getattr(msg, "target_component", 0)
        return system in (0, self._system) and component in (0, self._component)


def _parser() -> mav.MAVLink:
    parser = mav.MAVLink(None)
    parser.robust_parsing = True
    return parser
