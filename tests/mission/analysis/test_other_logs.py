"""Logs of PX4, ArduPilot and ground stations, compared with their missions; and the verdict."""

import json
import math
import os
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from made_up_logs import (
    CORNERS,
    HEIGHT_M,
    HOME,
    places,
    samples,
    write_dataflash,
    write_tlog,
    write_ulog,
)
from pymavlink.dialects.v20 import common as mav

import aerofed
from flightdyn.frames import LocalFrame
from mission.analysis.compare import RunComparison, compare_run
from mission.analysis.comparison_text import in_words
from mission.analysis.load import load_run
from mission.base.errors import EXIT_CODES, LIMITS_NOT_MET, LimitsNotMetError
from mission.cli import call
from mission.figures.flight import timeline_chart
from mission.flight.missions.mission_path import items_of, place_m
from mission.log.values import BatteryTrack
from sitl.firmware.relay import packets

Write = Callable[..., Path]
KINDS: dict[str, Write] = {".ulg": write_ulog, ".bin": write_dataflash, ".tlog": write_tlog}


def compared(log: Path) -> RunComparison:
    loaded = load_run(log)
    assert loaded.judged is not None, loaded.unjudged
    return compare_run(loaded)


def test_one_flight_in_three_logs_is_one_comparison(tmp_path: Path) -> None:
    found = [compared(write(tmp_path / f"x{end}", off_m=3.0)) for end, write in KINDS.items()]
    for other in found[1:]:
        for name in ("cross_track_rms_m", "cross_track_max_m", "corner_cut_max_m", "height_max_m"):
            first, second = (getattr(c.total, name) for c in (found[0], other))
            assert second == pytest.approx(first, abs=0.012), name  # degE7: 1.1 cm
        times = [
            [p.t_s - way.record.start_t_s for p in way.passages]
            for c in (found[0], other) if c.run.judged for way in c.run.judged.passes
        ]  # fmt: skip
        assert times[1] == pytest.approx(times[0], abs=0.02)
    for one in found:
        assert one.total.slots == len(CORNERS)
        assert one.total.slots_missed == 0
        assert one.run.judged is not None
        assert not one.run.judged.left_out
        assert one.run.data.source.only == "believed"
        assert str(one.total.estimate_rms_m) == "nan"


@pytest.mark.parametrize("end", sorted(KINDS))
def test_a_log_that_ends_within_a_message_is_said_to(tmp_path: Path, end: str) -> None:
    whole = KINDS[end](tmp_path / f"x{end}").read_bytes()
    (tmp_path / f"cut{end}").write_bytes(whole[:-2])
    skipped = [load_run(tmp_path / f"{name}{end}").data.source.skipped for name in ("x", "cut")]
    assert [sum(found.values()) for found in skipped] == [0, 1]


def test_positions_that_are_not_the_vehicles_are_counted_in_words(tmp_path: Path) -> None:
    whole = write_tlog(tmp_path / "x.tlog").read_bytes()
    heartbeat = 8 + len(next(packets(whole[8:])).data)  # with its time

    def position(system: int) -> bytes:
        by = mav.MAVLink(None, system, 1)
        said = mav.MAVLink_global_position_int_message(0, 0, 0, 0, 0, 0, 0, 0, 0)
        return whole[:8] + bytes(said.pack(by))

    log = tmp_path / "more.tlog"
    log.write_bytes(position(1) + whole[:heartbeat] + 2 * position(9) + whole[heartbeat:])
    judged = load_run(log).judged
    assert judged is not None
    assert in_words(judged)[:2] == [
        "1 position before the first heartbeat not read",
        "2 positions of another vehicle not read",
    ]


def transfer(to: int, *, accepted: bool | None = None) -> list[tuple[Any, int]]:
    """Messages, and the system of each: a mission of one item to a system; from vehicle 1 where
    that is a station, else from station 255, with the vehicle's answer where there is one."""
    sender = 1 if to == 255 else 255
    count = mav.MAVLink_mission_count_message(to, 1, 1, 0)
    item = mav.MAVLink_mission_item_int_message(
        to, 1, 0, 3, mav.MAV_CMD_NAV_LAND, 0, 1, 0, 0, 0, 0, 474000000, 85460000, 9, 0
    )
    said = mav.MAV_MISSION_ACCEPTED if accepted else mav.MAV_MISSION_INVALID
    answer = mav.MAVLink_mission_ack_message(255, 190, said, 0), to
    return [(count, sender), (item, sender), *([] if accepted is None else [answer])]


ACCEPTED = transfer(1, accepted=True)


