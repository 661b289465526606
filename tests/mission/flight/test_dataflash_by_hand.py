"""What a DataFlash log says, row by row: ArduPilot's numbers, units and words."""

import math
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav

from mission.base.errors import InputError
from mission.flight.logs.dataflash import KIND
from mission.flight.missions.mission_path import items_of
from mission.log.values import COPTER, PLANE, ROVER, FlightData

NAN = math.nan
S = 1_000_000_000
Rows = tuple[str, str, Sequence[tuple[Any, ...]]]  # letters, columns, rows
# As AP_Logger's LogStructure.h has them.
PACKED = {
    "a": "64s", "n": "4s", "N": "16s", "Z": "64s", "g": "e", "M": "B", "L": "i", "c": "h",
    "C": "H", "e": "i", "E": "I",
}  # fmt: skip
LAT, LON = 470_000_000, 80_000_000
POS: Rows = ("QLLf", "TimeUS,Lat,Lng,Alt", [(0, LAT, LON, 500.0), (100 * 10**6, LAT, LON, 520.0)])


def content(kinds: Sequence[tuple[str, Rows]]) -> bytes:
    """Rows of each kind, one kind after another, numbered from 1 on."""
    out, numbers = bytearray(), dict[str, int]()

    def row(number: int, letters: str, values: Sequence[Any]) -> None:
        form = "<" + "".join(PACKED.get(letter, letter) for letter in letters)
        values = [each.encode() if isinstance(each, str) else each for each in values]
        out.extend(b"\xa3\x95" + bytes([number]) + struct.pack(form, *values))

    for name, (letters, columns, rows) in kinds:
        if name not in numbers:
            numbers[name] = len(numbers) + 1
            size = 3 + struct.calcsize("<" + "".join(PACKED.get(c, c) for c in letters))
            row(128, "BBnNZ", (numbers[name], size, name, letters, columns))
        for values in rows:
            row(numbers[name], letters, values)
    return bytes(out)


def read(path: Path, *kinds: tuple[str, Rows], places: Rows | None = POS) -> FlightData:
    more = [] if places is None else [("POS", places)]
    (path / "x.bin").write_bytes(content([*kinds, *more]))
    return KIND.flight(path / "x.bin")


def said(found: FlightData, *kinds: str) -> list[tuple[float, str]]:
    return [(e.t_ns / S, e.text) for e in found.events if e.kind in kinds]


@pytest.mark.parametrize(
    ("subsystem", "words"),
    [
        (2, ""), (3, ""), (4, ""), (5, "radio"), (6, "battery"), (7, "GPS"), (8, "ground station"),
        (9, "fence"), (10, ""), (11, ""), (12, ""), (13, ""), (14, ""), (15, ""), (16, ""),
        (17, "EKF"), (18, ""), (19, "CPU"), (20, "ADSB"), (21, ""), (22, ""), (23, "terrain"),
        (24, ""), (25, ""), (26, "sensors"), (27, ""), (28, ""), (29, "vibration"), (30, ""),
        (31, "dead reckoning"), (32, ""),
    ],
)  # fmt: skip
def test_failsafes_have_the_numbers_of_ardupilots_subsystems(
    tmp_path: Path, subsystem: int, words: str
) -> None:
    rows = [(5 * 10**6, subsystem, 0), (6 * 10**6, subsystem, 1), (7 * 10**6, subsystem, 2)]
    found = read(tmp_path, ("ERR", ("QBB", "TimeUS,Subsys,ECode", rows)))
    expected = [(t, f"failsafe: {words}") for t in (6.0, 7.0)] if words else []
    assert said(found, "failsafe") == expected
    assert all(event.severity == 4 for event in found.events)


