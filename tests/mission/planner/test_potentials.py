"""The bound from potentials, against plans and a solver that share nothing with it."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import LinearConstraint, milp
from scipy.sparse import coo_matrix
from test_certificate import SEEDS, random_problem
from test_places import CHANNELS, best_assignment, rewards

from fl.radio.channel import average_per
from mission.planner.arrays import instance
from mission.planner.certified import CertifiedPlanner
from mission.planner.check import check_plan
from mission.planner.evaluate import path_length
from mission.planner.native.library import (
    MOST_MESHES,
    Found,
    explore,
    lower_potentials,
    potential_bound,
)
from mission.planner.potentials import by_potentials, price_of_place
from mission.planner.sqp import SqpPlanner

ANYWHERE = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
MANY = settings(max_examples=25, deadline=None, derandomize=True)


def bound_of(problem, turns, *, plan=None, meshes=2, may_halve=False):
    """The bound after so many turns, from a plan or from none that is worth mentioning."""
    devices, limits = instance(problem)
    plan = plan or nothing_planned(problem, 1e-3 * devices.delta.max())
    return lower_potentials(
        devices, limits, plan=plan, price=price_of_place(devices, limits, plan), left_out=0.0,
        gap=0.0, turns=turns, meshes=meshes, may_halve=may_halve,
    )  # fmt: skip


def nothing_planned(problem, value):
    """A plan that is said to be worth that."""
    count = len(problem.devices_m)
    return Found(value, np.zeros((problem.steps, 2)), np.full(count, -1), np.inf)


def planned_bound(problem, plan, turns, *, gap=0.0):
    """The bound as it is made for a plan, without devices that are not worth a place."""
    devices, limits = instance(problem)
    return by_potentials(
        devices, limits, plan=plan, gap=gap, most_turns=turns, rough=False
    ).bound  # fmt: skip


def shrunk(problem, way):
    """The way, shrunk about the start onto the budget."""
    scale = min(1.0, problem.path_budget_m / max(path_length(way), 1e-9))
    return problem.start_m + (way - problem.start_m) * scale


def mesh_of(problem):
    """Vertices (rows, columns, 2) about the start, the side of a cell, and the start's indices."""
    u = problem.devices_m - problem.start_m
    low = np.maximum(np.minimum(u.min(axis=0), 0.0), -problem.path_budget_m)
    high = np.minimum(np.maximum(u.max(axis=0), 0.0), problem.path_budget_m)
    side = (high - low).max() / 16
    before = np.ceil(-low / side).astype(int)
    x, y = (side * np.arange(-b, a + 1) for b, a in zip(before, np.ceil(high / side), strict=True))
    return np.stack(np.meshgrid(x, y), axis=-1), side, (before[1], before[0])


