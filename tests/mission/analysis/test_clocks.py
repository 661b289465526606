"""Clocks of logs: that go back, be it by less than a second; of old versions."""

import json
import re
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import made_up_logs
import numpy as np
import pytest
from made_up_logs import Sample, write_dataflash, write_tlog, write_ulog
from pymavlink.dialects.v20 import common as mav
from test_who_tells import split
from told_logs import HOME, WRITERS, made, write_bin, write_ulg
from told_logs import write_tlog as write_told_tlog

from mission.analysis.compare import compare_run
from mission.analysis.load import load_run
from mission.cli import call

Write = Callable[..., Path]
KINDS: dict[str, Write] = {".ulg": write_ulog, ".bin": write_dataflash, ".tlog": write_tlog}


@pytest.mark.parametrize("end", KINDS)
@pytest.mark.parametrize("by_s", [0.13, 0.9, 7.5])
def test_of_a_clock_that_goes_back_the_longer_flight_counts(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    end: str,
    by_s: float,
) -> None:
    """Put in order by their times, positions would go to and fro, at 28 m/s rather than 8."""
    whole = made_up_logs.samples

    def set_back(**how: Any) -> list[Sample]:
        return [replace(s, t_s=s.t_s - by_s * (s.t_s > 50.05)) for s in whole(**how)]

    monkeypatch.setattr(made_up_logs, "samples", set_back)
    log = KINDS[end](tmp_path / f"x{end}")
    found = compare_run(load_run(log))
    assert found.run.data.truth.t_ns[-1] == round(50e9)
    assert found.total.speed_max_mps < 8.2
    assert call(["compare", str(log)]) == 0
    said = f"1 stretch of {50.1 - by_s:.1f} to "
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith(said))
    assert line.endswith(" s, on whose other side the clock goes back, not read")


@pytest.mark.parametrize("end", KINDS)
def test_each_start_of_the_vehicle_is_a_flight_of_its_own(tmp_path: Path, end: str) -> None:
    """Of two logs in one file, the longer flight counts, with its own modes and signals only."""
    write = WRITERS[end]
    short = write(tmp_path / f"short{end}", made(until_s=15.0))
    long = write(tmp_path / f"long{end}", made(off_m=3.0, when=(20.0, 25.0), until_s=40.0))
    told = compare_run(load_run(long))
    for first, second in ((short, long), (long, short)):
        content = second.read_bytes()
        if end == ".ulg":  # which has one head
            content = content[content.index(b"\x00D") - 1 :]
        log = tmp_path / f"both{end}"
        log.write_bytes(first.read_bytes() + content)
        found = compare_run(load_run(log))
        (said,) = found.run.data.source.skipped
        assert said.startswith("stretch of 0.0 to 14.9")
        assert found.run.data.modes.names == told.run.data.modes.names
        assert repr(found.stretches) == repr(told.stretches)


def test_a_clock_since_1970_counts_from_the_logs_begin(tmp_path: Path) -> None:
    """As in ULogs of simulations by wall time."""
    log = write_ulog(tmp_path / "x.ulg")
    told, content, at = load_run(log).data, bytearray(log.read_bytes()), 16
    times = [8]
    while at < len(content):
        times += {b"D": [at + 5], b"L": [at + 4]}.get(bytes(content[at + 2 : at + 3]), [])
        at += 3 + int.from_bytes(content[at : at + 2], "little")
    for time in times:
        late = int.from_bytes(content[time : time + 8], "little") + 1_710_773_350_346_000
        content[time : time + 8] = late.to_bytes(8, "little")
    log.write_bytes(content)
    found = load_run(log).data
    assert found.truth.t_ns.tolist() == told.truth.t_ns.tolist()
    assert found.events == told.events
    assert found.modes.t_ns.tolist() == told.modes.t_ns.tolist()


