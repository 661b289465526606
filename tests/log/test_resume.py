"""A log that goes on after its run was killed has the bytes of one that never stopped."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from synthetic_flight import AREA, SPEED_MPS, Fixed, fly

from mission.log.errors import LogError
from mission.log.writer import FlightLog, LogMark


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Fixed:
    return fly(tmp_path_factory.mktemp("run"), rounds=3)


def play(log: FlightLog, made: Fixed, rounds: range) -> LogMark:
    """Hand a made-up run's rounds to a log; each ends with a mark, as a checkpoint takes it."""
    mark = log.mark()
    for number in rounds:
        record = made.rounds[number]
        start_ns = round(record.start_t_s * 1e9)
        end_ns = round((record.start_t_s + record.duration_s) * 1e9)
        log.plan(
            start_ns, record.round, made.problems[number], made.plans[number], speed_mps=SPEED_MPS
        )
        for sample in made.samples:
            if start_ns < sample.t_ns <= end_ns:
                log.sampled(sample)
        log.uplinks([u for u in made.uplinks if u.round == record.round])
        log.round(record)
        mark = log.mark()
    return mark


@pytest.mark.parametrize("finished", [0, 1, 2])
def test_going_on_gives_the_bytes_of_an_uninterrupted_log(
    tmp_path: Path, made: Fixed, finished: int
) -> None:
    with FlightLog(tmp_path / "whole.mcap", area=AREA, devices=made.world) as log:
        play(log, made, range(3))
    path = tmp_path / "flight.mcap"
    dying = FlightLog(path, area=AREA, devices=made.world)
    mark = play(dying, made, range(finished))
    # Into the next round, then gone: the copy is what a killed process leaves.
    play_on = [s for s in made.samples if s.t_ns > mark.now_ns][:137]
    for sample in play_on:
        dying.sampled(sample)
    left = path.read_bytes()
    dying.close()
    path.write_bytes(left)

    stored = json.loads(json.dumps(dataclasses.asdict(mark)))
    mark = LogMark(**{**stored, "due_ns": tuple(stored["due_ns"])})
    with FlightLog(path, area=AREA, devices=made.world, resume=mark) as log:
        play(log, made, range(finished, 3))
    assert path.read_bytes() == (tmp_path / "whole.mcap").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["flight.mcap", "whole.mcap"]


def test_what_cannot_go_on_is_refused_and_left_alone(tmp_path: Path, made: Fixed) -> None:
    path = tmp_path / "flight.mcap"
    with FlightLog(path, area=AREA, devices=made.world) as log:
        mark = play(log, made, range(1))
    whole = path.read_bytes()

    def refused(data: bytes, size: int, reason: str) -> None:
        path.write_bytes(data)
        with pytest.raises(LogError, match=reason):
            FlightLog(
                path, area=AREA, devices=made.world,
                resume=dataclasses.replace(mark, size_bytes=size),
            )  # fmt: skip
        assert path.read_bytes() == data
        assert [p.name for p in tmp_path.iterdir()] == ["flight.mcap"]

    refused(whole[: mark.size_bytes - 5], mark.size_bytes, "the file ends within")
    refused(whole, mark.size_bytes - 1, "another version or another run")
    altered = bytearray(whole)
    altered[mark.size_bytes // 2] ^= 1
    refused(bytes(altered), mark.size_bytes, "damaged|another version")
    refused(b"", mark.size_bytes, "not an MCAP file")


def test_marks_do_not_depend_on_the_wall_clock(tmp_path: Path, made: Fixed) -> None:
    marks = []
    for name in ("a", "b"):
        with FlightLog(tmp_path / name, area=AREA, devices=made.world) as log:
            marks.append(play(log, made, range(2)))
    assert marks[0] == marks[1]
    assert marks[0].size_bytes == (tmp_path / "a").stat().st_size - tail(tmp_path / "a")
    assert np.all(np.array(marks[0].due_ns) > marks[0].now_ns - 1_000_000_000)


def tail(path: Path) -> int:
    """Bytes of the data end, index and footer, found through the footer."""
    data = path.read_bytes()
    summary_start = int.from_bytes(data[-8 - 20 : -8 - 12], "little")
    return len(data) - summary_start + 13  # the data end record stands before