def linear_on_triangles(values, east, north):
    """(..., rows - 1, columns - 1) at a place of every cell, whose diagonal goes north-east."""
    a, b, c, d = (
        values[..., :-1, :-1], values[..., :-1, 1:], values[..., 1:, :-1], values[..., 1:, 1:]
    )  # fmt: skip
    if east >= north:
        return (1.0 - east) * a + (east - north) * b + north * d
    return (1.0 - north) * a + (north - east) * c + east * d


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("devices", "steps", "per_step"), [(7, 4, 3), (11, 2, 20)], ids=["some", "all-at-once"]
)
@pytest.mark.parametrize("channel", ["suburban+10dB", "suburban+30dB", "high-rise"])
def test_the_bound_of_given_potentials_is_what_its_formula_says(
    seed, channel, devices, steps, per_step
):
    problem = random_problem(
        seed, devices=devices, steps=steps, per_step=per_step, budget=700.0, preset=channel
    )
    rng = np.random.default_rng(seed)
    places, side, start = mesh_of(problem)
    away = np.linalg.norm(places - (problem.devices_m - problem.start_m)[:, None, None], axis=-1)
    phi = problem.importance[:, None, None] * np.exp(-away / 200.0)
    phi += rng.uniform(0.0, 0.02, phi.shape)
    phi = np.maximum(0.0, phi - phi[:, start[0], start[1], None, None])
    phi = phi.astype(np.float32).astype(float)  # as they are stored
    chi = rng.uniform(-0.1, 0.1, phi.shape[1:])
    chi[start] = 0.0
    price = rng.uniform(0.0, 0.2, devices) * problem.importance
    given, limits = instance(problem)
    flat = np.ascontiguousarray(phi.reshape(devices, -1)), np.ascontiguousarray(chi.ravel())
    left_out = 0.1 * (seed % 2)
    # Where plans end, from one line of the mesh to another; both belong to it.
    lines = [(0, len(places) - 1), (0, len(places[0]) - 1)] if seed < 3 else [(0, 4), (3, 8)]
    here = tuple(slice(first, last + 1) for first, last in lines)
    corner = -side * np.array(start)
    ends = np.array([(corner + side * np.array(at))[::-1] for at in zip(*lines, strict=True)])
    as_it_is, raised = (
        potential_bound(given, limits, *flat, price, left_out=left_out, sampled=most, ends=ends)
        for most in (np.inf, 0.0)
    )
    floor = left_out * given.rows[0, 0]

    steepest = 0.0  # over directions, of what all potentials rise on a metre
    angles = np.linspace(0.0, 2.0 * np.pi, 2001)
    psi = chi - 0.5 * phi.sum(axis=0)
    for east, north in ((0.75, 0.25), (0.25, 0.75)):
        e = 1e-3  # differences within the triangle are those of its plane
        slopes = [
            np.stack([
                linear_on_triangles(f, east + e, north) - linear_on_triangles(f, east - e, north),
                linear_on_triangles(f, east, north + e) - linear_on_triangles(f, east, north - e),
            ]) / (2.0 * e * side)
            for f in (*phi, psi)
        ]  # fmt: skip
        for angle in angles:
            along = [np.cos(angle) * x + np.sin(angle) * y for x, y in slopes]
            rise = sum(np.maximum(0.0, one) for one in along[:-1]) + along[-1]
            steepest = max(steepest, rise.max())

    def stop_of(beyond):  # (..., K): what a stop is worth
        return np.sort(np.maximum(0.0, beyond), axis=-1)[..., -per_step:].sum(axis=-1)

    best, peaks = 0.0, price.copy()
    for east in np.linspace(0.0, 1.0, 17):
        for north in np.linspace(0.0, 1.0, 17):
            at = places[:-1, :-1] + side * np.array([east, north])
            beyond = rewards(problem, at + problem.start_m)
            beyond = beyond - floor - np.moveaxis(linear_on_triangles(phi, east, north), 0, -1)
            beyond = beyond[np.linalg.norm(at, axis=-1) <= problem.path_budget_m]
            best = max(best, stop_of(beyond - price).max())
            peaks = np.maximum(peaks, beyond.max(axis=0))
    at_start = rewards(problem, problem.start_m[None])[0] - floor
    rise = steepest * problem.path_budget_m - psi[here].min() + floor * steps * per_step
    sampled = rise + price.sum() + stop_of(at_start - price) + (steps - 1) * best
    assert sampled * (1.0 - 1e-6) <= as_it_is <= sampled * 1.03
    # Prices that are raised until no stop is worth anything are what each device earns at most.
    sampled = min(sampled, rise + peaks.sum())
    assert sampled * (1.0 - 1e-6) <= raised <= sampled * 1.03


def test_potentials_that_are_no_numbers_prove_nothing():
    problem = random_problem(0, devices=3)
    vertices = mesh_of(problem)[0][..., 0].size
    devices, limits = instance(problem)
    for broken in range(2):
        potentials = np.zeros((3, vertices)), np.zeros(vertices)
        potentials[broken].flat[-1] = np.nan
        bound = potential_bound(
            devices, limits, *potentials, np.zeros(3), sampled=0.0, ends=ANYWHERE
        )
        assert bound == np.inf


def test_potentials_on_another_mesh_are_refused():
    devices, limits = instance(random_problem(0, devices=3))
    with pytest.raises(ValueError, match="the mesh has not 4 vertices"):
        potential_bound(
            devices, limits, np.zeros((3, 4)), np.zeros(4), np.zeros(3), sampled=0.0, ends=ANYWHERE
        )


def test_a_crowd_has_as_many_meshes_as_there_is_memory_for():
    problem = random_problem(0, devices=3000, steps=50, preset="suburban+30dB")
    bounds = [bound_of(problem, 2, meshes=meshes) for meshes in (1, 2, MOST_MESHES)]
    assert bounds[2] == bounds[1] != bounds[0]


def test_more_meshes_prove_more():
    problem = random_problem(1, devices=150, steps=30, preset="suburban+10dB")
    devices, limits = instance(problem)
    plan = Found(*explore(devices, limits, starts=20, tries=100), np.inf)
    bounds = [bound_of(problem, 300, plan=plan, meshes=meshes) for meshes in (1, 2, 4)]
    assert plan.value <= bounds[2] < bounds[1] < bounds[0]


