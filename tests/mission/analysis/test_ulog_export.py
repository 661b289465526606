"""Our logs as ULog: read back by pyulog, and compared as before."""

import io
import math
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
import pytest
from flights import corner_distance, cross_track
from pyulog import ULog
from pyulog.px4 import PX4ULog
from synthetic_flight import AREA, fly
from test_flights import flown, plain

from flightdyn.state import BatteryState, Kinematics
from mission.analysis.compare import RunComparison, compare_run
from mission.analysis.load import load_run
from mission.base.errors import InputError
from mission.cli import call
from mission.flight.logs.ulog import KIND, MODES
from mission.flight.logs.ulog_export import export_ulog
from mission.log.reader import read_log
from mission.log.values import Devices
from mission.log.writer import FlightLog
from sitl.observer import VehicleEvent, VehicleSample


def topics_of(path: Path) -> dict[str, dict[str, Any]]:
    return {item.name: item.data for item in ULog(str(path)).data_list}


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a mission that was uploaded to `aerofed sitl`."""
    return flown(tmp_path_factory.mktemp("alone"), plain())


@pytest.fixture(scope="module")
def exported(alone: Path) -> Path:
    return export_ulog(alone, alone.with_suffix(".ulg"))


def test_pyulog_reads_what_was_logged(alone: Path, exported: Path) -> None:
    data, found = read_log(alone), topics_of(exported)
    for name, track in (("", data.belief), ("_groundtruth", data.truth)):
        local, globe = (found[f"vehicle_{kind}_position{name}"] for kind in ("local", "global"))
        ned = data.area.to_ned(track.pos_m[:, :2], track.pos_m[:, 2])
        np.testing.assert_array_equal(local["timestamp"], track.t_ns // 1000)
        for axis, values in zip("xyz", ned.T, strict=True):
            np.testing.assert_array_equal(local[axis], values.astype(np.float32))
        at = [data.area.frame.to_geodetic(row) for row in ned]
        np.testing.assert_array_equal(globe["lat"], [p.lat_deg for p in at])
        np.testing.assert_array_equal(globe["lon"], [p.lon_deg for p in at])
        np.testing.assert_allclose(globe["alt"] - data.area.home.alt_msl_m, -ned[:, 2], atol=1e-4)
    battery = found["battery_status"]
    np.testing.assert_array_equal(battery["timestamp"], data.battery.t_ns // 1000)
    for name, values in (
        ("voltage_v", data.battery.voltage_v),
        ("current_a", data.battery.current_a),
        ("discharged_mah", data.battery.consumed_mah),
        ("remaining", data.battery.remaining),
    ):
        np.testing.assert_array_equal(battery[name], values.astype(np.float32))
    fixes = found["vehicle_gps_position"]
    np.testing.assert_array_equal(fixes["timestamp"], data.gnss_ns // 1000)
    assert (fixes["timestamp_sample"] <= fixes["timestamp"]).all()
    status = found["vehicle_status"]
    first = np.searchsorted(status["timestamp"], data.modes.t_ns // 1000)
    assert [MODES[state] for state in status["nav_state"][first]] == list(data.modes.names)
    said = [(e.t_ns // 1000, e.text) for e in data.events if e.kind == "status"]
    assert [(m.timestamp, m.message) for m in ULog(str(exported)).logged_messages] == said


def test_items_are_reached_and_headed_for(alone: Path, exported: Path) -> None:
    data, found = read_log(alone), topics_of(exported)
    result, setpoint = found["mission_result"], found["position_setpoint_triplet"]
    reached = [(e.t_ns // 1000, e.seq) for e in data.events if e.kind == "reached"]
    told = list(zip(result["timestamp"].tolist(), result["seq_reached"].tolist(), strict=True))
    assert [row for row in told if row[1] >= 0] == reached
    assert set(result["seq_total"]) == {len(plain())}
    assert result["seq_current"].tolist()[:3] == [0, 1, 2]
    assert setpoint["current.type"].tolist() == [3, 0, 0, 0, 0]
    assert setpoint["current.valid"].all()
    assert result["valid"].all()
    assert setpoint["current.lat"][1] == pytest.approx(plain()[1].x / 1e7, abs=1e-9)
    np.testing.assert_allclose(setpoint["current.alt"], data.area.home.alt_msl_m + 30.0, atol=1e-4)


def test_attitude_and_speed_are_those_of_the_flight(tmp_path: Path) -> None:
    made = fly(tmp_path, rounds=1)
    log = ULog(str(export_ulog(made.log, tmp_path / "x.ulg")))
    PX4ULog(log).add_roll_pitch_yaw()
    found = {item.name: item.data for item in log.data_list}
    for name, states in (
        ("", [sample.belief for sample in made.samples]),
        ("_groundtruth", [sample.truth for sample in made.samples]),
    ):
        attitude, local = found[f"vehicle_attitude{name}"], found[f"vehicle_local_position{name}"]
        q = np.column_stack([attitude[f"q[{axis}]"] for axis in range(4)])
        cosine = np.abs((q * np.array([state.q_frd_to_ned for state in states])).sum(axis=1))
        assert cosine.min() > 1 - 1e-7
        np.testing.assert_allclose(np.cos(attitude["yaw"] - local["heading"]), 1.0, atol=1e-6)
        written = np.arange(0, len(states), 5)  # twice a second
        for axis, field in enumerate(("vx", "vy", "vz")):
            speeds = np.array([state.vel_ned_mps[axis] for state in states])
            np.testing.assert_allclose(local[field][written], speeds[written], atol=1e-3)


def test_flight_review_takes_its_positions_for_degrees_and_metres(exported: Path) -> None:
    assert ULog(str(exported)).msg_info_dict["ver_data_format"] >= 2


def test_pyulog_writes_the_same_again(exported: Path) -> None:
    first, copy = ULog(str(exported)), io.BytesIO()
    first.write_ulog(copy)
    again = ULog(io.BytesIO(copy.getvalue()))
    assert again == first
    assert not first.file_corruption


def test_compare_says_the_same_of_both(tmp_path: Path, alone: Path, exported: Path) -> None:
    plan = tmp_path / "p.waypoints"
    rows = [
        (i.seq, 0, 3 if i.x else 2, i.command, 0, 0, 0, 0, i.x / 1e7, i.y / 1e7, i.z, 1)
        for i in plain()
    ]
    plan.write_text("\n".join(["QGC WPL 110", *("\t".join(map(str, row)) for row in rows)]) + "\n")
    ours, theirs = (numbers(compare_run(load_run(log, plan))) for log in (alone, exported))
    assert theirs == pytest.approx(ours, abs=0.01, nan_ok=True)


def test_a_return_has_no_errors_in_either(tmp_path: Path) -> None:
    """It climbs first, which is no error of the last leg."""
    items = plain()
    for item in items[:5]:
        item.z = 12.0
    log = flown(tmp_path, items)
    ours, theirs = (
        compare_run(load_run(path)) for path in (log, export_ulog(log, log.with_suffix(".ulg")))
    )
    same(ours, theirs)
    assert ours.total.height_max_m < 0.01


def test_all_that_is_compared_is_said_by_both(
    alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Legs, items and every number, also of missions that take several messages."""
    monkeypatch.setattr("mission.flight.logs.ulog_file._MOST_TEXT", 100)
    log = export_ulog(alone, tmp_path / "x.ulg")
    assert load_run(log).data.missions == load_run(alone).data.missions
    same(compare_run(load_run(alone)), compare_run(load_run(log)))


