"""Raw MAVLink in a run's log, by option."""

import json
from collections import Counter
from contextlib import closing
from pathlib import Path

import pytest
from pymavlink import mavutil
from test_run import fly

from mission.cli import call
from mission.log import topics
from mission.log.read.contents import load

RAW = {topics.MAVLINK_TO_VEHICLE.name, topics.MAVLINK_FROM_VEHICLE.name}


@pytest.mark.slow
def test_what_was_said_is_recorded_and_changes_nothing_else(tmp_path: Path) -> None:
    plain, raw = tmp_path / "plain", tmp_path / "raw"
    assert fly(plain, rounds=1) == 0
    assert fly(raw, "--log-mavlink", rounds=1) == 0
    for name in ("rounds.csv", "uplinks.csv"):
        assert (plain / name).read_bytes() == (raw / name).read_bytes()
    without, with_raw = (load(out / "flight.mcap").messages for out in (plain, raw))
    assert with_raw.keys() - without.keys() == RAW
    for topic, messages in without.items():
        assert [(m.log_time, m.data) for m in messages] == [
            (m.log_time, m.data) for m in with_raw[topic]
        ]

    assert call(["log", "export", str(raw / "flight.mcap"), "--to", "tlog"]) == 0
    replay = mavutil.mavlink_connection(str(raw / "flight.tlog"))
    said: Counter[str] = Counter()
    with closing(replay.f):  # mavutil's own close() forgets it
        while (message := replay.recv_match()) is not None:
            said[message.get_type()] += 1
    assert said["BAD_DATA"] == 0
    # The pilot's plan and orders, and the vehicle's answers.
    assert said["MISSION_COUNT"] >= 1
    assert said["MISSION_ITEM_INT"] >= 2
    assert said["MISSION_ACK"] >= 1
    assert said["COMMAND_LONG"] >= 2
    assert said["COMMAND_ACK"] >= 2
    assert said["HEARTBEAT"] >= 2

    # A resumption goes on listening, without being told to.
    summary = json.loads((raw / "summary.json").read_text()) | {"status": "interrupted"}
    (raw / "summary.json").write_text(json.dumps(summary))
    assert call(["run", "--resume", str(raw), "--quiet"]) == 0
    assert load(raw / "flight.mcap").messages.keys() == with_raw.keys()


def test_an_external_autopilot_cannot_be_listened_to(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = ["run", "--out", str(out), "--log-mavlink", "--vehicle", "udpin://127.0.0.1:14599"]
    assert call(command) == 2
    assert "--log-mavlink: an external autopilot" in capsys.readouterr().err
    assert not out.exists()