def test_a_bound_that_is_enough_is_not_lowered_further():
    problem = random_problem(1, devices=60, steps=30)
    plan = nothing_planned(problem, 0.5 * problem.importance.sum())
    quick, full = (planned_bound(problem, plan, 200, gap=gap) for gap in (0.5, 0.0))
    assert full < quick < np.inf


def test_a_bound_that_is_known_is_never_raised():
    problem = random_problem(2, devices=12, steps=8, preset="suburban+10dB")
    plan = dataclasses.replace(nothing_planned(problem, 0.1), bound=0.2)
    assert planned_bound(problem, plan, 20) == 0.2


def test_devices_that_are_not_worth_a_place_are_left_out_of_a_bound_above_the_best():
    """With two places, and eight devices at the start of which six cost more than they bring."""
    problem = random_problem(0, devices=8, steps=2, per_step=1, budget=2000.0, preset="suburban")
    there = np.tile(problem.start_m, (8, 1))
    importance = np.array([1.0, 0.9, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5])
    problem = dataclasses.replace(problem, devices_m=there, importance=importance)
    devices, limits = instance(problem)
    found = Found(*explore(devices, limits, starts=8, tries=20), np.inf)
    assert price_of_place(devices, limits, found) == pytest.approx(0.9, rel=1e-3)
    assert found.value <= planned_bound(problem, found, 200) <= 1.01 * found.value


def test_a_device_that_a_poor_plan_leaves_out_is_still_bounded():
    """The best serves it, at a price of places far below the poor plan's."""
    problem = random_problem(0, devices=3, steps=2, per_step=1, budget=50.0, preset="suburban")
    away_m = np.array([[0.0, 0.0], [600.0, 0.0], [0.0, 0.0]])
    problem = dataclasses.replace(
        problem, devices_m=problem.start_m + away_m, importance=np.array([10.0, 3.3, 2.6])
    )
    devices, _ = instance(problem)
    far_m = float(np.argmax(devices.rows[:, 0] < 0.3))
    poor = Found(5.9, np.array([[0.0, far_m], [600.0, 0.0]]), np.array([0, 1, -1]), np.inf)
    assert planned_bound(problem, poor, 1500) >= 12.6 * devices.rows[0, 0]


@pytest.mark.parametrize("meshes", [0, MOST_MESHES + 1])
def test_another_number_of_meshes_is_refused(meshes):
    with pytest.raises(ValueError, match=f"{meshes} meshes: there are 1 to {MOST_MESHES}"):
        bound_of(random_problem(0, devices=3), 1, meshes=meshes)


def planned_at_random(problem, rng, *, number):
    """Values of plans along devices in a random order, drawn together until they fit."""
    for _ in range(number):
        stops = problem.devices_m[rng.permutation(len(problem.devices_m))[: problem.steps - 1]]
        way = shrunk(problem, np.vstack([problem.start_m, stops]))
        way = np.vstack([way, np.tile(way[-1], (problem.steps - len(way), 1))])
        yield best_assignment(problem, way)


@MANY
@given(
    SEEDS,
    CHANNELS,
    st.integers(1, 30),
    st.integers(2, 20),
    st.integers(1, 5),
    st.floats(10.0, 2000.0),
)
def test_no_plan_lies_above_the_bound(seed, channel, devices, steps, per_step, budget):
    problem = random_problem(
        seed, devices=devices, steps=steps, per_step=per_step, budget=budget, preset=channel
    )
    plan = SqpPlanner(starts=20, tries=100).plan(problem)
    check_plan(problem, plan)
    others = [plan.value, *planned_at_random(problem, np.random.default_rng(seed), number=10)]
    devices_c, limits = instance(problem)
    known = Found(*explore(devices_c, limits, starts=8, tries=20), np.inf)
    for turns, meshes in itertools.product((1, 7, 40), (1, 2, 3)):
        for given_plan in (None, known):
            bound = bound_of(problem, turns, plan=given_plan, meshes=meshes)
            assert max(others) <= bound * (1.0 + 1e-9) < np.inf
    assert max(others) <= bound_of(problem, 40, plan=known, meshes=MOST_MESHES) * (1.0 + 1e-9)
    assert max(others) <= planned_bound(problem, known, 40) * (1.0 + 1e-9)


def of_whole_and_halves(problem, plan, turns):
    """The bound of all plans at once, and of those that end in either half each by itself."""
    return [
        bound_of(problem, turns, plan=plan, meshes=3, may_halve=may_halve)
        for may_halve in (False, True)
    ]


