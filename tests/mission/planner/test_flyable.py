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
from mission.planner.flyable import Stop, acceptance_radius, cut_behind, stops_of
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


def test_waypoints_within_half_a_metre_of_the_first_are_one_stop():
    way = np.array([[0, 0], [0.5, 0], [0.9, 0], [100, 0], [100.3, 0.4], [100.7, 0.0], [100.7, 50]])
    schedule = np.zeros((7, 3), dtype=bool)
    schedule[(3, 4, 6), (0, 1, 2)] = True
    plan = one_path(way, schedule, 1.0)
    stops = stops_of(plan)
    assert [stop.steps for stop in stops] == [(0, 1), (2,), (3, 4), (5,), (6,)]
    assert [stop.xy_m.tolist() for stop in stops] == way[[0, 2, 3, 5, 6]].tolist()
    assert [stop.hold_s for stop in stops] == [0.0] * 5
    assert stops[2].slots_s == (0.0, 0.0)
    held = stops_of(plan, hold_s=2.0)  # at every stop but the first, shared by its steps
    assert [stop.hold_s for stop in held] == [0.0, 2.0, 2.0, 2.0, 2.0]
    assert [stop.slots_s for stop in held] == [(0.0, 0.0), (0.0,), (0.0, 1.0), (0.0,), (0.0,)]
    sent = stops_of(plan, upload_s=np.array([1.5, 0.25, 4.0]))
    assert [stop.hold_s for stop in sent] == [0.0, 0.0, 1.75, 0.0, 4.0]
    assert sent[2].slots_s == (0.0, 1.5)
    both = stops_of(plan, hold_s=4.0, upload_s=np.array([1.5, 0.25, 4.5]))
    assert [stop.hold_s for stop in both] == [0.0, 4.0, 4.0, 4.0, 4.5]
    assert both[2].slots_s == (0.0, 2.0)
    (only,) = stops_of(one_path(np.zeros((4, 2)), np.zeros((4, 1), dtype=bool), 0.0), hold_s=2.0)
    assert (only.hold_s, only.slots_s) == (2.0, (0.0, 0.5, 1.0, 1.5))


def test_a_flight_is_cut_behind_each_stop_that_serves():
    at = [Stop(np.array([float(n), 0.0]), (n,), hold_s=float(n)) for n in range(5)]

    def parts(*serves: int) -> list[list[tuple[float, float]]]:
        cut = cut_behind(at, np.isin(np.arange(5), serves))
        return [[(float(stop.xy_m[0]), stop.hold_s) for stop in part] for part in cut]

    # Where a part ends the next begins, without a hover.
    whole = [(float(n), float(n)) for n in range(5)]
    assert parts() == parts(4) == [whole]
    assert parts(2) == [whole[:3], [(2.0, 0.0), *whole[3:]]]
    assert parts(0, 3) == [whole[:1], [(0.0, 0.0), *whole[1:4]], [(3.0, 0.0), whole[4]]]
