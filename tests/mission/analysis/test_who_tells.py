"""Whose messages of a telemetry log count: those of the autopilot of the vehicle that is judged."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_logs import HOME, write_tlog
from pymavlink.dialects.v20 import common as mav

from mission.analysis.compare import compare_run
from mission.analysis.comparison_text import in_words
from mission.analysis.load import LoadedRun, load_run
from mission.base.errors import InputError
from sitl.firmware.relay import packets

HEARTBEAT_OF = {
    "companion": mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3),
    "companion that claims an autopilot": mav.MAVLink_heartbeat_message(18, 0, 0, 0, 4, 3),
    "camera": mav.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3),
}


def split(log: Path) -> Iterator[bytes]:
    """Each message of a log, after its time."""
    content, at = log.read_bytes(), 0
    while at < len(content):
        size = 8 + len(next(packets(content[at + 8 :])).data)
        yield content[at : at + size]
        at += size


def added(log: Path, messages: Sequence[Any], *, component: int, first: Any) -> LoadedRun:
    """The flight of a log in which a component of vehicle 1 speaks, too: `first` at the begin, and
    its messages beside each of the autopilot's positions."""
    by, reader = mav.MAVLink(None, 1, component), mav.MAVLink(None)
    rows = list(split(log))
    out = [rows[0][:8] + bytes(first.pack(by))]
    for row in rows:
        out.append(row)
        said: Any = next(iter(reader.parse_buffer(row[8:]) or ()))
        if said.get_type() == "GLOBAL_POSITION_INT":
            for message in messages:
                if hasattr(message, "time_boot_ms"):
                    message.time_boot_ms = said.time_boot_ms + 50
                out.append(row[:8] + bytes(message.pack(by)))
    other = log.with_name("other.tlog")
    other.write_bytes(b"".join(out))
    return load_run(other)


@pytest.mark.parametrize("who", HEARTBEAT_OF)
def test_another_component_of_the_vehicle_tells_nothing_of_it(tmp_path: Path, who: str) -> None:
    lat, lon = round(HOME.lat_deg * 1e7) + 9000, round(HOME.lon_deg * 1e7) + 9000
    messages = [
        mav.MAVLink_global_position_int_message(0, lat, lon, 488_200, 200, 0, 0, 0, 0),
        mav.MAVLink_home_position_message(lat, lon, 470_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0),
        mav.MAVLink_sys_status_message(0, 0, 0, 0, 5000, 10, 3, *(0,) * 6),
        mav.MAVLink_mission_current_message(0),
        mav.MAVLink_mission_item_reached_message(2),
        mav.MAVLink_statustext_message(2, b"failsafe of a winch"),
        mav.MAVLink_gps_raw_int_message(0, 3, lat, lon, 0, 0, 0, 0, 0, 9),
    ]
    log = write_tlog(tmp_path / "x.tlog")
    alone = load_run(log)
    found = added(log, messages, component=191, first=HEARTBEAT_OF[who])
    assert found.judged is not None, found.unjudged
    np.testing.assert_array_equal(found.data.truth.pos_m, alone.data.truth.pos_m)
    assert found.data.area == alone.data.area
    assert not len(found.data.battery.t_ns)
    assert not len(found.data.gnss_ns)
    assert np.array_equal(found.data.current, alone.data.current)
    assert [e.text for e in found.data.events] == [e.text for e in alone.data.events]
    total = compare_run(found).total
    assert (total.height_max_m, total.cross_track_max_m) == pytest.approx((0.0, 0.0), abs=0.05)
    passed_over = len(messages) * len(alone.data.truth.t_ns)
    assert in_words(found.judged)[0] == f"{passed_over} messages of another component not read"


@pytest.mark.parametrize("accepted", [True, False])
def test_a_mission_that_a_companion_uploads_is_the_vehicles_once_it_is_accepted(
    tmp_path: Path, accepted: bool
) -> None:
    """It comes from the same system as the vehicle, but is no list that the vehicle holds."""
    lat, lon = round(HOME.lat_deg * 1e7), round(HOME.lon_deg * 1e7)
    out = list(split(write_tlog(tmp_path / "x.tlog")))
    said = mav.MAV_MISSION_ACCEPTED if accepted else mav.MAV_MISSION_DENIED
    item = (1, 1, 0, 3, mav.MAV_CMD_NAV_LAND, 0, 1, 0, 0, 0, 0, lat, lon, 9, 0)
    for message, component in (
        (mav.MAVLink_mission_count_message(1, 1, 1, 0), 191),
        (mav.MAVLink_mission_item_int_message(*item), 191),
        (mav.MAVLink_mission_ack_message(1, 191, said, 0), 1),
    ):
        by = mav.MAVLink(None, 1, component)
        out.append(out[-1][:8] + bytes(message.pack(by)))
    log = tmp_path / "more.tlog"
    log.write_bytes(b"".join(out))
    sizes = [len(m.items) for m in load_run(log).data.missions if m.kind == "mission"]
    assert sizes == ([4, 1] if accepted else [4])


def test_a_log_without_heartbeats_says_what_was_not_read(tmp_path: Path) -> None:
    log = write_tlog(tmp_path / "x.tlog")
    log.write_bytes(b"".join(row for row in split(log) if row[15:18] != bytes(3)))
    with pytest.raises(InputError, match=r"not read: \d+ positions before the first heartbeat"):
        load_run(log)