@pytest.mark.parametrize(
    ("letter", "packed", "value"),
    [
        ("b", -3, -3), ("B", 200, 200), ("h", -300, -300), ("H", 40_000, 40_000),
        ("i", -70_000, -70_000), ("I", 3_000_000_000, 3e9), ("f", 2.5, 2.5), ("d", 0.1, 0.1),
        ("Q", 2**40, 2.0**40), ("q", -(2**40), -(2.0**40)), ("g", 1.5, 1.5), ("M", 9, 9),
        ("L", -15_000_000, -1.5), ("c", -250, -2.5), ("C", 250, 2.5), ("e", -250, -2.5),
        ("E", 250, 2.5),
    ],
)  # fmt: skip
def test_letters_are_numbers_of_their_size_and_scale(
    tmp_path: Path, letter: str, packed: float, value: float
) -> None:
    """By the table of formats in AP_Logger's README."""
    told = ("Q" + letter + "f", "TimeUS,Alt,DAlt", [(10**6, packed, 7.0), (2 * 10**6, packed, 8.0)])
    found = read(tmp_path, ("CTUN", told)).signals
    limit = value if abs(value) < 1e10 else NAN
    np.testing.assert_equal(found["wanted_height_m"].values[:, 0], [7.0, 8.0])
    if math.isnan(limit):
        assert "height_m" not in found
    else:
        np.testing.assert_allclose(found["height_m"].values[:, 0], [limit] * 2, rtol=1e-15)


@pytest.mark.parametrize(
    ("letter", "packed", "metres"),
    [("L", LAT, 47.0), ("d", 47.0, 47.0), ("f", 47.0, 47.0)],
)
def test_columns_of_rows_are_scaled_too(
    tmp_path: Path, letter: str, packed: float, metres: float
) -> None:
    rows = [(0, packed, 8.0, 500.0), (10**6, packed, 8.0, 501.0)]
    found = read(tmp_path, places=(f"Q{letter}ff", "TimeUS,Lat,Lng,Alt", rows))
    assert found.area.home.lat_deg == metres


def test_multipliers_of_a_log_count_and_ids_that_it_lacks_are_ardupilots(tmp_path: Path) -> None:
    """'F' is 1e-6 for ArduPilot, 'A' to 'G' tenths to 1e-7; '-' and 0 stand for none."""
    letters = "0ABCDEFG"
    for n, letter in enumerate(letters):
        rows = [(10**6, 3000.0, 5.0), (2 * 10**6, 4000.0, 6.0)]
        kinds: list[tuple[str, Rows]] = [
            ("CTUN", ("Qff", "TimeUS,Alt,DAlt", rows)),
            ("FMTU", ("QBNN", "TimeUS,FmtType,UnitIds,MultIds", [(0, 1, "smm", f"F{letter}-")])),
        ]
        found = read(tmp_path, *kinds).signals
        np.testing.assert_allclose(found["height_m"].values[:, 0], [3e3 / 10**n, 4e3 / 10**n])
        assert found["wanted_height_m"].values[:, 0].tolist() == [5.0, 6.0]
    told: tuple[str, Rows] = (
        "MULT",
        ("Qbd", "TimeUS,Id,Mult", [(0, ord("A"), 0.5), (0, ord("-"), 0.0)]),
    )
    kinds[1] = ("FMTU", ("QBNN", "TimeUS,FmtType,UnitIds,MultIds", [(0, 1, "smm", "FA-")]))
    found = read(tmp_path, told, ("CTUN", kinds[0][1]), kinds[1]).signals
    assert found["height_m"].values[:, 0].tolist() == [3000.0, 4000.0]  # its number is 2 now
    kinds[1] = ("FMTU", ("QBNN", "TimeUS,FmtType,UnitIds,MultIds", [(0, 2, "smm", "FA-")]))
    found = read(tmp_path, told, ("CTUN", kinds[0][1]), kinds[1]).signals
    assert found["height_m"].values[:, 0].tolist() == [1500.0, 2000.0]
    assert found["wanted_height_m"].values[:, 0].tolist() == [5.0, 6.0]


