"""What a ULog says, row by row: PX4's numbers, units and words for what it does not know."""

import json
import math
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from ulog_bytes import UlogBytes

from mission.base.errors import InputError
from mission.flight.logs.ulog import KIND
from mission.flight.missions.mission_path import items_of
from mission.log.values import COPTER, PLANE, ROVER, FlightData

NAN = math.nan
S = 1_000_000_000
Topic = tuple[str, str, Sequence[tuple[Any, ...]]]
PLACES: Topic = (
    "double lat;double lon;float alt", "ddf", [(0.0, 47.0, 8.0, 500.0), (100.0, 47.001, 8.0, 520.0)]
)  # fmt: skip


def written(path: Path, told: dict[str, Topic | None]) -> UlogBytes:
    every = {"vehicle_global_position": PLACES, **told}
    topics = {name: topic for name, topic in every.items() if topic is not None}
    log = UlogBytes({name: (fields, form) for name, (fields, form, _) in topics.items()})
    for name, (_, _, rows) in topics.items():
        for t_s, *values in rows:
            log.row(name, t_s, *values)
    path.write_bytes(log.content)
    return log


def read(path: Path, **topics: Topic | None) -> FlightData:
    written(path / "x.ulg", topics)
    return KIND.flight(path / "x.ulg")


def test_modes_have_the_numbers_of_px4s_nav_state(tmp_path: Path) -> None:
    """vehicle_status.msg: AUTO_MISSION 3, AUTO_LOITER 4, AUTO_RTL 5 and so on."""
    rows = [(float(n), n, 1, False, 1) for n in range(23)]
    told = "uint8_t nav_state;uint8_t arming_state;bool failsafe;uint8_t vehicle_type"
    found = read(tmp_path, vehicle_status=(told, "BB?B", rows))
    names = {
        "MANUAL": 0, "ALTITUDE": 1, "POSITION": 2, "MISSION": 3, "HOLD": 4, "RETURN": 5,
        "ACRO": 10, "DESCEND": 12, "TERMINATED": 13, "OFFBOARD": 14, "STABILIZED": 15,
        "TAKEOFF": 17, "LAND": 18, "FOLLOW": 19, "PRECISION LAND": 20, "ORBIT": 21,
    }  # fmt: skip
    expected = {n: name for name, n in names.items()}
    assert found.modes.names == tuple(expected.get(n, f"MODE {n}") for n in range(23))
    assert found.modes.t_ns.tolist() == [n * S for n in range(23)]


