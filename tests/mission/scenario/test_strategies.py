"""The baselines' paths and schedules, against geometry done by hand and HiGHS."""

import operator
from functools import partial
from typing import Any

import numpy as np
import pytest
from one_aircraft import changed, round_problem
from scipy.optimize import linprog

from fl.radio.channel import CHANNEL_PRESETS, average_per
from mission.base.errors import InputError
from mission.config.area import AreaConfig
from mission.config.models import MissionConfig
from mission.planner.certified import CertifiedPlanner
from mission.planner.check import check_plan
from mission.planner.problem import RoundProblem
from mission.scenario.strategies import (
    Barycenter,
    Rectangular,
    Sortie,
    longest,
    make_strategy,
    stretch,
)

SQUARE = np.array([[0.0, 0.0], [400.0, 0.0], [400.0, 400.0], [0.0, 400.0]])
CHANNEL = CHANNEL_PRESETS["suburban"]


def problem(*, devices: np.ndarray, steps: int = 6, per_step: int = 2) -> RoundProblem:
    return round_problem(
        devices_m=devices,
        importance=np.linspace(0.1, 1.0, len(devices)),
        start_m=np.array([0.0, 0.0]),
        steps=steps,
        per_step=per_step,
        path_budget_m=800.0,
        channel=CHANNEL,
    )


def test_stretch_has_the_corners_and_the_length() -> None:
    points = stretch(SQUARE, 200.0, 800.0, 10)
    assert points.shape == (10, 2)
    legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert legs.sum() == pytest.approx(800.0)
    for corner in ([400.0, 0.0], [400.0, 400.0]):
        assert np.linalg.norm(points - corner, axis=1).min() < 1e-9
    np.testing.assert_allclose(points[[0, -1]], [[200.0, 0.0], [200.0, 400.0]])


def test_stretch_closes_after_a_lap_and_goes_on() -> None:
    first, second = stretch(SQUARE, 0.0, 800.0, 9), stretch(SQUARE, 800.0, 800.0, 9)
    np.testing.assert_allclose(first[-1], second[0])
    np.testing.assert_allclose(second[-1], SQUARE[0])
    np.testing.assert_allclose(stretch(SQUARE, 1600.0, 800.0, 9), first)


def test_a_stretch_has_the_corner_where_a_lap_ends() -> None:
    """40 m before the first corner, and 150 m behind it in 3 legs."""
    points = stretch(SQUARE, 1560.0, 190.0, 5)
    np.testing.assert_allclose(points, [[0, 40], [0, 0], [50, 0], [100, 0], [150, 0]])


def test_stretch_longer_than_a_lap() -> None:
    points = stretch(SQUARE, 0.0, 2000.0, 21)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(2000.0)


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_stretch_with_few_steps_keeps_its_ends(steps: int) -> None:
    points = stretch(SQUARE, 0.0, 800.0, steps)
    assert points.shape == (steps, 2)
    np.testing.assert_allclose(points[0], [0.0, 0.0])
    if steps > 1:
        np.testing.assert_allclose(points[-1], [400.0, 400.0], atol=1e-9)


@pytest.mark.parametrize(
    ("begin", "length_m", "steps", "points"),
    [
        # The longer a leg between corners, the more steps are on it: 100, 200 and 300 m in all.
        (100.0, 500.0, 6,
         [[100, 0], [200, 0], [300, 0], [400, 0], [400, 100], [400, 200]]),
        (100.0, 500.0, 4, [[100, 0], [250, 0], [400, 0], [400, 200]]),
        (100.0, 500.0, 3, [[100, 0], [400, 0], [400, 200]]),
        (100.0, 500.0, 2, [[100, 0], [400, 200]]),
        (300.0, 600.0, 3, [[300, 0], [400, 200], [300, 400]]),  # which cut two corners
        (1500.0, 200.0, 3, [[0, 100], [0, 0], [100, 0]]),
        (1700.0, 300.0, 2, [[100, 0], [400, 0]]),  # its end is no corner on the way
        (400.0, 400.0, 2, [[400, 0], [400, 400]]),
        (0.0, 1600.0, 5, [[0, 0], [400, 0], [400, 400], [0, 400], [0, 0]]),
    ],
)  # fmt: skip
def test_stretch_has_its_steps_where_they_are_worked_out(
    begin: float, length_m: float, steps: int, points: list[list[float]]
) -> None:
    np.testing.assert_allclose(stretch(SQUARE, begin, length_m, steps), points, atol=1e-9)


def test_the_longest_that_fits_is_found_by_halves() -> None:
    assert longest(100.0, lambda metres: metres <= 100.0) == 100.0
    assert longest(100.0, lambda metres: metres < 0.0) == 0.0
    for most_m in (0.01, 37.7, 99.99):
        found = longest(100.0, partial(operator.ge, most_m))
        assert most_m - 100.0 / 2**12 < found <= most_m
    assert longest(100.0, lambda metres: metres <= 37.7, halvings=3) == 37.5
    assert longest(100.0, lambda metres: metres <= 37.5, halvings=3) == 37.5


