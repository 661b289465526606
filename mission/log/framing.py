"""MCAP record by record, with every checksum verified and the place of any damage known.

The format is https://mcap.dev/spec. `mcap` parses the records; framing, bounds and checksums are
done here, because a log may be cut or altered anywhere and the library then raises whatever it
meets (struct.error, MemoryError, EndOfFile).
"""

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeAlias

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from mission.log.errors import DamagedLogError, ForeignLogError, LogError

Content: TypeAlias = Schema | Channel | Message
HEAD = struct.Struct("<BQ")  # opcode and length of a record

# What our writer makes is far below: a chunk holds a second. More is damage, not data.
_MAX_CHUNK_BYTES = 1 << 30


@dataclass(frozen=True, slots=True)
class Frame:
    """One record as it lies in the file."""

    offset: int
    opcode: int
    body: bytes

    @property
    def end(self) -> int:
        """Offset of the byte after it."""
        return self.offset + HEAD.size + len(self.body)


class BrokenRecordError(Exception):
    """A record is not sound. `offset` is where it starts."""

    def __init__(self, offset: int, reason: str) -> None:
        super().__init__(reason)
        self.offset = offset
        self.reason = reason


def open_log(path: Path) -> IO[bytes]:
    """Open a file that begins like an MCAP file, positioned after the magic bytes.

    Raises:
        LogError: it cannot be read. ForeignLogError: it begins otherwise.
    """
    try:
        stream = path.open("rb")
    except OSError as error:
        raise LogError(path, f"cannot read the log: {error.strerror}") from None
    start = stream.read(len(MCAP0_MAGIC))
    if start != MCAP0_MAGIC:
        stream.close()
        raise ForeignLogError(path, "not an MCAP file")
    return stream


def frames(stream: IO[bytes], *, size: int, start: int = len(MCAP0_MAGIC)) -> Iterator[Frame]:
    """The records from `start`, up to and including the footer.

    Raises:
        BrokenRecordError: the file ends before the footer, or a length points past its end.
    """
    stream.seek(start)
    offset = start
    while True:
        head = stream.read(HEAD.size)
        if len(head) < HEAD.size:
            raise BrokenRecordError(offset, "the file ends here, before its index")
        opcode, length = HEAD.unpack(head)
        if length > size - offset - HEAD.size:
            raise BrokenRecordError(offset, "the file ends within the record that starts here")
        frame = Frame(offset, opcode, stream.read(length))
        yield frame
        if opcode == Opcode.FOOTER:
            return
        offset = frame.end


def chunk_records(frame: Frame) -> list[Content]:
    """Unpack a chunk; its checksum has been verified.

    Raises:
        BrokenRecordError: it does not unpack to what it says.
    """
    try:
        chunk = Chunk.read(_stream(frame.body))
        if chunk.uncompressed_size > _MAX_CHUNK_BYTES:
            raise BrokenRecordError(frame.offset, "a chunk of impossible size")
        if (
            chunk.compression == "zstd"
            and zstandard.frame_content_size(chunk.data) != chunk.uncompressed_size
        ):
            raise BrokenRecordError(frame.offset, "a chunk whose sizes contradict each other")
        records: list[Content] = breakup_chunk(chunk, validate_crc=True)
    except CRCValidationError:
        raise BrokenRecordError(frame.offset, "a chunk with a wrong checksum") from None
    except (McapError, zstandard.ZstdError, struct.error, UnicodeDecodeError) as error:
        raise BrokenRecordError(frame.offset, f"a chunk that does not unpack ({error})") from None
    return records


def attachment(frame: Frame) -> Attachment:
    """Unpack an attachment and verify its checksum.

    Raises:
        BrokenRecordError: it is not sound.
    """
    try:
        (stored,) = struct.unpack("<I", frame.body[-4:])
        parsed: Attachment = Attachment.read(_stream(frame.body))
    except (McapError, struct.error, UnicodeDecodeError) as error:
        raise BrokenRecordError(frame.offset, f"an attachment that is not one ({error})") from None
    if stored not in (0, zlib.crc32(frame.body[:-4])):
        raise BrokenRecordError(frame.offset, "an attachment with a wrong checksum")
    return parsed


def metadata(frame: Frame) -> Metadata:
    """Unpack a metadata record (the format gives it no checksum of its own).

    Raises:
        BrokenRecordError: it is not sound.
    """
    try:
        parsed: Metadata = Metadata.read(_stream(frame.body))
    except (McapError, struct.error, UnicodeDecodeError) as error:
        raise BrokenRecordError(frame.offset, f"metadata that is none ({error})") from None
    return parsed


def declaration(frame: Frame) -> Schema | Channel:
    """Unpack a schema or channel that stands outside the chunks.

    Raises:
        BrokenRecordError: it is not sound.
    """
    kind = Schema if frame.opcode == Opcode.SCHEMA else Channel
    try:
        parsed: Schema | Channel = kind.read(_stream(frame.body))
    except (McapError, struct.error, UnicodeDecodeError) as error:
        raise BrokenRecordError(frame.offset, f"a declaration that is none ({error})") from None
    return parsed


def verify(path: Path) -> Iterator[Frame]:
    """The records of a complete, sound log; damage is found before the last one is handed out.

    Chunk, attachment, data and summary checksums are verified where they are not zero.

    Raises:
        LogError: the file cannot be read. ForeignLogError: not an MCAP file.
        DamagedLogError: cut short or altered.
    """
    with open_log(path) as stream:
        size = path.stat().st_size
        data_crc, summary_crc, in_summary = zlib.crc32(MCAP0_MAGIC), 0, False
        summary_start = 0
        try:
            for frame in frames(stream, size=size):
                raw = HEAD.pack(frame.opcode, len(frame.body)) + frame.body
                if frame.opcode == Opcode.DATA_END:
                    (stored,) = struct.unpack("<I", frame.body[:4])
                    if stored not in (0, data_crc):
                        raise BrokenRecordError(frame.offset, "wrong checksum of all data before")
                    in_summary, summary_start = True, frame.end
                elif frame.opcode == Opcode.FOOTER:
                    _check_footer(frame, summary_start, zlib.crc32(raw[:-4], summary_crc))
                    if stream.read() != MCAP0_MAGIC:
                        raise BrokenRecordError(frame.end, "the file does not end as MCAP does")
                elif in_summary:
                    summary_crc = zlib.crc32(raw, summary_crc)
                else:
                    data_crc = zlib.crc32(raw, data_crc)
                yield frame
        except BrokenRecordError as broken:
            raise DamagedLogError(path, broken.reason, broken.offset) from None
        except struct.error:
            raise DamagedLogError(path, "a record shorter than its kind", frame.offset) from None


def _check_footer(frame: Frame, summary_start: int, crc: int) -> None:
    footer: Footer = Footer.read(_stream(frame.body))
    if footer.summary_crc not in (0, crc):
        raise BrokenRecordError(frame.offset, "wrong checksum of the index")
    if footer.summary_start not in (0, summary_start):
        raise BrokenRecordError(frame.offset, "the footer does not point at the index")


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(body))