@pytest.mark.parametrize(
    ("messages", "sizes"),
    [
        (ACCEPTED, [4, 1]),
        (transfer(1, accepted=False), [4]),
        (transfer(1), [4]),
        (transfer(2, accepted=True), [4]),  # another vehicle
        (transfer(255), [4, 1]),  # a download
        ([*transfer(1, accepted=False), ACCEPTED[-1]], [4]),  # of something else
        ([ACCEPTED[0], *transfer(2), *ACCEPTED[1:]], [4, 1]),
    ],
)
def test_a_mission_in_a_telemetry_log_is_one_that_the_vehicle_has(
    tmp_path: Path, messages: Sequence[tuple[Any, int]], sizes: list[int]
) -> None:
    found = load_run(write_tlog(tmp_path / "x.tlog", before=messages)).data.missions
    assert [len(record.items) for record in found if record.kind == "mission"] == sizes


def test_what_px4_adds_to_a_mission_is_no_item(tmp_path: Path) -> None:
    found = compared(write_ulog(tmp_path / "x.ulg"))
    assert [leg.item for leg in found.legs] == [0, 1, 3, 4]
    assert found.total.corner_cut_max_m < 0.05
    assert found.total.slots == len(CORNERS)


@pytest.mark.parametrize(
    ("fields", "form", "unknown"),
    [
        ("double lat;double lon;float alt", "ddf", (math.nan, math.nan, 0.0)),
        ("double lat;double lon;float alt", "ddf", (0.0, 0.0, 0.0)),
        ("double lat;double lon;float alt;bool valid_hpos", "ddf?", (HOME.lat_deg, 1.0, 0.0, 0)),
    ],
)
def test_a_home_that_px4_does_not_know_is_none(
    tmp_path: Path, fields: str, form: str, unknown: tuple[float, ...]
) -> None:
    known = (HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m, 1)[: len(unknown)]
    homes = (0.0, *known), (1.0, *unknown)
    for rows in (homes, homes[1:]):
        log = write_ulog(
            tmp_path / f"{len(rows)}.ulg", instead={"home_position": (fields, form, rows)}
        )
        total = compared(log).total
        assert total.cross_track_max_m < 0.05
        assert total.height_max_m < 0.05


@pytest.mark.parametrize(("set_at_s", "down_m"), [(999.0, 0.0), (1.0, 4.0)])
def test_home_is_what_was_set_last_before_the_flight_was_highest(
    tmp_path: Path, set_at_s: float, down_m: float
) -> None:
    """Its heights are above that: a home that is set after the landing, 4 m lower, is another's."""
    at = HOME.lat_deg, HOME.lon_deg
    rows = (0.0, *at, HOME.alt_msl_m), (set_at_s, *at, HOME.alt_msl_m - 4.0)
    topic = {"home_position": ("double lat;double lon;float alt", "ddf", rows)}
    area = load_run(write_ulog(tmp_path / "x.ulg", instead=topic)).data.area
    assert area.home.alt_msl_m == HOME.alt_msl_m - down_m


@pytest.mark.parametrize("identity", ["uint32_t mission_id", "uint32_t instance_count"])
def test_missions_that_follow_each_other_are_as_many(tmp_path: Path, identity: str) -> None:
    """A, B, and A again, of three items each; the second time A is only flown as far as item 1."""
    frame = LocalFrame(HOME)
    places = {
        1: ((50.0, 0.0), (50.0, 50.0), (0.0, 50.0)),
        2: ((0.0, 90.0), (9.0, 90.0), (9.0, 0.0)),
    }
    told, headed_for = [], []
    for begin_s, mission, flown in ((10.0, 1, 3), (25.0, 2, 3), (40.0, 1, 2)):
        for seq, place in enumerate(places[mission][:flown]):
            at = frame.to_geodetic(np.array([*place, 0.0]))
            t_s = begin_s + 4.0 * seq
            told.append((t_s, mission, 3, seq, False))
            headed_for.append((t_s, True, 0, at.lat_deg, at.lon_deg, HOME.alt_msl_m + HEIGHT_M))
    result = f"{identity};uint16_t seq_total;uint16_t seq_current;bool finished"
    setpoint = (
        "bool current.valid;uint8_t current.type;"
        "double current.lat;double current.lon;float current.alt"
    )
    log = write_ulog(
        tmp_path / "x.ulg",
        instead={
            "mission_result": (result, "IHH?", told),
            "position_setpoint_triplet": (setpoint, "?Bddf", headed_for),
        },
    )
    found = load_run(log).data
    assert [record.t_ns / 1e9 for record in found.missions] == [10.0, 25.0, 40.0]
    for record, (mission, flown) in zip(found.missions, ((1, 3), (2, 3), (1, 2)), strict=True):
        led = [place_m(item, found.area)[:2] - found.area.home_m for item in items_of(record)]
        wanted = [(east, north) for north, east in places[mission][:flown]]
        np.testing.assert_allclose(led, wanted, atol=0.01)