@pytest.mark.parametrize("channel", ["suburban+10dB", "dense-urban"])
def test_no_plan_lies_above_the_bound_of_both_halves(channel):
    lowered = 0
    for seed in range(4):
        problem = random_problem(seed, devices=30, steps=12, budget=700.0, preset=channel)
        devices, limits = instance(problem)
        plan = Found(*explore(devices, limits, starts=8, tries=300), np.inf)
        best = max(plan.value, *planned_at_random(problem, np.random.default_rng(seed), number=10))
        # A value is made up that leaves as much open as makes it worth while to halve the area.
        claimed = plan
        for _ in range(4):
            whole = bound_of(problem, 200, plan=claimed, meshes=3)
            claimed = dataclasses.replace(plan, value=0.92 * whole)
        whole, halves = of_whole_and_halves(problem, claimed, 200)
        assert best * (1.0 - 1e-9) <= halves <= whole
        lowered += halves < whole
    assert lowered > 0


def sixty_devices(seed):
    """A problem, and a plan of it."""
    problem = random_problem(seed, devices=60, steps=30, preset="suburban+10dB")
    return problem, Found(*explore(*instance(problem), starts=20, tries=100), np.inf)


def test_halves_prove_more():
    problem, plan = sixty_devices(4)
    whole, halves = of_whole_and_halves(problem, plan, 800)
    assert plan.value <= halves <= 0.991 * whole


def test_both_halves_count():
    """Turned about the start by half a circle, what was the first half is the second."""
    problem, plan = sixty_devices(10)
    turned = dataclasses.replace(problem, devices_m=2.0 * problem.start_m - problem.devices_m)
    bounds = [bound_of(one, 300, plan=plan, meshes=3, may_halve=True) for one in (problem, turned)]
    assert bounds[0] == pytest.approx(bounds[1], rel=5e-3)


@pytest.mark.parametrize("meshes", [2, 3])
@pytest.mark.parametrize("channel", ["suburban", "suburban+30dB", "suburban-log-variance"])
def test_a_crowd_in_one_place_is_approached_as_far_as_the_budget_goes(channel, meshes):
    problem = random_problem(0, devices=60, steps=21, budget=800.0, preset=channel)
    there = problem.start_m + 900.0 * np.array([np.cos(0.3), np.sin(0.3)])
    problem = dataclasses.replace(problem, devices_m=np.tile(there, (60, 1)))
    best = float(
        ((1.0 - average_per(problem.channel, np.array([100.0]))) * problem.importance).sum()
    )
    bound = bound_of(problem, 1500, plan=nothing_planned(problem, best), meshes=meshes)
    assert best * (1.0 - 1e-9) <= bound <= 1.1 * best


def test_devices_on_opposite_sides_are_not_both_reached():
    """What a bound by distance from the start alone cannot see."""
    problem = random_problem(0, devices=4, steps=12, budget=600.0, preset="suburban+10dB")
    sides = 600.0 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    problem = dataclasses.replace(problem, devices_m=problem.start_m + sides, importance=np.ones(4))
    assert 1.0 - 1e-9 <= bound_of(problem, 800) <= 1.15


@pytest.mark.parametrize("channel", ["suburban+10dB", "high-rise"])
def test_few_stops_serve_fewer_devices_than_the_path_passes(channel):
    """What a bound that lets a path stop as often as it likes cannot see."""
    problem = random_problem(0, devices=24, steps=4, per_step=24, budget=900.0, preset=channel)
    angles = np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
    ring = 250.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    problem = dataclasses.replace(problem, devices_m=problem.start_m + ring, importance=np.ones(24))
    quick = CertifiedPlanner(max_nodes=100)
    plan = quick.plan(problem)
    often = quick.plan(dataclasses.replace(problem, steps=25))
    assert plan.value <= bound_of(problem, 1500) <= 0.7 * often.value