@pytest.mark.parametrize("instance", ["I", "C", "IMU", "Inst", "Instance"])
def test_sensors_of_a_kind_are_told_apart_by_whichever_column_numbers_them(
    tmp_path: Path, instance: str
) -> None:
    rows = [(n * 10**6, at, 12.0 + at, 5.0 + at) for n in (1, 2) for at in (0, 1, 2)]
    found = read(tmp_path, ("BAT", ("QBff", f"TimeUS,{instance},Volt,Curr", rows))).signals
    assert found["voltage_v"].values[:, 1].tolist() == [13.0, 13.0]
    assert found["current_a"].values[:, 1].tolist() == [6.0, 6.0]


@pytest.mark.parametrize(
    ("letters", "columns", "row", "state"),
    [
        ("QBfffB", "TimeUS,Inst,Volt,Curr,CurrTot,RemPct", (0, 12.5, 3.5, 70.0, 80),
         (12.5, 3.5, 70.0, 0.8)),
        ("QBff", "TimeUS,Instance,Volt,Curr", (0, 12.5, 3.5), (12.5, 3.5, NAN, NAN)),
        ("Qhhf", "TimeUS,Volt,Curr,CurrTot", (1250, 350, 70.0), (12.5, 3.5, 70.0, NAN)),
        ("QBff", "TimeUS,Instance,Volt,Curr", (1, 12.5, 3.5), None),
        ("QBff", "TimeUS,Inst,Volt,Curr", (1, 12.5, 3.5), None),
    ],
)  # fmt: skip
def test_a_battery_is_the_first_one_in_its_units(
    tmp_path: Path, letters: str, columns: str, row: tuple[Any, ...],
    state: tuple[float, ...] | None,
) -> None:  # fmt: skip
    got = read(tmp_path, ("BAT", (letters, columns, [(10**6, *row)]))).battery
    assert got.t_ns.tolist() == ([] if state is None else [S])
    if state is not None:
        values = got.voltage_v[0], got.current_a[0], got.consumed_mah[0], got.remaining[0]
        np.testing.assert_allclose(values, state)


def test_wind_home_and_modes_have_their_columns(tmp_path: Path) -> None:
    wind = [(10**6, 0, 3.0, 4.0), (2 * 10**6, 1, 7.0, 7.0)]
    origin = [(0, 0, LAT + 9, LON, 100.0), (1, 1, LAT, LON, 510.0)]
    found = read(
        tmp_path,
        ("XKF2", ("QBff", "TimeUS,C,VWN,VWE", wind)),
        ("ORGN", ("QBLLf", "TimeUS,Type,Lat,Lng,Alt", origin)),
        ("MODE", ("QBB", "TimeUS,Mode,ModeNum", [(10**6, 99, 3), (2 * 10**6, 99, 6)])),
    )
    assert found.wind.vel_mps.tolist() == [[4.0, 3.0, 0.0]]
    assert found.area.home.alt_msl_m == 510.0
    assert said(found, "mode") == [(1.0, "AUTO"), (2.0, "RTL")]
    old = read(tmp_path, ("MODE", ("QB", "TimeUS,Mode", [(10**6, 5)])))
    assert said(old, "mode") == [(1.0, "LOITER")]


@pytest.mark.parametrize(
    ("text", "vehicle"),
    [
        ("ArduCopter V4.5.0", COPTER), ("ArduPlane V4.5.0", PLANE), ("ArduRover V4.5.0", ROVER),
        ("Rover V4.5.0", ROVER), ("ArduSub V4.5.0", COPTER), ("Blimp V4.5.0", COPTER),
        ("ArduPlaneX V4", COPTER),
    ],
)  # fmt: skip
def test_a_vehicle_is_what_its_firmware_calls_itself(
    tmp_path: Path, text: str, vehicle: str
) -> None:
    told = [(10**6, text), (2 * 10**6, "Rover is no beginning")] if vehicle == ROVER else None
    found = read(tmp_path, ("MSG", ("QZ", "TimeUS,Message", told or [(10**6, text)])))
    assert found.vehicle == vehicle
    assert said(found, "status")[0] == (1.0, text)