@pytest.mark.parametrize(
    ("times_s", "known", "skipped"),
    [
        ((0.0, 999.0), True, None),
        ((40.0, 999.0), True, "position of a ground truth that does not span the log"),
        ((0.0, 40.0), True, "position of a ground truth that does not span the log"),
        ((0.0, 999.0), False, "position without a value"),
    ],
)
def test_ground_truth_counts_where_it_spans_the_flight(
    tmp_path: Path, times_s: tuple[float, float], known: bool, skipped: str | None
) -> None:
    rows = [
        (s.t_s, s.lat_deg, s.lon_deg, s.alt_msl_m) if known else (s.t_s, 0.0, 0.0, 0.0)
        for s in samples(off_m=3.0)
        if times_s[0] <= s.t_s <= times_s[1]
    ]
    truth = ("double lat;double lon;float alt", "ddf", rows)
    log = write_ulog(tmp_path / "x.ulg", instead={"vehicle_global_position_groundtruth": truth})
    found = compared(log)
    assert found.run.data.source.only == ("believed" if skipped else None)
    assert found.total.cross_track_max_m == pytest.approx(0.0 if skipped else 3.0, abs=0.05)
    assert found.run.data.source.skipped == ({skipped: len(rows)} if skipped else {})


@pytest.mark.parametrize(
    ("from_s", "until_s", "spans"),
    [(0.9, 19.1, True), (1.1, 20.0, False), (0.0, 18.9, False), (0.0, 10.0, False)],
)
def test_ground_truth_of_who_never_moved_spans_the_log(
    tmp_path: Path, from_s: float, until_s: float, spans: bool
) -> None:
    """To a second; its last position comes ten seconds after the one before."""
    fields = "double lat;double lon;float alt"
    here = HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m
    stands = [(float(t_s), *here) for t_s in (*range(11), 20)]
    truth = [(t_s, *here) for t_s in (from_s, until_s)]
    topics = {"vehicle_global_position": stands, "vehicle_global_position_groundtruth": truth}
    log = write_ulog(
        tmp_path / "x.ulg", instead={name: (fields, "ddf", rows) for name, rows in topics.items()}
    )
    source = load_run(log).data.source
    assert source.only == (None if spans else "believed")
    unread = "position of a ground truth that does not span the log"
    assert source.skipped == ({} if spans else {unread: 2})


def test_what_px4_does_not_know_of_its_battery_is_not_known(tmp_path: Path) -> None:
    fields = "float voltage_v;float current_a;float discharged_mah;float remaining"
    rows = [(t_s, 15.0, -1.0, -1.0, -1.0) for t_s in range(60)]
    log = write_ulog(tmp_path / "x.ulg", instead={"battery_status": (fields, "ffff", rows)})
    found = compared(log)
    assert math.isnan(found.rounds[0].battery_remaining)
    track = found.run.data.battery
    assert np.isnan([track.current_a, track.consumed_mah, track.remaining]).all()
    assert set(track.voltage_v) == {15.0}


@pytest.mark.parametrize("volts_amperes", [(65535, -1), (0, 0)])
def test_what_a_ground_station_is_not_told_of_a_battery_is_not_known(
    tmp_path: Path, volts_amperes: tuple[int, int]
) -> None:
    """Or told as 0 by a vehicle that measures neither."""
    said = mav.MAVLink_sys_status_message(0, 0, 0, 0, *volts_amperes, 40, *(0,) * 6)
    track = load_run(write_tlog(tmp_path / "x.tlog", before=[(said, 1)])).data.battery
    assert track.remaining.tolist() == [0.4]
    assert np.isnan([track.voltage_v, track.current_a]).all()


@pytest.mark.parametrize("end", [".bin", ".tlog"])
def test_a_fence_and_rally_points_are_those_that_were_uploaded(tmp_path: Path, end: str) -> None:
    data = compared(KINDS[end](tmp_path / f"x{end}")).run.data
    around, about = data.fence
    assert (around.keep_in, about.keep_in) == (True, False)
    home = np.array(data.area.home_m)
    corners = home + 300.0 * np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]])
    np.testing.assert_allclose(around.outline_m, corners, atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(about.outline_m - home, axis=1), 12.5, atol=0.02)
    assert data.planned is not None
    np.testing.assert_allclose(data.planned.rally_m, [[*corners[0], 20.0]], atol=0.02)
    assert [mission.kind for mission in data.missions] == ["mission", "fence", "rally"]
    assert not data.source.skipped