def same(ours: RunComparison, theirs: RunComparison) -> None:
    pairs: list[tuple[Any, Any]] = [(ours.total, theirs.total)]
    for one, other in [*pairs, *zip(ours.legs, theirs.legs, strict=True)]:
        expected, found = asdict(one), asdict(other)
        for name in ("wind_mean_mps", "wind_max_mps"):  # no wind is none that is known
            expected.pop(name, None), found.pop(name, None)
        assert found == pytest.approx(expected, abs=1e-3, nan_ok=True)


def numbers(found: RunComparison) -> list[float]:
    """What a comparison of either log has to say alike, to a centimetre and 20 ms."""
    assert found.run.judged is not None
    names = (
        *("cross_track_rms_m", "cross_track_max_m", "corner_cut_max_m", "height_rms_m"),
        *("height_max_m", "slot_miss_rms_m", "estimate_rms_m", "flown_path_m", "failsafes"),
    )
    passed_s = [p.t_s / 2 for way in found.run.judged.passes for p in way.passages]
    return [*(getattr(found.total, name) for name in names), *passed_s]


def test_a_run_and_a_log_without_rounds_export_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = fly(tmp_path, rounds=2)
    assert call(["log", "export", str(made.log), "--to", "ulog"]) == 0
    target = made.log.with_suffix(".ulg")
    assert capsys.readouterr().out.splitlines() == [str(target)]
    assert len(topics_of(target)["vehicle_attitude"]["timestamp"]) == len(made.samples)
    assert call(["log", "export", str(made.log), "--to", "ulog"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(r"flight\.ulg: exists already", line)


def test_each_failsafe_is_a_pulse_and_unknown_modes_have_a_number(tmp_path: Path) -> None:
    path, still = tmp_path / "x.mcap", np.zeros(3)
    state = Kinematics(0, still, still, np.array([1.0, 0.0, 0.0, 0.0]), still)
    battery = BatteryState(22.0, 1.0, 0.0, 1.0)
    with FlightLog(path, area=AREA, devices=Devices(np.zeros((0, 2)), ())) as log:
        for t_s in range(6):
            mode = "MISSION" if t_s < 3 else "GUIDED"
            log.sampled(VehicleSample(t_s * 10**9, state, state, None, battery, mode, armed=True))
            if t_s in (2, 4):
                log.happened(VehicleEvent(t_s * 10**9 + 500, "failsafe", "low", state, state))
    target = export_ulog(path, tmp_path / "x.ulg")
    status = topics_of(target)["vehicle_status"]
    assert status["timestamp"].tolist() == [0, 1000000, 2000000, 2000001, 3000000, 4000000, 4000001]
    assert status["failsafe"].tolist() == [0, 0, 1, 0, 0, 1, 0]
    assert status["nav_state"].tolist() == [3, 3, 3, 3, 255, 255, 255]
    found = load_run(target).data
    assert [e.kind for e in found.events].count("failsafe") == 2
    assert found.modes.names == ("MISSION", "MODE 255")


def test_a_flight_of_a_plan_is_compared_with_it_as_before_and_by_other_programs(
    tmp_path: Path,
) -> None:
    plan, out = tmp_path / "p.waypoints", tmp_path / "out"
    rows = [(22, 0.0, 0.0), (16, 0.0, 5e-4), (16, 5e-4, 5e-4)]
    lines = [
        f"{seq}\t0\t3\t{command}\t0\t0\t0\t0\t{47 + north}\t{8 + east}\t20\t1"
        for seq, (command, north, east) in enumerate(rows)
    ]
    plan.write_text("\n".join(["QGC WPL 110", *lines]) + "\n")
    quiet = ["--no-report", "--no-figures", "--quiet", "--out", str(out)]
    assert call(["fly", str(plan), *quiet]) == 0
    target = export_ulog(out / "flight.mcap", out / "flight.ulg")
    ours, given, alone = (
        compare_run(load_run(*path))
        for path in ((out / "flight.mcap", plan), (target, plan), (target,))
    )
    assert numbers(given) == pytest.approx(numbers(ours), abs=0.01, nan_ok=True)
    assert alone.total.slots == len(rows)  # what was headed for is in the log
    # By the positions that pyulog reads, in metres north and east, to the way's two legs.
    assert ours.run.judged is not None
    (flown,) = ours.run.judged.passes
    begin_s, end_s = flown.record.start_t_s, flown.record.start_t_s + flown.record.duration_s
    truth = topics_of(target)["vehicle_global_position_groundtruth"]
    within = (truth["timestamp"] >= begin_s * 1e6) & (truth["timestamp"] <= end_s * 1e6)
    globe = [truth[name][within] for name in ("lat", "lon", "alt")]
    track = np.column_stack(pymap3d.geodetic2ned(*globe, 47.0, 8.0, truth["alt"][0]))
    corners = np.array([pymap3d.geodetic2ned(47 + n, 8 + e, 0, 47, 8, 0) for _, n, e in rows])
    away_m = cross_track(corners, track)
    way_m, flown_m = (
        float(np.hypot(*np.diff(line[:, :2], axis=0).T).sum()) for line in (corners, track)
    )
    total = ours.total
    assert (total.slots, total.slots_missed, total.failsafes) == (3, 0, 0)
    assert total.plan_path_m == pytest.approx(way_m, rel=1e-4)
    assert total.flown_path_m == pytest.approx(flown_m, abs=0.1)
    # On the way round a corner a sample may count for the leg that is not the nearest.
    assert total.cross_track_max_m == pytest.approx(float(away_m.max()), abs=0.15)
    assert total.cross_track_rms_m == pytest.approx(math.sqrt((away_m**2).mean()), abs=0.05)
    cut_m = float(corner_distance(corners, track).min())
    assert total.corner_cut_max_m == pytest.approx(cut_m, abs=0.01)


def test_a_log_that_ends_within_a_message_is_said_to(tmp_path: Path, exported: Path) -> None:
    cut = tmp_path / "cut.ulg"
    whole = exported.read_bytes()
    cut.write_bytes(whole[: len(whole) * 2 // 3 + 1])
    assert KIND.flight(exported).source.skipped == {}
    assert KIND.flight(cut).source.skipped == {"message that the end cut off": 1}


def test_a_log_without_a_flight_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "empty.mcap"
    with FlightLog(path, area=AREA, devices=Devices(np.zeros((0, 2)), ())):
        pass
    with pytest.raises(InputError, match=r"^[^\n]*the log has no positions[^\n]*$"):
        export_ulog(path, tmp_path / "x.ulg")
    text = tmp_path / "text.mcap"
    text.write_text("no log")
    with pytest.raises(InputError, match="not an MCAP file"):
        export_ulog(text, tmp_path / "x.ulg")
    assert not (tmp_path / "x.ulg").exists()
