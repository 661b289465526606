"""Files on board as values: what the log protocol and MAVLink FTP say and hear."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class LogFile:
    """One flight log that is complete."""

    name: str
    size: int  # bytes
    written_s: int  # seconds since 1970


class LogFolder(Protocol):
    """Where the vehicle's flight logs lie. A file that has gone is read as empty."""

    def logs(self) -> Sequence[LogFile]:
        """Those that are complete, the oldest first."""

    def read(self, name: str, offset: int, count: int, /) -> bytes:
        """`count` bytes of a log from `offset` on; fewer at its end."""

    def erase(self) -> None:
        """Remove all that are complete."""


class NoLogs:
    """The folder of a vehicle that keeps no logs."""

    def logs(self) -> Sequence[LogFile]:
        return ()

    def read(self, _name: str, _offset: int, _count: int) -> bytes:
        return b""

    def erase(self) -> None:
        """There is nothing to remove."""


@dataclass(frozen=True, slots=True)
class LogRequestList:
    """LOG_REQUEST_LIST: the logs from one number to another are asked for."""

    first: int
    last: int


@dataclass(frozen=True, slots=True)
class LogRequestData:
    """LOG_REQUEST_DATA: a part of a log is asked for."""

    log: int
    offset: int
    count: int


@dataclass(frozen=True, slots=True)
class LogRequestEnd:
    """LOG_REQUEST_END: nothing more is wanted."""


@dataclass(frozen=True, slots=True)
class LogErase:
    """LOG_ERASE: the logs shall be removed."""


@dataclass(frozen=True, slots=True)
class LogEntry:
    """LOG_ENTRY: one log, or with `count` 0 none."""

    log: int
    count: int
    last: int
    written_s: int
    size: int


@dataclass(frozen=True, slots=True)
class LogData:
    """LOG_DATA: a part of a log; fewer than 90 bytes are its end."""

    log: int
    offset: int
    data: bytes


@dataclass(frozen=True, slots=True)
class FtpMessage:
    """FILE_TRANSFER_PROTOCOL, in both directions: 251 bytes."""

    payload: bytes


FileRequest = LogRequestList | LogRequestData | LogRequestEnd | LogErase | FtpMessage
FileAnswer = LogEntry | LogData | FtpMessage
