"""Reading and verifying MCAP files without decoding their messages, and recovery of damaged ones.

A killed writer leaves whole chunks and no index: everything that was flushed is in whole chunks.
Reading ends at a broken record, but goes on after a chunk whose content was altered.
"""

import io
import json
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import zstandard
from google.protobuf.message import DecodeError
from lz4.frame import LZ4FrameDecompressor
from mcap.exceptions import McapError
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import LIBRARY_IDENTIFIER, MCAP0_MAGIC, Writer
from mcap_protobuf.decoder import DecoderFactory

from mission.base.area import Area
from mission.base.errors import InputError
from mission.base.run_folder import write_atomically
from mission.base.user_files import DATA_BYTES, read_bytes, taken_by
from mission.log import SPOILT, DamagedLogError, ForeignLogError, LogError
from mission.log.topics import FORMAT_VERSION, Topic
from mission.log.values import NS_PER_S, area_from_text

Batch: TypeAlias = list[Message] | Attachment | Metadata

# All that the libraries raise of bytes that are not MCAP; RuntimeError: LZ4.
_BROKEN = (*SPOILT, McapError, zstandard.ZstdError, RuntimeError)
# Of what a chunk unpacks to, and how often its own size that is: our writer's are a hundredth of
# both. More is damage.
_CHUNK_BYTES, _MOST_UNPACKED = 2**26, 200


@dataclass(frozen=True, slots=True)
class Loss:
    """A stretch of the file that is not sound, from byte `start` to before `end`."""

    start: int
    end: int
    reason: str