@pytest.mark.parametrize(
    ("kinds", "vehicle"),
    [((0,), COPTER), ((1,), COPTER), ((2,), PLANE), ((3,), ROVER), ((4,), COPTER),
     ((1, 2), COPTER), ((0, 2), PLANE)],
)  # fmt: skip
def test_a_vehicle_is_of_its_kind_and_armed_by_its_state(
    tmp_path: Path, kinds: tuple[int, ...], vehicle: str
) -> None:
    states = [(1, False), (2, False), (2, True), (2, True), (3, True), (2, True), (2, False)]
    rows = [
        (float(t), 14, arming, lost, 1e6 * t - 3e5 if t != 6 else 9e6, kinds[t % len(kinds)])
        for t, (arming, lost) in enumerate(states)
    ]
    told = "uint8_t nav_state;uint8_t arming_state;bool failsafe;uint64_t nav_state_timestamp"
    rows[1] = (1.0, 3, *rows[1][2:])
    found = read(
        tmp_path,
        vehicle_status=(
            f"{told};uint8_t vehicle_type", "BB?QB",
            [(*row[:4], max(0, round(row[4])), row[5]) for row in rows],
        ),
    )  # fmt: skip
    assert found.vehicle == vehicle
    assert found.modes.names == ("OFFBOARD", "MISSION", "OFFBOARD")
    assert found.modes.t_ns.tolist() == [0, 7 * S // 10, 17 * S // 10]
    told_of = [(e.t_ns // S, e.text, e.severity) for e in found.events if e.kind != "mode"]
    assert told_of == [
        (1, "armed", 6), (2, "failsafe", 4), (4, "disarmed", 6), (5, "armed", 6),
        (5, "failsafe", 4),
    ]  # fmt: skip


def test_battery_wind_and_fixes_have_their_columns(tmp_path: Path) -> None:
    battery = [(1.0, 16.5, 2.5, 30.0, 0.75), (2.0, -1.0, -1.0, -1.0, -1.0), (3.0, 16.0, 0.0, 0, 0)]
    names = "float voltage_v;float current_a;float discharged_mah;float remaining"
    found = read(
        tmp_path,
        battery_status=(names, "ffff", battery),
        wind_estimate=("float windspeed_north;float windspeed_east", "ff", [(1.0, 3.0, 4.0)]),
        vehicle_gps_position=("uint8_t fix_type", "B", [(1.0, 2), (2.0, 3), (3.0, 4)]),
    )
    assert found.battery.t_ns.tolist() == [S, 2 * S, 3 * S]
    got = found.battery
    np.testing.assert_equal(got.voltage_v, [16.5, NAN, 16.0])
    np.testing.assert_equal(got.current_a, [2.5, NAN, 0.0])
    np.testing.assert_equal(got.consumed_mah, [30.0, NAN, 0.0])
    np.testing.assert_equal(got.remaining, [0.75, NAN, 0.0])
    assert found.wind.t_ns.tolist() == [S]
    assert found.wind.vel_mps.tolist() == [[4.0, 3.0, 0.0]]
    assert found.gnss_ns.tolist() == [2 * S, 3 * S]


@pytest.mark.parametrize("topic", ["vehicle_gps_position", "sensor_gps"])
@pytest.mark.parametrize(("later_us", "zero_s"), [(None, 1000), (0, 1000), (-200_000, 1000.2)])
def test_utc_is_that_of_the_row_or_of_another_instant(
    tmp_path: Path, topic: str, later_us: int | None, zero_s: float
) -> None:
    told = "uint64_t time_utc_usec", "Q"
    rows: list[tuple[Any, ...]] = [(t, round((1000 + t) * 1e6)) for t in (1.0, 2.0)]
    rows.insert(0, (0.5, 0))  # no time yet
    if later_us is not None:
        told = "uint64_t time_utc_usec;int32_t timestamp_time_relative", "Qi"
        rows = [(*row, later_us) for row in rows]
    assert read(tmp_path, **{topic: (*told, rows)}).source.utc_ns == round(zero_s * S)


@pytest.mark.parametrize(
    ("form", "first", "home"),
    [
        (("double lat;double lon;float alt", "ddf"), (47.0, 8.0, 500.0), (47.0, 8.0, 500.0)),
        (("double lat;double lon;float alt", "ddf"), (89.5, -180.0, 5.0), (89.5, -180.0, 5.0)),
        (("int32_t lat;int32_t lon;int32_t alt", "iii"), (470000000, 100, 7000), (47.0, 1e-5, 7.0)),
        (("int32_t lat;int32_t lon;int32_t alt", "iii"), (50, 80000000, -10), (5e-6, 8.0, -0.01)),
        (("int32_t lat;int32_t lon;int32_t alt", "iii"), (91, 90, 0), (9.1e-6, 9e-6, 0.0)),
        (("int32_t lat;int32_t lon;int32_t alt", "iii"), (50, 181, 0), (5e-6, 1.81e-5, 0.0)),
        (
            ("double latitude_deg;double longitude_deg;double altitude_msl_m", "ddd"),
            (-47.0, 8.5, 500.0), (-47.0, 8.5, 500.0),
        ),
    ],
)  # fmt: skip
def test_places_of_a_receiver_are_degrees_or_whole_numbers(
    tmp_path: Path,
    form: tuple[str, str],
    first: tuple[float, ...],
    home: tuple[float, ...],
) -> None:
    rows = [(0.0, *first), (1.0, *first)]
    found = read(tmp_path, vehicle_global_position=None, vehicle_gps_position=(*form, rows))
    at = found.area.home
    assert (at.lat_deg, at.lon_deg, at.alt_msl_m) == pytest.approx(home, rel=1e-12)
    assert found.source.only == "believed"


@pytest.mark.parametrize(
    ("valid", "names", "alt_m"),
    [
        ((), "", 510.0),
        ((True, True), ";bool valid_hpos;bool valid_alt", 510.0),
        ((True, False), ";bool valid_hpos;bool valid_alt", 500.0),
        ((False, True), ";bool valid_hpos;bool valid_alt", 500.0),
        ((False,), ";bool valid_alt", 500.0),
    ],
)
def test_a_home_counts_unless_it_is_said_to_be_none(
    tmp_path: Path, valid: tuple[bool, ...], names: str, alt_m: float
) -> None:
    fields, form = "double lat;double lon;float alt" + names, "ddf" + "?" * len(valid)
    found = read(tmp_path, home_position=(fields, form, [(1.0, 47.0, 8.0, 510.0, *valid)]))
    assert found.area.home.alt_msl_m == alt_m
    np.testing.assert_allclose(found.belief.pos_m[:, 2], [500 - alt_m, 520 - alt_m], atol=1e-3)


def test_local_places_count_where_it_is_known_where_they_begin(tmp_path: Path) -> None:
    names = "float x;float y;float z;double ref_lat;double ref_lon;float ref_alt;bool xy_global"
    rows = [
        (0.0, 10.0, -20.0, -5.0, 47.0, 8.0, 500.0, True),
        (1.0, 0.0, 0.0, 0.0, 47.0, 8.0, 500.0, False),
        (2.0, 0.0, 0.0, 0.0, NAN, 8.0, 500.0, True),
        (3.0, 13.0, -16.0, -7.0, 47.0, 8.0, 500.0, True),
    ]
    found = read(
        tmp_path, vehicle_global_position=None, vehicle_local_position=(names, "fffddf?", rows)
    )
    assert found.belief.t_ns.tolist() == [0, 3 * S]
    assert found.area.home.alt_msl_m == pytest.approx(505.0)
    moved = found.belief.pos_m[1] - found.belief.pos_m[0]
    np.testing.assert_allclose(moved, [4.0, 3.0, 2.0], atol=1e-3)
    # 10 m north of 47 degrees, and 20 m west of 8: 111.2 km and 76.06 km are a degree.
    assert found.area.home.lat_deg == pytest.approx(47.0 + 10 / 111_172, abs=1e-7)
    assert found.area.home.lon_deg == pytest.approx(8.0 - 20 / 76_056, abs=1e-7)


TRIPLET = "bool current.valid;uint8_t current.type;double current.lat;double current.lon"
TRIPLET += ";float current.alt"
STATUS = "uint8_t nav_state;uint8_t arming_state;bool failsafe"


def missions(path: Path, rows: Sequence[tuple[Any, ...]], **more: Topic) -> list[list[Any]]:
    """Seq, command, place of each item of each mission; the mode is MISSION from 2.05 s on."""
    found = read(
        path,
        vehicle_status=(STATUS, "BB?", [(1.0, 4, 2, False), (2.05, 3, 2, False)]),
        position_setpoint_triplet=(TRIPLET, "?Bddf", rows),
        **more,
    )
    return [
        [(item.seq, item.command, item.x, item.y, item.z) for item in items_of(mission)]
        for mission in found.missions
    ]


def test_what_it_headed_for_in_mission_mode_are_the_items_of_that_time(tmp_path: Path) -> None:
    result = (
        "uint32_t mission_id;uint16_t seq_current;bool finished",
        "IH?",
        [(0.5, 7, 0, False), (5.0, 7, 1, False), (6.0, 7, 3, False), (8.0, 7, 3, True),
         (20.0, 9, 0, False)],
    )  # fmt: skip
    rows = [
        (1.94, True, 0, 1.0, 1.0, 1.0),  # 110 ms before the mode
        (1.96, True, 3, 47.1, 8.1, 10.0),  # 90 ms: it changed with it
        (5.0, True, 0, 47.2, 8.2, 20.0),
        (5.5, False, 0, 47.9, 8.2, 20.0),
        (5.6, True, 1, 47.9, 8.2, 20.0),  # a velocity
        (6.5, True, 2, 47.3, 8.3, 30.0),
        (8.5, True, 2, 47.9, 8.9, 30.0),  # it hovers where it is
        (21.0, True, 4, 47.4, 8.4, 40.0),
    ]
    found = missions(tmp_path, rows, mission_result=result)
    assert found == [
        [
            (0, mav.MAV_CMD_NAV_TAKEOFF, 47.1, 8.1, 10.0),
            (1, mav.MAV_CMD_NAV_WAYPOINT, 47.2, 8.2, 20.0),
            (2, 0, 0.0, 0.0, 0.0),
            (3, mav.MAV_CMD_NAV_LOITER_UNLIM, 47.3, 8.3, 30.0),
        ],
        [(0, mav.MAV_CMD_NAV_LAND, 47.4, 8.4, 40.0)],
    ]


def test_a_jump_has_the_most_times_that_were_left(tmp_path: Path) -> None:
    names = "uint16_t seq_current;bool finished;uint16_t seq_total;bool item_do_jump_changed"
    names += ";uint16_t item_changed_index;uint16_t item_do_jump_remaining"
    result = (
        names,
        "H?H?HH",
        [
            (0.5, 0, False, 4, False, 9, 9),
            (3.0, 0, False, 4, True, 2, 5),
            (4.0, 1, False, 4, True, 2, 4),
        ],
    )
    found = read(
        tmp_path,
        vehicle_status=(STATUS, "BB?", [(1.0, 3, 2, False)]),
        position_setpoint_triplet=(TRIPLET, "?Bddf", [(2.0, True, 0, 47.1, 8.1, 10.0)]),
        mission_result=result,
    )
    (mission,) = found.missions
    assert mission.t_ns == S // 2
    jump = items_of(mission)[2]
    assert (jump.command, jump.frame, jump.params) == (177, mav.MAV_FRAME_MISSION, (0.0, 6.0, 0, 0))
    assert (jump.x, jump.y, jump.z) == (0.0, 0.0, 0.0)
    assert items_of(mission)[0].params == (0.0, 0.0, 0.0, 0.0)
    assert [t.tolist() for t in found.current] == [[S // 2, 4 * S], [0, 1]]


def test_texts_dropouts_and_events_are_told(tmp_path: Path) -> None:
    log = written(tmp_path / "x.ulg", {"event": ("uint32_t id", "I", [(1.0, 1), (2.0, 2)])})
    for level, text in ((0, b"gone"), (7, b" detail ")):
        log.message(b"L", bytes([ord("0") + level]) + struct.pack("<Q", 50_000_000) + text)
    log.message(b"O", struct.pack("<H", 1500))
    (tmp_path / "x.ulg").write_bytes(log.content)
    found = KIND.flight(tmp_path / "x.ulg")
    assert [(e.t_ns, e.text, e.severity) for e in found.events] == [
        (50 * S, "gone", 0), (50 * S, "detail", 7),
    ]  # fmt: skip
    assert found.dropouts_s.tolist() == [[2.0, 1.5]]  # after the last row
    assert found.source.skipped == {"dropout": 1, "event of PX4's events interface": 2}


@pytest.mark.parametrize(
    ("at", "bit", "known"),
    [(7, 255, True), (8, 1, True), (8, 2, False), (9, 1, False), (15, 128, False), (16, 1, True)],
)
def test_flags_that_no_reader_knows_refuse_a_log(
    tmp_path: Path, at: int, bit: int, known: bool
) -> None:
    """ULog: bytes 0..7 are compatible flags, 8..15 incompatible ones; appended data is known."""
    log = written(tmp_path / "x.ulg", {})
    log.content[16 + 3 + at] |= bit
    (tmp_path / "x.ulg").write_bytes(log.content)
    if known:
        assert len(KIND.flight(tmp_path / "x.ulg").truth.t_ns) == 2
    else:
        with pytest.raises(InputError, match="flags that nobody here knows"):
            KIND.flight(tmp_path / "x.ulg")


@pytest.mark.parametrize(("start_us", "zero_us"), [(10**15, 0), (10**15 + 1, 10**15 + 1)])
def test_a_clock_since_1970_begins_with_the_log(
    tmp_path: Path, start_us: int, zero_us: int
) -> None:
    log = written(tmp_path / "x.ulg", {})
    content = bytes(log.content).replace(
        struct.pack("<Q", 100_000_000), struct.pack("<Q", start_us + 100_000_000)
    )
    (tmp_path / "x.ulg").write_bytes(content[:8] + struct.pack("<Q", start_us) + content[16:])
    found = KIND.flight(tmp_path / "x.ulg")
    assert found.truth.t_ns.tolist() == [0, (start_us + 100_000_000 - zero_us) * 1000]


def test_only_the_first_instance_of_a_topic_counts_and_nested_rows_are_flat(
    tmp_path: Path,
) -> None:
    log = UlogBytes({"vehicle_global_position": PLACES[:2]})
    log.message(b"F", b"part:float a;float[2] b;")
    log.message(b"F", b"whole:uint64_t timestamp;part[2] of;uint8_t[4] _padding0;")
    log.message(b"A", struct.pack("<BH", 1, 7) + b"vehicle_global_position")
    log.message(b"A", struct.pack("<BH", 0, 8) + b"whole")
    for t_s, *values in PLACES[2]:
        log.row("vehicle_global_position", t_s, *values)
        other = struct.pack("<HQddf", 7, round(t_s * 1e6) + 10**6, 0.0, 90.0, 0.0)
        log.message(b"D", other)
    for padding in (4, 2, 0):
        log.message(b"D", struct.pack("<HQ6f", 8, 5, *range(6)) + bytes(padding))
    log.message(b"D", struct.pack("<HQ6f", 8, 5, *range(6)) + bytes(5))  # longer than it is
    (tmp_path / "x.ulg").write_bytes(log.content)
    found = KIND.flight(tmp_path / "x.ulg")
    assert found.truth.t_ns.tolist() == [0, 100 * S]
    assert found.area.home.lat_deg == 47.0
    assert found.source.skipped == {"byte with damage": 3 + 2 + 8 + 24 + 5}


@pytest.mark.parametrize(
    ("name", "truth", "clock"),
    [
        ("Aerofed", True, "simulated time"),
        ("Aerofed", False, "seconds since PX4 started"),
        ("PX4", True, "seconds since PX4 started"),
    ],
)
def test_a_log_of_ours_says_so_and_has_missions_in_parts(
    tmp_path: Path, name: str, truth: bool, clock: str
) -> None:
    log = written(
        tmp_path / "x.ulg", {"vehicle_global_position_groundtruth": PLACES} if truth else {}
    )
    key = f"char[{len(name)}] sys_name".encode()
    log.message(b"I", bytes([len(key)]) + key + name.encode())
    item = [0.0, 16.0, 3.0, 0.0, 0.0, 0.0, 0.0, 47.0, 8.0, 20.0, 1.0]
    for t_ns, kind in ((1, "mission"), (2, "fence")):
        text = json.dumps([t_ns, kind, [item]]).encode()
        for continued, part in ((0, text[:7]), (1, text[7:20]), (1, text[20:])):
            key = f"char[{len(part)}] aerofed_missions".encode()
            log.message(b"M", bytes([continued, len(key)]) + key + part)
    (tmp_path / "x.ulg").write_bytes(log.content)
    found = KIND.flight(tmp_path / "x.ulg")
    assert found.source.clock == clock
    assert found.source.only == (None if truth else "believed")
    assert [(m.t_ns, m.kind, m.items) for m in found.missions] == [
        (1, "mission", (tuple(item),)), (2, "fence", (tuple(item),)),
    ]  # fmt: skip


def floats(names: str, *rows: tuple[float, ...]) -> Topic:
    """A topic of floats; rows are at 1 s, 2 s and on."""
    fields = ";".join(f"float {name}" for name in names.split())
    return fields, "f" * len(rows[0]), [(float(n), *row) for n, row in enumerate(rows, start=1)]


def test_signals_of_a_ulog_have_their_units_and_what_is_not_known(tmp_path: Path) -> None:
    """The quaternion is of 90 degrees about down; angles are in radians."""
    half, radian = math.sqrt(0.5), 180.0 / math.pi
    turn = ("float[4] q", "ffff", [(1.0, half, 0.0, 0.0, half), (2.0, 1.0, 0.0, 0.0, 0.0)])
    goal = ("float[4] q_d", "ffff", turn[2])
    imu = "float accel_vibration_metric;uint32_t[3] accel_clipping", "fIII"
    gps = "uint8_t fix_type;uint8_t satellites_used;float hdop;float eph", "BBff"
    local = "float x;float y;float z;bool xy_valid;float vx;float vy;float vz;bool v_xy_valid"
    motors = "float[12] control", "f" * 12
    found = read(
        tmp_path,
        vehicle_attitude=turn,
        vehicle_attitude_setpoint=goal,
        vehicle_rates_setpoint=floats("roll pitch yaw", (0.1, 0.2, 0.3), (0.1, 0.2, 0.3)),
        vehicle_angular_velocity=("float[3] xyz", "fff", [(1.0, 1.0, 2.0, 3.0)]),
        vehicle_local_position_setpoint=floats("x y z vx vy vz", (1, 2, -3, 4, 5, -6)),
        trajectory_setpoint=("float[3] position", "fff", [(1.0, 9.0, 9.0, 9.0)]),
        vehicle_local_position=(local, "fff?fff?", [
            (1.0, 1, 2, -3, True, 4, 5, -6, False), (2.0, 7, 8, -9, False, 10, 11, -12, True),
        ]),
        vehicle_imu_status=(*imu, [(1.0, 0.5, 1, 2, 3)]),
        estimator_status=floats(
            "vel_test_ratio pos_test_ratio hgt_test_ratio mag_test_ratio", (0.1, 0.2, 0.3, 0.4)
        ),
        vehicle_gps_position=(*gps, [(1.0, 3, 14, 1.25, 2.5), (2.0, 4, 15, 0.0, 4294967.5)]),
        actuator_motors=(*motors, [(1.0, *[0.25, 0.5], *[NAN] * 10)]),
    ).signals  # fmt: skip
    expected: dict[str, list[list[float]]] = {
        "attitude_deg": [[0.0, 0.0, 90.0], [0.0, 0.0, 0.0]],
        "wanted_attitude_deg": [[0.0, 0.0, 90.0], [0.0, 0.0, 0.0]],
        "wanted_rates_degps": [[0.1 * radian, 0.2 * radian, 0.3 * radian]] * 2,
        "rates_degps": [[radian, 2 * radian, 3 * radian]],
        "wanted_position_m": [[1.0, 2.0, -3.0]], "wanted_velocity_mps": [[4.0, 5.0, -6.0]],
        "position_m": [[1.0, 2.0, -3.0], [NAN, NAN, -9.0]],
        "velocity_mps": [[NAN, NAN, -6.0], [10.0, 11.0, -12.0]],
        "vibration_mps2": [[0.5]], "clips": [[6.0]], "innovation_ratio": [[0.1, 0.2, 0.3, 0.4]],
        "gnss_fix": [[3.0], [4.0]], "satellites": [[14.0], [15.0]], "hdop": [[1.25], [NAN]],
        "gnss_accuracy_m": [[2.5], [NAN]], "motors": [[0.25, 0.5]],
    }  # fmt: skip
    assert set(found) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(found[name].values, values, atol=1e-5, err_msg=name)
        assert found[name].t_s[0] == 1.0


def test_signals_of_older_versions_stand_elsewhere(tmp_path: Path) -> None:
    attitude = "roll pitch yaw rollspeed pitchspeed yawspeed"
    found = read(
        tmp_path,
        vehicle_attitude=floats(attitude, (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)),
        vehicle_attitude_setpoint=floats("roll_body pitch_body yaw_body", (0.4, 0.5, 0.6)),
        vehicle_local_position=floats("x y z vx vy vz", (1, 2, -3, 4, 5, -6)),
        trajectory_setpoint=(
            "float[3] position;float[3] velocity", "ffffff", [(1.0, 1, 2, 3, 4, 5, 6)],
        ),
        estimator_status=floats("vel_test_ratio hdg_test_ratio", (0.1, 0.2)),
        sensor_gps=("uint8_t fix_type;uint8_t satellites_used", "BB", [(1.0, 3, 14)]),
    ).signals  # fmt: skip
    expected: dict[str, list[float]] = {
        "attitude_deg": [5.72958, 11.45916, 17.18873],
        "rates_degps": [22.91831, 28.64789, 34.37747],
        "wanted_attitude_deg": [22.91831, 28.64789, 34.37747], "position_m": [1.0, 2.0, -3.0],
        "velocity_mps": [4.0, 5.0, -6.0], "wanted_position_m": [1.0, 2.0, 3.0],
        "wanted_velocity_mps": [4.0, 5.0, 6.0], "gnss_fix": [3.0], "satellites": [14.0],
        "innovation_ratio": [0.1, NAN, NAN, 0.2],
    }  # fmt: skip
    for name, values in expected.items():
        np.testing.assert_allclose(found[name].values[0], values, atol=1e-4, err_msg=name)
