"""Plans made to fit limits: cut where these end, or shrunk."""

import dataclasses
import itertools
import pickle

import numpy as np
import pytest
from drawn_problems import drawn_problem
from one_aircraft import one_path, round_problem

from fl.radio.channel import CHANNEL_PRESETS
from flightdyn.config import LimitsConfig
from mission.base import polyline
from mission.base.airspace import Airspace
from mission.planner.check import check_plan
from mission.planner.evaluate import plan_along
from mission.planner.flyable import foresee_round, share_of
from mission.planner.improving import fitted, serving_fewer, varied
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.planner.problem import RoundProblem

FLYING = Performance(20.0, 5.0, LimitsConfig())
WALL = np.array([[300.0, 100], [360, 100], [360, 700], [300, 700]])
AREAS = Airspace((WALL,), None, 15.0)


def problem(seed: int, *, duration_s: float = 40.0, **more) -> RoundProblem:
    limits, start_m = RoundLimits(FLYING, duration_s), np.array([200.0, 400.0])
    return drawn_problem(seed, start_m=start_m, path_budget_m=700.0, limits=limits, **more)


def path(given: RoundProblem, seed: int) -> np.ndarray:
    drawn = np.random.default_rng(seed).uniform(0, 800, (given.steps, 2))
    drawn[0] = given.start_m
    return drawn


