"""Any flight against what the vehicle was told: errors, delays, steps, health and verdicts."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from described import charts
from made_up_logs import write_ulog
from pymavlink import DFReader
from pymavlink.dialects.v20 import common as mav
from pyulog import ULog
from told_logs import (
    HOME,
    STEP_S,
    WRITERS,
    Floats,
    made,
    step_response,
    way,
    write_bin,
    write_tlog,
    write_ulg,
)

import aerofed
from mission.analysis.compare import RunComparison, compare_run
from mission.analysis.load import load_run
from mission.analysis.told import _reached_s, missing
from mission.cli import call
from mission.figures.charts import envelope
from mission.figures.flight import timeline_chart

KINDS = pytest.mark.parametrize("end", WRITERS)


def compared(path: Path) -> RunComparison:
    return compare_run(load_run(path))


@KINDS
@pytest.mark.parametrize("off_m", [0.5, 2.0, 5.0])
def test_an_offset_is_found_with_its_time_and_place(tmp_path: Path, end: str, off_m: float) -> None:
    flight = made(off_m=off_m, down_m=-off_m / 2, tilt_deg=4 * off_m)
    found = compared(WRITERS[end](tmp_path / f"x{end}", flight))
    total = found.total
    assert total.tracking_max_m == pytest.approx(off_m, abs=1e-3)
    assert total.height_tracking_max_m == pytest.approx(off_m / 2, abs=1e-3)
    assert total.attitude_tracking_max_deg == pytest.approx(4 * off_m, abs=0.01)
    assert total.yaw_tracking_max_deg == pytest.approx(0.0, abs=0.01)
    assert found.flown is not None
    t_s = found.flown.series["tracking_m"].t_s
    inside = (t_s >= 40.0) & (t_s <= 45.0)
    expected = off_m * math.sqrt(inside.mean())
    assert total.tracking_rms_m == pytest.approx(expected, rel=2e-3)
    across, along = total.across_rms_m, total.along_rms_m
    assert math.hypot(across, along) == pytest.approx(total.tracking_rms_m, rel=0.2)
    (row,) = [row for row in found.stretches if row["reference"] == "position"]
    worst = row["worst"]["tracking_max_m"]
    assert 40.0 - STEP_S <= worst["t_s"] <= 45.0 + STEP_S
    where = flight.actual[round(worst["t_s"] / STEP_S)]
    assert worst["lat_deg"] == pytest.approx(HOME.lat_deg + where[0] / 111_200, abs=1e-5)
    assert worst["height_m"] == pytest.approx(-where[2], abs=0.05)


@KINDS
@pytest.mark.parametrize("delay_s", [0.1, 0.5])
def test_a_delay_is_found(tmp_path: Path, end: str, delay_s: float) -> None:
    found = compared(WRITERS[end](tmp_path / f"x{end}", made(delay_s=delay_s)))
    assert found.total.tracking_delay_s == pytest.approx(delay_s, abs=0.02)


def test_a_flight_without_gnss_is_around_where_it_began(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As all flights in a hall: nothing but the places on the globe is missing."""
    flight = made(off_m=2.0)
    log = write_ulg(tmp_path / "hall.ulg", flight, xy_valid=True)
    found, outside = compared(log), compared(write_ulg(tmp_path / "x.ulg", flight))
    names = ("tracking_max_m", "height_tracking_max_m", "tracking_delay_s", "flown_path_m")
    for name in names:
        known = getattr(outside.total, name)
        assert getattr(found.total, name) == pytest.approx(known, rel=1e-3, abs=1e-3)
    assert set(missing(found.run.data)) - set(missing(outside.run.data)) == {
        "places on the globe", "satellites"
    }  # fmt: skip
    assert call(["report", str(log), "--out", str(tmp_path / "page.html")]) == 0
    assert call(["compare", str(log), str(tmp_path / "x.ulg"), "--together"]) == 2
    assert "hall.ulg: the log has no places on the globe" in capsys.readouterr().err