@pytest.mark.parametrize("off_m", [0.0, 3.0])
def test_the_time_line_names_only_what_is_on_it(tmp_path: Path, off_m: float) -> None:
    chart = timeline_chart(compared(write_ulog(tmp_path / "x.ulg", off_m=off_m)), alone=True)
    assert ("points: spikes" in str(chart["title"])) is (off_m > 0.0)


@pytest.mark.parametrize("end", KINDS)
def test_a_return_has_no_errors(tmp_path: Path, end: str) -> None:
    """It cuts the last corner, climbs, and passes earlier legs; one autopilot stays in its mode."""
    found = compared(KINDS[end](tmp_path / f"x{end}", returns=True))
    assert [round(row.length_m) for row in found.legs][1:4] == [100, 120, 160]
    assert max(row.cross_track_max_m for row in found.legs[:4]) < 0.05
    assert found.total.cross_track_max_m < 0.05
    assert found.total.height_max_m < 0.05
    assert found.total.corner_cut_max_m < 0.05


@pytest.mark.parametrize("end", KINDS)
@pytest.mark.parametrize("planned", [False, True])
def test_a_pause_ends_no_pass(tmp_path: Path, end: str, planned: bool) -> None:
    plan, log = tmp_path / "x.waypoints", KINDS[end](tmp_path / f"x{end}", pause_s=10.0)
    rows = [
        f"{seq}\t0\t3\t{command}\t0\t0\t0\t0\t{lat_deg}\t{lon_deg}\t{HEIGHT_M}\t1"
        for seq, (command, lat_deg, lon_deg) in enumerate(places())
    ]
    plan.write_text("\n".join(["QGC WPL 110", *rows]) + "\n")
    loaded = load_run(log, plan if planned else None)
    assert loaded.judged is not None
    (only,) = loaded.judged.passes
    total = compare_run(loaded).total
    assert (total.slots, total.slots_missed) == (len(CORNERS), 0)
    assert total.cross_track_max_m < 0.05
    assert only.record.flown_path_m == pytest.approx(only.plan.path_m, abs=1.0)
    assert not [line for line in in_words(loaded.judged) if "never reached" in line]
    assert sum(loaded.judged.apart.values()) == pytest.approx(10.0, abs=1.0)


@pytest.mark.parametrize(
    ("told", "passes_s"),
    [
        ([(55.0, 2)], [(5.6, 55.0), (55.0, 67.5)]),
        ([(55.0, 2), (56.8, 1)], [(5.6, 55.0), (56.8, 67.5)]),  # what is shorter than 2 s is none
        ([(55.0, 2), (57.2, 1)], [(5.6, 55.0), (55.0, 57.2), (57.2, 67.5)]),
    ],
)
def test_going_back_to_an_earlier_item_is_another_pass(
    tmp_path: Path, told: list[tuple[float, int]], passes_s: list[tuple[float, float]]
) -> None:
    judged = load_run(write_tlog(tmp_path / "x.tlog", current=told)).judged
    assert judged is not None
    found = [
        (way.record.start_t_s, way.record.start_t_s + way.record.duration_s)
        for way in judged.passes
    ]
    assert np.array(found) == pytest.approx(np.array(passes_s), abs=0.11)


@pytest.mark.parametrize("end", KINDS)
@pytest.mark.parametrize("off_m", [1.0, 3.0, 10.0])
def test_an_offset_is_at_the_right_leg(tmp_path: Path, end: str, off_m: float) -> None:
    found = compared(KINDS[end](tmp_path / f"x{end}", off_m=off_m))
    assert found.run.judged is not None
    rows = found.legs
    assert [round(row.length_m) for row in rows] == [round(HEIGHT_M), 100, 120, 160]
    assert rows[2].cross_track_max_m == pytest.approx(off_m, abs=0.02)
    assert max(row.cross_track_max_m for row in (*rows[:2], rows[3])) < 0.05


@pytest.mark.parametrize(
    ("end", "other"), [(".ulg", {"kind": 2}), (".ulg", {"kind": 3}), (".tlog", {"kind": 10})]
)
def test_another_vehicle_has_the_same_cross_track(
    tmp_path: Path, end: str, other: dict[str, int]
) -> None:
    """A plane's and a rover's; of a rover no heights."""
    total = compared(KINDS[end](tmp_path / f"x{end}", off_m=3.0, **other)).total
    assert total.cross_track_max_m == pytest.approx(3.0, abs=0.02)
    assert math.isnan(total.height_max_m) == (other["kind"] in (3, 10))


def test_modes_are_those_of_the_vehicle(tmp_path: Path) -> None:
    for vehicle, name in (("ArduPlane", "TRAINING"), ("ArduRover", "STEERING")):
        log = write_dataflash(tmp_path / "x.bin", vehicle=vehicle)
        assert name in load_run(log).data.modes.names


