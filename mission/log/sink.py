"""Where encoded messages go: the MCAP file here, viewers in `live`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import foxglove
from foxglove.mcap import MCAPWriteOptions

from mission.base.record_file import RecordFile
from mission.log.topics import TOPICS, Topic


class Sink(Protocol):
    """Receiver of encoded messages, such as a file or live viewers."""

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None: ...

    def flush(self) -> None: ...

    def close(self) -> None: ...


def channels(context: foxglove.Context) -> dict[str, Any]:
    """Create a Foxglove channel for each topic of a flight log; returns them by topic name."""
    return {topic.name: channel(context, topic) for topic in TOPICS}


def channel(context: foxglove.Context, topic: Topic) -> Any:
    """Create a topic's Foxglove channel.

    The library's constructor is not used: it keeps every channel ever made, 55 KB for a log.
    """
    schema = foxglove.Schema(
        name=topic.schema_name, encoding=topic.schema_encoding, data=topic.schema
    )
    return context._create_channel(topic.name, message_encoding=topic.encoding, schema=schema)


class McapSink:
    """An MCAP file: zstd chunks, every index, statistics and checksums.

    The bytes are a function of what is written and flushed: nothing of the wall clock goes in.
    """

    def __init__(self, path: Path) -> None:
        """Start the file, replacing one that is there.

        Raises:
            InputError: it cannot be made.
        """
        self.file = RecordFile(path)
        self._context = foxglove.Context()  # kept: channels alone do not keep it alive
        # A chunk ends with each flush, and goes into the file as a whole, or not at all.
        options = MCAPWriteOptions(chunk_size=None, compression_threads=0, disable_seeking=True)
        self._writer = foxglove.open_mcap(self.file, context=self._context, writer_options=options)
        self._log = {name: channel.log for name, channel in channels(self._context).items()}

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None:
        self._log[topic.name](data, t_ns)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a named set of strings (an MCAP Metadata record)."""
        self._writer.write_metadata(name, dict(values))

    def attach(self, t_ns: int, name: str, media_type: str, data: bytes) -> None:
        """Add a file to the log (an MCAP Attachment record)."""
        self._writer.attach(
            log_time=t_ns, create_time=0, name=name, media_type=media_type, data=data
        )

    def flush(self) -> None:
        """Hand everything to the operating system: it survives the death of this process.

        Raises:
            InputError: it could not be written, or somebody else changed the file.
        """
        self._writer.flush()
        self.file.check()

    def sync(self) -> None:
        """Flush to the disk itself, so that it survives a power loss."""
        self._writer.flush()
        self.file.sync()
        self.file.check()

    def close(self) -> None:
        """Write indexes and statistics. Closing twice is fine."""
        self._writer.close()
        self.file.close()
        self.file.check()
