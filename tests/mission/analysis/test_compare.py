"""Planned against flown, on flights whose errors are known by construction."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from one_aircraft import one_path, round_problem
from rich.console import Console
from synthetic_flight import AREA, CHANNEL, fly

from flightdyn.state import BatteryState, Kinematics
from mission.analysis.compare import RunComparison, compare_run, names_of
from mission.analysis.comparison_text import in_full, side_by_side, tables
from mission.analysis.load import load_run
from mission.base.errors import InputError
from mission.cli import call
from mission.log.records import UNKNOWN_ROUND, RoundRecord, UplinkRecord
from mission.log.values import Devices
from mission.log.writer import FlightLog
from sitl.observer import VehicleSample

SPEED = 20.0
WORLD = Devices(np.array([[300.0, 100.0], [300.0, 500.0]]), ("a", "b"))
START_S = 10.0


def right_angle(
    path: Path,
    *,
    offset_m: float = 0.0,
    bias_m: float = 0.0,
    sink_m: float = 0.0,
    late_s: float = 0.0,
) -> RunComparison:
    """100,100 -> 300,100 -> 300,500 at 20 m/s, `offset_m` to the right of the second leg."""
    waypoints = np.array([[100.0, 100.0], [300.0, 100.0], [300.0, 500.0]])
    schedule = np.array([[False, False], [True, False], [False, True]])
    importance = np.array([0.5, 0.25])
    problem = round_problem(WORLD.pos_m, importance, waypoints[0], 3, 1, 800.0, CHANNEL)
    at = np.concatenate((np.arange(0.0, 200.0, 2.0), np.arange(200.0, 601.0, 2.0)))
    corner = 200.0 + offset_m
    xy = np.where(
        at[:, None] <= corner,
        np.column_stack((100.0 + np.minimum(at, corner), np.full(len(at), 100.0))),
        np.column_stack((np.full(len(at), 300.0 + offset_m), 100.0 + at - 200.0)),
    )
    with FlightLog(path, area=AREA, devices=WORLD) as log:
        log.plan(round(START_S * 1e9), 0, problem, one_path(waypoints, schedule, 0.7, 0.8),
                 speed_mps=SPEED)  # fmt: skip
        for s, (x, y) in zip(at, xy, strict=True):
            t_ns = round((START_S + s / SPEED) * 1e9)
            north, east = y - AREA.home_m[1], x - AREA.home_m[0]
            globe_m = (north**2 + east**2) / (2 * 6.371e6)  # so far below the plane
            truth = np.array([north, east, globe_m - (60.0 - sink_m)])
            log.sampled(vehicle(t_ns, truth, truth + np.array([bias_m, 0.0, 0.0])))
        log.uplinks(
            [
                uplink(0, 1, START_S + 10.0 + late_s, (300, 100), (300 + offset_m, 100), 0.125),
                uplink(1, 2, START_S + 30.0 + late_s, (300, 500), (300 + offset_m, 500), 0.5),
            ]
        )
        log.round(record())
    return compare_run(load_run(path))


def vehicle(t_ns: int, true_ned: np.ndarray, est_ned: np.ndarray) -> VehicleSample:
    truth, belief = (
        Kinematics(t_ns, at, np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3))
        for at in (true_ned, est_ned)
    )
    battery = BatteryState(22.0, 30.0, 100.0, 0.9)
    return VehicleSample(t_ns, truth, belief, None, battery, "mission", armed=True)


def uplink(device: int, step: int, slot_s: float, plan, true, true_per: float) -> UplinkRecord:
    return UplinkRecord(
        0, device, WORLD.community[device], step, slot_s, plan[0], plan[1],
        true[0], true[1], 60.0, true[0], true[1], 60.0,
        0.1, 0.11, true_per, 0.5, delivered=device == 0,
    )  # fmt: skip


def record(**changes: Any) -> RoundRecord:
    values = dataclasses.replace(
        UNKNOWN_ROUND, start_t_s=START_S, duration_s=30.0, plan_objective=0.7, est_objective=0.65,
        true_objective=0.6, upper_bound=0.8, plan_path_m=600.0, flown_path_m=601.0,
        budget_used_m=601.0, scheduled=2, delivered=1, battery_remaining=0.9,
        accuracy={"a": 0.5, "b": 0.4}, cov={"a": 1.0, "b": 1.0},
    )  # fmt: skip
    return dataclasses.replace(values, **changes)


def test_a_perfect_flight_has_no_error(tmp_path: Path) -> None:
    total = right_angle(tmp_path / "a.mcap").total
    for name in ("cross_track_max_m", "straight_max_m", "corner_cut_max_m", "height_max_m",
                 "slot_miss_max_m", "estimate_max_m"):  # fmt: skip
        assert getattr(total, name) == pytest.approx(0.0, abs=2e-3), name
    assert total.slot_late_max_s == pytest.approx(0.0, abs=1e-9)


def test_every_number_of_a_flight_with_known_errors(tmp_path: Path) -> None:
    result = right_angle(tmp_path / "a.mcap", offset_m=4.0, bias_m=0.5, sink_m=1.5, late_s=0.25)
    c = result.total
    assert c.straight_max_m == pytest.approx(4.0, abs=1e-3)
    # Of the straights, [0, 175) of the first leg is exact and (225, 600] of the second 4 m off.
    share = 375 / (375 + 175)
    assert c.straight_rms_m == pytest.approx(4.0 * math.sqrt(share), rel=0.01)
    assert c.cross_track_max_m == pytest.approx(4.0, abs=1e-3)
    assert c.corner_cut_max_m == pytest.approx(0.0, abs=1e-3)  # it overshot: passed the corner
    assert c.height_rms_m == pytest.approx(1.5, abs=1e-3)
    assert c.estimate_rms_m == pytest.approx(0.5, abs=1e-3)
    assert c.slot_miss_rms_m == pytest.approx(4.0)
    # At the corner the path heads north-east: 4 m east is 4/sqrt 2 along; at the end it heads
    # north: nothing along.
    assert c.slot_along_max_m == pytest.approx(4.0 / math.sqrt(2))
    assert c.slot_along_rms_m == pytest.approx(4.0 / math.sqrt(2) / math.sqrt(2))
    assert c.slot_late_mean_s == pytest.approx(0.25)
    assert (c.slots, c.slots_missed, c.scheduled, c.delivered) == (2, 0, 2, 1)
    assert c.plan_per_mean == pytest.approx(0.1)
    assert c.est_per_mean == pytest.approx(0.11)
    assert c.true_per_mean == pytest.approx(0.3125)
    assert c.per_shift_max == pytest.approx(0.4)
    assert c.expected == pytest.approx(1.375)
    assert (c.plan_objective, c.est_objective, c.true_objective) == (0.7, 0.65, 0.6)
    assert [(d.scheduled, d.delivered, d.true_per) for d in result.devices] == [
        (1, 1, 0.125),
        (1, 0, 0.5),
    ]


def test_cutting_a_corner_counts_there_and_not_on_the_straights(tmp_path: Path) -> None:
    waypoints = np.array([[0.0, 0.0], [200.0, 0.0], [200.0, 200.0]])
    cut = np.array([[190.0, 0.0], [200.0, 10.0]])  # a chord: 10 / sqrt 2 from the corner
    track = np.vstack(
        (
            np.column_stack((np.arange(0.0, 190.0, 2.0), np.zeros(95))),
            np.linspace(cut[0], cut[1], 9),
            np.column_stack((np.full(95, 200.0), np.arange(12.0, 202.0, 2.0))),
        )
    )
    problem = round_problem(WORLD.pos_m, np.ones(2), waypoints[0], 3, 1, 800.0, CHANNEL)
    plan = one_path(waypoints, np.zeros((3, 2), dtype=bool), 0.0)
    with FlightLog(tmp_path / "a.mcap", area=AREA, devices=WORLD) as log:
        log.plan(0, 0, problem, plan, speed_mps=SPEED)
        for index, (x, y) in enumerate(track):
            ned = np.array([y - AREA.home_m[1], x - AREA.home_m[0], -60.0])
            log.sampled(vehicle(index * 100_000_000, ned, ned))
        log.round(record(start_t_s=0.0, duration_s=(len(track) - 1) / 10, scheduled=0, delivered=0))
    total = compare_run(load_run(tmp_path / "a.mcap")).total
    assert total.corner_cut_max_m == pytest.approx(10 / math.sqrt(2), abs=1e-3)
    assert total.straight_max_m == pytest.approx(0.0, abs=1e-3)
    assert total.cross_track_max_m == pytest.approx(5.0, abs=1e-3)
    assert math.isnan(total.slot_late_mean_s)


def test_folder_and_bare_log_agree_and_json_is_plain(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = fly(tmp_path, rounds=2)
    assert call(["compare", "--json", str(tmp_path), str(made.log)]) == 0
    folder, bare = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert (folder["rounds"], folder["total"]) == (bare["rounds"], bare["total"])
    assert folder["total"]["scheduled"] == len(made.uplinks)


def test_the_total_pools_samples_and_slots(tmp_path: Path) -> None:
    fly(tmp_path, rounds=3)
    result = compare_run(load_run(tmp_path))
    assert result.total.duration_s == pytest.approx(sum(r.duration_s for r in result.rounds))
    assert result.total.cross_track_max_m == max(r.cross_track_max_m for r in result.rounds)
    assert result.total.slot_late_mean_s == pytest.approx(
        np.average(
            [r.slot_late_mean_s for r in result.rounds], weights=[r.slots for r in result.rounds]
        )
    )


def test_tables_fit_eighty_columns(tmp_path: Path) -> None:
    fly(tmp_path, rounds=2)
    result = compare_run(load_run(tmp_path))
    console = Console(width=80, record=True, force_terminal=False)
    with console.capture() as captured:
        for table in tables(result):
            console.print(table)
        for table in side_by_side([result, result], width=80):
            console.print(table)
    text = captured.get()
    assert "…" not in text
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 80
    assert f"{result.total.cross_track_rms_m:.2f} / {result.total.cross_track_max_m:.2f}" in text
    assert "+0.000" in text


@pytest.mark.slow
@pytest.mark.parametrize("width", [80, 200])
@pytest.mark.parametrize("runs", [3, 6, 12])
def test_no_number_wraps_however_many_runs(tmp_path: Path, runs: int, width: int) -> None:
    fly(tmp_path, rounds=1)
    result = compare_run(load_run(tmp_path))
    many = [
        dataclasses.replace(
            result,
            run=dataclasses.replace(
                result.run, path=Path(f"runs-cov-learning_rate=0.1-seed{seed}")
            ),
            total=dataclasses.replace(result.total, flown_path_m=10_000.5 + seed),
        )
        for seed in range(runs)
    ]
    console = Console(width=width, force_terminal=False)
    found = side_by_side(many, width=width)
    with console.capture() as captured:
        for table in found:
            console.print(table)
    lines = captured.get().splitlines()
    assert max(len(line.rstrip()) for line in lines) <= width
    flown = [line.split()[3:] for line in lines if line.strip().startswith("flown path (m)")]
    assert [cell for row in flown for cell in row] == [f"{10_000.5 + s:.1f}" for s in range(runs)]
    assert "…" not in captured.get()
    assert "difference" not in captured.get()  # of two tables' columns there is none
    assert len(found) == math.ceil(runs / ((width - 28) // 13))


def test_runs_of_one_name_are_told_apart_by_the_folders_above(tmp_path: Path) -> None:
    fly(tmp_path, rounds=1)
    loaded = load_run(tmp_path)
    paths = ("a/x/long", "b/x/long", "b/y/short", "b/y/short")
    many = [compare_run(dataclasses.replace(loaded, path=Path(path))) for path in paths]
    assert names_of(many) == ["a/x/long", "b/x/long", "short", "short"]


def test_runs_side_by_side_say_in_which_settings_they_differ(tmp_path: Path) -> None:
    fly(tmp_path, rounds=1)
    loaded = load_run(tmp_path)
    pair = []
    for steps, extra_m in ((8, 0.0), (16, -1e-4)):
        own = f'strategy = "examples.weights:of_{steps}"'
        config = f"seed = 1\n[mission]\nsteps = {steps}\n{own}\n".encode()
        data = dataclasses.replace(loaded.data, attachments={"config.toml": config})
        path = Path(f"runs/quickstart-cov-seed1-{steps}")
        one = compare_run(dataclasses.replace(loaded, path=path, data=data))
        total = dataclasses.replace(one.total, flown_path_m=100.0 + extra_m)
        pair.append(dataclasses.replace(one, total=total))
    console = Console(width=80, force_terminal=False)
    with console.capture() as captured:
        for part in in_full(pair, width=80):
            console.print(part)
    printed = captured.get()
    assert printed.splitlines()[-2] == "mission.steps: 8 / 16"
    assert "'examples.weights:of_8' / 'examples.weights:of_16'" in " ".join(printed.split())
    assert "cov-seed1-8   cov-seed1-16" in printed  # broken at a hyphen, not within a word
    assert "-0.0 " not in printed
    bare = dataclasses.replace(loaded, data=dataclasses.replace(loaded.data, attachments={}))
    others = [compare_run(bare), pair[0]]  # a log of somebody else's has no settings
    assert [part for part in in_full(others, width=80) if isinstance(part, str)] == []


def test_two_runs_stay_together_on_a_narrow_terminal(tmp_path: Path) -> None:
    fly(tmp_path, rounds=1)
    result = compare_run(dataclasses.replace(load_run(tmp_path), path=Path("runs-cov-seed1")))
    console = Console(width=50, force_terminal=False)
    (table,) = side_by_side([result, result], width=50)
    with console.capture() as captured:
        console.print(table)
    path = f"{result.total.plan_path_m:.1f}"
    assert [path, path, "+0.0"] in [line.split()[-3:] for line in captured.get().splitlines()]
    assert "difference" in captured.get()


def test_what_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such run folder or log file"):
        compare_run(load_run(tmp_path / "gone"))
    with pytest.raises(InputError, match=r"it has no flight\.mcap"):
        compare_run(load_run(tmp_path))
    with FlightLog(tmp_path / "e.mcap", area=AREA, devices=WORLD):
        pass
    with pytest.raises(InputError, match="no round was flown"):
        compare_run(load_run(tmp_path / "e.mcap"))
