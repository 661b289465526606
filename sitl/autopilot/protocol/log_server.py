"""The MAVLink log protocol from the vehicle's side: lists, sends and erases flight logs."""

from collections.abc import Callable, Iterator, Sequence

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import Handlers, Outbox, Peer
from sitl.autopilot.protocol.streams import Burst
from sitl.autopilot.reporter import Reporter
from sitl.logfolder import LogFile, LogFolder

_PART = 90  # bytes of one message
_AT_ONCE = 60  # messages


class LogServer:
    """Server of flight logs: one download at a time, as in PX4; a new one ends the one before."""

    def __init__(
        self, outbox: Outbox, folder: LogFolder, *, reporter: Reporter, armed: Callable[[], bool]
    ) -> None:
        self._outbox = outbox
        self._folder = folder
        self._report = reporter
        self._armed = armed
        self._logs: Sequence[LogFile] = ()  # as listed last: numbers stay what they were
        self.burst = Burst(outbox, at_once=_AT_ONCE, every_s=0.005)
        self.handlers: Handlers = {
            mav.MAVLink_log_request_list_message: self._list,
            mav.MAVLink_log_request_data_message: self._begin,
            mav.MAVLink_log_request_end_message: self._end,
            mav.MAVLink_log_erase_message: self._erase,
        }

    def _list(self, _peer: Peer, msg: mav.MAVLink_log_request_list_message, _now: float) -> None:
        if msg.start == 0 or not self._logs:
            self._logs = tuple(self._folder.logs())
        count = len(self._logs)
        if count == 0:
            self._outbox.append(mav.MAVLink_log_entry_message(0, 0, 0, 0, 0))
        for number in range(msg.start, min(msg.end + 1, count)):
            log = self._logs[number]
            size = min(log.size, 2**32 - 1)
            self._outbox.append(
                mav.MAVLink_log_entry_message(number, count, count - 1, log.written_s, size)
            )

    def _begin(self, _peer: Peer, msg: mav.MAVLink_log_request_data_message, now: float) -> None:
        self._logs = self._logs or tuple(self._folder.logs())
        if msg.id >= len(self._logs):
            self._outbox.append(_data(msg.id, msg.ofs, b""))
            return
        parts = self._parts(msg.id, self._logs[msg.id].name, msg.ofs, msg.count)
        self.burst.start(parts, now)

    def _parts(self, log: int, name: str, offset: int, left: int) -> Iterator[mav.MAVLink_message]:
        """LOG_DATA up to the end of what was asked for, or of the file."""
        while left > 0:
            wanted = min(_PART * _AT_ONCE, left)
            data = self._folder.read(name, offset, wanted)
            for at in range(0, len(data), _PART):
                yield _data(log, offset + at, data[at : at + _PART])
            offset, left = offset + len(data), left - len(data)
            if len(data) < wanted:
                if len(data) % _PART == 0:
                    yield _data(log, offset, b"")  # the end of a file whose last part was full
                return

    def _end(self, _peer: Peer, _msg: mav.MAVLink_message, _now: float) -> None:
        self.burst.stop()

    def _erase(self, _peer: Peer, _msg: mav.MAVLink_message, _now: float) -> None:
        if self._armed():
            self._report.say("Logs are not erased while armed")
            return
        self.burst.stop()
        self._logs = ()
        self._folder.erase()
        self._report.say("Logs erased", mav.MAV_SEVERITY_INFO)


def _data(log: int, offset: int, part: bytes) -> mav.MAVLink_message:
    """Build a LOG_DATA message; fewer bytes than it holds mark the end of the log."""
    return mav.MAVLink_log_data_message(log, offset, len(part), list(part.ljust(_PART, b"\0")))