def test_a_log_that_pauses_between_two_flights_has_no_hole(tmp_path: Path) -> None:
    """ArduCopter logs only while it is armed, as it comes, and goes on in the same file."""
    pause_s = 30.0, 60.0
    flight = made(until_s=80.0)
    armed = [[30_010_000, 11], [59_990_000, 10]]
    log = write_bin(tmp_path / "x.bin", flight.without(*pause_s), more=[("EV", "QB", "", armed)])
    total = compared(log).total
    assert (total.gap_max_s, total.gnss_gap_max_s) == (0.0, 0.0)
    limits = ("--limit", "gap_max_s=0", "--limit", "height_tracking_max_m=0.1")
    assert call(["compare", str(log), *limits]) == 0
    unknown = compared(write_bin(tmp_path / "y.bin", flight.without(*pause_s))).total
    assert unknown.gap_max_s == pytest.approx(30.0, abs=0.2)


@pytest.mark.parametrize("version", ["NTUN", "PSC", "PSCN 4.7"])
def test_each_version_of_dataflash_tells_the_same(tmp_path: Path, version: str) -> None:
    flight = made(off_m=2.0, delay_s=0.2)
    new = compared(write_bin(tmp_path / "new.bin", flight)).total
    old = compared(write_bin(tmp_path / "old.bin", flight, version=version)).total
    for name in ("tracking_rms_m", "tracking_max_m", "height_tracking_max_m", "tracking_delay_s"):
        assert getattr(old, name) == pytest.approx(getattr(new, name), abs=1e-4), name


@pytest.mark.parametrize("version", ["PSC", "PSCN 4.7"])
def test_multipliers_that_a_log_lacks_are_ardupilots(tmp_path: Path, version: str) -> None:
    """Their rows stand at a log's begin, and are lost where that is."""
    flight = made(off_m=2.0, down_m=1.0)
    log = write_bin(tmp_path / "x.bin", flight, version=version, multipliers=False)
    assert compared(log).total.tracking_max_m == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize(("kind", "at", "other"), [("GUIP", 2, 5), ("GUID", 1, 4)])
def test_targets_of_guided_hold_until_the_next_one(
    tmp_path: Path, kind: str, at: int, other: int
) -> None:
    """North for 20 s, east for the rest, and 3 m off to the south meanwhile; targets in cm, from
    the filter's origin at home. Rows of other kinds have no place."""
    t_s = np.arange(0.0, 60.0, STEP_S)
    path = np.column_stack((np.clip(t_s - 10, 0, 20), np.clip(t_s - 30, 0, 20), -10 + 0 * t_s))
    path[(t_s > 40) & (t_s < 42), 0] -= 3.0
    flight = made(path=lambda _: path)
    rows = [(10e6, at, 2000.0, 0.0), (20e6, other, 7.0, 7.0), (30e6, at, 2000.0, 2000.0)]
    origin = (0, 0, *(round(x * 1e7) for x in (HOME.lat_deg, HOME.lon_deg)), HOME.alt_msl_m)
    log = write_bin(
        tmp_path / "x.bin", flight, version="none",
        more=[("ORGN", "QBLLf", "TimeUS,Type,Lat,Lng,Alt", [origin]),
              (kind, "QBff", "TimeUS,Type,pX,pY", [(round(t), *more) for t, *more in rows])],
    )  # fmt: skip
    found = compared(log)
    assert found.total.across_target_max_m == pytest.approx(3.0, abs=0.05)
    of_target = [row for row in found.stretches if row["reference"] == "target"]
    times_s = [row[end] for row in of_target for end in ("start_s", "end_s")]
    assert times_s == pytest.approx([10.0, 20.0, 30.0, t_s[-1]], abs=0.1)


_BAT = "QBfff", "TimeUS,Inst,Volt,Curr,CurrTot"
_CURR = "TimeUS,Volt,Curr,CurrTot"
_TWO = [(n * 10**6, k, 12.0 - k - n / 50, 9.0 + k, 0.0) for n in range(80) for k in (0, 1)]