def test_fixes_and_the_time_of_day_are_the_receivers(tmp_path: Path) -> None:
    """2024-01-01T00:00:00Z is second 18 past that day of GPS week 2295, a Monday."""
    columns = "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt"
    gms = 86_400_000 + 18_000
    rows = [
        (10**6, 0, 2, gms + 1000, 2295, LAT, LON, 400.0),
        (2 * 10**6, 0, 3, gms + 2000, 2295, LAT, LON, 500.0),
        (3 * 10**6, 1, 3, 0, 0, LAT, LON, 600.0),
        (4 * 10**6, 0, 4, gms + 4000, 2295, LAT, LON, 530.0),
    ]
    found = read(tmp_path, ("GPS", ("QBBIHLLf", columns, rows)), places=None)
    assert found.gnss_ns.tolist() == [2 * S, 4 * S]
    assert found.belief.t_ns.tolist() == [2 * S, 4 * S]
    assert found.area.home.alt_msl_m == 500.0
    assert found.source.utc_ns == 1_704_067_200 * S
    assert read(tmp_path, ("GPS", ("QBBIHLLf", columns, rows))).belief.t_ns.tolist() == [0, 100 * S]


FENCE = "TimeUS,Tot,Seq,Type,Lat,Lng,Count,Radius"


def test_a_fence_has_the_kinds_of_ac_fence(tmp_path: Path) -> None:
    """AC_PolyFenceType: 98 and 97 corners, 92 and 94 circles to keep to, 93 and 96 out of, 95
    where to return to; the second of a pair is of whole metres."""
    kinds = (98, 97, 92, 93, 94, 96, 95)
    rows = [
        (10**6, 7, n, kind, LAT, LON, 4, 12.5 if kind in (92, 93, 94, 96) else 0.0)
        for n, kind in enumerate(kinds)
    ]
    rows.append((10**6, 7, 7, 91, LAT, LON, 1, 0.0))  # none that is known
    found = read(tmp_path, ("FNCE", ("QBBBLLBf", FENCE, rows)))
    (fence,) = found.missions
    assert fence.kind == "fence"
    got = [(item.command, item.params[0]) for item in items_of(fence)]
    within, without = 5003, 5004  # MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, _EXCLUSION
    assert got == [
        (5001, 4.0), (5002, 4.0), (within, 12.5), (without, 12.5), (within, 12.5), (without, 12.5),
        (5000, 4.0),
    ]  # fmt: skip
    assert {(i.frame, i.x, i.y, i.z, i.params[1:]) for i in items_of(fence)} == {
        (mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, 47.0, 8.0, 0.0, (0.0, 0.0, 0.0))
    }


def test_rally_points_and_items_have_their_columns(tmp_path: Path) -> None:
    rally = [(10**6, 2, 0, LAT, LON, 20), (10**6, 2, 1, LAT, LON + 10, 30)]
    columns = "TimeUS,CTot,CNum,CId,Prm1,Prm2,Prm3,Prm4,Lat,Lng,Alt,Frame"
    items = [
        (10**6, 3, 0, 16, 9.0, 9.0, 9.0, 9.0, LAT, LON, 488.0, 0),
        (10**6, 3, 1, 22, 1.0, 2.0, 3.0, 4.0, LAT, LON, 20.0, 10),
        (10**6, 3, 2, 16, 5.0, 6.0, 7.0, 8.0, LAT, LON, 30.0, 3),
    ]
    found = read(
        tmp_path,
        ("RALY", ("QBBLLh", "TimeUS,Tot,Seq,Lat,Lng,Alt", rally)),
        ("CMD", ("QHHHffffLLfB", columns, items)),
        ("MISE", ("QHHHffffLLfB", columns, [(5 * 10**6, *items[2][1:])])),
    )
    points, mission = (items_of(each) for each in found.missions)
    assert [(i.command, i.x, i.y, i.z) for i in points] == [
        (5100, 47.0, 8.0, 20.0), (5100, 47.0, 8.000001, 30.0),
    ]  # fmt: skip
    assert [(i.seq, i.command, i.frame, i.params, i.z) for i in mission] == [
        (0, 0, 0, (9.0, 9.0, 9.0, 9.0), 488.0),
        (1, 22, 10, (1.0, 2.0, 3.0, 4.0), 20.0),
        (2, 16, 3, (5.0, 6.0, 7.0, 8.0), 30.0),
    ]
    assert [each.tolist() for each in found.current] == [[5 * S], [2]]


