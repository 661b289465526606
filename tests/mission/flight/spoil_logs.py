"""Damages logs and has them compared, in a process of its own: `spoil_logs.py FIRST COUNT LOG...`.

Prints a line for each answer that is neither a comparison nor one line of refusal. Whatever else is
printed, from C as well, goes to that answer. Processor time and memory are limited by the caller.
"""

import os
import random
import re
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import IO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.records import Chunk
from pymavlink.dialects.v20 import common as mav

from mission.cli import call

SEAMS = {  # where messages may begin
    ".ulg": re.compile(rb"(?s)..[ABDFILMOPS](?=[\w\x00-\x10])"),
    ".bin": re.compile(rb"\xa3\x95"),
    ".tlog": re.compile(rb"(?s)(?<=.{8})[\xfd\xfe]"),
    ".mcap": re.compile(rb"(?s)[\x01-\x0f].{2}\x00{6}"),
}
# What promises sizes, layouts and compression.
TELLING = {
    ".ulg": re.compile(rb"(?s)..[BFAIM].{12}"),
    ".bin": re.compile(rb"(?s)\xa3\x95\x80.{86}"),
    ".tlog": re.compile(rb"(?s)[\xfd\xfe].{9}"),
    ".mcap": re.compile(rb"(?s)[\x01-\x0f].{2}\x00{6}.{12}|(?:zstd|lz4)[^\0]?.{12}"),
}


def spoilt(content: bytes, end: str, r: random.Random) -> bytes:
    """The log with damage of one or two kinds."""
    for _ in range(r.choice((1, 1, 2))):
        content = (
            r.choice(SPOILING + [partial(repacked, end=end), partial(told, end=end)] * 2)(
                content, r=r
            )
            or b"\0"
        )
    return content


def cut(content: bytes, *, r: random.Random) -> bytes:
    return content[: r.randrange(len(content))]


def erased(content: bytes, *, r: random.Random) -> bytes:
    """As flash memory is from a place on."""
    return cut(content, r=r) + r.choice((b"\xff", b"\0", b"D", b"\xa3\x95\x80", b"\xfd")) * 20_000


def flipped(content: bytes, *, r: random.Random) -> bytes:
    data = bytearray(content)
    for _ in range(r.choice((1, 3, 30, 300))):
        data[r.randrange(len(data))] ^= 1 << r.randrange(8)
    return bytes(data)


def noisy(content: bytes, *, r: random.Random) -> bytes:
    at = r.randrange(len(content))
    return content[:at] + r.randbytes(r.randrange(1, 600)) + content[at + r.randrange(300) :]


def doubled(content: bytes, *, r: random.Random) -> bytes:
    """A stretch stands somewhere else, too."""
    begin, at = r.randrange(len(content)), r.randrange(len(content))
    return content[:at] + content[begin : begin + r.randrange(2000)] + content[at:]


SPOILING: list[Callable[..., bytes]] = [cut, erased, flipped, noisy, doubled]


def told(content: bytes, end: str, *, r: random.Random) -> bytes:
    """A byte or a number of what tells lengths and layouts is another."""
    found = [match.span() for match in TELLING[end].finditer(content)]
    if not found:
        return content
    begin, stop = r.choice(found)
    at, new = (
        r.randrange(begin, stop),
        r.choice((b"\xff", b"\xff\xff", b"\0", b"\0\0\0", b"9", b"@")),
    )
    return content[:at] + (new if r.random() < 0.7 else r.randbytes(8)) + content[at + len(new) :]


def repacked(content: bytes, end: str, *, r: random.Random) -> bytes:
    """Damage that no checksum tells: of values, of telemetry messages, of what chunks hold."""
    found = list(SEAMS[end].finditer(content))
    if not found:
        return content
    match = r.choice(found)
    at = match.end() + r.randrange(40)
    if end == ".tlog" and content[match.start()] == 0xFD:
        return _message(content, match.start(), r)
    if end == ".mcap":
        return _chunk(content, r)
    return content[:at] + r.randbytes(r.choice((1, 2, 8))) + content[at + 8 :]