@pytest.mark.parametrize(
    ("kinds", "least_v", "most_a", "sag_v"),
    [
        ([("BAT", *_BAT, _TWO)], 9.42, 10.0, 1.54),
        # Until 3.5, a row a battery; whole numbers are hundredths.
        ([("CURR", "Qfff", _CURR, [(n * 10**6, 12.0, 9.0, 0.0) for n in range(80)]),
          ("CUR2", "Qff", _CURR[:-8], [(n * 10**6, 11.0 - n / 50, 10.0) for n in range(80)])],
         9.42, 10.0, 1.54),
        ([("CURR", "Qhhf", _CURR, [(n * 10**6, 1200, 900, 0.0) for n in range(80)])],
         12.0, 9.0, 0.0),
    ],
)  # fmt: skip
def test_every_battery_of_dataflash_counts(
    tmp_path: Path, kinds: list[Any], least_v: float, most_a: float, sag_v: float
) -> None:
    total = compared(write_bin(tmp_path / "x.bin", made(until_s=80.0), more=kinds)).total
    assert total.voltage_min_v == pytest.approx(least_v, abs=1e-3)
    assert total.current_max_a == pytest.approx(most_a, abs=1e-3)
    assert total.voltage_sag_max_v == pytest.approx(sag_v, abs=0.021)


def test_every_battery_of_a_telemetry_log_counts(tmp_path: Path) -> None:
    """Cells in mV, of which those that are not there are 65535; what is not known is -1."""
    told = [
        (float(n), mav.MAVLink_battery_status_message(
            k, 0, 0, 32767, [4000 - 10 * n * k] * 3 + [65535] * 7, 900 if k else -1, -1, -1,
            90 - n if k else -1))
        for n in range(80) for k in (0, 1)
    ]  # fmt: skip
    found = compared(write_tlog(tmp_path / "x.tlog", made(until_s=80.0), more=told))
    assert found.total.voltage_min_v == pytest.approx(3 * (4.0 - 0.79), abs=1e-3)
    assert found.total.current_max_a == pytest.approx(9.0)
    assert found.total.battery_min == pytest.approx(0.11)
    assert "battery" not in missing(found.run.data)


def test_a_row_of_attitude_without_a_value_costs_itself_alone(tmp_path: Path) -> None:
    flight = made(tilt_deg=9.0)
    flight.attitude[1][int(20 / STEP_S)] = math.nan
    total = compared(write_bin(tmp_path / "x.bin", flight)).total
    assert total.attitude_tracking_max_deg == pytest.approx(9.0, abs=0.01)


def rms(values: Floats) -> float:
    return math.sqrt(float(np.mean(np.square(values))))


def test_numbers_are_those_of_other_readers(tmp_path: Path) -> None:
    """pymavlink and pyulog read the same logs."""
    flight = made(off_m=2.0, delay_s=0.2, tilt_deg=9.0)
    log = write_bin(tmp_path / "x.bin", flight)
    found = compared(log)
    assert found.flown is not None
    span = found.flown.start_s, found.flown.end_s
    reader, rows = DFReader.DFReader_binary(str(log)), dict[str, list[Any]]()
    while (message := reader.recv_msg()) is not None:
        kind = message.get_type()
        inside = span[0] - 1e-6 <= getattr(message, "TimeUS", 0) / 1e6 <= span[1] + 1e-6
        if kind in ("PSCN", "PSCE", "ATT") and inside:
            rows.setdefault(kind, []).append(message)
    reader.data_map.close()
    reader.filehandle.close()
    north = np.array([row.PN - row.TPN for row in rows["PSCN"]])
    east = np.array([row.PE - row.TPE for row in rows["PSCE"]])
    rolled = np.array([row.Roll - row.DesRoll for row in rows["ATT"]])
    assert found.total.tracking_rms_m == pytest.approx(rms(np.hypot(north, east)), rel=1e-6)
    assert found.total.attitude_tracking_rms_deg == pytest.approx(rms(rolled), rel=1e-5)

    log = write_ulg(tmp_path / "x.ulg", flight)
    found = compared(log)
    assert found.flown is not None
    read = ULog(str(log))
    told, was = (
        read.get_dataset(name).data
        for name in ("vehicle_local_position_setpoint", "vehicle_local_position")
    )
    t_s = told["timestamp"] / 1e6
    here = (t_s >= found.flown.start_s - 1e-6) & (t_s <= found.flown.end_s + 1e-6)
    off = np.hypot(was["x"] - told["x"], was["y"] - told["y"])[here]
    assert found.total.tracking_rms_m == pytest.approx(rms(off), rel=1e-6)