def test_an_item_until_version_3_1_has_its_first_parameter_alone(tmp_path: Path) -> None:
    rows = [(10**6, 2, n, 16, 3.0 + n, LAT, LON, 20.0) for n in range(2)]
    (mission,) = read(
        tmp_path, ("CMD", ("QHHHfLLf", "TimeUS,CTot,CNum,CId,Prm1,Lat,Lng,Alt", rows))
    ).missions
    item = items_of(mission)[1]
    assert item.params == (4.0, 0.0, 0.0, 0.0)
    assert item.frame == mav.MAV_FRAME_GLOBAL_RELATIVE_ALT


def test_who_is_armed_again_was_disarmed_at_the_row_before(tmp_path: Path) -> None:
    """As a log that pauses while it is disarmed has it."""
    events = [(10**6, 10), (2 * 10**6, 11), (3 * 10**6, 10), (8 * 10**6, 10), (9 * 10**6, 15)]
    events += [(10 * 10**6, 11)]
    found = read(tmp_path, ("EV", ("QB", "TimeUS,Id", events)))
    assert said(found, "armed") == [
        (1.0, "armed"), (2.0, "disarmed"), (3.0, "armed"), (3.0, "disarmed"), (9.0, "armed"),
        (10.0, "disarmed"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("slow", "factor"),
    [(21.0, 0.01), (19.0, 1.0)],
)
def test_body_rates_that_turn_nothing_so_fast_are_hundredths(
    tmp_path: Path, slow: float, factor: float
) -> None:
    """It rolls 2 degrees a second; its rates are told as `slow` times that."""
    rolls = [(n * 10**5, 0.0, 0.2 * n, 0.0, 0.2 * n, 0.0, 0.0) for n in range(20)]
    rates = [(n * 10**5, 50.0, 2.0 * slow, 50.0, 2.0 * slow, 50.0, 9.0) for n in range(20)]
    found = read(
        tmp_path,
        ("ATT", ("Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw", rolls)),
        ("RATE", ("Qffffff", "TimeUS,RDes,R,PDes,P,YDes,Y", rates)),
    ).signals
    np.testing.assert_allclose(found["rates_degps"].values[0] / factor, [2 * slow, 2 * slow, 9.0])
    np.testing.assert_allclose(found["wanted_rates_degps"].values[0] / factor, [50.0] * 3)


def test_times_in_milliseconds_and_rows_without_any(tmp_path: Path) -> None:
    """Until 3.3: a receiver's T is the vehicle's, its TimeMS that of the week."""
    gps = [(3, 500_000, 1000 + 1000 * n, LAT, LON, 500.0) for n in range(3)]
    columns = "Status,TimeMS,T,Lat,Lng,Alt"
    found = read(
        tmp_path,
        ("GPS", ("BIILLf", columns, gps[:2])),
        ("MSG", ("Z", "Message", [("hello",)])),
        ("GPS", ("BIILLf", columns, gps[2:])),
        places=None,
    )
    assert found.belief.t_ns.tolist() == [S, 2 * S, 3 * S]
    assert said(found, "status") == [(2.0, "hello")]
    assert found.source.clock.endswith(
        ", in whole milliseconds; rows without a time have that of the row before"
    )


@pytest.mark.parametrize(
    ("size", "letters", "columns", "sound"),
    [(15, "Qf", "TimeUS,Alt", True), (16, "Qf", "TimeUS,Alt", False),
     (15, "Qf", "TimeUS,Alt,More", False), (15, "Qf", "TimeUS", False)],
)  # fmt: skip
def test_a_format_that_contradicts_itself_is_none(
    tmp_path: Path, size: int, letters: str, columns: str, sound: bool
) -> None:
    told = struct.pack("<3sBB4s16s64s", b"\xa3\x95\x80", 77, size, b"CTUN", letters.encode(), columns.encode())  # fmt: skip  # noqa: E501
    row = struct.pack("<3sQf", b"\xa3\x95\x4d", 10**6, 5.0)
    (tmp_path / "x.bin").write_bytes(content([("POS", POS)]) + told + 2 * row)
    found = KIND.flight(tmp_path / "x.bin")
    assert ("height_m" in found.signals) is sound
    assert found.source.skipped == ({} if sound else {"byte with damage": 30})


def test_what_is_no_dataflash_log_is_said(tmp_path: Path) -> None:
    (tmp_path / "x.bin").write_bytes(b"\xa3\x96" + content([("POS", POS)]))
    with pytest.raises(InputError, match="it does not begin as one"):
        KIND.flight(tmp_path / "x.bin")
    with pytest.raises(InputError, match="sdlog2"):
        read(tmp_path, ("TIME", ("Q", "StartTime", [])))


@pytest.mark.parametrize(("letter", "size"), [("n", 4), ("N", 16), ("Z", 64), ("a", 64)])
def test_text_ends_at_its_first_zero(tmp_path: Path, letter: str, size: int) -> None:
    rows = [(10**6, b"abc\0xyz"[:size])]
    found = read(tmp_path, ("MSG", (f"Q{letter}", "TimeUS,Message", rows)))
    assert said(found, "status") == [(1.0, "abc")]


def test_rows_that_lack_a_column_are_counted(tmp_path: Path) -> None:
    rows = [(10**6, 3), (2 * 10**6, 3)]
    found = read(tmp_path, ("ORGN", ("QB", "TimeUS,Type", rows)))
    assert found.source.skipped == {"row of ORGN without Lat": 2}


def test_targets_of_guided_hold_while_its_mode_does(tmp_path: Path) -> None:
    """From the filter's origin, in centimetres; a target of before the mode counts no more."""
    places = [(n * 10**6, LAT, LON, 500.0) for n in range(1, 10)]
    found = read(
        tmp_path,
        ("ORGN", ("QBLLf", "TimeUS,Type,Lat,Lng,Alt", [(0, 0, LAT, LON, 500.0)])),
        ("MODE", ("QBB", "TimeUS,Mode,ModeNum", [(2 * 10**6, 4, 4), (7 * 10**6, 3, 3)])),
        ("GUIP", ("QBff", "TimeUS,Type,pX,pY", [
            (10**6, 1, 9e4, 9e4), (3 * 10**6, 1, 1e4, 0.0), (5 * 10**6, 2, 0.0, 2e4),
        ])),
        places=("QLLf", "TimeUS,Lat,Lng,Alt", places),
    )  # fmt: skip
    goal = found.signals["goal_deg"]
    assert goal.t_s.tolist() == [float(n) for n in range(1, 10)]
    north, east = ((goal.values - [47.0, 8.0]) * [111_172.0, 76_056.0]).T
    unknown = [NAN] * 2
    np.testing.assert_allclose(north, [*unknown, 100, 100, 0, 0, *unknown, NAN], atol=0.1)
    np.testing.assert_allclose(east, [*unknown, 0, 0, 200, 200, *unknown, NAN], atol=0.3)
    assert "goal_m" not in found.signals
    without = read(tmp_path, ("GUIP", ("QBff", "TimeUS,Type,pX,pY", [(10**6, 1, 1.0, 1.0)])))
    assert not {"goal_deg", "goal_m"} & set(without.signals)


def test_a_mission_that_was_not_listed_is_known_as_far_as_it_was_started(tmp_path: Path) -> None:
    columns = "TimeUS,CTot,CNum,CId,Lat,Lng,Alt"

    def started(t_s: int, total: int, *numbers: int) -> list[tuple[Any, ...]]:
        return [
            (t_s * 10**6 + n, total, number, 16, LAT + 10 * t_s + number, LON, 20.0)
            for n, number in enumerate(numbers)
        ]

    rows = ("QHHHLLf", columns)
    found = read(
        tmp_path,
        ("MISE", (*rows, started(1, 5, 1, 2))),
        ("MSG", ("QZ", "TimeUS,Message", [(2 * 10**6, "New mission")])),
        ("CMD", (*rows, started(3, 4, 0, 1))),  # two of its rows are lost
        ("CMD", (*rows, started(4, 2, 0, 1))),
    )
    assert [(m.t_ns, [i.seq for i in items_of(m)]) for m in found.missions] == [
        (S, [0, 1, 2]), (3 * S, [0, 1]), (4 * S + 1000, [0, 1]),
    ]  # fmt: skip
    assert items_of(found.missions[0])[0].command == 0
    assert found.source.skipped == {"item of a mission": 2}
    times, numbers = found.current  # a list that is not whole is no list of what is started
    assert (times.tolist(), numbers.tolist()) == ([S, S + 1000], [1, 2])


def test_of_stretches_those_without_a_flight_are_passed_over(tmp_path: Path) -> None:
    """The clock goes back twice; only the last part has positions."""

    def turns(*times_s: int) -> tuple[str, Rows]:
        return "ATT", ("Qff", "TimeUS,Roll,Pitch", [(t * 10**6, 0.0, 0.0) for t in times_s])

    starts = turns(*range(50, 60)), turns(*range(20, 30))
    with pytest.raises(InputError, match="no positions"):
        read(tmp_path, *starts, places=None)
    flown: Rows = (*POS[:2], [(t * 10**6, LAT, LON, 500.0 + t) for t in range(1, 10)])
    found = read(tmp_path, *starts, turns(*range(1, 10)), places=flown)
    assert found.belief.t_ns.tolist() == [t * S for t in range(1, 10)]


SIGNALS: list[tuple[list[tuple[str, str, tuple[float, ...]]], str, list[float]]] = [
    ([("PSCN", "TPN PN TVN VN", (1, 2, 3, 4)), ("PSCE", "TPE PE TVE VE", (5, 6, 7, 8)),
      ("PSCD", "TPD PD TVD VD", (9, 10, 11, 12))], "wanted_position_m", [1, 5, 9]),
    ([("PSCN", "TPN PN TVN VN", (1, 2, 3, 4)), ("PSCE", "TPE PE TVE VE", (5, 6, 7, 8)),
      ("PSCD", "TPD PD TVD VD", (9, 10, 11, 12))], "position_m", [2, 6, 10]),
    ([("PSCN", "TPN PN TVN VN", (1, 2, 3, 4)), ("PSCE", "TPE PE TVE VE", (5, 6, 7, 8)),
      ("PSCD", "TPD PD TVD VD", (9, 10, 11, 12))], "wanted_velocity_mps", [3, 7, 11]),
    ([("PSCN", "TPN PN TVN VN", (1, 2, 3, 4)), ("PSCE", "TPE PE TVE VE", (5, 6, 7, 8)),
      ("PSCD", "TPD PD TVD VD", (9, 10, 11, 12))], "velocity_mps", [4, 8, 12]),
    ([("PSC", "TPX TPY PX PY", (1, 2, 3, 4))], "wanted_position_m", [1, 2]),
    ([("PSC", "TPX TPY PX PY", (1, 2, 3, 4))], "position_m", [3, 4]),
    ([("PSC", "TVX TVY VX VY", (1, 2, 3, 4))], "velocity_mps", [3, 4]),
    ([("NTUN", "DPosX DPosY PosX PosY", (100, 200, 300, 400))], "wanted_position_m", [1, 2]),
    ([("NTUN", "DPosX DPosY PosX PosY", (100, 200, 300, 400))], "position_m", [3, 4]),
    ([("NTUN", "DVelX DVelY VelX VelY", (100, 200, 300, 400))], "wanted_velocity_mps", [1, 2]),
    ([("NTUN", "DVelX DVelY VelX VelY", (100, 200, 300, 400))], "velocity_mps", [3, 4]),
    ([("CTUN", "DAlt Alt", (5, 6))], "wanted_height_m", [5]),
    ([("CTUN", "DAlt Alt", (5, 6))], "height_m", [6]),
    ([("ATT", "DesRoll Roll DesPitch Pitch DesYaw Yaw", (1, 2, 3, 4, 5, 6))],
     "wanted_attitude_deg", [1, 3, 5]),
    ([("ATT", "DesRoll Roll DesPitch Pitch DesYaw Yaw", (1, 2, 3, 4, 5, 6))],
     "attitude_deg", [2, 4, 6]),
    ([("RATE", "RDes R PDes P YDes Y", (1, 2, 3, 4, 5, 6))], "wanted_rates_degps", [1, 3, 5]),
    ([("VIBE", "VibeX VibeY VibeZ Clip0 Clip1 Clip2", (1, 2, 3, 4, 5, 6))],
     "vibration_mps2", [1, 2, 3]),
    ([("VIBE", "VibeX VibeY VibeZ Clip0 Clip1 Clip2", (1, 2, 3, 4, 5, 6))], "clips", [4, 5, 6]),
    ([("XKF4", "SV SP SH SM", (1, 2, 3, 4)), ("NKF4", "SV SP SH SM", (5, 6, 7, 8))],
     "innovation_ratio", [1, 2, 3, 4]),
    ([("EKF4", "SV SP SH SM", (1, 2, 3, 4)), ("NKF4", "SV SP SH SM", (5, 6, 7, 8))],
     "innovation_ratio", [5, 6, 7, 8]),
    ([("GPS", "Status NSats HDop", (3, 14, 1.5))], "gnss_fix", [3]),
    ([("GPS", "Status NSats HDop", (3, 14, 1.5))], "satellites", [14]),
    ([("GPS", "Status NSats HDop", (3, 14, 1.5))], "hdop", [1.5]),
    ([("GPA", "VDop HAcc", (1, 2.5))], "gnss_accuracy_m", [2.5]),
    ([("CUR2", "Volt Curr", (12, 3))], "voltage_v", [NAN, 12]),
    ([("CUR2", "Volt Curr", (12, 3))], "current_a", [NAN, 3]),
]  # fmt: skip


@pytest.mark.parametrize(("rows", "signal", "values"), SIGNALS)
def test_each_signal_is_of_its_rows_and_columns(
    tmp_path: Path,
    rows: list[tuple[str, str, tuple[float, ...]]],
    signal: str,
    values: list[float],
) -> None:
    """A velocity that stands still is none, so that they last a second."""
    kinds = [
        (name, ("Q" + "f" * len(row), f"TimeUS,{names.replace(' ', ',')}", [
            (10**6, *row), (2 * 10**6, *row),
        ]))
        for name, names, row in rows
    ]  # fmt: skip
    found = read(tmp_path, *kinds).signals[signal]
    np.testing.assert_allclose(found.values[0], values)
    assert found.t_s[0] == 1.0