@pytest.mark.parametrize("end", KINDS)
def test_cut_and_altered_logs_end_in_a_line_at_most(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], end: str
) -> None:
    whole = KINDS[end](tmp_path / f"x{end}").read_bytes()
    broken = tmp_path / f"broken{end}"
    stretches = [whole[: len(whole) * k // 5] for k in range(5)]
    stretches += [
        whole[:at] + os.urandom(200) + whole[at + 200 :]
        for at in range(0, len(whole), len(whole) // 5)
    ]
    for content in stretches:
        broken.write_bytes(content)
        code = call(["compare", str(broken)])
        errors = capsys.readouterr().err.splitlines()
        assert (code, len(errors)) in ((0, 0), (2, 1)), errors


def spliced(whole: bytes, end: str, junk: bytes) -> bytes:
    """With junk between two messages in the middle."""
    marks = {".ulg": b"\x1e\x00D", ".bin": b"\xa3\x95\x01", ".tlog": b"\x01\x01\x21\x00\x00"}
    # A packet's number stands behind five bytes, and the time before it is eight.
    at = whole.index(marks[end], len(whole) // 2) - (13 if end == ".tlog" else 0)
    return whole[:at] + junk + whole[at:]


@pytest.mark.parametrize("end", KINDS)
def test_every_byte_of_damage_is_counted_and_nothing_printed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], end: str
) -> None:
    """C code prints, too: what comes is caught at the descriptor."""
    log = tmp_path / f"x{end}"
    whole = KINDS[end](log, off_m=3.0).read_bytes()
    sound = compared(log)
    log.write_bytes(spliced(whole, end, b"\x11\x22\x33" * 400))
    assert call(["compare", str(log)]) == 0
    printed = capfd.readouterr()
    assert printed.err == ""
    assert "1200 bytes with damage not read" in printed.out
    assert str(compared(log).total) == str(sound.total)


@pytest.mark.parametrize("end", KINDS)
@pytest.mark.parametrize("erased", [b"\xff", b"\0"])
def test_erased_memory_at_the_end_is_read_past(tmp_path: Path, end: str, erased: bytes) -> None:
    log = tmp_path / f"x{end}"
    whole = KINDS[end](log, off_m=3.0).read_bytes()
    sound = compared(log)
    log.write_bytes(whole + erased * 9000)
    found = compared(log)
    assert str(found.total) == str(sound.total)
    assert found.run.data.source.skipped == {"byte with damage": 9000}


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (b"", "it does not begin as one"),
        (bytes(8), "the log has no positions"),
        (bytes(8) + b"\xff" * 5000, "no flight in it; not read: 5000 bytes with damage"),
        (bytes(8) + b"\x28\0B" + bytes(8) + b"\2" + bytes(31), "flags that nobody here knows"),
        # A format that holds itself, and one of more numbers than any row has.
        (bytes(8) + b"\x0d\0Fa:a[9] b;c d;" + b"\4\0A\0\0\0a", "bytes with damage"),
        (
            bytes(8) + b"".join(
                len(text).to_bytes(2, "little") + b"F" + text
                for text in (b"%c:%c[9999] x;" % (n, n + 1) for n in range(97, 105))
            ) + b"\4\0A\0\0\0a",
            "bytes with damage",
        ),
    ],
)  # fmt: skip
def test_a_ulog_of_nothing_but_damage_is_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], damage: bytes, said: str
) -> None:
    log = tmp_path / "x.ulg"
    log.write_bytes(b"ULog\x01\x12\x35\x01" + damage)
    assert call(["compare", str(log)]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert said in line


@pytest.mark.parametrize("kind", [b"\x05", b"D"])
def test_a_message_beyond_the_end_of_a_ulog_costs_itself_alone(tmp_path: Path, kind: bytes) -> None:
    log = tmp_path / "x.ulg"
    whole = write_ulog(log, off_m=3.0).read_bytes()
    sound = compared(log)
    end = 16 + 3 + 40 if kind == b"\x05" else len(whole)  # of the flags, before all formats; of all
    log.write_bytes(whole[:end] + b"\xff\xff" + kind + whole[end:])
    assert str(compared(log).total) == str(sound.total)


@pytest.mark.parametrize(
    "told",
    ["[" * 50_000, "[1]", '["x", "mission", []]', '[1, "mission", [[1, 2]]]', '[1, 2, [["x"]]]'],
)
def test_a_mission_in_a_ulog_that_is_none_is_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], told: str
) -> None:
    log = tmp_path / "x.ulg"
    key = f"char[{len(told)}] aerofed_missions".encode()
    body = bytes([0, len(key)]) + key + told.encode()
    whole = write_ulog(log).read_bytes()
    log.write_bytes(whole + len(body).to_bytes(2, "little") + b"M" + body)
    assert call(["compare", str(log)]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"aerofed: {log}: cannot be read as a .ulg flight log: damaged")


