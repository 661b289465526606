"""Corners as sharp as the plan needs them, and what a flight then brings."""

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from small_runs import QUIET

from fl.radio.channel import CHANNEL_PRESETS
from mission.cli import call
from mission.planner.certified import CertifiedPlanner
from mission.planner.flyable import acceptance_radius, cut_corners
from mission.planner.problem import RoundPlan, RoundProblem


def test_a_right_angle_is_cut_along_its_bisector():
    way = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 0.0], [100.0, 100.0]])
    cut = cut_corners(way, 4.0)
    inside = [100.0 - 4.0 / math.sqrt(2.0), 4.0 / math.sqrt(2.0)]
    assert cut == pytest.approx(np.array([[0.0, 0.0], inside, inside, [100.0, 100.0]]))


def test_short_legs_leave_no_room_for_a_deep_cut():
    way = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 8.0]])
    # Half of the shorter leg is 4 m; the parabola touches both legs there.
    depth = np.hypot(*(cut_corners(way, 50.0)[1] - way[1]))
    assert depth == pytest.approx(4.0 * math.sin(math.pi / 4.0) / 2.0)


@pytest.mark.parametrize("points", [[[3.0, 4.0]], [[3.0, 4.0]] * 5, [[0.0, 0.0], [9.0, 0.0]]])
def test_a_path_without_corners_stays(points):
    assert cut_corners(np.array(points), 5.0).tolist() == points


def test_a_path_that_comes_back_in_small_steps_has_no_corner_there():
    way = np.array([[0.0, 0.0], [0.4, 0.0], [0.8, 0.0], [0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    cut = cut_corners(way, 1.0)
    assert cut[:4].tolist() == [[0.0, 0.0]] * 4
    assert np.hypot(*(cut[4] - way[4])) == pytest.approx(1.0)


def problem(preset: str) -> RoundProblem:
    rng = np.random.default_rng(3)
    return RoundProblem(
        devices_m=rng.uniform(0, 800, (12, 2)),
        importance=rng.uniform(0.5, 1.5, 12),
        start_m=np.full(2, 400.0),
        steps=10,
        per_step=3,
        path_budget_m=800.0,
        channel=CHANNEL_PRESETS[preset],
    )


def test_only_a_channel_that_falls_off_at_once_needs_sharp_corners():
    sharp, gentle = problem("high-rise"), problem("suburban+30dB")
    assert acceptance_radius(gentle, CertifiedPlanner().plan(gentle), 5.0) == 5.0
    plan = CertifiedPlanner().plan(sharp)
    assert 1.0 <= acceptance_radius(sharp, plan, 5.0) < 5.0
    assert acceptance_radius(sharp, plan, 0.5) == 0.5


def test_a_plan_worth_nothing_is_flown_as_wide_as_allowed():
    nothing = dataclasses.replace(problem("suburban"), importance=np.zeros(12))
    plan = RoundPlan(np.zeros((10, 2)), np.zeros((10, 12), dtype=bool), 0.0)
    assert acceptance_radius(nothing, plan, 5.0) == 5.0


@pytest.mark.slow
def test_with_perfect_sensors_in_calm_air_one_percent_is_lost_at_most(tmp_path: Path):
    # With 5 m of acceptance this loses 2 %.
    settings = (
        "channel.preset=high-rise", "vehicle.aircraft.sensors.kind=perfect",
        "learning.local_epochs=1",
    )  # fmt: skip
    given = [word for setting in settings for word in ("--set", setting)]
    out = tmp_path / "run"
    assert call(["run", "--out", str(out), "--rounds", "2", *QUIET, *given]) == 0
    with (out / "rounds.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    lost = [1.0 - float(row["true_objective"]) / float(row["plan_objective"]) for row in rows]
    assert np.mean(lost) < 0.01
