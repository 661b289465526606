"""Corners as sharp as the plan needs them, and what a flight then brings."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from one_aircraft import one_path, round_problem
from small_runs import QUIET, rows

from fl.radio.channel import CHANNEL_PRESETS
from mission.cli import call
from mission.planner.certified import CertifiedPlanner
from mission.planner.flyable import acceptance_radius
from mission.planner.problem import RoundProblem


def problem(preset: str) -> RoundProblem:
    rng = np.random.default_rng(3)
    return round_problem(
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
    plan = one_path(np.zeros((10, 2)), np.zeros((10, 12), dtype=bool), 0.0)
    assert acceptance_radius(nothing, plan, 5.0) == 5.0


@pytest.mark.slow
def test_with_perfect_sensors_in_calm_air_one_percent_is_lost_at_most(tmp_path: Path):
    # With 5 m of acceptance this loses 2 %.
    settings = (
        "channel.preset=high-rise", "vehicle.aircraft.sensors.kind=perfect",
        "learning.local_epochs=1", "communities.0.subset=0.2", "communities.1.subset=0.2",
    )  # fmt: skip
    out = tmp_path / "run"
    assert call(["run", "--out", str(out), "--rounds", "2", *QUIET, "--set", *settings]) == 0
    rounds = rows(out / "rounds.csv")
    lost = [1.0 - float(row["true_objective"]) / float(row["plan_objective"]) for row in rounds]
    assert np.mean(lost) < 0.01
