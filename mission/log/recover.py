"""Saves what a log still holds: after `kill -9`, a full disk, or damage in its midst.

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
from mcap.writer import MCAP0_MAGIC, Writer

from mission.log import framing
from mission.log.errors import LogError
from mission.log.framing import HEAD, BrokenRecordError, Frame
from mission.log.mcapio import new_writer, our_channels
from mission.log.values import NS_PER_S

_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_SUMMARY = frozenset((Opcode.SCHEMA, Opcode.CHANNEL))

# How our chunks look: opcode, length, times, sizes and checksum, then the compression's name.
_SIGNATURE = struct.pack("<I", 4) + b"zstd"
_SIGNATURE_AT = HEAD.size + 8 + 8 + 8 + 4

_Batch: TypeAlias = list[Message] | Attachment | Metadata


@dataclass(frozen=True, slots=True)
class Loss:
    """A stretch of the file from which nothing could be saved."""

    start: int
    end: int
    reason: str


@dataclass(frozen=True)
class Recovery:
    """What was saved into `target`, and what was not."""

    target: Path
    messages: int
    attachments: int
    start_ns: int
    end_ns: int
    losses: tuple[Loss, ...]
    unknown: int  # messages of channels that nothing describes any more

    @property
    def seconds(self) -> float:
        """Simulated time from the first to the last message saved."""
        return (self.end_ns - self.start_ns) / NS_PER_S


@dataclass
class _Saved:
    batches: list[_Batch] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)


def recover(source: Path, target: Path) -> Recovery:
    """Write everything sound in `source` to a new, complete, indexed log `target`.

    A complete log comes out as it went in. `target` appears whole or not at all.

    Raises:
        ForeignLogError: `source` does not begin like an MCAP file.
        LogError: it cannot be read, nothing in it is sound, or `target` exists or cannot be made.
    """
    if target.exists():
        raise LogError(target, "exists already; give another name")
    saved = _salvage(source)
    if not any(isinstance(batch, list) for batch in saved.batches):
        raise LogError(source, "nothing to recover: it holds no whole chunk")
    partial = target.with_name(f".{target.name}.partial")
    try:
        with partial.open("wb") as stream:
            unknown = _write(stream, saved)
        partial.replace(target)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise LogError(target, f"cannot write the recovered log: {error.strerror}") from None
    messages = [m for batch in saved.batches if isinstance(batch, list) for m in batch]
    return Recovery(
        target=target,
        messages=len(messages) - unknown,
        attachments=sum(isinstance(batch, Attachment) for batch in saved.batches),
        start_ns=min(message.log_time for message in messages),
        end_ns=max(message.log_time for message in messages),
        losses=tuple(saved.losses),
        unknown=unknown,
    )


def _salvage(source: Path) -> _Saved:
    saved = _Saved()
    with framing.open_log(source) as stream:
        for frame in _sound_frames(stream, source.stat().st_size, saved.losses):
            _take(frame, saved)
    return saved


def _take(frame: Frame, saved: _Saved) -> None:
    """Keep what a frame holds; one that does not unpack becomes a loss."""
    try:
        if frame.opcode == Opcode.CHUNK:
            messages: list[Message] = []
            for item in framing.chunk_records(frame):
                if isinstance(item, Message):
                    messages.append(item)
                elif isinstance(item, Channel):
                    saved.channels.setdefault(item.id, item)
                else:
                    saved.schemas.setdefault(item.id, item)
            saved.batches.append(messages)
        elif frame.opcode == Opcode.ATTACHMENT:
            saved.batches.append(framing.attachment(frame))
        elif frame.opcode == Opcode.METADATA:
            saved.batches.append(framing.metadata(frame))
        elif frame.opcode in _SUMMARY:  # repeated after the data, in case the first was lost
            item = framing.declaration(frame)
            table = saved.channels if isinstance(item, Channel) else saved.schemas
            table.setdefault(item.id, item)
    except BrokenRecordError as broken:
        saved.losses.append(Loss(frame.offset, frame.end, broken.reason))


def _sound_frames(stream: IO[bytes], size: int, losses: list[Loss]) -> Iterator[Frame]:
    """Every frame that can be found, going on behind damage."""
    offset = len(MCAP0_MAGIC)
    while offset < size:
        try:
            for frame in framing.frames(stream, size=size, start=offset):
                if frame.opcode not in _OPCODES or not _plausible_after(stream, frame, size):
                    raise BrokenRecordError(frame.offset, "bytes that are no record")
                yield frame
                stream.seek(frame.end)
            return
        except BrokenRecordError as broken:
            found = _next_chunk(stream, broken.offset + 1, size)
            losses.append(Loss(broken.offset, found, broken.reason))
            offset = found


def _plausible_after(stream: IO[bytes], frame: Frame, size: int) -> bool:
    """Whether a record, or the end, follows: an altered length points anywhere."""
    head = stream.read(HEAD.size)
    if frame.opcode == Opcode.FOOTER or len(head) < HEAD.size:
        return True
    opcode, _ = HEAD.unpack(head)
    return opcode in _OPCODES and frame.end < size


def _next_chunk(stream: IO[bytes], start: int, size: int) -> int:
    """Offset of the first sound chunk at or after `start`; the file's size if there is none."""
    stream.seek(start)
    rest = stream.read()
    at = rest.find(_SIGNATURE)
    while at >= 0:
        offset = start + at - _SIGNATURE_AT
        if offset >= start and _is_chunk(rest, offset - start):
            return offset
        at = rest.find(_SIGNATURE, at + 1)
    return size


