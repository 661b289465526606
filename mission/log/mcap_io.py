"""The one way in which this program writes MCAP."""

from typing import IO

from mcap.records import Channel, Schema
from mcap.writer import LIBRARY_IDENTIFIER

from mission.log.chunked import ChunkedWriter
from mission.log.topics import TOPICS

LIBRARY = f"aerofed {LIBRARY_IDENTIFIER}"

# A chunk ends with each flush; this only bounds one that grows while simulated time stands still.
_CHUNK_BYTES = 4 << 20


def new_writer(stream: IO[bytes]) -> ChunkedWriter:
    """A started writer: zstd chunks, every index, statistics and checksums."""
    return ChunkedWriter(stream, library=LIBRARY, chunk_bytes=_CHUNK_BYTES)


def register(writer: ChunkedWriter) -> None:
    """Register every topic, in one order, so that ids mean the same in every log of ours."""
    schemas, channels = our_channels()
    for schema in schemas.values():
        writer.register_schema(schema.name, schema.encoding, schema.data)
    for channel in channels.values():
        writer.register_channel(channel.topic, channel.message_encoding, channel.schema_id, {})


def our_channels() -> tuple[dict[int, Schema], dict[int, Channel]]:
    """The schemas and channels of every log of ours, by id; ids count from 1 as mcap gives them."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    known: dict[str, int] = {}
    for topic in TOPICS:
        if topic.schema_name not in known:
            number = known[topic.schema_name] = len(schemas) + 1
            schemas[number] = Schema(number, topic.schema, topic.schema_encoding, topic.schema_name)
        channel = len(channels) + 1
        channels[channel] = Channel(
            channel, topic.name, topic.encoding, {}, known[topic.schema_name]
        )
    return schemas, channels