def test_a_time_that_is_none_costs_its_row_alone(tmp_path: Path) -> None:
    fields = "float voltage_v;float current_a;float discharged_mah;float remaining"
    rows = [(t_s, 15.0, 1.0, 1.0, 0.5) for t_s in (1, 2, (2**64 - 1) / 1e6 - 9000)]
    log = write_ulog(tmp_path / "x.ulg", instead={"battery_status": (fields, "ffff", rows)})
    line = b"4" + b"\xff" * 8 + b"late"
    log.write_bytes(log.read_bytes() + len(line).to_bytes(2, "little") + b"L" + line)
    found = compared(log).run.data
    assert found.battery.t_ns.tolist() == [1_000_000_000, 2_000_000_000]
    assert "late" not in [event.text for event in found.events]
    assert found.source.skipped == {"row without a time": 2}


@pytest.mark.parametrize("letters", ["@LLf", "QLL", "QLLfff", ""])
def test_rows_whose_format_is_damaged_are_counted(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], letters: str
) -> None:
    log = tmp_path / "x.bin"
    whole = write_dataflash(log).read_bytes()
    rows = whole.count(b"\xa3\x95\x01")
    at = whole.index(b"QLLf")
    log.write_bytes(whole[:at] + letters.encode().ljust(6, b"\0") + whole[at + 6 :])
    assert call(["compare", str(log)]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.endswith(f"no flight in it; not read: {rows * 23} bytes with damage")


def test_a_damaged_log_costs_a_folder_itself_alone(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for end, write in KINDS.items():
        write(tmp_path / f"whole{end}")
        (tmp_path / f"bad{end}").write_bytes(b"x" * 99)
    (tmp_path / "bad.mcap").write_bytes(b"x" * 99)
    assert call(["compare", str(tmp_path)]) == 0
    printed = capfd.readouterr()
    assert "whole.ulg" in printed.out
    assert "bad" not in printed.out
    bad = [tmp_path / f"bad{end}" for end in (".bin", ".mcap", ".tlog", ".ulg")]
    assert [line.split(": ")[:2] for line in printed.err.splitlines()] == [
        ["left out", str(log)] for log in bad
    ]
    with pytest.warns(UserWarning, match="left out: ") as warned:
        assert set(aerofed.compare(tmp_path).index) == {f"whole{end}" for end in KINDS}
    assert len(warned) == len(bad)
    verdict = tmp_path / "verdict.xml"
    limit = ("--limit", "cross_track_max_m=500", "--junit", str(verdict))
    assert call(["compare", str(tmp_path), *limit]) == 6  # nobody knows what flew in the bad ones
    *_, last = (line.split(": ") for line in capfd.readouterr().err.splitlines())
    unknown = [str(bad[-1]), "cross_track_max_m = not known", "must be at most 500; not a ULog"]
    assert last[1:4] == unknown
    with pytest.warns(UserWarning, match="left out: "), pytest.raises(LimitsNotMetError) as unmet:
        aerofed.compare(tmp_path).check(cross_track_max_m=500)
    assert str(unmet.value).count("not known") == len(bad)
    skipped = ET.parse(verdict).findall(
        "testsuite[@name='left out'][@skipped='4']/testcase/skipped"
    )
    assert [case.get("message", "").split(": ")[0] for case in skipped] == list(map(str, bad))
    for log in tmp_path.glob("whole*"):
        log.unlink()
    assert call(["compare", str(tmp_path)]) == 2
    assert capfd.readouterr().err.startswith(f"aerofed: {bad[0]}: ")


def test_a_log_without_a_mode_is_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """All rows of modes fell to damage."""
    log = tmp_path / "x.bin"
    whole = write_dataflash(log).read_bytes()
    log.write_bytes(whole.replace(b"\xa3\x95\x03", b"---"))
    assert call(["compare", str(log)]) == 0
    said = capfd.readouterr()
    assert said.err == ""
    assert "its mission was never flown (modes: no mode that is known)" in " ".join(
        said.out.split()
    )


@pytest.mark.parametrize("end", KINDS)
def test_an_empty_log_is_said_to_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], end: str
) -> None:
    log = tmp_path / f"x{end}"
    log.touch()
    assert call(["compare", str(log)]) == 2
    assert capsys.readouterr().err == f"aerofed: {log}: the file is empty\n"