@dataclass
class Contents:
    """The sound records of an MCAP file, in file order, and its damaged stretches (`losses`)."""

    path: Path
    batches: list[Batch] = field(default_factory=list)  # the messages of each chunk, and the rest
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)

    @cached_property
    def messages(self) -> dict[str, list[Message]]:
        """The messages, not decoded, by topic name; in file order."""
        found: dict[str, list[Message]] = defaultdict(list)
        for batch in self.batches:
            for message in batch if isinstance(batch, list) else ():
                found[self.channels[message.channel_id].topic].append(message)
        return dict(found)

    @cached_property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The MCAP Metadata records by name: each maps strings to strings."""
        return {item.name: item.metadata for item in self.batches if isinstance(item, Metadata)}

    @cached_property
    def attachments(self) -> dict[str, bytes]:
        """The contents of the attached files by file name."""
        return {item.name: item.data for item in self.batches if isinstance(item, Attachment)}

    @property
    def area(self) -> Area:
        """The flight area, from the `aerofed` metadata.

        Raises:
            ForeignLogError: that metadata is missing, incomplete, or of another format version.
        """
        ours = self.metadata.get("aerofed")
        if ours is None:
            raise ForeignLogError(
                self.path, "an MCAP file, but not one of ours (no `aerofed` metadata)"
            )
        if ours.get("format") != FORMAT_VERSION:
            raise ForeignLogError(
                self.path,
                f"log format {ours.get('format')!r}, this version reads {FORMAT_VERSION!r}",
            )
        try:
            return area_from_text(ours)
        except (*SPOILT, InputError) as error:
            raise ForeignLogError(self.path, f"`aerofed` metadata without {error}") from None

    def schema(self, topic: str) -> Schema:
        """Return the MCAP schema of a topic; KeyError if the topic has no messages."""
        channel = self.channels[self.messages[topic][0].channel_id]
        return self.schemas[channel.schema_id]

    def decoded(self, topic: Topic) -> Iterator[tuple[int, Any]]:
        """Yield (t_ns, message) of a topic in time order: JSON as dicts, protobuf as messages.

        Raises:
            ForeignLogError: a message does not decode, or the topic has another schema.
        """
        rows = sorted(self.messages.get(topic.name, ()), key=lambda message: message.log_time)
        if not rows:
            return
        schema = self.schema(topic.name)
        if schema.name != topic.schema_name:
            raise ForeignLogError(
                self.path, f"{topic.name} has schema {schema.name}, not {topic.schema_name}"
            )
        decode: Callable[[bytes], Any] = json.loads
        part = "its schema"
        try:
            if topic.encoding == "protobuf":
                decode = DecoderFactory().decoder_for(topic.encoding, schema)
            for message in rows:
                part = f"message {message.sequence}"
                yield message.log_time, decode(message.data)
        except (*SPOILT, McapError, DecodeError) as error:
            raise ForeignLogError(
                self.path, f"{topic.name}: {part} does not decode: {error}"
            ) from None


def load(path: Path) -> Contents:
    """Read a whole, sound log.

    Raises:
        LogError: it cannot be read, is no MCAP file, or is damaged; the message says where.
    """
    contents = load_damaged(path)
    for loss in contents.losses:
        raise DamagedLogError(path, loss.reason, loss.start)
    return contents


def load_damaged(path: Path) -> Contents:
    """What is sound in a log whose writer was killed, or that is still being written.

    Raises:
        LogError: it cannot be read, or is no MCAP file.
    """
    contents = Contents(path)
    # In memory: a file would make room for as much as a broken record promises.
    stream = io.BytesIO(read_bytes(path, most=DATA_BYTES))
    if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        other = "" if path.suffix == ".mcap" else taken_by(path)
        raise ForeignLogError(path, f"not an MCAP file{other}")
    stream.seek(0)
    _read(stream, contents)
    return contents


def _read(stream: io.BytesIO, found: Contents) -> None:
    at, size = 0, stream.getbuffer().nbytes
    try:
        for record in StreamReader(stream, emit_chunks=True, record_size_limit=size).records:
            end = stream.tell()
            if isinstance(record, Chunk):
                _read_chunk(record, found, Loss(at, end, "a chunk that does not unpack"))
            elif isinstance(record, DataEnd):
                _verify(stream, found, record.data_section_crc, Loss(0, at, "wrong checksum"))
            elif isinstance(record, Footer):
                index = Loss(record.summary_start, end - 4, "wrong checksum of the index")
                _verify(stream, found, record.summary_crc, index)
            elif isinstance(record, Message):  # of a writer without chunks
                last = found.batches[-1] if found.batches else None
                if isinstance(last, list):
                    last.append(record)
                else:
                    found.batches.append([record])
            else:
                _take(record, found)
            at = end
    except _BROKEN as error:
        cut = stream.tell() == size
        why = "the file ends here, before its index" if cut else f"a broken record ({error})"
        found.losses.append(Loss(at, size, why))
    _drop_undeclared(found)


def _read_chunk(chunk: Chunk, found: Contents, otherwise: Loss) -> None:
    try:
        size, unpacker = chunk.uncompressed_size, LZ4FrameDecompressor()
        # Zstandard's own promise: the library allocates as much.
        told = zstandard.frame_content_size(chunk.data) if chunk.compression == "zstd" else 0
        if told > size or size > min(_CHUNK_BYTES, _MOST_UNPACKED * len(chunk.data)):
            raise ValueError
        if chunk.compression == "lz4":  # of which the library unpacks whatever there is
            chunk.data = unpacker.decompress(chunk.data, max_length=size + 1)
            chunk.compression = ""
            if not unpacker.eof:
                raise ValueError
        content = breakup_chunk(chunk, validate_crc=True)
    except _BROKEN:
        found.losses.append(otherwise)
        return
    found.batches.append([record for record in content if isinstance(record, Message)])
    for record in content:
        _take(record, found)


def _take(record: McapRecord, found: Contents) -> None:
    """Store a record; schemas and channels, repeated at the end of the file, only once."""
    if isinstance(record, Channel):
        found.channels.setdefault(record.id, record)
    elif isinstance(record, Schema):
        found.schemas.setdefault(record.id, record)
    elif isinstance(record, Attachment | Metadata):
        found.batches.append(record)


def _verify(stream: io.BytesIO, found: Contents, stored: int, otherwise: Loss) -> None:
    """Append the loss `otherwise` if its bytes fail their CRC and no earlier loss explains it."""
    here = stream.tell()
    stream.seek(otherwise.start)
    actual = zlib.crc32(stream.read(otherwise.end - otherwise.start))
    stream.seek(here)
    if stored not in (0, actual) and not found.losses:
        found.losses.append(otherwise)


def _drop_undeclared(found: Contents) -> None:
    """Drop messages whose channel record was lost with its chunk, and append a loss for them."""
    dropped = 0
    for number, batch in enumerate(found.batches):
        if isinstance(batch, list):
            known = [message for message in batch if message.channel_id in found.channels]
            dropped += len(batch) - len(known)
            found.batches[number] = known
    if dropped:
        found.losses.append(Loss(0, 0, f"{dropped} messages of channels that nothing describes"))


@dataclass(frozen=True)
class Recovery:
    """Result of `recover`: what was saved into `target`, and the stretches that were lost."""

    target: Path
    messages: int
    attachments: int
    start_ns: int
    end_ns: int
    losses: tuple[Loss, ...]

    @property
    def seconds(self) -> float:
        """Simulated time from the first to the last message saved."""
        return (self.end_ns - self.start_ns) / NS_PER_S


def recover(source: Path, target: Path) -> Recovery:
    """Write everything sound in `source` to a new, complete, indexed log `target`.

    A complete log comes out as it went in. `target` appears whole or not at all.

    Raises:
        ForeignLogError: `source` does not begin like an MCAP file.
        LogError: it cannot be read, nothing in it is sound, or `target` exists.
        InputError: `target` cannot be written.
    """
    if target.exists():
        raise LogError(target, "exists already; give another name")
    saved = load_damaged(source)
    messages = [message for batch in saved.messages.values() for message in batch]
    if not messages:
        raise LogError(source, "nothing to recover: it holds no whole chunk")
    write_atomically(target, _rewritten(saved))
    return Recovery(
        target=target,
        messages=len(messages),
        attachments=len(saved.attachments),
        start_ns=min(message.log_time for message in messages),
        end_ns=max(message.log_time for message in messages),
        losses=tuple(saved.losses),
    )


def _rewritten(saved: Contents) -> bytes:
    """Return the contents as a new, indexed MCAP file, with one chunk for each of the source."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=_CHUNK_BYTES, enable_data_crcs=True)
    writer.start(library=f"aerofed {LIBRARY_IDENTIFIER}")
    schemas = {
        schema.id: writer.register_schema(schema.name, schema.encoding, schema.data)
        for schema in saved.schemas.values()
    }
    channels = {
        channel.id: writer.register_channel(
            channel.topic,
            channel.message_encoding,
            schemas.get(channel.schema_id, 0),
            channel.metadata,
        )
        for channel in saved.channels.values()
    }
    for batch in saved.batches:
        if isinstance(batch, Metadata):
            writer.add_metadata(batch.name, batch.metadata)
        elif isinstance(batch, Attachment):
            writer.add_attachment(
                batch.create_time, batch.log_time, batch.name, batch.media_type, batch.data
            )
        else:
            for message in batch:
                writer.add_message(
                    channels[message.channel_id],
                    message.log_time,
                    message.data,
                    message.publish_time,
                    message.sequence,
                )
            writer.flush()
    writer.finish()
    return stream.getvalue()
