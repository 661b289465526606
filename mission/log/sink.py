"""Where encoded messages go: the file here, the live view in `live`."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from mission.log.errors import LogError
from mission.log.topics import TOPICS, Topic

LIBRARY = f"aerofed {LIBRARY_IDENTIFIER}"

# A chunk ends with each flush; this only bounds one that grows while simulated time stands still.
_CHUNK_BYTES = 4 << 20


class Sink(Protocol):
    """Takes messages in the order in which they happen."""

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None: ...

    def flush(self) -> None: ...

    def close(self) -> None: ...


class McapSink:
    """An MCAP file with zstd chunks, indexes, statistics and checksums.

    The bytes are a function of what is written and flushed: nothing of the wall clock goes in.
    """

    def __init__(self, path: Path) -> None:
        """Raises LogError if the file cannot be made."""
        self.path = path
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise LogError(path, f"cannot write the log: {error.strerror}") from None
        self._writer = new_writer(self._file)
        self._channel = register(self._writer)
        self._sequence = dict.fromkeys(self._channel, 0)

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None:
        name = topic.name
        self._writer.add_message(
            self._channel[name], t_ns, data, publish_time=t_ns, sequence=self._sequence[name]
        )
        self._sequence[name] += 1

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """A named set of strings beside the messages."""
        self._writer.add_metadata(name, dict(values))

    def attach(self, t_ns: int, name: str, media_type: str, data: bytes) -> None:
        """A file inside the file."""
        self._writer.add_attachment(
            create_time=0, log_time=t_ns, name=name, media_type=media_type, data=data
        )

    def flush(self) -> None:
        """Hand everything to the operating system: it survives the death of this process."""
        try:
            self._writer.flush()
        except OSError as error:
            raise LogError(self.path, f"cannot write the log: {error.strerror}") from None

    def sync(self) -> int:
        """Flush to the disk itself, so that it survives a power loss; returns the file's size."""
        self.flush()
        os.fsync(self._file.fileno())
        return self._file.tell()

    def close(self) -> None:
        """Write indexes and statistics. Closing twice is fine."""
        if self._file.closed:
            return
        try:
            self._writer.finish()
            self._file.close()
        except OSError as error:
            raise LogError(self.path, f"cannot write the log: {error.strerror}") from None


def new_writer(stream: object) -> Writer:
    """The one way in which this program writes MCAP, started."""
    writer = Writer(
        stream,
        chunk_size=_CHUNK_BYTES,
        compression=CompressionType.ZSTD,
        enable_data_crcs=True,
    )
    writer.start(library=LIBRARY)
    return writer


def register(writer: Writer) -> dict[str, int]:
    """Register every topic, in one order, so that ids mean the same in every log of ours."""
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    for topic in TOPICS:
        if topic.schema_name not in schemas:
            schemas[topic.schema_name] = writer.register_schema(
                topic.schema_name, topic.schema_encoding, topic.schema
            )
        channels[topic.name] = writer.register_channel(
            topic.name, topic.encoding, schemas[topic.schema_name]
        )
    return channels
