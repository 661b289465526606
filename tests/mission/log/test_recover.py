"""Nothing that was flushed is lost, whatever happens to the writer or to the file."""

import contextlib
import io
import json
import math
import os
import struct
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from limits import no_file_larger_than
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk, Message, Metadata
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer
from synthetic_flight import AREA, Fixed, fly

from mission.base.errors import InputError
from mission.cli import call
from mission.log import DamagedLogError, LogError
from mission.log.contents import _rewritten, load, load_damaged, recover
from mission.log.inspection import check, diff, info
from mission.log.reader import read_log
from mission.log.writer import FlightLog

KILLS = 12


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Fixed:
    return fly(tmp_path_factory.mktemp("run"), rounds=1)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory, made: Fixed) -> bytes:
    """A short log with an attachment between its chunks."""
    path = tmp_path_factory.mktemp("small") / "small.mcap"
    with FlightLog(path, area=AREA, devices=made.world) as log:
        for index, sample in enumerate(made.samples[:35]):
            log.sampled(sample)
            if index == 15:
                log.attach("a.txt", "text/plain", b"hello " * 20)
        log.plan(made.samples[34].t_ns, 1, made.problems[0], made.plans[0], speed_mps=20.0)
    return path.read_bytes()


def frames_of(data: bytes) -> Iterator[tuple[int, int, int]]:
    """(opcode, offset, end) of every record."""
    at = len(MCAP0_MAGIC)
    while at < len(data) - len(MCAP0_MAGIC):
        opcode, length = struct.unpack_from("<BQ", data, at)
        yield opcode, at, at + 9 + length
        at += 9 + length


def messages_of(path: Path) -> list[tuple[str, int, bytes]]:
    with path.open("rb") as stream:
        return [
            (channel.topic, message.sequence, message.data)
            for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages(
                log_time_order=False
            )
        ]