@pytest.mark.parametrize("seed", range(4))
def test_a_path_that_is_too_long_is_cut_where_its_limit_ends(seed: int) -> None:
    given = problem(seed, duration_s=20.0, airspace=AREAS)
    whole = plan_along(given, path(given, seed))
    cut = fitted(given, path(given, seed))
    assert cut is not None
    check_plan(given, cut)
    assert 0.85 < share_of(given, cut) <= 1.0, "corners may take a jump at the end"
    assert share_of(given, whole) > 1.0
    # It is the beginning of the whole path.
    until = polyline.along(cut.route_m)
    whole_m = polyline.along(whole.route_m)
    for axis in (0, 1):
        on_whole = np.interp(until, whole_m, whole.route_m[:, axis])
        np.testing.assert_allclose(on_whole, cut.route_m[:, axis], atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_where_nothing_is_in_the_way_a_path_is_shrunk(seed: int) -> None:
    given = problem(seed, duration_s=15.0)
    plan = fitted(given, path(given, seed))
    assert plan is not None
    check_plan(given, plan)
    assert 0.75 < share_of(given, plan) <= 1.0
    along, whole = plan.waypoints_m - given.start_m, path(given, seed) - given.start_m
    scale = np.linalg.norm(along) / np.linalg.norm(whole)
    np.testing.assert_allclose(along, scale * whole, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_remembered_between_changes_is_what_a_new_look_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    given = problem(seed, airspace=Airspace((WALL, WALL + 100.0), None, 15.0))
    given = dataclasses.replace(
        given.with_own(limits=RoundLimits(FLYING, 45.0, 8100.0)),
        upload_s=rng.uniform(0.5, 6.0, len(given.devices_m)),
        ready_in_s=rng.uniform(0.0, 30.0, len(given.devices_m)),
    )
    begun = fitted(given, path(given, seed))
    assert begun is not None
    found = varied(given, begun, 10_000, tolerance=0.02, seed=seed)
    check_plan(given, found)
    assert found.value > begun.value
    assert share_of(given, found) <= 1.0
    again = fitted(given, found.waypoints_m)
    assert again is not None
    np.testing.assert_allclose(again.route_m, found.route_m, atol=1e-6)
    assert again.value == pytest.approx(found.value, rel=1e-9)


def test_what_is_worth_too_little_is_not_given_back() -> None:
    given = problem(1)
    worth = plan_along(given, path(given, 1)).value
    assert fitted(given, path(given, 1), above=worth) is None


def test_what_is_worth_too_little_once_it_is_cut_is_not_given_back() -> None:
    given = problem(1, duration_s=12.0, airspace=AREAS)
    whole = plan_along(given, path(given, 1))
    assert fitted(given, path(given, 1), above=0.99 * whole.value) is None
    assert fitted(given, path(given, 1), above=0.0) is not None


def test_seconds_are_foreseen_without_the_rest() -> None:
    upload_s = np.array([0.0, 2.0, 0.0, 1.0, 0.0, 3.0, 0.0, 0.5])
    for seed in range(4):
        given = problem(seed, upload_s=upload_s if seed % 2 else None)
        plan = plan_along(given, path(given, seed))
        seconds = foresee_round(given, plan).duration_s
        assert share_of(given, plan) == pytest.approx(seconds / 40.0, abs=1e-9)


def test_problems_and_plans_may_be_sent_to_other_processes() -> None:
    given = problem(1, airspace=AREAS)
    plan = fitted(given, path(given, 1))
    assert plan is not None
    assert share_of(given, plan) == share_of(*pickle.loads(pickle.dumps((given, plan))))


@pytest.mark.parametrize("order", [*itertools.permutations(range(4))])
def test_who_brings_least_a_second_is_left_out_first(order: tuple[int, ...]) -> None:
    """Importance 1 for 10 s, 0.5 for 6 s, 0.45 for 6 s, 0.02 for 2 s, all from where it hovers, for
    a second more than that: 17.5 s are enough for the first two, 19.5 for the last as well."""
    turn = np.array(order)
    importance = np.array([1.0, 0.5, 0.45, 0.02])[turn]
    upload_s = np.array([10.0, 6.0, 6.0, 2.0])[turn]
    start_m = np.full(2, 400.0)
    whom = {17.5: {0, 1}, 19.5: {0, 1, 3}, 25.5: {0, 1, 2, 3}, 1.5: set()}
    for duration_s, served in whom.items():
        given = round_problem(
            np.tile(start_m, (4, 1)), importance, start_m, 1, 4, 100.0,
            CHANNEL_PRESETS["suburban+30dB"], limits=RoundLimits(FLYING, duration_s),
            upload_s=upload_s,
        )  # fmt: skip
        everybody = one_path(start_m[None], np.ones((1, 4), dtype=bool), importance.sum())
        found = serving_fewer(given, everybody)
        assert {int(turn[k]) for k in np.flatnonzero(found.schedule[0, 0])} == served
        assert found.value == pytest.approx(importance[found.schedule[0, 0]].sum(), rel=1e-3)
        # And so where it has to be worth more than what is known, which is not told too early.
        if served:
            better = fitted(given, start_m[None], above=found.value * (1.0 - 1e-9))
            assert better is not None
            assert better.schedule.tolist() == found.schedule.tolist()
            assert fitted(given, start_m[None], above=found.value) is None


@pytest.mark.parametrize("order", [*itertools.permutations(range(3))])
def test_who_does_not_fit_counts_by_its_share_of_what_may_be_earned(
    order: tuple[int, ...],
) -> None:
    """1 for 6 s, 0.88 for 5.5 s, 0.62 for 4 s: in 11.4 s the first and the last, worth 1.62. The
    second fits by nine tenths: 1.8 seems possible, and nobody gives up before."""
    turn, start_m = np.array(order), np.full(2, 400.0)
    importance, upload_s = np.array([1.0, 0.88, 0.62])[turn], np.array([6.0, 5.5, 4.0])[turn]
    given = round_problem(
        np.tile(start_m, (3, 1)), importance, start_m, 1, 3, 100.0,
        CHANNEL_PRESETS["suburban+30dB"], limits=RoundLimits(FLYING, 11.4), upload_s=upload_s,
    )  # fmt: skip
    found = fitted(given, start_m[None], above=1.61)
    assert found is not None
    assert {int(turn[k]) for k in np.flatnonzero(found.schedule[0, 0])} == {0, 2}
    assert found.value == pytest.approx(1.62, rel=1e-3)