def test_steps_and_their_answers_are_those_of_the_closed_form(tmp_path: Path) -> None:
    """A second-order system rises and overshoots as textbooks say."""
    damping, omega, size = 0.5, 2.0, 10.0

    def told(t_s: Floats) -> Floats:
        up = way(t_s)
        north = np.where(t_s >= 30.0, size, 0.0)
        return np.column_stack((north, 0 * t_s, up[:, 2]))

    flight = made(path=told)
    answer = size * step_response(flight.t_s, at_s=30.0, damping=damping, omega=omega)
    flight = replace(flight, actual=np.column_stack((answer, flight.actual[:, 1:])))
    found = compared(write_ulg(tmp_path / "x.ulg", flight))
    assert found.flown is not None
    (step,) = [step for step in found.flown.steps if step.what == "position_m"]
    assert step.t_s == pytest.approx(30.0, abs=STEP_S)
    assert step.size == pytest.approx(size)
    overshoot = math.exp(-math.pi * damping / math.sqrt(1 - damping**2))
    assert step.overshoot == pytest.approx(overshoot, abs=0.002)
    fine = step_response(t := np.arange(0.0, 10.0, 1e-4), at_s=0.0, damping=damping, omega=omega)
    rise_s = float(t[(fine >= 0.9).argmax()] - t[(fine >= 0.1).argmax()])
    assert step.rise_s == pytest.approx(rise_s, abs=1.5 * STEP_S)
    assert "at 30.0 s a step of position by 10.0 m: 10 to 90 %" in step.words


@pytest.mark.parametrize(
    ("share", "reached_s"),
    [
        ((0.95, 1.0), 10.0),  # at once
        ((0.5, 1.0), 10.4),  # straight between two samples: 0.9 is 4/5 of the way
        ((0.0, 0.3, 1.1), 10.875),
        ((math.nan, 1.0), 10.5),
        ((0.2, 0.89), math.nan),
        ((), math.nan),
    ],
)
def test_a_share_is_reached_between_samples(share: tuple[float, ...], reached_s: float) -> None:
    t_s = np.linspace(10.0, 11.0, 3)[: len(share)]
    assert _reached_s(t_s, np.array(share), 0.9) == pytest.approx(reached_s, nan_ok=True)