@pytest.mark.parametrize("bit", [*range(18, 24), 40, 62, 63])
def test_a_flipped_bit_in_a_time_costs_one_position(tmp_path: Path, bit: int) -> None:
    """In microseconds. One of less than the time of two positions looks as a clock set back."""
    whole = write_dataflash(tmp_path / "x.bin")
    told, content = compare_run(load_run(whole)).total, whole.read_bytes()
    kind = next(  # of the rows POS, by its FMT
        content[at + 3]
        for at in range(len(content))
        if content[at : at + 3] == b"\xa3\x95\x80" and content[at + 5 : at + 9] == b"POS\0"
    )
    rows = [m.start() for m in re.finditer(b"(?s)\xa3\x95" + re.escape(bytes([kind])), content)]
    for at in (0, 1, 300, len(rows) - 1):
        damaged = bytearray(content)
        damaged[rows[at] + 3 + bit // 8] ^= 1 << bit % 8
        log = tmp_path / "damaged.bin"
        log.write_bytes(damaged)
        loaded = load_run(log)
        assert sum(loaded.data.source.skipped.values()) <= 2
        found = compare_run(loaded).total
        assert found.cross_track_max_m == pytest.approx(told.cross_track_max_m, abs=0.9)
        assert found.flown_path_m == pytest.approx(told.flown_path_m, abs=2.0)


def test_a_position_that_was_overtaken_on_its_way_is_no_clock_that_goes_back(
    tmp_path: Path,
) -> None:
    """Its number, from 0 to 255, is before that of the position that came first."""
    rows = list(split(write_tlog(tmp_path / "x.tlog")))
    numbered = []
    for number, row in enumerate(rows):
        said = next(iter(mav.MAVLink(None).parse_buffer(row[8:]) or ()))
        by = mav.MAVLink(None, said.get_srcSystem(), said.get_srcComponent())
        by.seq = number % 256
        numbered.append((said.get_type(), bytes(said.pack(by))))
    positions = [at for at, (kind, _) in enumerate(numbered) if kind == "GLOBAL_POSITION_INT"]
    for at in positions[100::50]:
        numbered[at], numbered[at + 1] = numbered[at + 1], numbered[at]
    first, last = positions[310], positions[325]  # a burst, 1.5 s long
    numbered[first:last] = numbered[last - 1 : first - 1 : -1]
    log = tmp_path / "late.tlog"
    log.write_bytes(
        b"".join(row[:8] + packet for row, (_, packet) in zip(rows, numbered, strict=True))
    )
    found = load_run(log)
    swaps = sum(at + 1 in positions for at in positions[100::50]) + 14
    assert found.data.source.skipped == {"position that came late": swaps}
    assert compare_run(found).total.speed_max_mps < 8.2


def test_old_logs_count_milliseconds(tmp_path: Path) -> None:
    """Before 3.3; rows of modes and arming have no times, and only a receiver tells places."""
    flight = made(off_m=3.0, tilt_deg=8.0, when=(20.0, 25.0), until_s=30.0)
    roll = 5.0 * np.sin(flight.t_s)
    swayed = np.column_stack((roll, roll, 0 * roll))
    true, believed = flight.attitude
    flight = replace(flight, attitude=(true + swayed, believed + swayed))
    rate = 500.0 * np.cos(flight.t_s)  # hundredths of a degree
    rows = [(round(t * 1e6), 0, r, 0, r, 0, 0) for t, r in zip(flight.t_s, rate, strict=True)]
    more = [("RATE", "Qffffff", "TimeUS,RDes,R,PDes,P,YDes,Y", rows)]
    now = compare_run(load_run(write_bin(tmp_path / "now.bin", flight, version="NTUN")))
    old = compare_run(
        load_run(write_bin(tmp_path / "old.bin", flight, version="NTUN", old=True, more=more))
    )
    assert old.flown is not None
    assert [(s.mode, s.reference) for s in old.flown.stretches] == [("GUIDED", "position")]
    for name in ("tracking_max_m", "height_tracking_max_m", "attitude_tracking_max_deg"):
        assert getattr(old.total, name) == pytest.approx(getattr(now.total, name), abs=1e-6)
    assert old.total.satellites_min == 12
    assert old.total.rates_tracking_rms_degps == pytest.approx(5.0, abs=0.3)
    assert old.total.flown_path_m == pytest.approx(now.total.flown_path_m, abs=0.5)
    assert old.run.data.truth.t_ns[-1] == now.run.data.truth.t_ns[-1]


@pytest.mark.parametrize("by_s", [-3600, -3, 3600])
def test_a_recorders_clock_that_is_set_anew_moves_nothing(tmp_path: Path, by_s: int) -> None:
    """As where a ground station learns the time on the way: its modes and items have its times."""
    log = write_tlog(tmp_path / "x.tlog")
    right, rows = compare_run(load_run(log)), list(split(log))
    at = len(rows) // 2
    later = [
        struct.pack(">Q", int.from_bytes(row[:8], "big") + by_s * 1_000_000) + row[8:]
        for row in rows[at:]
    ]
    log.write_bytes(b"".join((*rows[:at], *later)))
    found = compare_run(load_run(log))
    assert found.run.data.modes.t_ns.tolist() == right.run.data.modes.t_ns.tolist()
    assert str(found.total) == str(right.total)  # NaN included


@pytest.mark.parametrize(("told_s", "utc_s"), [(None, 1e9), (1.7e9, 1.7e9)])
def test_where_a_vehicle_does_not_tell_utc_the_recorders_clock_does(
    tmp_path: Path, told_s: float | None, utc_s: float
) -> None:
    """It is that of a log which the test's writer began at 10^9 s."""
    flight = replace(made(until_s=5.0), utc_s=told_s)
    assert load_run(write_told_tlog(tmp_path / "x.tlog", flight)).data.source.utc_ns == utc_s * 1e9


@pytest.mark.parametrize("without", [(33,), (33, 32)])
def test_a_telemetry_log_without_global_positions_is_read(
    tmp_path: Path, without: tuple[int, ...]
) -> None:
    """Places are then those of the receiver; times those of any message that has the vehicle's."""
    log = write_told_tlog(tmp_path / "x.tlog", made(off_m=2.0))
    right = compare_run(load_run(log)).total
    rows = [row for row in split(log) if int.from_bytes(row[15:18], "little") not in without]
    log.write_bytes(b"".join(rows))
    found = compare_run(load_run(log)).total
    for name in ("flown_path_m", "duration_s", "speed_max_mps"):
        assert getattr(found, name) == pytest.approx(getattr(right, name), rel=0.01)
    if without == (33,):
        assert found.tracking_max_m == pytest.approx(right.tracking_max_m)


def test_a_vehicle_that_is_armed_again_was_disarmed_before(tmp_path: Path) -> None:
    """A log that pauses while it is disarmed does not say when that began; that it is armed has no
    time in old ones."""
    flight = made(until_s=80.0).without(30.0, 60.0)
    log = write_bin(tmp_path / "x.bin", flight, version="NTUN", old=True)
    content = log.read_bytes()
    ((event,), (target,)) = (
        re.findall(rb"(?s)\xa3\x95\x80(.)." + name, content) for name in (rb"EV\0", rb"NTUN")
    )
    goes_on = content.index(b"\xa3\x95" + target + struct.pack("<I", 60_050))
    armed = b"\xa3\x95" + event + bytes([10])
    log.write_bytes(content[:goes_on] + armed + content[goes_on:])
    found = compare_run(load_run(log)).total
    assert (found.gap_max_s, found.gnss_gap_max_s) == (0.0, 0.0)
    assert found.duration_s == pytest.approx(50.0, abs=1.5)


def test_missions_of_old_logs_are_read_and_rows_without_a_column_are_counted(
    tmp_path: Path,
) -> None:
    """Of ArduCopter 3.1, whose items have one parameter; and of a version that nobody knows."""
    lat, lon = round(HOME.lat_deg * 1e7), round(HOME.lon_deg * 1e7)
    items = [(0, 2, n, 16, 1, 0, 2000, lat + n * 900, lon) for n in range(2)]
    more: Any = [
        ("CMD", "QBBBBBeLL", "TimeUS,CTot,CNum,CId,COpt,Prm1,Alt,Lat,Lng", items),
        ("RALY", "QBB", "TimeUS,Tot,Seq", [(1, 1, 0)]),
    ]
    data = load_run(write_bin(tmp_path / "x.bin", made(until_s=9.0), old=True, more=more)).data
    (mission,) = data.missions
    (_, (_, command, _, *params, _, _, height_m, _)) = mission.items
    assert (command, params, height_m) == (16, [0.0] * 4, 20.0)
    assert data.source.skipped == {"row of RALY without Lat": 1}


def test_a_log_of_px4_before_ulog_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is laid out as DataFlash, with other rows."""
    log = write_bin(tmp_path / "x.bin", made(until_s=5.0), more=[("TIME", "Q", "StartTime", [])])
    assert call(["compare", str(log)]) == 2
    assert "x.bin: a log of PX4 before ULog (sdlog2), which" in capsys.readouterr().err


@pytest.mark.parametrize("end", [".bin", ".ulg", ".tlog"])
def test_heights_alone_are_a_flight_without_a_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], end: str
) -> None:
    flight = made(down_m=-2.0, tilt_deg=8.0, when=(20.0, 25.0), until_s=30.0).without(14.0, 17.0)
    log = tmp_path / f"x{end}"
    if end == ".bin":
        write_bin(log, flight, version="none", places_at=False)
    elif end == ".ulg":
        write_ulg(log, flight, xy_valid=False)
    else:
        write_told_tlog(log, flight, places_at=False)
    assert call(["compare", str(log), "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)
    total = found["total"]
    assert total["height_tracking_max_m"] == pytest.approx(2.0, abs=0.1)
    assert total["attitude_tracking_max_deg"] == pytest.approx(8.0, abs=0.1)
    assert "positions" in found["not_in_the_log"]
    unknown = ("flown_path_m", "speed_max_mps", "tracking_max_m", "cross_track_max_m")
    assert [total[name] for name in unknown] == [None] * 4
    page = tmp_path / "x.html"
    assert call(["report", str(log), "--out", str(page)]) == 0
    assert 'id="map"' not in page.read_text()
    assert "heights only" in page.read_text()
    assert "height off max" in page.read_text()
    (hole,) = found["holes"]
    assert hole["from_deg"] == [None, None]
    assert call(["compare", str(log)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert ": what was flown there is not known" in said
    assert "0.0000000" not in said
    assert call(["compare", str(log), str(log), "--together"]) == 2
    assert "no places on the globe" in capsys.readouterr().err