def whole_chunks(path: Path) -> list[tuple[int, int]]:
    """(end offset, messages up to there) of every chunk, by the format's own reader."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    ends, total = [], 0
    data = path.read_bytes()
    for index in summary.chunk_indexes:
        end = index.chunk_start_offset + index.chunk_length
        body = data[index.chunk_start_offset + 9 : end]
        records = breakup_chunk(Chunk.read(ReadDataStream(io.BytesIO(body))))
        total += sum(isinstance(record, Message) for record in records)
        ends.append((end, total))
    return ends


def test_a_complete_log_comes_out_as_it_went_in(tmp_path: Path, made: Fixed) -> None:
    saved = recover(made.log, tmp_path / "out.mcap")
    assert messages_of(tmp_path / "out.mcap") == messages_of(made.log)
    assert diff(tmp_path / "out.mcap", made.log) == ()
    assert saved.losses == ()
    assert saved.attachments == 2


@pytest.mark.slow
def test_cut_at_every_kind_of_place_keeps_every_whole_chunk(tmp_path: Path, small: bytes) -> None:
    intact = tmp_path / "intact.mcap"
    intact.write_bytes(small)
    everything = messages_of(intact)
    chunks = whole_chunks(intact)
    frames = list(frames_of(small))
    assert {opcode for opcode, _, _ in frames} >= {1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}
    # Of each opcode the first and last: the others are cut alike.
    places = {(op, end): (at, end) for op, at, end in (*frames, *frames[::-1])}
    kept = {op: [p for (o, _), p in places.items() if o == op] for op, _, _ in frames}
    cuts = {
        cut
        for of_kind in kept.values()
        for at, end in (of_kind[0], of_kind[-1])
        for cut in (at, at + 1, at + 9, (at + end) // 2, end - 1)
    } | {0, 4, 8, len(small) - 8, len(small) - 1}
    for cut in sorted(cuts):
        source, target = tmp_path / "cut.mcap", tmp_path / f"{cut}.mcap"
        source.write_bytes(small[:cut])
        expected = max((count for end, count in chunks if end <= cut), default=0)
        if not expected:
            with pytest.raises(LogError, match=r"nothing to recover|not an MCAP file"):
                recover(source, target)
            assert not target.exists()
            continue
        with pytest.raises(DamagedLogError):
            load(source)
        saved = recover(source, target)
        assert saved.messages == expected, cut
        assert messages_of(target) == everything[:expected]
        assert check(target) == ()


def test_a_machine_without_memory_is_no_damage(
    made: Fixed, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was `an MCAP file without the devices`, and a recovery without the rest."""

    def starved(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr("mission.log.contents.breakup_chunk", starved)
    assert call(["log", "check", str(made.log)]) == 1
    assert capsys.readouterr().err == "aerofed: out of memory\n"


def test_a_length_beyond_the_file_is_a_broken_record(tmp_path: Path, small: bytes) -> None:
    at = next(at for opcode, at, _ in frames_of(small) if opcode == 6)  # the first chunk
    length_at = small.index(b"zstd", at) + 4
    data = bytearray(small)
    data[length_at : length_at + 8] = (2**62).to_bytes(8, "little")
    (tmp_path / "long.mcap").write_bytes(data)
    with pytest.raises(DamagedLogError):
        load(tmp_path / "long.mcap")


@settings(max_examples=60, deadline=None)
@given(place=st.floats(0, 1, exclude_max=True), change=st.integers(1, 255))
def test_an_altered_byte_is_noticed_or_harmless_and_what_is_saved_is_unaltered(
    tmp_path_factory: pytest.TempPathFactory, small: bytes, place: float, change: int
) -> None:
    folder = tmp_path_factory.mktemp("altered")
    intact, altered, target = (folder / f"{name}.mcap" for name in ("intact", "altered", "saved"))
    intact.write_bytes(small)
    data = bytearray(small)
    data[int(place * len(data))] ^= change
    altered.write_bytes(data)
    whole = load(intact)
    with contextlib.suppress(LogError):
        found = load(altered)
        assert (found.messages, found.attachments) == (whole.messages, whole.attachments)
    try:
        saved = recover(altered, target)
    except LogError:
        return
    everything, found_messages = messages_of(intact), messages_of(target)
    assert set(found_messages) <= set(everything)
    assert len(found_messages) == saved.messages


def test_an_altered_chunk_costs_itself_alone(tmp_path: Path, made: Fixed) -> None:
    data = bytearray(made.log.read_bytes())
    chunks = whole_chunks(made.log)
    lost = 0
    for number in (0, 2):  # [0] holds all declarations; the end of the file has them again
        data[chunks[number][0] - 100] ^= 1
        lost += chunks[number][1] - (chunks[number - 1][1] if number else 0)
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(data)
    with pytest.raises(DamagedLogError, match="damaged at byte"):
        load(broken)
    saved = recover(broken, tmp_path / "saved.mcap")
    assert len(saved.losses) == 2
    assert saved.messages == len(messages_of(made.log)) - lost
    run = read_log(tmp_path / "saved.mcap")
    assert run.rounds == tuple(made.rounds)
    np.testing.assert_array_equal(run.devices.pos_m, made.world.pos_m)


def test_a_chunk_that_does_not_unpack_as_lz4_costs_itself_alone(
    tmp_path: Path, made: Fixed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Our writer compresses by Zstandard; other tools rewrite logs with LZ4."""
    lz4 = partial(Writer, compression=CompressionType.LZ4)
    monkeypatch.setattr("mission.log.contents.Writer", lz4)
    whole, broken = (tmp_path / f"{name}.mcap" for name in ("whole", "broken"))
    recover(made.log, whole)
    data, chunks = bytearray(whole.read_bytes()), whole_chunks(whole)
    at = [at for opcode, at, _ in frames_of(bytes(data)) if opcode == 6][2]
    data[data.index(b"lz4", at) + 11] ^= 1  # after the length: how LZ4 begins
    broken.write_bytes(data)
    assert call(["log", "check", str(broken)]) == 2
    saved = recover(broken, tmp_path / "saved.mcap")
    assert len(saved.losses) == 1
    assert saved.messages == chunks[-1][1] - (chunks[2][1] - chunks[1][1])


def with_a_chunk(data: bytes, kind: str, *, holds: int, promises: int) -> bytes:
    """A log with one more chunk before its index: of zeros, `holds` bytes, as LZ4 or Zstandard."""
    pack = {"lz4": lz4.frame.compress, "zstd": zstandard.compress, "": bytes}[kind]
    builder = RecordBuilder()
    Chunk(kind, pack(bytes(holds)), 0, 0, 0, promises).write(builder)
    at = next(at for opcode, at, _ in frames_of(data) if opcode == 15)
    return data[:at] + builder.end() + data[at:]


@pytest.mark.parametrize("kind", ["lz4", "zstd"])
@pytest.mark.parametrize("promises", [100, 10**9])
def test_a_chunk_unpacks_to_no_more_than_it_promises_and_is_fit_for(
    tmp_path: Path, made: Fixed, kind: str, promises: int
) -> None:
    log = tmp_path / "a.mcap"
    log.write_bytes(with_a_chunk(made.log.read_bytes(), kind, holds=300_000_000, promises=promises))
    tracemalloc.start()
    try:
        contents = load_damaged(log)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert [loss.reason for loss in contents.losses] == ["a chunk that does not unpack"]
    assert sum(map(len, contents.messages.values())) == len(messages_of(made.log))
    assert most < 100_000_000


def test_a_log_without_chunks_is_read(tmp_path: Path, made: Fixed) -> None:
    """As writers that do not compress leave it."""
    contents, log = load(made.log), tmp_path / "a.mcap"
    with log.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start()
        for schema in contents.schemas.values():
            writer.register_schema(schema.name, schema.encoding, schema.data)
        for it in contents.channels.values():
            writer.register_channel(it.topic, it.message_encoding, it.schema_id, it.metadata)
        for name, values in contents.metadata.items():
            writer.add_metadata(name, values)
        for batch in contents.messages.values():
            for m in batch:
                writer.add_message(m.channel_id, m.log_time, m.data, m.publish_time, m.sequence)
        writer.finish()
    assert read_log(log).rounds == tuple(made.rounds)
    assert info(log).messages == len(messages_of(made.log))
    assert sorted(messages_of(log)) == sorted(messages_of(made.log))


@pytest.mark.parametrize(
    ("topic", "change"),
    [
        ("/devices", {"community": [1.0] * 12}),
        ("/events", {"seq": math.nan}),
        ("/events", {"text": 3}),
        ("/events", {"true_m": [[1.0], 2.0, 3.0]}),
        ("/rounds", {"round": "1"}),
        ("/rounds", {"duration_s": 10**400}),
        ("", {"home": '{"lat_deg": NaN, "lon_deg": 8, "alt_msl_m": 1}'}),
        ("", {"size_m": '["800", [1]]'}),
    ],
)
def test_values_that_no_checksum_tells_are_one_line(
    tmp_path: Path,
    made: Fixed,
    capfd: pytest.CaptureFixture[str],
    topic: str,
    change: dict[str, Any],
) -> None:
    contents, log = load(made.log), tmp_path / "a.mcap"
    for number, batch in enumerate(contents.batches):
        if isinstance(batch, Metadata) and not topic:
            contents.batches[number] = replace(batch, metadata={**batch.metadata, **change})
        for message in batch if isinstance(batch, list) else ():
            if contents.channels[message.channel_id].topic == topic:
                message.data = json.dumps({**json.loads(message.data), **change}).encode()
    log.write_bytes(_rewritten(contents))
    assert call(["compare", str(log)]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"aerofed: {log}: ")


def test_messages_that_nothing_describes_any_more_are_told(tmp_path: Path, made: Fixed) -> None:
    data = bytearray(made.log.read_bytes())
    chunks = whole_chunks(made.log)
    data[chunks[1][0] - 100] ^= 1  # the first samples', and with them what declares their topics
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: chunks[-1][0]])
    saved = recover(cut, tmp_path / "saved.mcap")
    topics = load(saved.target).messages.keys()
    assert {"/devices", "/true/pose", "/uplinks"} & topics == {"/devices", "/uplinks"}
    lost = chunks[-1][1] - (chunks[1][1] - chunks[0][1]) - saved.messages
    assert lost > 100
    assert f"{lost} messages of channels" in saved.losses[-1].reason


def test_a_full_disk_is_one_line_and_loses_nothing_that_was_flushed(
    tmp_path: Path, made: Fixed
) -> None:
    path = tmp_path / "a.mcap"

    def fly_on() -> None:
        with FlightLog(path, area=AREA, devices=made.world) as log:
            for sample in made.samples:
                log.sampled(sample)

    full = pytest.raises(InputError, match=r"a\.mcap: cannot write: File too large")
    with no_file_larger_than(60_000), full:
        fly_on()
    saved = recover(path, tmp_path / "saved.mcap")
    assert saved.messages > 500
    assert not check(saved.target)


def test_recovery_never_overwrites(tmp_path: Path, made: Fixed) -> None:
    target = tmp_path / "there.mcap"
    target.write_text("mine")
    with pytest.raises(LogError, match="exists already"):
        recover(made.log, target)
    assert target.read_text() == "mine"


@pytest.mark.slow
def test_killed_at_random_moments(tmp_path: Path) -> None:
    """`kill -9` while the log is written: all but the last ten seconds come back, unaltered."""
    reference = tmp_path / "reference"
    reference.mkdir()
    everything = messages_of(whole := fly(reference, rounds=2).log)
    samples = len(load(whole).messages["/true/pose"])
    script = Path(__file__).with_name("kill_writers.py")
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path), str(KILLS), str(samples)],
        check=True, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    reports = [tuple(map(int, line.split())) for line in done.stdout.splitlines()]
    assert len(reports) == KILLS
    for number, sampled_ns in reports:
        log, saved = tmp_path / f"{number}.mcap", tmp_path / f"{number}.saved.mcap"
        try:
            recover(log, saved)
        except LogError:
            assert sampled_ns < 10_000_000_000
            continue
        found = messages_of(saved)
        assert found == everything[: len(found)]
        assert check(saved) == ()
        poses = load(saved).messages.get("/true/pose", [])
        newest = poses[-1].log_time if poses else 0
        assert newest > sampled_ns - 10_000_000_000
    assert len({sampled_ns for _, sampled_ns in reports}) > KILLS // 6  # not always the same