def test_devices_are_not_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for end in KINDS:
        link = tmp_path / f"zero{end}"
        link.symlink_to("/dev/zero")
        assert call(["compare", str(link)]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert call(["compare", "/dev/zero"]) == 2
    assert capsys.readouterr().err == "aerofed: /dev/zero: neither a folder nor a file\n"


def test_a_limit_that_is_not_met_is_told_with_where_and_when(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, xml = write_ulog(tmp_path / "x.ulg", off_m=3.0), tmp_path / "verdict.xml"
    limits = ["--limit", "cross_track_max_m=2", "--limit", "height_rms_m=1"]
    assert call(["compare", str(log), *limits, "--junit", str(xml)]) == LIMITS_NOT_MET
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("aerofed: x.ulg: cross_track_max_m = 3: must be at most 2; leg 3, 3")
    (suite,) = ET.parse(xml).getroot()
    assert (suite.get("tests"), suite.get("failures")) == ("2", "1")
    assert float(suite.attrib["time"]) == pytest.approx(60.0, abs=10.0)  # of the flight
    assert all(case.get("time") for case in suite)
    table = tmp_path / "limits.toml"
    table.write_text("[limits]\ncross_track_max_m = 3.5\nwind_max_mps = 5\n")
    assert call(["compare", str(log), "--limits", str(table)]) == LIMITS_NOT_MET
    assert "wind_max_mps = not known" in capsys.readouterr().err
    assert call(["compare", str(log), "--limit", "cross_trak_max_m=2"]) == 2
    assert "did you mean cross_track_max_m? (it has: plan_path_m, " in capsys.readouterr().err
    assert EXIT_CODES[LIMITS_NOT_MET] == "limits not met"


@pytest.mark.parametrize(
    "name",
    [
        "a\x1b[31m\x07b",
        "\udcff\udc80",
        "a&b<c>d\"e'f",
        "a\tb\nc\rd",
        "\x7f\x85\ufffe\uffff",
        "é" * 120,
    ],
)
def test_a_verdict_is_xml_whatever_the_file_is_called(tmp_path: Path, name: str) -> None:
    log, xml = write_ulog(tmp_path / "x.ulg", off_m=3.0), tmp_path / "verdict.xml"
    log = log.rename(tmp_path / f"{name}.ulg")
    limit = ["--limit", "cross_track_max_m=2"]
    assert call(["compare", str(log), *limit, "--junit", str(xml)]) == LIMITS_NOT_MET
    (suite,) = ET.parse(xml).getroot()
    said = name.encode("utf-8", "backslashreplace").decode()
    for odd, told in {
        "\x1b": "\\x1b", "\x07": "\\x07", "\x7f": "\\x7f", "\x85": "\\x85", "\r": "\\r",
        "\ufffe": "\\ufffe", "\uffff": "\\uffff",
    }.items():  # fmt: skip
        said = said.replace(odd, told)
    assert suite.attrib["name"] == suite[0].attrib["classname"] == f"{said}.ulg"
    assert suite[0][0].attrib["message"].startswith(f"{said}.ulg: cross_track_max_m = 3")


def test_python_has_the_same_verdict(tmp_path: Path) -> None:
    found = aerofed.compare(write_dataflash(tmp_path / "x.bin", off_m=3.0))
    assert found.loc["x.bin", "cross_track_max_m"] == pytest.approx(3.0, abs=0.02)
    assert all(item.met for item in found.check(cross_track_max_m=3.5))
    with pytest.raises(LimitsNotMetError, match="leg 3") as raised:
        found.check(cross_track_max_m=2, failsafes=0)
    assert [item.met for item in raised.value.verdicts] == [False, True]


def test_a_flight_of_a_plan_ends_with_its_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, out = tmp_path / "p.waypoints", tmp_path / "out"
    rows = [(22, 0, 0), (16, 0, 5e-4), (16, 5e-4, 5e-4)]
    lines = [
        f"{seq}\t0\t3\t{command}\t0\t0\t0\t0\t{47 + north}\t{8 + east}\t20\t1"
        for seq, (command, north, east) in enumerate(rows)
    ]
    plan.write_text("\n".join(["QGC WPL 110", *lines]) + "\n")
    common = ["fly", str(plan), "--no-report", "--quiet", "--out"]
    assert call([*common, str(out), "--limit", "slots_missed=0"]) == 0
    again = [*common, str(tmp_path / "two"), "--set", "limits.corner_cut_max_m=0.0", "--json"]
    assert call(again) == LIMITS_NOT_MET
    said = capsys.readouterr()
    assert "corner_cut_max_m" in said.err
    (verdict,) = json.loads(said.out)["limits"]
    assert (verdict["name"], verdict["met"]) == ("corner_cut_max_m", False)
    assert tomllib.loads((tmp_path / "two/config.toml").read_text())["limits"]
    assert "limits" not in tomllib.loads((out / "config.toml").read_text())


def test_a_file_with_limits_alone_will_do_and_keys_that_count_for_nothing_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    limits, plan = tmp_path / "limits.toml", tmp_path / "p.waypoints"
    limits.write_text("[limits]\ncross_track_max_m = 50\nslots_missed = 0\n")
    rows = [(22, 0, 0), (16, 0, 3e-4), (20, 0, 0)]
    lines = [
        f"{seq}\t0\t3\t{command}\t0\t0\t0\t0\t{47 + north}\t{8 + east}\t20\t1"
        for seq, (command, north, east) in enumerate(rows)
    ]
    plan.write_text("\n".join(["QGC WPL 110", *lines]) + "\n")
    common = ["fly", str(plan), "--no-report", "--no-figures", "--out"]
    assert call([*common, str(tmp_path / "a"), "--config", str(limits)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[-1] == "2 limits met"
    assert not [line for line in printed if "not compared" in line]  # it returns by its plan
    assert call(["compare", str(tmp_path / "a"), "--limits", str(limits), "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)
    assert found["limits_met"] is True
    assert found["total"]["energy_j"] > 0
    for what in ("fly", "sitl"):
        given = [str(plan)] if what == "fly" else []
        assert call([what, *given, "--set", "mission.speed_mps=3"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "command line: mission.speed_mps: counts for nothing here; " in line


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        ("failsafes", "--limit failsafes: must be NAME=VALUE, as cross_track_max_m=3"),
        ("failsafes=-1", "--limit: failsafes = -1: must be at least 0, as the number is"),
        ("failsafes=", "--limit: failsafes = '': must be a number"),
    ],
)
def test_a_limit_that_is_none_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], limit: str, said: str
) -> None:
    assert call(["compare", str(write_ulog(tmp_path / "x.ulg")), "--limit", limit]) == 2
    assert capsys.readouterr().err == f"aerofed: {said}\n"


def test_a_folder_of_flight_logs_is_compared_and_each_line_names_its_flight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for end, write in KINDS.items():
        write(tmp_path / f"x{end}", off_m=3.0)
    (tmp_path / "notes.txt").touch()
    assert call(["compare", str(tmp_path), "--limit", "failsafes=0"]) == 0
    printed = capsys.readouterr().out
    for end in KINDS:
        assert f"\nx{end}: at " in printed
        assert f"\nx{end}: energy not known: the log has no numbers of a battery\n" in printed
    assert printed.endswith("1 limit met by all\n")
    assert aerofed.compare(tmp_path).index.tolist() == ["x.bin", "x.tlog", "x.ulg"]
    assert call(["report", str(tmp_path)]) == 2
    assert "--offset x.tlog=SECONDS says what to add" in capsys.readouterr().err


@pytest.mark.parametrize("where", ["b/flight.mcap", "runs/b/flight.mcap"])
def test_of_a_folder_of_runs_one_is_to_be_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], where: str
) -> None:
    (tmp_path / where).parent.mkdir(parents=True)
    (tmp_path / where).touch()
    assert call(["compare", str(tmp_path)]) == 2
    one = (tmp_path / where).parent
    assert capsys.readouterr().err.endswith(f"no flight.mcap; give one of its runs, as {one}\n")


def test_energy_is_known_by_charge_or_else_by_current() -> None:
    t_ns = np.arange(11) * 10**9
    ones, unknown = np.ones(11), np.full(11, np.nan)
    charged = BatteryTrack(t_ns, 10 * ones, unknown, np.arange(11) / 3.6, ones)
    told = BatteryTrack(t_ns, 10 * ones, 2 * ones, unknown, ones)
    assert charged.energy_j(0, 10**10) == pytest.approx(100.0)
    assert told.energy_j(0, 10**10) == pytest.approx(200.0)
    assert str(told.energy_j(2 * 10**10, 3 * 10**10)) == "nan"


def test_positions_go_out_as_geojson(tmp_path: Path) -> None:
    log = write_ulog(tmp_path / "x.ulg")
    assert call(["log", "export", str(log), "--to", "geojson"]) == 0
    found = json.loads((tmp_path / "x.geojson").read_text())["features"]
    assert [feature["properties"]["kind"] for feature in found] == ["planned", "believed"]
    lon, lat, alt = found[1]["geometry"]["coordinates"][0]
    assert (lat, lon, alt) == pytest.approx((HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m), abs=1e-6)
    times = found[1]["properties"]["t_s"]
    assert len(times) == len(found[1]["geometry"]["coordinates"])
    assert times == sorted(times)