def by_grid(problem, *, spacing, slack_m):
    """The best plan with its stops on a grid, by HiGHS, and what no plan at all exceeds.

    A time-expanded network: one arc a leg, from place to place. With `slack_m` the reward of a
    place is the most within that distance, and a leg may be twice that much longer than it is: what
    any plan turns into when each of its stops is moved to the nearest place of the grid.
    """
    low = np.minimum(problem.devices_m.min(axis=0), problem.start_m)
    high = np.maximum(problem.devices_m.max(axis=0), problem.start_m)
    lines = [
        np.arange(a + spacing / 2, b + spacing / 2, spacing) for a, b in zip(low, high, strict=True)
    ]
    grid = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
    places, legs, devices = len(grid), problem.steps - 1, len(problem.devices_m)
    away = np.linalg.norm(grid[:, None] - problem.devices_m, axis=-1)
    worth = problem.importance * (1.0 - average_per(problem.channel, np.maximum(0, away - slack_m)))
    at_start = rewards(problem, problem.start_m[None])[0]
    first = np.maximum(0.0, np.linalg.norm(grid - problem.start_m, axis=1) - slack_m)
    between = np.maximum(0.0, np.linalg.norm(grid[:, None] - grid, axis=-1) - 2.0 * slack_m)
    # Columns: the first arcs, further arcs (leg, from, to), who is served at each stop and start.
    arcs = places + (legs - 1) * places**2
    serves = legs * places * devices
    columns = arcs + serves + devices
    arc = np.arange(places, arcs).reshape(legs - 1, places, places)
    serve = np.arange(arcs, arcs + serves).reshape(legs, places, devices)
    served_at_start = np.arange(arcs + serves, columns)
    gain = np.zeros(columns)
    gain[serve] = worth[None]
    gain[served_at_start] = at_start
    rows, where, weight = [], [], []
    low_side: list[float] = []
    high_side: list[float] = []

    def constrain(columns, weights, lower, upper):
        rows.append(np.full(len(columns), len(low_side)))
        where.append(columns)
        weight.append(np.broadcast_to(weights, len(columns)))
        low_side.append(lower)
        high_side.append(upper)

    constrain(np.arange(places), 1.0, 1.0, 1.0)
    lengths = np.concatenate([first, np.tile(between.ravel(), legs - 1)])
    constrain(np.arange(arcs), lengths, 0.0, problem.path_budget_m)
    constrain(served_at_start, 1.0, 0.0, problem.per_step)
    for k in range(devices):
        constrain(np.append(serve[:, :, k].ravel(), served_at_start[k]), 1.0, 0.0, 1.0)
    for n in range(legs):
        for c in range(places):
            into = np.array([c]) if n == 0 else arc[n - 1, :, c]
            if n + 1 < legs:
                out = arc[n, c]
                constrain(np.r_[into, out], np.r_[np.ones(len(into)), -np.ones(places)], 0.0, 0.0)
            constrain(
                np.r_[serve[n, c], into],
                np.r_[np.ones(devices), np.full(len(into), -float(problem.per_step))],
                -np.inf, 0.0,
            )  # fmt: skip
    matrix = coo_matrix(
        (np.concatenate(weight), (np.concatenate(rows), np.concatenate(where))),
        shape=(len(low_side), columns),
    )
    found = milp(
        -gain,
        constraints=LinearConstraint(matrix.tocsr(), low_side, high_side),
        integrality=np.r_[np.ones(arcs), np.zeros(columns - arcs)],
        bounds=(0.0, 1.0),
        options={"mip_rel_gap": 1e-4, "time_limit": 300.0},
    )
    assert found.x is not None
    return -found.fun, -found.mip_dual_bound


@pytest.mark.slow
@pytest.mark.parametrize(
    ("devices", "steps", "per_step", "channel"),
    [
        (30, 3, 3, "suburban"),
        (30, 4, 2, "suburban+10dB"),
        (12, 4, 1, "suburban-log-variance"),
    ],
)
def test_bounds_agree_with_an_integer_programme_on_a_grid(devices, steps, per_step, channel):
    problem = random_problem(
        devices + steps, devices=devices, steps=steps, per_step=per_step, preset=channel
    )
    spacing = 220.0
    plan = CertifiedPlanner().plan(problem)
    check_plan(problem, plan)
    reached, _ = by_grid(problem, spacing=spacing, slack_m=0.0)
    assert reached <= plan.upper_bound * (1.0 + 1e-9)
    assert reached <= bound_of(problem, 100) * (1.0 + 1e-9)
    _, allowed = by_grid(problem, spacing=spacing, slack_m=spacing * np.sqrt(0.5))
    assert plan.value <= allowed * (1.0 + 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("devices", "channel", "gap"),
    [(100, "suburban", 0.05), (100, "suburban+30dB", 0.025), (300, "suburban", 0.05)],
)
def test_large_plans_are_proven_to_a_few_percent(devices, channel, gap):
    problem = random_problem(1, devices=devices, steps=50, preset=channel)
    plan = CertifiedPlanner().plan(problem)
    check_plan(problem, plan)
    assert 0.0 <= plan.gap <= gap


def test_without_nodes_nothing_is_searched_and_the_bound_is_still_one():
    problem = random_problem(1, devices=100, steps=50)
    quick, full = CertifiedPlanner(max_nodes=0).plan(problem), CertifiedPlanner().plan(problem)
    assert quick.value == full.value
    assert full.value <= full.upper_bound < quick.upper_bound
