"""The MAVLink log protocol from the vehicle's side: lists, sends and erases flight logs."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import Handlers, Outbox, Peer
from sitl.autopilot.reporter import Reporter
from sitl.logfolder import LogFile, LogFolder

_PART = 90  # bytes of one message
_BURST = 60  # messages sent at a time, so that no receiver's buffer overflows
_BURST_EVERY_S = 0.005
_READ = _PART * _BURST


@dataclass(slots=True)
class _Download:
    log: int
    name: str
    offset: int
    left: int


class LogServer:
    """Serves one download at a time, as PX4 does; a new one ends it."""

    def __init__(
        self, outbox: Outbox, folder: LogFolder, *, reporter: Reporter, armed: Callable[[], bool]
    ) -> None:
        self._outbox = outbox
        self._folder = folder
        self._report = reporter
        self._armed = armed
        self._logs: Sequence[LogFile] = ()  # as listed last: numbers stay what they were
        self._download: _Download | None = None
        self._next_burst = 0.0

    def handlers(self) -> Handlers:
        """Who handles which message."""
        return {
            mav.MAVLink_log_request_list_message: self._list,
            mav.MAVLink_log_request_data_message: self._begin,
            mav.MAVLink_log_request_end_message: self._end,
            mav.MAVLink_log_erase_message: self._erase,
        }

    def poll(self, now: float) -> None:
        """Send the next parts of what is being downloaded."""
        download = self._download
        if download is None or now < self._next_burst:
            return
        self._next_burst = now + _BURST_EVERY_S
        data = self._folder.read(download.name, download.offset, min(_READ, download.left))
        parts = [data[i : i + _PART] for i in range(0, len(data), _PART)]
        ended = len(data) < min(_READ, download.left) or len(data) == download.left
        if ended and len(data) < download.left and len(data) % _PART == 0:
            parts.append(b"")  # the end of the file, where its last part was full
        for part in parts:
            self._outbox.append(_data(download.log, download.offset, part))
            download.offset += len(part)
            download.left -= len(part)
        if ended:
            self._download = None

    def due(self) -> float:
        """When `poll` has something to do; infinite for never."""
        return math.inf if self._download is None else self._next_burst

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
        self._download = _Download(msg.id, self._logs[msg.id].name, msg.ofs, msg.count)
        self._next_burst = now

    def _end(self, _peer: Peer, _msg: mav.MAVLink_message, _now: float) -> None:
        self._download = None

    def _erase(self, _peer: Peer, _msg: mav.MAVLink_message, _now: float) -> None:
        if self._armed():
            self._report.say("Logs are not erased while armed")
            return
        self._download = None
        self._logs = ()
        self._folder.erase()
        self._report.say("Logs erased", mav.MAV_SEVERITY_INFO)


def _data(log: int, offset: int, part: bytes) -> mav.MAVLink_message:
    """LOG_DATA; fewer bytes than one message holds are the end of the log."""
    return mav.MAVLink_log_data_message(log, offset, len(part), list(part.ljust(_PART, b"\0")))
