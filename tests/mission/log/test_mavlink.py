"""Raw MAVLink in the log, read back by pymavlink."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common
from synthetic_flight import AREA, devices, fly

from mission.base.errors import InputError
from mission.log.errors import LogError
from mission.log.export.mavlink import RecordedLink, export_tlog, split_frames
from mission.log.read.inspection import check, info
from mission.log.read.reader import read_log
from mission.log.write.writer import FlightLog
from sitl.links import Chunk, Wake


def frames() -> list[bytes]:
    mav = common.MAVLink(None, srcSystem=1, srcComponent=1)
    return [
        common.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3).pack(mav),
        common.MAVLink_attitude_message(1000, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0).pack(mav),
        common.MAVLink_statustext_message(6, b"\xfd hello \xfe", 0, 0).pack(mav),
    ]


class Loop:
    """A link whose other side is the test."""

    def __init__(self) -> None:
        self.arrived: list[Chunk] = []
        self.sent: list[bytes] = []

    def open(self, wake: Wake) -> None: ...

    def receive(self) -> list[Chunk]:
        arrived, self.arrived = self.arrived, []
        return arrived

    def newcomers(self) -> bool:
        return True

    def send(self, frames: Sequence[bytes]) -> None:
        self.sent += frames

    def close(self) -> None: ...


def recorded(path: Path) -> Loop:
    inner = Loop()
    world = devices(np.random.default_rng(1))
    with FlightLog(path, area=AREA, devices=world, raw_mavlink=True) as log:
        link = RecordedLink(inner, log)
        inner.arrived = [(b"".join(frames()[:2]), None)]
        assert link.receive() == [(b"".join(frames()[:2]), None)]
        assert link.newcomers()
        link.send(frames())
    return inner


def test_what_passes_is_passed_on_and_written(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    assert recorded(path).sent == frames()
    counts = {topic.name: topic.messages for topic in info(path).topics}
    assert counts["/mavlink/to_vehicle"] == 1
    assert counts["/mavlink/from_vehicle"] == 3
    assert check(path) == ()
    assert len(read_log(path).truth.t_ns) == 0


def test_pymavlink_reads_the_tlog(tmp_path: Path) -> None:
    recorded(tmp_path / "a.mcap")
    target = export_tlog(tmp_path / "a.mcap", tmp_path / "a.tlog")
    reader = mavutil.mavlink_connection(str(target))
    try:
        kinds = []
        while (message := reader.recv_match()) is not None:
            kinds.append(message.get_type())
    finally:
        reader.close()
    assert kinds == ["HEARTBEAT", "ATTITUDE", "HEARTBEAT", "ATTITUDE", "STATUSTEXT"]


def test_frames_are_split_whole_and_rubbish_is_passed_over() -> None:
    data = b"\x00\x01" + frames()[0] + b"\xff" + frames()[2] + frames()[1][:-1]
    assert list(split_frames(data)) == [frames()[0], frames()[2]]


def test_a_log_without_it_is_refused(tmp_path: Path) -> None:
    made = fly(tmp_path, rounds=1)
    with pytest.raises(LogError, match="holds no raw MAVLink"):
        export_tlog(made.log, tmp_path / "b.tlog")
    (tmp_path / "there.tlog").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        export_tlog(made.log, tmp_path / "there.tlog")
