"""Goes on with a log that a killed run left, as if it had never stopped."""

import os
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Message
from mcap.writer import MCAP0_MAGIC, Writer

from mission.log import framing
from mission.log.errors import DamagedLogError, LogError
from mission.log.framing import BrokenRecordError, Frame
from mission.log.mcapio import new_writer, register


def replay(path: Path, keep_bytes: int) -> tuple[IO[bytes], Writer, dict[int, int]]:
    """Cut the log at `path` to its first bytes and open it for more.

    A writer keeps indexes and statistics in memory, so what is kept is written anew, chunk by
    chunk, and must come out byte for byte; only then does it take the old file's place.

    Returns the open file, its writer, and by channel id the number of its next message.

    Raises:
        LogError: the file is shorter than `keep_bytes`, damaged before it, from another version,
            or cannot be written.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        stream = partial.open("w+b")
    except OSError as error:
        raise LogError(path, f"cannot write the log: {error.strerror}") from None
    try:
        writer, sequence = _copy(path, stream, keep_bytes)
        partial.replace(path)
    except OSError as error:
        stream.close()
        partial.unlink(missing_ok=True)
        raise LogError(path, f"cannot go on with the log: {error.strerror}") from None
    except LogError:
        stream.close()
        partial.unlink(missing_ok=True)
        raise
    return stream, writer, sequence


def _copy(path: Path, target: IO[bytes], keep_bytes: int) -> tuple[Writer, dict[int, int]]:
    writer = new_writer(target)
    register(writer)
    sequence: dict[int, int] = {}
    with framing.open_log(path) as source:
        try:
            end = len(MCAP0_MAGIC)
            for frame in framing.frames(source, size=path.stat().st_size):
                if frame.end > keep_bytes:
                    break
                _repeat(frame, writer, sequence)
                end = frame.end
                if end == keep_bytes:
                    break
        except BrokenRecordError as broken:
            raise DamagedLogError(path, broken.reason, broken.offset) from None
        writer.flush()
        os.fsync(target.fileno())
        source.seek(0)
        kept = source.read(keep_bytes)
    target.seek(0)
    if end != keep_bytes or target.read() != kept:
        raise LogError(
            path, f"cannot go on at byte {keep_bytes}: another version or another run wrote it"
        )
    return writer, sequence


def _repeat(frame: Frame, writer: Writer, sequence: dict[int, int]) -> None:
    if frame.opcode == Opcode.CHUNK:
        for item in framing.chunk_records(frame):
            if isinstance(item, Message):
                writer.add_message(
                    item.channel_id, item.log_time, item.data, item.publish_time, item.sequence
                )
                sequence[item.channel_id] = item.sequence + 1
        writer.flush()
    elif frame.opcode == Opcode.METADATA:
        found = framing.metadata(frame)
        writer.add_metadata(found.name, found.metadata)
    elif frame.opcode == Opcode.ATTACHMENT:
        file = framing.attachment(frame)
        writer.add_attachment(
            file.create_time, file.log_time, file.name, file.media_type, file.data
        )
