"""Where encoded messages go: the MCAP file here, viewers in `live`."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Protocol

from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from mission.log import LogError
from mission.log.topics import TOPICS, Topic

# A chunk ends with each flush; this only bounds one that grows while simulated time stands still.
_CHUNK_BYTES = 4 << 20


class Sink(Protocol):
    """Takes messages in the order in which they happen."""

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None: ...

    def flush(self) -> None: ...

    def close(self) -> None: ...


def new_writer(stream: IO[bytes]) -> Any:
    """A started `mcap.writer.Writer`: zstd chunks, every index, statistics and checksums."""
    writer = Writer(
        stream,
        chunk_size=_CHUNK_BYTES,
        compression=CompressionType.ZSTD,
        enable_data_crcs=True,
    )
    writer.start(library=f"aerofed {LIBRARY_IDENTIFIER}")
    return writer


class McapSink:
    """An MCAP file of every topic of a flight log.

    The bytes are a function of what is written and flushed: nothing of the wall clock goes in.
    """

    def __init__(self, path: Path) -> None:
        """Start the file, replacing one that is there.

        Raises:
            LogError: it cannot be made.
        """
        self.path = path
        with self._named():
            self._file = path.open("wb")
            self._writer = new_writer(self._file)
            schemas = {
                name: self._writer.register_schema(name, topic.schema_encoding, topic.schema)
                for name, topic in {topic.schema_name: topic for topic in TOPICS}.items()
            }
            self._channels: dict[str, int] = {
                topic.name: self._writer.register_channel(
                    topic.name, topic.encoding, schemas[topic.schema_name]
                )
                for topic in TOPICS
            }
        self._sequence = dict.fromkeys(self._channels, 0)

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None:
        sequence = self._sequence[topic.name]
        self._sequence[topic.name] = sequence + 1
        try:  # a context manager would cost a tenth of the log
            self._writer.add_message(self._channels[topic.name], t_ns, data, t_ns, sequence)
        except OSError as error:
            raise self._error(error) from None

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a named set of strings (an MCAP Metadata record)."""
        with self._named():
            self._writer.add_metadata(name, dict(values))

    def attach(self, t_ns: int, name: str, media_type: str, data: bytes) -> None:
        """Write a file into the file (an MCAP Attachment record)."""
        with self._named():
            self._writer.add_attachment(0, t_ns, name, media_type, data)

    def flush(self) -> None:
        """Hand everything to the operating system: it survives the death of this process."""
        with self._named():
            self._writer.flush()

    def sync(self) -> None:
        """Flush to the disk itself, so that it survives a power loss."""
        self.flush()
        with self._named():
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Write indexes and statistics. Closing twice is fine."""
        if self._file.closed:
            return
        with self._named():
            try:
                self._writer.finish()
            finally:
                self._file.close()

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Say of which file an error of the operating system is."""
        try:
            yield
        except OSError as error:
            raise self._error(error) from None

    def _error(self, error: OSError) -> LogError:
        return LogError(self.path, f"cannot write the log: {error.strerror}")
