"""The MAVLink log protocol from the vehicle's side: lists, sends and erases flight logs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sitl.autopilot.reporter import Reporter
from sitl.autopilot.values import messages as m
from sitl.autopilot.values.enums import Severity
from sitl.autopilot.values.files import (
    LogData,
    LogEntry,
    LogErase,
    LogFile,
    LogFolder,
    LogRequestData,
    LogRequestEnd,
    LogRequestList,
)

_PART = 90  # bytes of one message
_BURST = 60  # messages sent at a time, so that no receiver's buffer overflows
_BURST_EVERY_S = 0.005
_READ = _PART * _BURST


@dataclass(slots=True)
class _Download:
    peer: m.Peer
    log: int
    name: str
    offset: int
    left: int


class LogServer:
    """Serves one download at a time, as PX4 does; a new one ends it."""

    def __init__(
        self, outbox: m.Outbox, folder: LogFolder, *, reporter: Reporter, armed: Callable[[], bool]
    ) -> None:
        self._outbox = outbox
        self._folder = folder
        self._report = reporter
        self._armed = armed
        self._logs: Sequence[LogFile] = ()  # as listed last: numbers stay what they were
        self._download: _Download | None = None
        self._next_burst = 0.0

    def receive(self, peer: m.Peer, body: m.Incoming, now: float) -> bool:
        """Handle a message of the log protocol; False for one that is none."""
        match body:
            case LogRequestList(first, last):
                self._list(peer, first, last)
            case LogRequestData():
                self._begin(peer, body, now)
            case LogRequestEnd():
                self._download = None
            case LogErase():
                self._erase()
            case _:
                return False
        return True

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
            body = LogData(download.log, download.offset, part)
            self._outbox.append(m.Envelope(body, download.peer))
            download.offset += len(part)
            download.left -= len(part)
        if ended:
            self._download = None

    def due(self) -> float | None:
        """When `poll` has something to do; None for never."""
        return None if self._download is None else self._next_burst

    def _list(self, peer: m.Peer, first: int, last: int) -> None:
        if first == 0 or not self._logs:
            self._logs = tuple(self._folder.logs())
        count = len(self._logs)
        if count == 0:
            self._outbox.append(m.Envelope(LogEntry(0, 0, 0, 0, 0), peer))
        for number in range(first, min(last + 1, count)):
            log = self._logs[number]
            entry = LogEntry(number, count, count - 1, log.written_s, log.size)
            self._outbox.append(m.Envelope(entry, peer))

    def _begin(self, peer: m.Peer, body: LogRequestData, now: float) -> None:
        self._logs = self._logs or tuple(self._folder.logs())
        if body.log >= len(self._logs):
            self._outbox.append(m.Envelope(LogData(body.log, body.offset, b""), peer))
            return
        name = self._logs[body.log].name
        self._download = _Download(peer, body.log, name, body.offset, body.count)
        self._next_burst = now

    def _erase(self) -> None:
        if self._armed():
            self._report.say(Severity.WARNING, "Logs are not erased while armed")
            return
        self._download = None
        self._logs = ()
        self._folder.erase()
        self._report.say(Severity.INFO, "Logs erased")
