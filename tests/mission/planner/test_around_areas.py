"""Plans around areas: feasible, close to the best, with a bound that stays true."""

import dataclasses
import itertools
from functools import partial

import numpy as np
import pytest
from drawn_problems import drawn_problem, plan

from mission.base.airspace import Airspace
from mission.base.errors import InfeasiblePlanError
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import finish
from mission.planner.factory import make_planner
from mission.planner.flyable import acceptance_radius
from mission.planner.limited import reach_bound

pytestmark = pytest.mark.usefixtures("hasty")

WALL = np.array([[300.0, 100], [360, 100], [360, 700], [300, 700]])
BLOCK = np.array([[500.0, 300], [700, 300], [700, 500], [500, 500]])
FENCE = np.array([[-100.0, -100], [900, -100], [900, 900], [-100, 900]])
SPACE = Airspace((WALL, BLOCK), FENCE, 15.0)

problem = partial(drawn_problem, start_m=np.array([200.0, 400.0]), airspace=SPACE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed"), [("certified", 0), ("certified", 1), ("sqp", 2), ("paper", 3)]
)
def test_every_planner_keeps_out(kind: str, seed: int) -> None:
    made = plan(problem(seed), kind)
    route = made.route_m
    dense = np.vstack([np.linspace(a, b, 300) for a, b in itertools.pairwise(route)])
    for ring in (WALL, BLOCK):
        (left, low), (right, high) = ring.min(axis=0) - 14.9, ring.max(axis=0) + 14.9
        x, y = dense.T
        near = (x > left) & (x < right) & (y > low) & (y < high)
        corners = np.array(
            list(itertools.product((left + 14.9, right - 14.9), (low + 14.9, high - 14.9)))
        )
        away = np.array([np.hypot(*(corners - p).T).min() for p in dense[near]])
        # The rounded corners of the margin are all that a path may cut of the larger rectangle.
        assert (away >= 14.9).all()
    assert made.path_m <= 800.0 + 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_the_bound_is_above_every_plan_and_not_above_that_without_areas(seed: int) -> None:
    given = problem(seed)
    made = plan(given)
    free = make_planner(PlannerConfig()).plan(dataclasses.replace(given, airspace=Airspace()))
    assert made.value <= made.upper_bound <= max(free.upper_bound, made.value)
    rng = np.random.default_rng(seed)
    for _ in range(300):
        other = finish(given, np.vstack((given.start_m, rng.uniform(0, 800, (5, 2)))))
        check_plan(given, other)
        assert other.value <= made.upper_bound
        assert other.value <= made.value * 1.02


def test_where_nothing_is_in_the_way_the_plan_is_the_planners_own() -> None:
    far = Airspace((WALL + 5000.0,), None, 15.0)
    given = problem(airspace=far)
    free = make_planner(PlannerConfig()).plan(dataclasses.replace(given, airspace=Airspace()))
    np.testing.assert_array_equal(plan(given).waypoints_m, free.waypoints_m)


@pytest.mark.slow
def test_two_steps_are_as_good_as_the_best_of_a_fine_grid() -> None:
    given = problem(3, devices=3, steps=2, path_budget_m=700.0)
    x, y = np.meshgrid(np.arange(-80, 881, 10.0), np.arange(-80, 881, 10.0))
    places = np.column_stack((x.ravel(), y.ravel()))
    places = places[SPACE.free(places)]
    best = max(finish(given, np.array([given.start_m, place])).value for place in places)
    made = plan(given)
    assert made.value >= 0.995 * best
    assert made.upper_bound >= best


def test_a_device_deep_inside_bounds_what_a_plan_is_worth() -> None:
    wide = np.array([[200.0, -400], [1600, -400], [1600, 1000], [200, 1000]])
    inside = problem(
        devices_m=np.array([[900.0, 300.0]]), importance=np.ones(1), path_budget_m=5000.0,
        start_m=np.array([100.0, 300.0]), airspace=Airspace((wide,), None, 15.0),
    )  # fmt: skip
    bound = reach_bound([inside])
    assert bound < 0.05
    made = plan(inside)
    assert made.value <= made.upper_bound <= max(bound, made.value)


def test_a_start_that_has_drifted_into_the_margin_is_left() -> None:
    given = problem(start_m=np.array([290.0, 400.0]))
    made = plan(given)
    np.testing.assert_array_equal(made.waypoints_m[0], given.start_m)
    np.testing.assert_allclose(made.route_m[1], [285.0, 400.0], atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["certified", "sqp"])
def test_devices_behind_what_nobody_can_cross_are_heard_from_this_side(kind: str) -> None:
    river = np.array([[380.0, -200], [420, -200], [420, 1000], [380, 1000]])
    given = problem(path_budget_m=2500.0, airspace=Airspace((river,), FENCE, 15.0))
    made = plan(given, kind)
    assert (made.route_m[:, 0] <= 365.0 + 1e-6).all()
    assert made.value > 0.0
    ring = [np.add(c, (200.0, 400.0)) for c in (
        [[-60, -60], [60, -60], [60, -40], [-60, -40]], [[-60, 40], [60, 40], [60, 60], [-60, 60]],
        [[-60, -50], [-40, -50], [-40, 50], [-60, 50]], [[40, -50], [60, -50], [60, 50], [40, 50]],
    )]  # fmt: skip
    inside = plan(problem(path_budget_m=2500.0, airspace=Airspace(tuple(ring), None, 5.0)), kind)
    assert (np.abs(inside.route_m - (200, 400)) <= 40.0).all()


def test_a_plan_that_crosses_is_refused() -> None:
    given = problem(steps=2)
    crossing = np.array([given.start_m, [450.0, 400.0]])
    straight = finish(dataclasses.replace(given, airspace=Airspace()), crossing)
    with pytest.raises(InfeasiblePlanError, match=r"leg from \(200.0, 400.0\) to \(450.0, 400.0\)"):
        check_plan(given, straight)
    check_plan(given, finish(given, crossing))
    with pytest.raises(InfeasiblePlanError, match="between 3 pairs"):
        check_plan(given, straight.with_own(via_m=(np.empty((0, 2)),) * 3))


def test_a_route_that_is_free_nowhere_is_judged() -> None:
    """In an area from beginning to end it may stay; in the margin it may not cross the area."""
    given = problem(start_m=np.array([600.0, 400.0]), steps=3)
    inside = np.array([given.start_m, [650.0, 400.0], [650.0, 450.0]])
    anywhere = dataclasses.replace(given, airspace=Airspace())
    check_plan(given, finish(anywhere, inside))
    beside = problem(start_m=np.array([495.0, 400.0]), steps=2)
    across = np.array([beside.start_m, [705.0, 400.0]])
    straight = finish(dataclasses.replace(beside, airspace=Airspace()), across)
    with pytest.raises(InfeasiblePlanError, match=r"leg from \(495.0, 400.0\) to \(705.0, 400.0\)"):
        check_plan(beside, straight)


def test_what_the_budget_does_not_pay_for_is_left_out() -> None:
    given = problem(steps=3, path_budget_m=100.0)
    made = finish(given, np.array([given.start_m, [450.0, 400.0], [450.0, 500.0]]))
    check_plan(given, made)
    assert made.path_m == pytest.approx(100.0)
    np.testing.assert_array_equal(made.waypoints_m[1], made.waypoints_m[2])


def test_corners_are_cut_by_half_of_the_margin_at_most() -> None:
    given = problem()
    assert acceptance_radius(given, plan(given), 50.0) <= 7.5
