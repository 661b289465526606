"""A log's messages, verified and sorted by topic, not yet decoded."""

import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap_protobuf.decoder import DecoderFactory

from mission.base.area import Area
from mission.log import framing, topics
from mission.log.errors import DamagedLogError, ForeignLogError
from mission.log.framing import BrokenRecordError
from mission.log.salvage import Salvaged, salvage
from mission.log.topics import Topic
from mission.log.values import area_from_text

Json: TypeAlias = dict[str, Any]  # an object, as it is parsed
Row = tuple[int, Any]


@dataclass(frozen=True)
class Contents:
    """A verified log, not yet decoded: messages in file order by topic."""

    path: Path
    schemas: dict[str, Schema]  # by topic
    encodings: dict[str, str]  # by topic
    messages: dict[str, list[Message]]
    metadata: dict[str, dict[str, str]]
    attachments: dict[str, bytes]

    @property
    def area(self) -> Area:
        """The area that the log is about.

        Raises:
            ForeignLogError: the metadata that our writer puts first is missing.
        """
        ours = self.metadata.get("aerofed")
        if ours is None:
            raise ForeignLogError(
                self.path, "an MCAP file, but not one of ours (no `aerofed` metadata)"
            )
        if ours.get("format") != topics.FORMAT_VERSION:
            raise ForeignLogError(
                self.path,
                f"log format {ours.get('format')!r}, this version reads {topics.FORMAT_VERSION!r}",
            )
        try:
            return area_from_text(ours)
        except (KeyError, ValueError) as error:
            raise ForeignLogError(self.path, f"`aerofed` metadata without {error}") from None

    def decoded(self, topic: Topic) -> Iterator[Row]:
        """(t_ns, message) in order of time; JSON as dicts, protobuf as messages.

        Raises:
            DamagedLogError: a message does not decode, or the topic has another schema.
        """
        rows = sorted(self.messages.get(topic.name, ()), key=lambda message: message.log_time)
        if not rows:
            return
        schema = self.schemas[topic.name]
        if schema.name != topic.schema_name:
            raise ForeignLogError(
                self.path, f"{topic.name} has schema {schema.name}, not {topic.schema_name}"
            )
        decode: Callable[[bytes], Any] | None = json.loads
        if topic.encoding == "protobuf":
            decode = DecoderFactory().decoder_for(self.encodings[topic.name], schema)
        if decode is None:
            raise ForeignLogError(self.path, f"{topic.name} is not {topic.encoding}")
        for message in rows:
            try:
                yield message.log_time, decode(message.data)
            except ValueError as error:
                raise ForeignLogError(
                    self.path, f"{topic.name}: message {message.sequence} does not decode: {error}"
                ) from None


def load(path: Path) -> Contents:
    """Verify a whole log and sort its messages by topic.

    Raises:
        LogError: it cannot be read, is no MCAP file, or is damaged; the message says where.
    """
    whole = Salvaged()
    for frame in framing.verify(path):
        try:
            whole.take(frame)
        except BrokenRecordError as broken:
            raise DamagedLogError(path, broken.reason, broken.offset) from None
        batch = whole.batches[-1] if frame.opcode == Opcode.CHUNK else ()
        if isinstance(batch, list):
            undeclared = {message.channel_id for message in batch} - whole.channels.keys()
            if undeclared:
                why = f"a message of channel {min(undeclared)}, which was never declared"
                raise DamagedLogError(path, why, frame.offset)
    return _contents(path, whole, whole.schemas, whole.channels)


def load_damaged(path: Path) -> Contents:
    """What is sound in a log whose writer was killed, or that is still being written.

    Raises:
        LogError: it cannot be read, or is no MCAP file.
    """
    saved = salvage(path)
    return _contents(path, saved, *saved.declarations())


def _contents(
    path: Path, saved: Salvaged, schemas: Mapping[int, Schema], channels: Mapping[int, Channel]
) -> Contents:
    messages: dict[str, list[Message]] = defaultdict(list)
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    for batch in saved.batches:
        if isinstance(batch, Metadata):
            metadata[batch.name] = dict(batch.metadata)
        elif isinstance(batch, Attachment):
            attachments[batch.name] = batch.data
        else:
            for message in batch:
                if message.channel_id in channels:
                    messages[channels[message.channel_id].topic].append(message)
    by_topic = {channel.topic: channel for channel in channels.values()}
    return Contents(
        path=path,
        schemas={
            name: schemas[channel.schema_id]
            for name, channel in by_topic.items()
            if channel.schema_id in schemas
        },
        encodings={name: channel.message_encoding for name, channel in by_topic.items()},
        messages=dict(messages),
        metadata=metadata,
        attachments=attachments,
    )
