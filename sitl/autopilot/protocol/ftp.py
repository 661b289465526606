"""MAVLink FTP from the vehicle's side: its flight logs and its parameters, to be read.

https://mavlink.io/en/services/ftp.html. Nothing can be written; what is not there, or not
allowed, is answered by FTP's own errors.
"""

import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum

from sitl.autopilot.parameters import SPECS, Parameters
from sitl.autopilot.values import messages as m
from sitl.autopilot.values.enums import ParamType
from sitl.autopilot.values.files import FtpMessage, LogFolder

_HEADER = struct.Struct("<HBBBBBxI")  # number, session, opcode, size, asked, complete, offset
_DATA = 239
_PAYLOAD = 251
_SESSIONS = 8
_BURST = 30  # messages sent at a time, so that no receiver's buffer overflows
_BURST_EVERY_S = 0.005
_LOGS = ("/log", "/fs/microsd/log")  # where PX4 has them, on a file system of its own and not
_PARAMETERS = "@PARAM/param.pck"
_PACK_MAGIC = 0x671B
_PACK_TYPES = {ParamType.INT32: (3, "<i"), ParamType.REAL32: (4, "<f")}


class Op(IntEnum):
    """FTP opcodes."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WO = 11
    TRUNCATE_FILE = 12
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class ErrorCode(IntEnum):
    """Why a request is refused (MAV_FTP_ERR)."""

    FAIL = 1
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


class _RefusedError(Exception):
    def __init__(self, code: ErrorCode) -> None:
        self.code = code


@dataclass(frozen=True, slots=True)
class _Request:
    number: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes

    @property
    def path(self) -> str:
        return self.data.split(b"\0")[0].decode("ascii", "replace")


@dataclass(frozen=True, slots=True)
class _File:
    size: int
    read: Callable[[int, int], bytes]  # offset, count


@dataclass(slots=True)
class _Burst:
    peer: m.Peer
    number: int
    session: int
    offset: int
    part: int


class FtpServer:
    """A few sessions; at most one of them in a burst."""

    def __init__(self, outbox: m.Outbox, folder: LogFolder, parameters: Parameters) -> None:
        self._outbox = outbox
        self._folder = folder
        self._parameters = parameters
        self._sessions: dict[int, _File] = {}  # the least recently used one first
        self._burst: _Burst | None = None
        self._next_burst = 0.0
        self._last: tuple[m.Peer, bytes, bytes] | None = None  # request and answer
        self._handlers: dict[int, Callable[[_Request], tuple[int, bytes]]] = {
            Op.NONE: lambda r: (r.session, b""),
            Op.TERMINATE_SESSION: self._terminate,
            Op.RESET_SESSIONS: self._reset,
            Op.LIST_DIRECTORY: self._list,
            Op.OPEN_FILE_RO: self._open,
            Op.READ_FILE: self._read,
            Op.CALC_FILE_CRC32: self._checksum,
            **dict.fromkeys(
                (
                    Op.CREATE_FILE,
                    Op.WRITE_FILE,
                    Op.REMOVE_FILE,
                    Op.CREATE_DIRECTORY,
                    Op.REMOVE_DIRECTORY,
                    Op.OPEN_FILE_WO,
                    Op.TRUNCATE_FILE,
                    Op.RENAME,
                ),
                _protected,
            ),
        }

    def receive(self, peer: m.Peer, body: m.Incoming, now: float) -> bool:
        """Handle a message of FTP; False for one that is none."""
        if not isinstance(body, FtpMessage):
            return False
        last = self._last
        if last is not None and last[:2] == (peer, body.payload):
            self._outbox.append(m.Envelope(FtpMessage(last[2]), peer))  # our answer was lost
            return True
        number, session, opcode, size, _, _, offset = _HEADER.unpack_from(body.payload)
        data = body.payload[_HEADER.size : _HEADER.size + min(size, _DATA)]
        request = _Request(number, session, opcode, size, offset, data)
        try:
            if size > _DATA:
                raise _RefusedError(ErrorCode.INVALID_DATA_SIZE)
            if opcode == Op.BURST_READ_FILE:
                self._begin_burst(peer, request, now)
                return True
            handler = self._handlers.get(opcode)
            if handler is None:
                raise _RefusedError(ErrorCode.UNKNOWN_COMMAND)
            opened, answer = handler(request)
            packed = _packed(request, Op.ACK, answer, session=opened)
        except _RefusedError as refused:
            packed = _packed(request, Op.NAK, bytes((refused.code,)))
        self._last = (peer, body.payload, packed)
        self._outbox.append(m.Envelope(FtpMessage(packed), peer))
        return True

    def poll(self, now: float) -> None:
        """Send the next parts of a burst."""
        burst = self._burst
        if burst is None or now < self._next_burst:
            return
        self._next_burst = now + _BURST_EVERY_S
        file = self._used(burst.session)
        for _ in range(_BURST):
            data = b"" if file is None else file.read(burst.offset, burst.part)
            left = 0 if file is None else file.size - burst.offset - len(data)
            burst.number = (burst.number + 1) % 2**16
            head = (burst.number, burst.session, Op.ACK, len(data), Op.BURST_READ_FILE)
            complete = left <= 0 or not data
            packed = _HEADER.pack(*head, complete, burst.offset) + data
            envelope = m.Envelope(FtpMessage(packed.ljust(_PAYLOAD, b"\0")), burst.peer)
            self._outbox.append(envelope)
            burst.offset += len(data)
            if complete:
                self._burst = None
                return

    def due(self) -> float | None:
        """When `poll` has something to do; None for never."""
        return None if self._burst is None else self._next_burst

    def _begin_burst(self, peer: m.Peer, request: _Request, now: float) -> None:
        file = self._file(request)
        if request.offset >= file.size:
            raise _RefusedError(ErrorCode.END_OF_FILE)
        part = request.size or _DATA
        self._burst = _Burst(peer, request.number, request.session, request.offset, part)
        self._next_burst = now

    def _file(self, request: _Request) -> _File:
        file = self._used(request.session)
        if file is None:
            raise _RefusedError(ErrorCode.INVALID_SESSION)
        return file

    def _used(self, session: int) -> _File | None:
        file = self._sessions.pop(session, None)
        if file is not None:
            self._sessions[session] = file
        return file

    def _terminate(self, request: _Request) -> tuple[int, bytes]:
        self._file(request)
        del self._sessions[request.session]
        return request.session, b""

    def _reset(self, request: _Request) -> tuple[int, bytes]:
        self._sessions.clear()
        self._burst = None
        return request.session, b""

    def _list(self, request: _Request) -> tuple[int, bytes]:
        entries = self._entries(request.path)[request.offset :]
        if not entries:
            raise _RefusedError(ErrorCode.END_OF_FILE)
        data = b""
        for entry in entries:
            line = entry.encode("ascii", "replace") + b"\0"
            if len(data) + len(line) > _DATA:
                break
            data += line
        return request.session, data

    def _entries(self, path: str) -> Sequence[str]:
        """Of a folder: D and a name for a folder, F, name, tab and size for a file."""
        plain = path.rstrip("/") or "/"
        if plain in _LOGS:
            return [f"F{log.name}\t{log.size}" for log in self._folder.logs()]
        inner = {"/": ["D@PARAM", "Dfs", "Dlog"], "/fs": ["Dmicrosd"], "/fs/microsd": ["Dlog"]}
        if plain.strip("/") == "@PARAM":
            return [f"Fparam.pck\t{len(self._parameter_pack())}"]
        if plain not in inner:
            raise _RefusedError(ErrorCode.FILE_NOT_FOUND)
        return inner[plain]

    def _find(self, path: str) -> _File:
        if path.lstrip("/").split("?")[0] == _PARAMETERS:
            pack = self._parameter_pack()
            return _File(len(pack), lambda offset, count: pack[offset : offset + count])
        parent, _, name = path.rpartition("/")
        if parent in _LOGS:
            for log in self._folder.logs():
                if log.name == name:
                    return _File(
                        log.size, lambda offset, count: self._folder.read(name, offset, count)
                    )
        raise _RefusedError(ErrorCode.FILE_NOT_FOUND)

    def _open(self, request: _Request) -> tuple[int, bytes]:
        file = self._find(request.path)
        free = next((i for i in range(_SESSIONS) if i not in self._sessions), None)
        if free is None:  # a client that died never closes its own
            free = next(iter(self._sessions))
            del self._sessions[free]
            if self._burst is not None and self._burst.session == free:
                self._burst = None
        self._sessions[free] = file
        return free, struct.pack("<I", file.size)

    def _read(self, request: _Request) -> tuple[int, bytes]:
        file = self._file(request)
        if request.offset >= file.size:
            raise _RefusedError(ErrorCode.END_OF_FILE)
        return request.session, file.read(request.offset, request.size or _DATA)

    def _checksum(self, request: _Request) -> tuple[int, bytes]:
        file, checksum, at = self._find(request.path), 0xFFFFFFFF, 0
        while data := file.read(at, 1 << 16):
            checksum, at = zlib.crc32(data, checksum), at + len(data)
        # FTP's starts at zero and is not inverted at the end.
        return request.session, struct.pack("<I", checksum ^ 0xFFFFFFFF)

    def _parameter_pack(self) -> bytes:
        """All parameters in ArduPilot's packed format, which ground stations read."""
        values = self._parameters.as_dict()
        pack, before = struct.pack("<HHH", _PACK_MAGIC, len(values), len(values)), ""
        for name, value in values.items():
            common = 0
            while common < min(len(name) - 1, len(before), 15) and name[common] == before[common]:
                common += 1
            rest = name[common:].encode()
            number, form = _PACK_TYPES[SPECS[name].kind]
            pack += bytes((number, (len(rest) - 1) << 4 | common)) + rest
            pack += struct.pack(form, int(value) if form == "<i" else value)
            before = name
        return pack


def _protected(_: _Request) -> tuple[int, bytes]:
    raise _RefusedError(ErrorCode.FILE_PROTECTED)


def _packed(request: _Request, op: Op, data: bytes, *, session: int | None = None) -> bytes:
    head = _HEADER.pack(
        (request.number + 1) % 2**16,
        request.session if session is None else session,
        op,
        len(data),
        request.opcode,
        0,
        request.offset,
    )
    return (head + data).ljust(_PAYLOAD, b"\0")
