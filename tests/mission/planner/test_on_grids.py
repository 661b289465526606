"""Plans with what is believed of each place: against enumeration, SciPy and long climbs."""

import dataclasses
import itertools

import numpy as np
import pytest
from one_aircraft import changed
from scipy.interpolate import RegularGridInterpolator
from test_certificate import random_problem

from fl.radio.per_grid import PerGrid
from mission.planner.certified import CertifiedPlanner
from mission.planner.check import check_plan
from mission.planner.evaluate import finish, fit_budget, objective, path_length, success
from mission.planner.improving import varied
from mission.planner.native.library import assign
from mission.planner.problem import RoundProblem


def hilly(seed: int, devices: int, places: int, cell_m: float) -> PerGrid:
    """Success with many summits, which are not above the devices."""
    rng = np.random.default_rng(seed)
    rough = rng.uniform(0.0, 1.0, (devices, places, places))
    smooth = (rough + np.roll(rough, 1, axis=1) + np.roll(rough, 1, axis=2)) / 3.0
    return PerGrid(np.ascontiguousarray(smooth**2), (0.0, 0.0), cell_m)


def on_grid(seed: int, *, places: int = 41, cell_m: float = 20.0, **more) -> RoundProblem:
    given = random_problem(seed, **more)
    grid = hilly(seed, len(given.devices_m), places, cell_m)
    return dataclasses.replace(given, per_grid=grid)


def test_it_is_bilinear_and_beyond_its_edge_as_there() -> None:
    grid, axis = hilly(1, 3, 9, 25.0), 25.0 * np.arange(9)
    rng = np.random.default_rng(1)
    device, place_m = rng.integers(0, 3, 500), rng.uniform(-80.0, 280.0, (500, 3))
    per = grid.per(device, place_m)
    for k in range(3):
        other = RegularGridInterpolator((axis, axis), 1.0 - grid.success[k])
        inside = np.clip(place_m[device == k, 1::-1], 0.0, 200.0)
        np.testing.assert_allclose(per[device == k], other(inside), atol=1e-12)


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("seed", range(3))
def test_a_plan_is_worth_what_its_places_are(seed: int) -> None:
    problem = on_grid(seed)
    plan = CertifiedPlanner().plan(problem)
    check_plan(problem, plan)
    assert plan.value == pytest.approx(
        objective(problem, plan.waypoints_m, plan.schedule[0]), rel=1e-12
    )
    best = assign(success(problem, plan.waypoints_m), problem.importance, problem.per_step)
    assert plan.value == pytest.approx(objective(problem, plan.waypoints_m, best), rel=1e-9)


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("seed", range(6))
def test_no_path_over_a_coarse_grid_is_worth_more(seed: int) -> None:
    problem = on_grid(seed, places=6, cell_m=100.0, devices=3, steps=3, per_step=1, budget=250.0)
    problem = changed(problem, start_m=np.array([200.0, 300.0]))
    plan = CertifiedPlanner().plan(problem)
    corners = [np.array(at) * 100.0 for at in itertools.product(range(6), repeat=2)]
    ways = (np.array([problem.start_m, *stops]) for stops in itertools.product(corners, repeat=2))
    values = [finish(problem, way).value for way in ways if path_length(way) <= 250.0]
    # Changes at random end near a summit, not on it.
    assert max(values) <= plan.value * (1.0 + 1e-3)
    assert max(values) <= plan.upper_bound * (1.0 + 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_long_climb_hardly_improves_plans_and_passes_no_bound(seed: int) -> None:
    problem = on_grid(seed, budget=500.0)
    plan = best = CertifiedPlanner().plan(problem)
    for turn in range(4):
        best = varied(problem, best, 200_000, tolerance=0.01 if turn < 3 else 0.0, seed=turn)
    assert best.value <= plan.upper_bound
    assert plan.value >= 0.97 * best.value


@pytest.mark.usefixtures("hasty")
def test_a_bound_counts_what_a_path_reaches_only() -> None:
    success_at = np.zeros((1, 41, 41))
    success_at[0, 20, 30:] = 1.0  # 600 m east, behind the budget
    problem = random_problem(1, devices=1, steps=3, budget=100.0)
    grid = PerGrid(success_at, (0.0, 0.0), 20.0)
    near = changed(problem, start_m=np.array([100.0, 400.0]), per_grid=grid)
    far = changed(near, path_budget_m=490.0)
    assert CertifiedPlanner().plan(near).upper_bound == 0.0
    reached = CertifiedPlanner().plan(far)
    # It ends halfway up the step, and patches count whole.
    assert reached.value == pytest.approx(0.5 * problem.importance[0], rel=1e-3)
    assert reached.upper_bound == problem.importance[0]


@pytest.mark.usefixtures("hasty")
def test_improvements_begin_on_paths_within_the_budget() -> None:
    problem = on_grid(3, budget=60.0)
    plan = CertifiedPlanner().plan(problem)
    assert plan.path_m <= 60.0 + 1e-6
    np.testing.assert_array_equal(fit_budget(plan.waypoints_m, 60.0), plan.waypoints_m)
    assert plan.ended.startswith("its bound is what each device promises")
