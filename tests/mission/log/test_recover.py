"""Nothing that was flushed is lost, whatever happens to the writer or to the file."""

import io
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from limits import no_file_larger_than
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC
from synthetic_flight import AREA, Fixed, fly

from mission.log import framing
from mission.log.contents import load
from mission.log.errors import DamagedLogError, ForeignLogError, LogError
from mission.log.framing import Frame
from mission.log.inspection import check
from mission.log.reader import read_log
from mission.log.recover import recover
from mission.log.writer import FlightLog

KILLS = 50


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
    assert (tmp_path / "out.mcap").read_bytes() == made.log.read_bytes()
    assert saved.losses == ()
    assert saved.attachments == 3


@pytest.mark.slow
def test_cut_at_every_kind_of_place_keeps_every_whole_chunk(tmp_path: Path, small: bytes) -> None:
    intact = tmp_path / "intact.mcap"
    intact.write_bytes(small)
    everything = messages_of(intact)
    chunks = whole_chunks(intact)
    with intact.open("rb") as stream:
        frames = list(framing.frames(stream, size=len(small)))
    assert {frame.opcode for frame in frames} >= {1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}
    cuts = {
        cut
        for frame in frames
        for cut in (
            frame.offset, frame.offset + 1, frame.offset + 8, frame.offset + 9,
            frame.offset + 10, (frame.offset + frame.end) // 2, frame.end - 1,
        )
    } | {0, 4, 8, len(small) - 8, len(small) - 1}  # fmt: skip
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


@settings(max_examples=60, deadline=None)
@given(place=st.floats(0, 1, exclude_max=True), change=st.integers(1, 255))
def test_an_altered_byte_is_always_noticed_and_costs_one_chunk(
    tmp_path_factory: pytest.TempPathFactory, small: bytes, place: float, change: int
) -> None:
    folder = tmp_path_factory.mktemp("altered")
    intact, altered, target = (folder / f"{name}.mcap" for name in ("intact", "altered", "saved"))
    intact.write_bytes(small)
    data = bytearray(small)
    data[int(place * len(data))] ^= change
    altered.write_bytes(data)
    with pytest.raises(LogError):
        load(altered)
    everything = messages_of(intact)
    try:
        saved = recover(altered, target)
    except ForeignLogError:
        assert place * len(small) < 8  # the magic bytes themselves
        return
    found = messages_of(target)
    assert set(found) <= set(everything)
    assert len(found) == saved.messages
    largest = np.diff([0, *(count for _, count in whole_chunks(intact))]).max()
    assert len(found) >= len(everything) - largest


def test_a_lost_first_chunk_takes_only_its_own_second(tmp_path: Path, made: Fixed) -> None:
    data = bytearray(made.log.read_bytes())
    end, count = whole_chunks(made.log)[1]  # [0] holds what was written at the start
    data[end - 100] ^= 1
    data[whole_chunks(made.log)[0][0] - 100] ^= 1
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(data)
    saved = recover(broken, tmp_path / "saved.mcap")
    assert len(saved.losses) == 2
    assert saved.unknown == 0
    assert saved.messages == len(messages_of(made.log)) - count
    run = read_log(tmp_path / "saved.mcap")
    assert run.rounds == tuple(made.rounds)
    np.testing.assert_array_equal(run.devices.pos_m, made.world.pos_m)


def test_a_full_disk_is_one_line_and_loses_nothing_that_was_flushed(
    tmp_path: Path, made: Fixed
) -> None:
    path = tmp_path / "a.mcap"

    def fly_on() -> None:
        with FlightLog(path, area=AREA, devices=made.world) as log:
            for sample in made.samples:
                log.sampled(sample)

    full = pytest.raises(LogError, match=r"a\.mcap: cannot write the log: File too large")
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
    """`kill -9` while the log is being written: all but the last second comes back, unaltered."""
    reference = tmp_path / "reference"
    reference.mkdir()
    everything = messages_of(fly(reference, rounds=2).log)
    script = Path(__file__).with_name("kill_writers.py")
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path), str(KILLS)],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    reports = [tuple(map(int, line.split())) for line in done.stdout.splitlines()]
    assert len(reports) == KILLS
    for number, sampled_ns in reports:
        log, saved = tmp_path / f"{number}.mcap", tmp_path / f"{number}.saved.mcap"
        try:
            recover(log, saved)
        except LogError:
            assert sampled_ns < 5_000_000_000
            continue
        found = messages_of(saved)
        assert found == everything[: len(found)]
        assert check(saved) == ()
        poses = load(saved).messages.get("/true/pose", [])
        newest = poses[-1].log_time if poses else 0
        assert newest > sampled_ns - 5_000_000_000
    assert len({sampled_ns for _, sampled_ns in reports}) > KILLS // 10  # not always the same


def _hostile(size: int, length_of: Callable[[int], int]) -> bytes:
    """Beginnings of chunks, one behind the other, each of a length that goes on to the end."""
    parts, at = [MCAP0_MAGIC], len(MCAP0_MAGIC)
    zstd = zstandard.compress(bytes(400))
    while at < size:
        head = struct.pack("<QQQI", 0, 0, 400, 1) + struct.pack("<I", 4) + b"zstd"
        body = head + struct.pack("<Q", len(zstd)) + zstd
        parts.append(struct.pack("<BQ", Opcode.CHUNK, length_of(at)) + body)
        at += len(parts[-1])
    return b"".join(parts)


@pytest.mark.parametrize("kind", ["to the end", "too long", "short"])
def test_a_hostile_log_is_looked_at_a_bounded_number_of_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """10 MB of it took minutes: each beginning of a chunk had all of the rest looked at."""
    size = 2_000_000
    lengths = {
        "to the end": lambda at: max(40, size - at - 2000),
        "too long": lambda at: size - at + 9,
        "short": lambda _: 40,
    }
    source, looked = tmp_path / "hostile.mcap", 0
    source.write_bytes(_hostile(size, lengths[kind]))
    unpack = framing.chunk_records

    def counted(frame: Frame) -> list[framing.Content]:
        nonlocal looked
        looked += len(frame.body)
        return unpack(frame)

    monkeypatch.setattr(framing, "chunk_records", counted)
    with pytest.raises(LogError, match="nothing to recover"):
        recover(source, tmp_path / "saved.mcap")
    assert looked < 20 * size + (1 << 27)