def _message(content: bytes, at: int, r: random.Random) -> bytes:
    length, number = content[at + 1], int.from_bytes(content[at + 7 : at + 10], "little")
    if number not in mav.mavlink_map or not length:
        return content
    data = bytearray(content[at : at + 10 + length])
    for _ in range(r.choice((1, 4))):
        data[10 + r.randrange(len(data) - 10)] = r.choice((0, 127, 255, r.randrange(256)))
    extra = mav.mavlink_map[number].crc_extra
    data += struct.pack("<H", mav.x25crc([*data[1:], extra]).crc)
    return content[:at] + bytes(data) + content[at + len(data) :]


def _chunk(content: bytes, r: random.Random) -> bytes:
    chunks = [(at, end) for at, end in _records(content) if content[at] == 6]
    if not chunks:
        return content
    at, end = r.choice(chunks)
    try:
        chunk = Chunk.read(ReadDataStream(_Stream(content[at + 9 : end])))
        inner = zstandard.decompress(chunk.data, max_output_size=1 << 22)
    except Exception:  # damaged before
        return content
    match r.randrange(4):
        case 0:
            inner += bytes(r.choice((10**5, 10**8)))  # more than is promised
        case 1:
            inner = inner[: r.randrange(len(inner) + 1)]
        case _:
            inner = spoilt_text(inner, r)
    kind = r.choice(("zstd", "lz4", ""))
    pack = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}[kind]
    size = r.choice((len(inner), chunk.uncompressed_size, 10))
    builder = RecordBuilder()
    replace(
        chunk, data=pack(inner), compression=kind, uncompressed_crc=0, uncompressed_size=size
    ).write(builder)
    # The index after it no longer fits, as after a repair by somebody else.
    return content[:at] + builder.end() + content[end:]


def spoilt_text(inner: bytes, r: random.Random) -> bytes:
    """Numbers and words of records are others."""
    at = r.randrange(len(inner))
    new = r.choice((b"null", b"1e999", b"-1", b'"x"', b"[]", b"{}", b"\xff", r.randbytes(4)))
    return inner[:at] + new + inner[at + len(new) :]


class _Stream:
    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def read(self, size: int) -> bytes:
        self._at += size
        return self._data[self._at - size : self._at]


def _records(content: bytes) -> Iterator[tuple[int, int]]:
    at = 8
    while at + 9 <= len(content):
        end = at + 9 + int.from_bytes(content[at + 1 : at + 9], "little")
        yield at, min(end, len(content))
        at = end


def answer(log: Path) -> str:
    """What is wrong with how `aerofed compare` answers; empty if nothing is."""
    kept = os.dup(1), os.dup(2)
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        os.dup2(out.fileno(), 1)
        os.dup2(err.fileno(), 2)
        try:
            code = call(["compare", str(log)])
            wrong = ""
        except BaseException as error:
            code, wrong = 1, repr(error)
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os.dup2(kept[0], 1)
            os.dup2(kept[1], 2)
        printed, said = (_written(file) for file in (out, err))
    for descriptor in kept:
        os.close(descriptor)
    fine = (code == 0 and printed and not said) or (
        code == 2
        and not printed
        and said.startswith(f"aerofed: {log}: ")
        and len(said.splitlines()) == 1
    )
    return "" if fine else f"code {code} {wrong} {printed[:200]!r} {said[-300:]!r}"


def _written(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode(errors="replace")


def main() -> None:
    first, count, *logs = sys.argv[1:]
    for number in range(int(first), int(first) + int(count)):
        r = random.Random(number)
        source = Path(logs[number % len(logs)])
        content = spoilt(source.read_bytes(), source.suffix.lower(), r)
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / f"spoilt{source.suffix}"
            log.write_bytes(content)
            if wrong := answer(log):
                sys.stdout.write(f"{number} {source.name}: {wrong}\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main()
