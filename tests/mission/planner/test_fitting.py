"""Plans made to fit limits: cut where these end, drawn together, at the best altitude."""

import numpy as np
import pytest

from fl.radio.channel import CHANNEL_PRESETS
from flightdyn.config import LimitsConfig
from mission.base import polyline
from mission.base.airspace import OPEN, Airspace
from mission.planner.check import check_plan
from mission.planner.evaluate import plan_along
from mission.planner.fitting import (
    at_best_altitude,
    drawn_together,
    fitted,
    made,
    share,
)
from mission.planner.performance import Performance, RoundLimits
from mission.planner.problem import RoundProblem

FLYING = Performance(20.0, 5.0, LimitsConfig())
WALL = np.array([[300.0, 100], [360, 100], [360, 700], [300, 700]])
AREAS = Airspace((WALL,), None, 15.0)


def problem(seed: int, *, duration_s: float = 40.0, **more) -> RoundProblem:
    rng = np.random.default_rng(seed)
    known = {
        "devices_m": rng.uniform(0, 800, (8, 2)),
        "importance": rng.uniform(0.2, 1.0, 8),
        "start_m": np.array([200.0, 400.0]),
        "steps": 6,
        "per_step": 2,
        "path_budget_m": 700.0,
        "channel": CHANNEL_PRESETS["suburban"],
        "limits": RoundLimits(FLYING, duration_s),
    }
    return RoundProblem(**{**known, **more})


def path(given: RoundProblem, seed: int) -> np.ndarray:
    drawn = np.random.default_rng(seed).uniform(0, 800, (given.steps, 2))
    drawn[0] = given.start_m
    return drawn


@pytest.mark.parametrize("seed", range(8))
def test_a_path_that_is_too_long_is_cut_where_its_limit_ends(seed: int) -> None:
    given = problem(seed, duration_s=20.0, airspace=AREAS)
    whole = plan_along(given, path(given, seed))
    cut = fitted(given, path(given, seed))
    assert cut is not None
    check_plan(given, cut)
    assert 0.85 < share(given, cut) <= 1.0, "corners may take a jump at the end"
    assert share(given, made(given, path(given, seed))) > 1.0
    # It is the beginning of the whole path.
    until = polyline.along(cut.route_m)
    whole_m = polyline.along(whole.route_m)
    for axis in (0, 1):
        on_whole = np.interp(until, whole_m, whole.route_m[:, axis])
        np.testing.assert_allclose(on_whole, cut.route_m[:, axis], atol=1e-6)


def test_where_nothing_is_in_the_way_nothing_is_cut() -> None:
    given = problem(0, duration_s=20.0)
    assert fitted(given, path(given, 0)) is None
    assert fitted(given, given.start_m + 0.02 * (path(given, 0) - given.start_m)) is not None


def test_what_is_not_wanted_is_not_foreseen(monkeypatch: pytest.MonkeyPatch) -> None:
    given = problem(1)
    monkeypatch.setattr("mission.planner.fitting.foresee_round", None)
    assert fitted(given, path(given, 1), wanted=lambda _: False) is None


def test_what_is_wanted_no_more_once_it_is_cut_is_not_given_back() -> None:
    given = problem(1, duration_s=12.0, airspace=AREAS)
    whole = plan_along(given, path(given, 1))
    assert fitted(given, path(given, 1), wanted=lambda plan: plan.value >= whole.value) is None
    assert fitted(given, path(given, 1), wanted=lambda plan: plan.value > 0.0) is not None


@pytest.mark.parametrize("space", [OPEN, AREAS])
def test_drawn_together_it_fits(space: Airspace) -> None:
    given = problem(3, duration_s=15.0, airspace=space)
    plan = drawn_together(given, path(given, 3))
    check_plan(given, plan)
    assert share(given, plan) <= 1.0


def test_another_altitude_is_taken_only_where_it_is_worth_more() -> None:
    given = problem(4, altitudes_m=(40.0, 120.0))
    lowest = drawn_together(given.at(40.0), path(given, 4))
    best = at_best_altitude(given, lowest, 40.0)
    check_plan(given, best)
    assert best.value > lowest.value
    again = at_best_altitude(given, best, best.altitude_m)
    assert (again.value, again.altitude_m) == (best.value, best.altitude_m)
    fixed = problem(4)
    assert at_best_altitude(fixed, lowest, None) is lowest
