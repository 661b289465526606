"""Where encoded messages go: the file here, the live view in `live`."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from mission.log.errors import LogError
from mission.log.mcap_io import new_writer, our_channels, register
from mission.log.topics import Topic


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
        """Start the file, replacing one that is there.

        Raises:
            LogError: it cannot be made.
        """
        self.path = path
        with self._named():
            self._file = path.open("wb")
        with self._named():
            self._writer = new_writer(self._file)
            register(self._writer)
        self._channel = {channel.topic: number for number, channel in our_channels()[1].items()}
        self._sequence = dict.fromkeys(self._channel.values(), 0)

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None:
        channel = self._channel[topic.name]
        sequence = self._sequence[channel]
        self._sequence[channel] = sequence + 1
        try:  # it may end a chunk; a context manager would cost more than the rest
            self._writer.add_message(channel, t_ns, data, t_ns, sequence)
        except OSError as error:
            raise self._error(error) from None

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """A named set of strings beside the messages."""
        with self._named():
            self._writer.add_metadata(name, dict(values))

    def attach(self, t_ns: int, name: str, media_type: str, data: bytes) -> None:
        """A file inside the file."""
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
