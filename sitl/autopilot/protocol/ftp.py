"""MAVLink FTP from the vehicle's side: read-only access to flight logs and parameters.

https://mavlink.io/en/services/ftp.html. Nothing can be written; what is not there, or not
allowed, is answered by FTP's own errors.
"""

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import Handlers, Outbox, Peer
from sitl.autopilot.parameters import SPECS, Parameters
from sitl.autopilot.protocol.streams import Burst
from sitl.logfolder import LogFolder

_HEADER = struct.Struct("<HBBBBBxI")  # number, session, opcode, size, asked, complete, offset
_DATA = 239
_PAYLOAD = 251
_PIECE = 1 << 16  # bytes of a file whose checksum is worked out
_SESSIONS = 8
_LOGS = ("/log", "/fs/microsd/log")  # where PX4 has them, on a file system of its own and not
_PARAMETERS = "@PARAM/param.pck"
_PACK_MAGIC = 0x671B
_PROTECTED = (  # requests to write
    mav.MAV_FTP_OPCODE_CREATEFILE,
    mav.MAV_FTP_OPCODE_WRITEFILE,
    mav.MAV_FTP_OPCODE_REMOVEFILE,
    mav.MAV_FTP_OPCODE_CREATEDIRECTORY,
    mav.MAV_FTP_OPCODE_REMOVEDIRECTORY,
    mav.MAV_FTP_OPCODE_OPENFILEWO,
    mav.MAV_FTP_OPCODE_TRUNCATEFILE,
    mav.MAV_FTP_OPCODE_RENAME,
)


class _RefusedError(Exception):
    """A request that cannot be granted; `code` is its MAV_FTP_ERR."""

    def __init__(self, code: int) -> None:
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


