"""Raw MAVLink: into the log by option, and out of it as a telemetry log (.tlog)."""

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

from mission.base.errors import InputError
from mission.base.run_folder import write_atomically
from mission.log import topics
from mission.log.errors import LogError
from mission.log.read.contents import Contents, load
from mission.log.write.writer import FlightLog
from sitl.links import Chunk, Link, Wake

# MAVLink 1 and 2: start byte -> bytes around the payload, and where its length stands.
_OVERHEAD = {0xFE: 8, 0xFD: 12}
_SIGNATURE = 13
_SIGNED = 0x01


class RecordedLink:
    """A link that writes what passes through it into a log. A `sitl.links.Link`."""

    def __init__(self, link: Link, log: FlightLog) -> None:
        self._link = link
        self._log = log

    def open(self, wake: Wake) -> None:
        """Start the link."""
        self._link.open(wake)

    def receive(self) -> list[Chunk]:
        """What has arrived, written as it arrived."""
        chunks = self._link.receive()
        for data, _ in chunks:
            self._log.mavlink(data, to_vehicle=True)
        return chunks

    def newcomers(self) -> bool:
        """Whether somebody has joined."""
        return self._link.newcomers()

    def send(self, frames: Sequence[bytes]) -> None:
        """Write and send frames."""
        for frame in frames:
            self._log.mavlink(frame, to_vehicle=False)
        self._link.send(frames)

    def close(self) -> None:
        """Stop the link."""
        self._link.close()


def export_tlog(path: Path, target: Path) -> Path:
    """Write a log's raw MAVLink as .tlog, which QGroundControl and MAVProxy replay.

    The format is a frame after its time in microseconds, big-endian, again and again; the time
    is simulated time.

    Raises:
        LogError: the log cannot be read, or holds no raw MAVLink.
        InputError: the file exists or cannot be written.
    """
    contents = load(path)
    _ = contents.area
    if target.exists():
        raise InputError(f"{target}: exists already; give another name")
    records = b"".join(struct.pack(">Q", t_ns // 1000) + frame for t_ns, frame in _all(contents))
    if not records:
        raise LogError(path, "holds no raw MAVLink: the run was not asked to record it")
    write_atomically(target, records)
    return target


def split_frames(data: bytes) -> Iterator[bytes]:
    """The whole MAVLink frames of a byte string; what lies between them is passed over."""
    at = 0
    while at < len(data):
        overhead = _OVERHEAD.get(data[at])
        if overhead is None or at + overhead > len(data):
            at += 1
            continue
        end = at + overhead + data[at + 1]
        if data[at] == 0xFD and data[at + 2] & _SIGNED:
            end += _SIGNATURE
        if end > len(data):
            at += 1
            continue
        yield data[at:end]
        at = end


def _all(contents: Contents) -> Iterator[tuple[int, bytes]]:
    messages = [
        message
        for topic in (topics.MAVLINK_TO_VEHICLE, topics.MAVLINK_FROM_VEHICLE)
        for message in contents.messages.get(topic.name, ())
    ]
    for message in sorted(messages, key=lambda item: item.log_time):
        for frame in split_frames(message.data):
            yield message.log_time, frame
