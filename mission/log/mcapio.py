"""The one way in which this program writes MCAP."""

from typing import IO

from mcap.records import Channel, Schema
from mcap.writer import LIBRARY_IDENTIFIER

from mission.log.mcapwriter import McapWriter
from mission.log.topics import TOPICS

LIBRARY = f"aerofed {LIBRARY_IDENTIFIER}"

# A chunk ends with each flush; this only bounds one that grows while simulated time stands still.
_CHUNK_BYTES = 4 << 20
_LEVEL = 5  # of zstd: beyond it a second of flight does not get smaller


def new_writer(stream: IO[bytes]) -> McapWriter:
    """A started writer."""
    return McapWriter(stream, library=LIBRARY, chunk_bytes=_CHUNK_BYTES, level=_LEVEL)


def register(writer: McapWriter) -> None:
    """Register every topic, in one order, so that ids mean the same in every log of ours."""
    schemas, channels = our_channels()
    for schema in schemas.values():
        writer.register_schema(schema.name, schema.encoding, schema.data)
    for channel in channels.values():
        writer.register_channel(channel.topic, channel.message_encoding, channel.schema_id)


def our_channels() -> tuple[dict[int, Schema], dict[int, Channel]]:
    """The schemas and channels of every log of ours, by id; ids count from 1 as mcap gives them."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    known: dict[str, int] = {"": 0}  # 0: no schema
    for topic in TOPICS:
        if topic.schema_name not in known:
            number = known[topic.schema_name] = len(schemas) + 1
            schemas[number] = Schema(number, topic.schema, topic.schema_encoding, topic.schema_name)
        channel = len(channels) + 1
        channels[channel] = Channel(
            channel, topic.name, topic.encoding, {}, known[topic.schema_name]
        )
    return schemas, channels