def test_a_log_without_what_was_told_is_no_error_and_says_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = write_tlog(tmp_path / "x.tlog", made())
    kept, content, at = bytearray(), whole.read_bytes(), 0
    while at < len(content):  # nothing but heartbeats and positions
        size = 8 + 12 + content[at + 9]
        if int.from_bytes(content[at + 15 : at + 18], "little") in (0, 33):
            kept += content[at : at + size]
        at += size
    whole.write_bytes(kept)
    assert call(["compare", str(whole)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "not in the log: a mission, position setpoints, velocity setpoints" in out
    assert "OFFBOARD nothing" in out
    assert call(["compare", str(whole), "--limit", "tracking_rms_m=100"]) == 6
    assert "tracking_rms_m = not known: must be at most 100" in capsys.readouterr().err


@KINDS
def test_health_is_counted_in_the_air(tmp_path: Path, end: str) -> None:
    flight = made()
    in_air = (flight.t_s > 30.0) & (flight.t_s < 31.0)
    flight = replace(
        flight,
        vibration=np.where(in_air, 42.0, flight.vibration),
        clips=np.where(flight.t_s > 30.0, 17.0, 10.0),
        satellites=np.where(in_air, 5.0, 12.0),
    )
    total = compared(WRITERS[end](tmp_path / f"x{end}", flight)).total
    assert total.vibration_max_mps2 == pytest.approx(42.0)
    assert total.clips_max == 7  # since it left the ground
    assert total.satellites_min == 5
    assert total.gnss_fix_min == 3
    assert total.log_dropout_max_s == pytest.approx(STEP_S, abs=1e-3)


@KINDS
def test_a_fix_of_a_receiver_is_one_in_three_dimensions(tmp_path: Path, end: str) -> None:
    """2 is one in two, of which nobody knows the height; 4 is better than 3."""
    flight = made()
    fix = np.select([flight.t_s < 20.0, flight.t_s < 40.0, flight.t_s < 50.0], [2, 3, 1], 4)
    log = WRITERS[end](tmp_path / f"x{end}", replace(flight, fix=fix))
    run = load_run(log)
    here = fix >= 3
    begin_s = flight.t_s[0] - run.data.truth.t_ns[0] / 1e9
    np.testing.assert_allclose(run.data.gnss_ns / 1e9 + begin_s, flight.t_s[here], atol=1e-3)
    assert compare_run(run).total.gnss_fix_min == 1


def test_fixes_of_dataflash_are_of_its_first_receiver(tmp_path: Path) -> None:
    flight = made()
    flight = replace(flight, fix=np.where(flight.t_s < 30.0, 3.0, 2.0))
    second = [(round(t_s * 1e6) + 5, 1, 3, 12, 120) for t_s in flight.t_s.tolist()]
    rows = ("GPS", "QBBBC", "TimeUS,I,Status,NSats,HDop", second)
    log = write_bin(tmp_path / "x.bin", flight, more=[rows])
    assert len(load_run(log).data.gnss_ns) == (flight.t_s < 30.0).sum()


def test_motors_are_those_that_the_parameters_name(tmp_path: Path) -> None:
    total = compared(write_bin(tmp_path / "x.bin", made())).total
    assert total.motor_max == pytest.approx(0.6)
    assert total.motor_imbalance == pytest.approx(0.2)
    assert total.motors_full_s == 0.0
    assert math.isnan(compared(write_bin(tmp_path / "y.bin", made(), motors=False)).total.motor_max)


def test_a_dropout_that_a_ulog_tells_of_counts(tmp_path: Path) -> None:
    total = compared(write_ulg(tmp_path / "x.ulg", made(), dropout_ms=700)).total
    assert total.log_dropout_max_s == pytest.approx(0.7)


@KINDS
def test_what_is_in_a_hole_meets_no_limit(
    tmp_path: Path, end: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The offset is cut out of the log."""
    log = WRITERS[end](tmp_path / f"x{end}", made(off_m=25.0).without(39.0, 46.0))
    limits = ["tracking_max_m=3", "vibration_max_mps2=30", "attitude_tracking_max_deg=20"]
    options = [word for limit in limits for word in ("--limit", limit)]
    assert call(["compare", str(log), *options]) == 6
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 3
    assert all("= not known: must be at most" in line for line in said)
    assert call(["compare", str(log), *options, "--limit", "gap_max_s=8"]) == 0
    assert call(["compare", str(log), "--limit", "log_dropout_max_s=1"]) == 6
    assert "log_dropout_max_s = 7" in capsys.readouterr().err


def test_limits_name_mode_time_and_place_and_are_in_the_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, verdict = write_bin(tmp_path / "x.bin", made(off_m=5.0)), tmp_path / "v.xml"
    options = [
        "--limit",
        "tracking_max_m=3",
        "--limit",
        "satellites_min=6",
        "--junit",
        str(verdict),
    ]
    assert call(["compare", str(log), *options]) == 6
    (line,) = capsys.readouterr().err.splitlines()
    assert f"aerofed: {log.name}: tracking_max_m = 5: must be at most 3; GUIDED, 4" in line
    cases = {case.get("name"): len(case) for case in ET.parse(verdict).iter("testcase")}
    assert cases == {"tracking_max_m": 1, "satellites_min": 0}


def test_two_flights_stand_side_by_side(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    logs = [
        write_bin(tmp_path / f"{name}.bin", made(off_m=off_m))
        for name, off_m in (("before", 5.0), ("after", 2.0))
    ]
    picture = tmp_path / "both.svg"
    assert call(["compare", *map(str, logs), "--figure", str(picture)]) == 0
    out = capsys.readouterr().out
    (row,) = [line.split() for line in out.splitlines() if "off setpoint max" in line]
    assert row[-3:] == ["5.000", "2.000", "-3.000"]
    assert "Off the setpoint" in picture.read_text()


def test_from_python_they_are_tables(tmp_path: Path) -> None:
    log = write_ulg(tmp_path / "x.ulg", made(off_m=2.0))
    found = aerofed.compare(log)
    assert list(found.table["mode"]) == ["OFFBOARD"]
    errors = found.errors.loc["x.ulg"]["tracking_m"].dropna()
    assert errors.loc[41.0:44.0].to_numpy() == pytest.approx(2.0, abs=1e-4)
    assert errors.loc[20.0:39.0].to_numpy() == pytest.approx(0.0, abs=1e-4)
    assert found.health.loc["x.ulg"]["satellites"].min() == 12
    with pytest.raises(aerofed.LimitsNotMetError, match="tracking_max_m = 2"):
        found.check(tracking_max_m=1)


def test_stretches_in_json_have_their_mode_and_reference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = made(until_s=80.0)
    told = flight.wanted.copy()
    told[(flight.t_s > 40.0) & (flight.t_s < 60.0), :2] = math.nan
    log = write_ulg(tmp_path / "x.ulg", replace(flight, wanted=told))
    assert call(["compare", str(log), "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)
    rows = [(row["mode"], row["reference"]) for row in found["stretches"]]
    assert rows == [(("OFFBOARD"), each) for each in ("position", "attitude", "position")]
    middle = found["stretches"][1]
    assert (middle["start_s"], middle["end_s"]) == pytest.approx((40.0, 60.0), abs=2 * STEP_S)
    assert middle["tracking_rms_m"] is None
    lacks = "a mission, velocity setpoints, wanted body rates, innovation ratios, accuracy of GNSS"
    assert ", ".join(found["not_in_the_log"]) == f"{lacks}, motors, battery"


def test_targets_of_a_controller_that_does_not_run_are_none(tmp_path: Path) -> None:
    """As of a VTOL in forward flight, whose rows go on: what it asks for stands still."""
    flight = made(delay_s=0.2, until_s=80.0)
    runs = (flight.t_s < 40.0) | (flight.t_s > 60.0)
    last = int(np.flatnonzero(~runs)[0])
    told = np.where(runs[:, None], flight.wanted, flight.wanted[last])
    asked = np.where(runs, np.sin(flight.t_s), 0.25)
    rows = [
        (round(t * 1e6), *told[n, :2], *flight.actual[n, :2], asked[n], -asked[n], 0.0, 0.0)
        for n, t in enumerate(flight.t_s)
    ]
    columns = "TimeUS,TPX,TPY,PX,PY,TVX,TVY,VX,VY"
    more = [("PSC", "Qffffffff", columns, rows)]
    found = compared(write_bin(tmp_path / "x.bin", flight, version="none", more=more))
    assert found.flown is not None
    stretches = [(s.reference, s.start_s, s.end_s) for s in found.flown.stretches]
    assert [reference for reference, *_ in stretches] == ["position", "attitude", "position"]
    assert stretches[1][1:] == pytest.approx((40.0, 60.0), abs=2 * STEP_S)
    assert found.total.tracking_max_m < 3.0


@KINDS
def test_cut_and_altered_logs_end_in_a_line_at_most(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], end: str
) -> None:
    """Whatever damage leaves of setpoints and of health."""
    log = WRITERS[end](tmp_path / f"x{end}", made(until_s=30.0, off_m=3.0))
    whole, random = log.read_bytes(), np.random.default_rng(5)
    for _ in range(6):
        spoilt = bytearray(whole[: int(random.integers(len(whole) // 2, len(whole)))])
        for at in random.integers(0, len(spoilt), 60):
            spoilt[at] = random.integers(256)
        begin = int(random.integers(len(spoilt)))
        del spoilt[begin : begin + 3000]
        log.write_bytes(spoilt)
        code = call(["compare", str(log), "--limit", "tracking_max_m=3"])
        said = capsys.readouterr().err.splitlines()
        assert code in (2, 6) or not said
        assert len(said) <= 1


def test_the_page_of_any_flight_shows_told_and_done_and_health(tmp_path: Path) -> None:
    log = write_bin(tmp_path / "x.bin", made(off_m=5.0))
    assert call(["report", str(log)]) == 0
    page = (tmp_path / "x.html").read_text()
    for title in ("Against what it was told", "Told and done", "Health", "Time line", "Height"):
        assert f">{title}</h" in page, title
    for title in ("Position east", "Roll", "Vibration", "Satellites", "Motors"):
        assert f">{title}</h3>" in page, title
    assert {"Position east", "Roll", "Motors"} <= {*charts(page)}
    assert "<td>off setpoint max (m)</td>" in page
    assert "not in the log: a mission" in page
    assert "GUIDED" in page


def test_no_line_is_drawn_where_nothing_was_told() -> None:
    t_s = np.concatenate((np.arange(0.0, 10.0, 0.1), np.arange(30.0, 90.0, 0.1)))
    x, y = envelope(t_s, np.sin(t_s))
    inside = (x > 9.0) & (x < 31.0)
    (last,) = np.flatnonzero(np.isnan(y) & inside)
    assert x[last] == pytest.approx(9.9)
    assert x[last + 1] == pytest.approx(30.0, abs=0.3)
    assert np.nanmax(y) == pytest.approx(np.sin(t_s).max())  # no peak is lost
    assert len(x) < 1000
    assert [len(each) for each in envelope(t_s[:0], t_s[:0])] == [0, 0]


def test_the_time_line_has_health_beside_the_errors(tmp_path: Path) -> None:
    """By an axis of its own: what is no share, as one of the most in the flight; dropouts told."""
    flight = replace(made(off_m=2.0), vibration=np.linspace(1.0, 4.0, 1200))
    log = write_ulg(tmp_path / "x.ulg", flight, dropout_ms=700)
    (of_errors, of_health) = timeline_chart(compared(log), alone=True)["layer"]
    assert of_health["encoding"]["y"]["title"] == "share"
    chart = timeline_chart(compared(log), alone=True)
    assert chart["resolve"]["scale"]["y"] == "independent"
    rows = chart["datasets"][of_health["data"]["name"]]
    shares = {row["series"]: row for row in rows}
    assert set(shares) == {"vibration, of 4.0 m/s2", "satellites, of 12"}
    assert max(row["y"] for row in rows if row["y"] is not None) == pytest.approx(1.0)
    words = str([chart["datasets"][layer["data"]["name"]] for layer in of_errors["layer"]])
    assert "log dropout of 0.70 s" in words


def test_an_accuracy_that_no_receiver_knows_is_none(tmp_path: Path) -> None:
    """PX4 writes 2**32 - 1 mm without a fix."""
    rows = [(float(second), 4294967.5 if second < 30 else 2.0) for second in range(60)]
    log = write_ulog(tmp_path / "a.ulg", instead={"sensor_gps": ("float eph", "f", rows)})
    assert compare_run(load_run(log)).total.gnss_accuracy_max_m == 2.0