@pytest.mark.parametrize("wrong", [-1e-9, float("nan"), float("inf")])
def test_a_sortie_that_cannot_be_flown_is_refused(wrong: float) -> None:
    plan = Barycenter(np.zeros(2), 5.0, 100.0).sortie(0, problem(devices=np.zeros((1, 2)))).plan
    assert (Sortie(plan).hold_s, Sortie(plan).cost_m) == (0.0, None)
    assert Sortie(plan, 0.0, 0.0).cost_m == 0.0
    with pytest.raises(ValueError, match=r"^hold_s = .*: must be a finite number of 0 or more"):
        Sortie(plan, hold_s=wrong)
    with pytest.raises(ValueError, match=r"^cost_m = .*: must be a finite number of 0 or more"):
        Sortie(plan, cost_m=wrong)


def test_the_strategies_of_a_mission() -> None:
    mission = MissionConfig(tour_inset=0.25, hover_s=7.0, hover_cost_m=90.0)
    area = AreaConfig(size_m=(800.0, 400.0)).build()

    def made(name: str) -> Any:
        named = mission.model_copy(update={"strategy": name})
        devices_m = np.array([[0.0, 0.0], [90.0, 30.0]])
        return make_strategy(named, CertifiedPlanner(), devices_m=devices_m, area=area)

    assert (made("cov").fairness, made("no_cov").fairness) == (True, False)
    assert made("cov").approach_m is None
    hover = made("barycenter")
    assert (hover.approach_m.tolist(), hover.hover_s, hover.cost_m) == ([45.0, 15.0], 7.0, 90.0)
    tour = made("rectangular")
    assert tour.corners_m.tolist() == [[200, 100], [600, 100], [600, 300], [200, 300]]
    assert (tour.length_m, tour.approach_m.tolist()) == (800.0, [200.0, 100.0])
    assert hover.fairness and tour.fairness  # noqa: PT018 - of both
    assert made("ideal") is None
    with pytest.raises(InputError, match=r"mission.strategy = 'best': no strategy of ours"):
        made("best")


def test_schedule_of_a_fixed_path_is_the_lp_optimum() -> None:
    rng = np.random.default_rng(5)
    given = problem(devices=rng.uniform(0, 400, (15, 2)))
    plan = Rectangular(SQUARE, 800.0).sortie(0, given).plan
    reach = np.linalg.norm(plan.waypoints_m[:, None] - given.devices_m[None], axis=2)
    worth = (1 - average_per(CHANNEL, reach)) * given.importance
    steps, devices = worth.shape
    once = np.tile(np.eye(devices), (1, steps))
    per_step = np.kron(np.eye(steps), np.ones(devices))
    answer = linprog(
        -worth.ravel(),
        A_ub=np.vstack((once, per_step)),
        b_ub=np.concatenate((np.ones(devices), np.full(steps, given.per_step))),
        bounds=(0, 1),
        method="highs",
    )
    assert plan.value == pytest.approx(-answer.fun, rel=1e-9)
    assert (plan.schedule.sum(axis=(0, 1)) <= 1).all()
    assert (plan.schedule.sum(axis=2) <= given.per_step).all()


def test_a_tour_goes_on_round_by_round_from_where_the_aircraft_is() -> None:
    here = np.array([399.0, 398.0])
    given = changed(problem(devices=np.array([[0.0, 400.0], [9.0, 9.0]])), start_m=here)
    way = Rectangular(SQUARE, 800.0).sortie(1, given).plan.waypoints_m
    np.testing.assert_array_equal(way[0], here)
    assert np.linalg.norm(way - [0.0, 400.0], axis=1).min() < 1e-9
    np.testing.assert_allclose(way[-1], [0.0, 0.0], atol=1e-9)


def test_a_round_of_the_tour_is_as_short_as_what_is_left_of_the_budget() -> None:
    given = changed(problem(devices=np.array([[9.0, 9.0]])), path_budget_m=500.0)
    way = Rectangular(SQUARE, 800.0).sortie(0, given).plan.waypoints_m
    assert np.linalg.norm(way - [400.0, 0.0], axis=1).min() < 1e-9
    np.testing.assert_allclose(way[-1], [400.0, 100.0])


def test_a_tour_from_beside_its_start_keeps_the_path_budget() -> None:
    here = np.array([401.0, 398.0])
    given = changed(problem(devices=np.array([[9.0, 9.0]])), start_m=here)
    plan = Rectangular(SQUARE, 800.0).sortie(1, given).plan
    check_plan(given, plan)
    assert 799.0 < plan.path_m <= 800.0


def test_barycenter_hovers_where_it_is() -> None:
    given = problem(devices=np.array([[0.0, 10.0], [20.0, 0.0], [5.0, 5.0]]))
    sortie = Barycenter(np.array([8.3, 5.0]), 5.0, 100.0).sortie(3, given)
    assert (sortie.plan.waypoints_m == given.start_m).all()
    assert (sortie.hold_s, sortie.cost_m) == (5.0, 100.0)
    assert sortie.plan.schedule.sum() == 3


def test_value_is_the_papers_objective() -> None:
    given = problem(devices=np.array([[30.0, 40.0]]), steps=1, per_step=1)
    plan = Barycenter(np.zeros(2), 5.0, 100.0).sortie(0, given).plan
    assert plan.value == pytest.approx(float(1 - average_per(CHANNEL, 50.0)) * 0.1)