def _is_chunk(data: bytes, at: int) -> bool:
    opcode, length = HEAD.unpack_from(data, at)
    body = data[at + HEAD.size : at + HEAD.size + length]
    if opcode != Opcode.CHUNK or len(body) < length:
        return False
    try:
        framing.chunk_records(Frame(at, opcode, body))
    except BrokenRecordError:
        return False
    return True


def _write(stream: IO[bytes], saved: _Saved) -> int:
    """Write the batches, a chunk each; returns the messages that no channel describes."""
    schemas, channels = _declarations(saved)
    writer = new_writer(stream)
    schema_ids = {
        old: writer.register_schema(schema.name, schema.encoding, schema.data)
        for old, schema in sorted(schemas.items())
    }
    channel_ids = {
        old: writer.register_channel(
            channel.topic,
            channel.message_encoding,
            schema_ids.get(channel.schema_id, 0),
            channel.metadata,
        )
        for old, channel in sorted(channels.items())
    }
    unknown = 0
    for batch in saved.batches:
        if isinstance(batch, Metadata):
            writer.add_metadata(batch.name, batch.metadata)
        elif isinstance(batch, Attachment):
            writer.add_attachment(
                batch.create_time, batch.log_time, batch.name, batch.media_type, batch.data
            )
        else:
            unknown += _write_chunk(writer, batch, channel_ids)
    writer.finish()
    return unknown


def _write_chunk(writer: Writer, messages: list[Message], channel_ids: dict[int, int]) -> int:
    unknown = 0
    for message in messages:
        channel = channel_ids.get(message.channel_id)
        if channel is None:
            unknown += 1
            continue
        writer.add_message(
            channel, message.log_time, message.data, message.publish_time, message.sequence
        )
    writer.flush()
    return unknown


def _declarations(saved: _Saved) -> tuple[dict[int, Schema], dict[int, Channel]]:
    """What was found, completed by what every log of ours declares.

    The first chunk of a log declares everything. Where it was lost, ids still mean what our
    writer always gives them, as the `aerofed` metadata in front of it vouches for.
    """
    ours = any(isinstance(b, Metadata) and b.name == "aerofed" for b in saved.batches)
    if not ours:
        return saved.schemas, saved.channels
    schemas, channels = our_channels()
    return {**schemas, **saved.schemas}, {**channels, **saved.channels}
