"""Saves what a log still holds: after `kill -9`, a full disk, or damage in its midst."""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mcap.records import Attachment, Message, Metadata

from mission.base.run_folder import write_atomically
from mission.log.chunked import ChunkedWriter
from mission.log.errors import LogError
from mission.log.mcap_io import new_writer
from mission.log.salvage import Gap, Salvaged, salvage
from mission.log.values import NS_PER_S


@dataclass(frozen=True)
class Recovery:
    """What was saved into `target`, and what was not."""

    target: Path
    messages: int
    attachments: int
    start_ns: int
    end_ns: int
    losses: tuple[Gap, ...]
    unknown: int  # messages of channels that nothing describes any more

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
    saved = salvage(source)
    if not any(isinstance(batch, list) for batch in saved.batches):
        raise LogError(source, "nothing to recover: it holds no whole chunk")
    content = io.BytesIO()
    unknown = _write(content, saved)
    write_atomically(target, content.getvalue())
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


def _write(stream: IO[bytes], saved: Salvaged) -> int:
    """Write the batches, a chunk each; returns the messages that no channel describes."""
    schemas, channels = saved.declarations()
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


def _write_chunk(
    writer: ChunkedWriter, messages: list[Message], channel_ids: dict[int, int]
) -> int:
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
