"""Finds what is sound in a log that was cut short or altered.

A killed writer leaves whole chunks and no index; everything that was flushed is in whole chunks.
Where bytes were altered, the sound chunks after them are found again by their signature.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TypeAlias

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from mission.log import framing
from mission.log.framing import HEAD, BrokenRecordError, Frame
from mission.log.mcap_io import our_channels

_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_SUMMARY = frozenset((Opcode.SCHEMA, Opcode.CHANNEL))

# How our chunks look: opcode, length, times, sizes and checksum, then the compression's name.
_SIGNATURE = struct.pack("<I", 4) + b"zstd"
_SIGNATURE_AT = HEAD.size + 8 + 8 + 8 + 4

Batch: TypeAlias = list[Message] | Attachment | Metadata


@dataclass(frozen=True, slots=True)
class Gap:
    """A stretch of the file from which nothing could be saved."""

    start: int
    end: int
    reason: str


@dataclass
class Salvaged:
    """Everything sound of a log, in the order of the file."""

    batches: list[Batch] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    losses: list[Gap] = field(default_factory=list)

    def take(self, frame: Frame) -> None:
        """Keep what a frame holds.

        Raises:
            BrokenRecordError: it does not unpack.
        """
        if frame.opcode == Opcode.CHUNK:
            messages: list[Message] = []
            for item in framing.chunk_records(frame):
                if isinstance(item, Message):
                    messages.append(item)
                else:
                    self._declare(item)
            self.batches.append(messages)
        elif frame.opcode == Opcode.ATTACHMENT:
            self.batches.append(framing.attachment(frame))
        elif frame.opcode == Opcode.METADATA:
            self.batches.append(framing.metadata(frame))
        elif frame.opcode in _SUMMARY:  # repeated after the data, in case the first was lost
            self._declare(framing.declaration(frame))

    def _declare(self, item: Schema | Channel) -> None:
        if isinstance(item, Channel):
            self.channels.setdefault(item.id, item)
        else:
            self.schemas.setdefault(item.id, item)

    def declarations(self) -> tuple[dict[int, Schema], dict[int, Channel]]:
        """What was found, completed by what every log of ours declares.

        The first chunk of a log declares everything. Where it was lost, ids still mean what our
        writer always gives them, as the `aerofed` metadata in front of it vouches for.
        """
        ours = any(isinstance(b, Metadata) and b.name == "aerofed" for b in self.batches)
        if not ours:
            return self.schemas, self.channels
        schemas, channels = our_channels()
        return {**schemas, **self.schemas}, {**channels, **self.channels}


def salvage(source: Path) -> Salvaged:
    """Everything sound in `source`.

    Raises:
        ForeignLogError: it does not begin like an MCAP file. LogError: it cannot be read.
    """
    saved = Salvaged()
    with framing.open_log(source) as stream:
        for frame in _sound_frames(stream, source.stat().st_size, saved.losses):
            try:
                saved.take(frame)
            except BrokenRecordError as broken:
                saved.losses.append(Gap(frame.offset, frame.end, broken.reason))
    return saved


class _ExhaustedError(Exception):
    """More was looked at in vain than damage explains."""


class _Effort:
    """Bounds what is looked at in vain, so that recovery takes time linear in the file's size.

    A hostile file may hold beginnings of chunks, each as long as the rest, by the thousand.
    """

    def __init__(self, size: int) -> None:
        self._left = 16 * size + (1 << 26)

    def spend(self, count: int) -> None:
        """Count bytes that were looked at for nothing; too many raise _ExhaustedError."""
        self._left -= count
        if self._left < 0:
            raise _ExhaustedError


def _sound_frames(stream: IO[bytes], size: int, losses: list[Gap]) -> Iterator[Frame]:
    """Every frame that can be found, going on behind damage."""
    offset, effort = len(MCAP0_MAGIC), _Effort(size)
    content: bytes | None = None
    while offset < size:
        in_vain = 0
        try:
            for frame in framing.frames(stream, size=size, start=offset):
                if frame.opcode not in _OPCODES or not _plausible_after(stream, frame, size):
                    in_vain = len(frame.body)
                    raise BrokenRecordError(frame.offset, "bytes that are no record")
                yield frame
                stream.seek(frame.end)
            return
        except BrokenRecordError as broken:
            if content is None:
                stream.seek(0)
                content = stream.read()
            try:
                effort.spend(in_vain)
                found, reason = _next_chunk(content, broken.offset + 1, effort), broken.reason
            except _ExhaustedError:
                found, reason = size, f"{broken.reason}; and too much like it after it"
            losses.append(Gap(broken.offset, found, reason))
            offset = found


def _plausible_after(stream: IO[bytes], frame: Frame, size: int) -> bool:
    """Whether a record, or the end, follows: an altered length points anywhere."""
    head = stream.read(HEAD.size)
    if frame.opcode == Opcode.FOOTER or len(head) < HEAD.size:
        return True
    opcode, _ = HEAD.unpack(head)
    return opcode in _OPCODES and frame.end < size


def _next_chunk(content: bytes, start: int, effort: _Effort) -> int:
    """Offset of the first sound chunk at or after `start`; the file's size if there is none."""
    at = content.find(_SIGNATURE, start + _SIGNATURE_AT)
    while at >= 0:
        if _is_chunk(content, at - _SIGNATURE_AT, effort):
            return at - _SIGNATURE_AT
        at = content.find(_SIGNATURE, at + 1)
    return len(content)


def _is_chunk(content: bytes, at: int, effort: _Effort) -> bool:
    opcode, length = HEAD.unpack_from(content, at)
    if opcode != Opcode.CHUNK or length > len(content) - at - HEAD.size:
        return False
    body = content[at + HEAD.size : at + HEAD.size + length]
    try:
        framing.chunk_records(Frame(at, opcode, body))
    except BrokenRecordError:
        effort.spend(length)
        return False
    return True