class FtpServer:
    """Server of MAVLink FTP: up to eight open files (sessions), and one burst at a time."""

    def __init__(self, outbox: Outbox, folder: LogFolder, parameters: Parameters) -> None:
        self._outbox = outbox
        self._folder = folder
        self._parameters = parameters
        self._sessions: dict[int, _File] = {}  # the least recently used one first
        self.burst = Burst(outbox, at_once=30, every_s=0.005)
        # What the burst is for: the session that is read, or the request for a checksum.
        self._bursting: int | tuple[Peer, bytes] | None = None
        self._last: tuple[Peer, bytes, bytes] | None = None  # request and answer
        self._handlers: dict[int, Callable[[_Request], tuple[int, bytes]]] = {
            mav.MAV_FTP_OPCODE_NONE: lambda r: (r.session, b""),
            mav.MAV_FTP_OPCODE_TERMINATESESSION: self._terminate,
            mav.MAV_FTP_OPCODE_RESETSESSION: self._reset,
            mav.MAV_FTP_OPCODE_LISTDIRECTORY: self._list,
            mav.MAV_FTP_OPCODE_OPENFILERO: self._open,
            mav.MAV_FTP_OPCODE_READFILE: self._read,
            **dict.fromkeys(_PROTECTED, _protected),
        }
        self.handlers: Handlers = {mav.MAVLink_file_transfer_protocol_message: self._receive}

    def _receive(
        self, peer: Peer, msg: mav.MAVLink_file_transfer_protocol_message, now: float
    ) -> None:
        payload, last = bytes(msg.payload), self._last
        if self._bursting == (peer, payload):
            return  # it is being worked out
        if last is not None and last[:2] == (peer, payload):
            self._send(peer, last[2])  # our answer was lost
            return
        number, session, opcode, size, _, _, offset = _HEADER.unpack_from(payload)
        data = payload[_HEADER.size : _HEADER.size + min(size, _DATA)]
        request = _Request(number, session, opcode, size, offset, data)
        try:
            if size > _DATA:
                raise _RefusedError(mav.MAV_FTP_ERR_INVALIDDATASIZE)
            if opcode == mav.MAV_FTP_OPCODE_BURSTREADFILE:
                self._begin_burst(peer, request, now)
                return
            if opcode == mav.MAV_FTP_OPCODE_CALCFILECRC:
                file = self._find(request.path)
                self._bursting = (peer, payload)
                self.burst.start(self._checksum(peer, payload, request, file), now, peer)
                return
            handler = self._handlers.get(opcode)
            if handler is None:
                raise _RefusedError(mav.MAV_FTP_ERR_UNKNOWNCOMMAND)
            opened, answer = handler(request)
            packed = _packed(request, mav.MAV_FTP_OPCODE_ACK, answer, session=opened)
        except _RefusedError as refused:
            packed = _packed(request, mav.MAV_FTP_OPCODE_NAK, bytes((refused.code,)))
        self._last = (peer, payload, packed)
        self._send(peer, packed)

    def _send(self, peer: Peer, payload: bytes) -> None:
        self._outbox.append(_message(peer, payload), peer)

    def _begin_burst(self, peer: Peer, request: _Request, now: float) -> None:
        file = self._file(request)
        if request.offset >= file.size:
            raise _RefusedError(mav.MAV_FTP_ERR_EOF)
        self._bursting = request.session
        self.burst.start(self._parts(peer, request, file), now, peer)

    def _parts(self, peer: Peer, request: _Request, file: _File) -> Iterator[mav.MAVLink_message]:
        """The messages of a burst: a file from an offset to its end."""
        number, offset, complete = request.number, request.offset, False
        ack, read = mav.MAV_FTP_OPCODE_ACK, mav.MAV_FTP_OPCODE_BURSTREADFILE
        while not complete:
            self._used(request.session)
            data = file.read(offset, request.size or _DATA)
            number = (number + 1) % 2**16
            complete = not data or offset + len(data) >= file.size
            head = (number, request.session, ack, len(data), read, complete, offset)
            yield _message(peer, (_HEADER.pack(*head) + data).ljust(_PAYLOAD, b"\0"))
            offset += len(data)

    def _file(self, request: _Request) -> _File:
        file = self._used(request.session)
        if file is None:
            raise _RefusedError(mav.MAV_FTP_ERR_INVALIDSESSION)
        return file

    def _used(self, session: int) -> _File | None:
        file = self._sessions.pop(session, None)
        if file is not None:
            self._sessions[session] = file
        return file

    def _terminate(self, request: _Request) -> tuple[int, bytes]:
        self._file(request)
        self._close(request.session)
        return request.session, b""

    def _close(self, session: int) -> None:
        del self._sessions[session]
        if self._bursting == session:
            self._stop()

    def _stop(self) -> None:
        self._bursting = None
        self.burst.stop()

    def _reset(self, request: _Request) -> tuple[int, bytes]:
        self._sessions.clear()
        self._stop()
        return request.session, b""

    def _list(self, request: _Request) -> tuple[int, bytes]:
        entries = self._entries(request.path)[request.offset :]
        if not entries:
            raise _RefusedError(mav.MAV_FTP_ERR_EOF)
        data = b""
        for entry in entries:
            line = entry.encode("ascii", "replace") + b"\0"
            if len(data) + len(line) > _DATA:
                break
            data += line
        return request.session, data

    def _entries(self, path: str) -> Sequence[str]:
        """List a folder as FTP does: D and name for a folder; F, name, tab and size for a file."""
        plain = path.rstrip("/") or "/"
        if plain in _LOGS:
            return [f"F{log.name}\t{log.size}" for log in self._folder.logs()]
        inner = {"/": ["D@PARAM", "Dfs", "Dlog"], "/fs": ["Dmicrosd"], "/fs/microsd": ["Dlog"]}
        if plain.strip("/") == "@PARAM":
            return [f"Fparam.pck\t{len(self._parameter_pack())}"]
        if plain not in inner:
            raise _RefusedError(mav.MAV_FTP_ERR_FILENOTFOUND)
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
        raise _RefusedError(mav.MAV_FTP_ERR_FILENOTFOUND)

    def _open(self, request: _Request) -> tuple[int, bytes]:
        file = self._find(request.path)
        free = next((i for i in range(_SESSIONS) if i not in self._sessions), None)
        if free is None:  # a client that died never closes its own
            free = next(iter(self._sessions))
            self._close(free)
        self._sessions[free] = file
        return free, struct.pack("<I", file.size)

    def _read(self, request: _Request) -> tuple[int, bytes]:
        file = self._file(request)
        if request.offset >= file.size:
            raise _RefusedError(mav.MAV_FTP_ERR_EOF)
        return request.session, file.read(request.offset, request.size or _DATA)

    def _checksum(
        self, peer: Peer, payload: bytes, request: _Request, file: _File
    ) -> Iterator[mav.MAVLink_message | None]:
        """Compute the CRC-32 of a file: yield None after each piece, then the answer."""
        checksum, at = 0xFFFFFFFF, 0
        while data := file.read(at, _PIECE):
            checksum, at = zlib.crc32(data, checksum), at + len(data)
            yield None
        # FTP's starts at zero and is not inverted at the end.
        answer = struct.pack("<I", checksum ^ 0xFFFFFFFF)
        packed = _packed(request, mav.MAV_FTP_OPCODE_ACK, answer)
        self._bursting, self._last = None, (peer, payload, packed)
        yield _message(peer, packed)

    def _parameter_pack(self) -> bytes:
        """All parameters in ArduPilot's packed format, which ground stations read."""
        values = self._parameters.as_dict()
        pack, before = struct.pack("<HHH", _PACK_MAGIC, len(values), len(values)), ""
        for name, value in values.items():
            common = 0
            while common < min(len(name) - 1, len(before), 15) and name[common] == before[common]:
                common += 1
            rest = name[common:].encode()
            number, form = (3, "<i") if SPECS[name].whole else (4, "<f")
            pack += bytes((number, (len(rest) - 1) << 4 | common)) + rest
            pack += struct.pack(form, int(value) if form == "<i" else value)
            before = name
        return pack


def _protected(_: _Request) -> tuple[int, bytes]:
    raise _RefusedError(mav.MAV_FTP_ERR_FILEPROTECTED)


def _packed(request: _Request, op: int, data: bytes, *, session: int | None = None) -> bytes:
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


def _message(peer: Peer, payload: bytes) -> mav.MAVLink_message:
    return mav.MAVLink_file_transfer_protocol_message(0, *peer.ids, list(payload))
