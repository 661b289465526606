"""Bounds of plans with few stops, against solvers that share nothing with them."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import differential_evolution, linear_sum_assignment
from search_parts import chain_bounds, square_bound
from test_certificate import SEEDS, random_problem

from fl.radio.channel import CHANNEL_PRESETS, average_per
from mission.planner.certified import CertifiedPlanner, ExploringPlanner, instance, relax
from mission.planner.check import check_plan
from mission.planner.evaluate import path_length
from mission.planner.native.crews import Crew, search_orders
from mission.planner.native.library import (
    Found,
    Goal,
    PathLimits,
    search_places,
)

CHANNELS = st.sampled_from(sorted(CHANNEL_PRESETS))
THOROUGH = settings(max_examples=25, deadline=None, derandomize=True)


def rewards(problem, places):
    """(..., N, K) delta f from the places (..., N, 2)."""
    away = np.linalg.norm(places[..., None, :] - problem.devices_m, axis=-1)
    return problem.importance * (1.0 - average_per(problem.channel, away))


def best_assignment(problem, places):
    """What the places (N, 2) earn at most, by scipy on K_bar copies of each."""
    worth = np.repeat(rewards(problem, places), problem.per_step, axis=0)
    rows, columns = linear_sum_assignment(worth, maximize=True)
    return float(worth[rows, columns].sum())


@THOROUGH
@given(SEEDS, CHANNELS, st.integers(1, 5), st.integers(1, 3), st.floats(0.05, 300.0))
def test_no_stop_in_a_square_earns_more_than_its_bound(seed, channel, devices, per_step, half):
    per_step = min(per_step, devices)
    problem = random_problem(seed, devices=devices, per_step=per_step, preset=channel)
    rng = np.random.default_rng(seed)
    middle = rng.uniform(0.0, 800.0, 2)
    if seed % 2:  # right above a device, where f may have a kink
        middle = problem.devices_m[0] + rng.uniform(-half, half, 2)
    places = middle + half * np.clip(rng.normal(0.0, 2.0, (500, 2)), -1.0, 1.0)
    best = np.sort(rewards(problem, places), axis=-1)[:, -per_step:].sum(axis=-1)
    devices_c, limits = instance(problem)
    x, y = middle - problem.start_m
    bound = square_bound(devices_c, limits, x, y, half)
    assert best.max() <= bound


@pytest.mark.parametrize("away_m", [0.0, 30.0, 60.0, 90.0, 150.0])
def test_the_bound_of_a_square_is_tight(away_m):
    problem = random_problem(3, per_step=3)
    middle = problem.devices_m[0] + away_m
    half = 4.0
    grid = np.linspace(-half, half, 41)
    places = middle + np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    best = np.sort(rewards(problem, places), axis=-1)[:, -3:].sum(axis=-1).max()
    devices_c, limits = instance(problem)
    x, y = middle - problem.start_m
    bound = square_bound(devices_c, limits, x, y, half)
    assert best <= bound <= 1.005 * best


def test_a_place_given_up_by_one_device_is_there_for_another():
    problem = random_problem(0, devices=9, steps=5, per_step=1, budget=399.0)
    best = CertifiedPlanner(gap=0.03).plan(problem)
    for gap in (0.01, 1e-3):
        plan = CertifiedPlanner(gap=gap, max_nodes=400).plan(problem)
        assert plan.upper_bound >= best.value


@THOROUGH
@given(SEEDS, CHANNELS, st.integers(1, 5), st.floats(60.0, 900.0))
def test_one_free_stop_agrees_with_a_grid_and_its_lipschitz_allowance(
    seed, channel, per_step, budget
):
    problem = random_problem(
        seed, devices=7, steps=2, per_step=per_step, budget=budget, preset=channel
    )
    plan = CertifiedPlanner().plan(problem)
    check_plan(problem, plan)
    # Nobody is scheduled whose success is below 1 %.
    hopeless = 0.01 * problem.importance[~plan.schedule.any(axis=(0, 1))].sum()
    assert plan.value + hopeless >= plan.upper_bound * (1.0 - 0.0101)
    spacing = 25.0
    line = np.arange(-spacing, 800.0 + 2.0 * spacing, spacing)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(grid - problem.start_m, axis=1)
    # What a stop within half a square's diagonal of a grid point may bring a device at most.
    diagonal = spacing * np.sqrt(0.5)
    near = np.linalg.norm(grid[:, None] - problem.devices_m, axis=-1)
    from_r = np.arange(0.0, 2500.0, 1.0)
    f = 1.0 - average_per(problem.channel, from_r)
    highest = np.maximum.accumulate(f[::-1])[::-1]
    index = np.floor(np.maximum(near - diagonal, 0.0)).astype(int)
    at_start = rewards(problem, problem.start_m[None])[0]

    def with_start(worth):
        rows = np.repeat(np.stack([at_start, worth]), per_step, axis=0)
        i, k = linear_sum_assignment(rows, maximize=True)
        return rows[i, k].sum()

    reached = [with_start(w) for w in rewards(problem, grid[away <= budget])]
    allowed = [
        with_start(w) for w in (problem.importance * highest[index])[away <= budget + diagonal]
    ]
    hoped_for = plan.upper_bound * (1.0 + 1e-9)
    if not plan.upper_bound:  # nobody in reach is worth asking, so there is nothing to collect
        hoped_for = hopeless
    assert max(reached, default=0.0) <= hoped_for
    assert plan.value <= max(allowed) * (1.0 + 1e-9)


@settings(max_examples=6, deadline=None, derandomize=True)
@given(SEEDS, CHANNELS, st.integers(1, 3))
def test_two_free_stops_agree_with_differential_evolution(seed, channel, per_step):
    problem = random_problem(
        seed, devices=6, steps=3, per_step=per_step, budget=500.0, preset=channel
    )
    plan = CertifiedPlanner().plan(problem)
    check_plan(problem, plan)

    def loss(x):
        way = np.vstack([problem.start_m, x.reshape(2, 2)])
        scale = min(1.0, problem.path_budget_m / max(path_length(way), 1e-9))
        return -best_assignment(problem, problem.start_m + (way - problem.start_m) * scale)

    found = differential_evolution(
        loss, [(0.0, 800.0)] * 4, rng=1, popsize=12, maxiter=60, polish=False
    )
    assert -found.fun <= plan.upper_bound * (1.0 + 1e-9)
    assert plan.value >= -found.fun * (1.0 - 0.0101)
    assert plan.gap <= 0.0101


@pytest.mark.slow
@THOROUGH
@given(SEEDS, CHANNELS, st.integers(2, 5), st.integers(1, 5), st.floats(20.0, 1500.0))
def test_no_other_plan_lies_above_the_bound(seed, channel, steps, per_step, budget):
    problem = random_problem(
        seed, devices=9, steps=steps, per_step=per_step, budget=budget, preset=channel
    )
    plan = CertifiedPlanner(max_nodes=400).plan(problem)
    check_plan(problem, plan)
    tighter = CertifiedPlanner(gap=1e-3, max_nodes=400).plan(problem)
    others = [tighter.value, ExploringPlanner(starts=20, tries=100).plan(problem).value]
    rng = np.random.default_rng(seed)
    for _ in range(20):
        way = np.vstack([problem.start_m, problem.devices_m[rng.permutation(9)[: steps - 1]]])
        scale = min(1.0, budget / max(path_length(way), 1e-9))
        others.append(best_assignment(problem, problem.start_m + (way - problem.start_m) * scale))
    hoped_for = min(plan.upper_bound, tighter.upper_bound) * (1.0 + 1e-9)
    if not plan.upper_bound:  # nobody in reach is worth asking
        hoped_for = 0.01 * problem.importance.sum()
    assert max(others) <= hoped_for


@pytest.mark.slow
@THOROUGH
@given(SEEDS, CHANNELS, st.integers(2, 6), st.integers(1, 4), st.floats(100.0, 900.0))
def test_both_searches_prove_no_less_than_the_best_plan(seed, channel, steps, per_step, budget):
    problem = random_problem(
        seed, devices=8, steps=steps, per_step=per_step, budget=budget, preset=channel
    )
    devices, limits = instance(problem)
    crew = Crew(devices, limits, relax(problem, devices))
    best = CertifiedPlanner(max_nodes=300).plan(problem).value
    assume(best > 0.0)  # somebody is scheduled
    nowhere = np.zeros((steps, 2)), np.full(8, -1)
    poor = Found(1e-6 * best, *nowhere, np.inf)  # the bound may not lean on a good plan
    known = Found(best, *nowhere, np.inf)  # nor close what holds a better one
    found = []
    for plan, most_nodes in ((poor, 64), (known, 1000)):
        for nodes in (1, 8, most_nodes):
            goal, less = Goal(1e-3, nodes), Goal(1e-3, min(nodes, 64))
            found.append(search_orders([crew], plan=plan, goal=goal))
            found.append(search_places(devices, limits, plan=plan, goal=less))
    assert min(one.bound for one in found) >= max(one.value for one in found) * (1.0 - 1e-6)


@pytest.mark.parametrize("channel", ["suburban+10dB", "suburban", "suburban+30dB"])
@pytest.mark.parametrize("steps", [2, 3, 4])
def test_few_stops_are_proven_to_one_percent(channel, steps):
    for seed in range(2):
        problem = random_problem(seed, steps=steps, preset=channel)
        plan = CertifiedPlanner().plan(problem)
        check_plan(problem, plan)
        assert 0.0 <= plan.gap <= 0.0101
        assert plan.nodes < 2000


def test_hundreds_of_devices_with_few_stops_are_proven_too():
    problem = random_problem(1, devices=120, steps=3)
    plan = CertifiedPlanner(gap=0.02).plan(problem)
    check_plan(problem, plan)
    assert plan.gap <= 0.0201


@pytest.mark.slow
def test_where_there_is_no_room_for_open_nodes_the_gap_stays_honest():
    problem = random_problem(2, steps=4)
    best = CertifiedPlanner(gap=1e-3, max_nodes=3000).plan(problem)
    for nodes in (1, 5, 20):
        plan = CertifiedPlanner(max_nodes=nodes).plan(problem)
        assert plan.nodes <= nodes
        assert plan.upper_bound >= best.value


@pytest.mark.parametrize("mu", [0.0, 0.002])
def test_what_squares_are_worth_to_a_chain_is_the_best_of_all_chains(mu: float) -> None:
    """Of three, four and two squares for three stops; legs bound as the docstring of zones.h says,
    squares by what C says that a stop there earns."""
    rng = np.random.default_rng(5)
    devices, _ = instance(random_problem(3, steps=4, per_step=2))
    squares = np.column_stack((rng.uniform(-300, 300, (9, 2)), rng.uniform(2, 20, 9)))
    first, lean = np.array([0, 3, 7, 9]), rng.uniform(-0.6, 0.6, (3, 2))
    limits = PathLimits(4, 2, 900.0)
    stop, ahead, behind = chain_bounds(devices, limits, first, squares, mu=mu, lean=lean)

    def leg(one: np.ndarray, other: np.ndarray, e: np.ndarray) -> float:
        way, length = (other - one)[:2], math.dist(one[:2], other[:2])
        size = (one[2] + other[2]) * np.abs(e - way / length).sum()
        return min(0.0, mu * (float(e @ way) - length + size))

    through = np.full(9, -np.inf)
    for chain in itertools.product(*(range(*ends) for ends in itertools.pairwise(first))):
        places = [np.zeros(3), *squares[list(chain)]]
        worth = stop[list(chain)].sum() + sum(map(leg, places, places[1:], lean))
        through[list(chain)] = np.maximum(through[list(chain)], worth)
    np.testing.assert_allclose(ahead + behind, through, rtol=1e-12)
