"""The paper's alternation: brute force, monotone ascent, its bound of the objective."""

import functools
import itertools

import numpy as np
import pytest
from one_aircraft import round_problem

from fl.arrays import Floats
from fl.radio.channel import (
    CHANNEL_PRESETS,
    Channel,
    LogisticFit,
    average_per,
    fit_logistic,
    smooth_per,
)
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner

SUBURBAN = CHANNEL_PRESETS["suburban"]


@pytest.fixture(scope="module")
def paper():
    """Loaded here, for it loads cvxpy, seconds that no process spends that only collects."""
    from mission.planner import paper

    return paper


def random_problem(seed, *, channel=SUBURBAN, budget=600.0):
    rng = np.random.default_rng(seed)
    return round_problem(
        devices_m=rng.uniform(0, 800, (6, 2)),
        importance=rng.uniform(0.5, 1.5, 6),
        start_m=rng.uniform(0, 800, 2),
        steps=5,
        per_step=2,
        path_budget_m=budget,
        channel=channel,
    )


def test_brute_force_on_a_tiny_case_is_not_beaten_and_nearly_reached():
    # Two moves of 260 m in all: one device can be overflown, the other two share what is left.
    problem = round_problem(
        devices_m=np.array([[150.0, 0.0], [260.0, 60.0], [-120.0, 160.0]]),
        importance=np.array([1.0, 1.2, 0.9]),
        start_m=np.zeros(2),
        steps=3,
        per_step=1,
        path_budget_m=260.0,
        channel=CHANNEL_PRESETS["suburban+10dB"],
    )
    grid = np.arange(-130.0, 270.0, 10.0)
    nodes = np.array([p for p in itertools.product(grid, grid) if np.hypot(*p) <= 260.0])
    success = 1.0 - average_per(
        problem.channel, np.hypot(*(nodes[:, None] - problem.devices_m).transpose(2, 0, 1))
    )
    at_start = 1.0 - average_per(problem.channel, np.hypot(*problem.devices_m.T))
    best = 0.0
    hop = np.hypot(*(nodes[:, None] - nodes).transpose(2, 0, 1))
    reachable = np.hypot(*nodes.T)[:, None] + hop <= 260.0
    worth = success * problem.importance
    for a, b, c in itertools.permutations(range(3)):
        total = at_start[a] * problem.importance[a] + worth[:, b][:, None] + worth[:, c]
        best = max(best, float(total[reachable].max()))
    plan = make_planner(PlannerConfig(kind="paper")).plan(problem)
    check_plan(problem, plan)
    assert plan.value >= 0.97 * best
    assert plan.value <= 1.02 * best  # the grid is 10 m wide


def _success(fit: LogisticFit, channel: Channel, r: Floats) -> Floats:
    return np.asarray(1.0 - smooth_per(fit, channel, r))


@pytest.mark.parametrize("preset", ["suburban+10dB", "suburban", "suburban+30dB"])
def test_the_exact_cone_never_loses_in_the_stand_in(paper, preset):
    for seed in range(3):
        problem = random_problem(seed, channel=CHANNEL_PRESETS[preset])
        program = paper.path_program(problem.steps, len(problem.devices_m), exact_cone=True)
        fit = fit_logistic(problem.channel)
        start = paper.greedy_walk(problem, functools.partial(_success, fit, problem.channel))
        values = [value for _, _, value in paper.ascend(problem, start, program=program)]
        assert len(values) > 2
        # Where the exponent is clipped the bound touches to within 1 / (1 + e^8) a device.
        slack = problem.importance.sum() / (1.0 + np.exp(paper.EXPONENT_LIMIT))
        assert all(b >= a - slack for a, b in itertools.pairwise(values))
        assert values[-1] > values[0] - slack


def test_the_tangent_bounds_the_stand_in_from_below_and_touches_it(paper):
    fit = fit_logistic(SUBURBAN)
    r = np.linspace(0.0, 900.0, 400)
    for around in (0.0, 40.0, 120.0, 160.0, 200.0, 500.0):
        intercept, slope = paper.tangent(fit, np.array([around]), height_m=SUBURBAN.altitude_m)
        plus_one = intercept - slope * r
        bound = 1.0 - 1.0 / plus_one[plus_one > 0.0]
        smooth = 1.0 - smooth_per(fit, SUBURBAN, r[plus_one > 0.0])
        assert np.all(bound <= smooth + 1e-9)
        touch = 1.0 - 1.0 / float(intercept[0] - slope[0] * around)
        assert touch == pytest.approx(1.0 - float(smooth_per(fit, SUBURBAN, around)), abs=4e-4)


def test_a_program_serves_all_rounds_of_its_size(paper):
    assert paper.path_program(5, 6, exact_cone=True) is paper.path_program(5, 6, exact_cone=True)
    assert isinstance(paper.path_program(4, 6, exact_cone=False), paper.PathProgram)


def test_a_path_step_agrees_with_the_program_written_out(paper):
    cp = paper.cp
    problem = random_problem(3)
    fit = fit_logistic(problem.channel)
    start = paper.greedy_walk(problem, lambda r: 1 - smooth_per(fit, problem.channel, r))
    program = paper.path_program(problem.steps, len(problem.devices_m), exact_cone=True)
    _, (path, _, _) = itertools.islice(paper.ascend(problem, start, program=program), 2)
    schedule = next(paper.ascend(problem, start, program=program))[1]
    # The paper's program with its slacks S, theta and r, for the scheduled pairs.
    v = cp.Variable((problem.steps, 2))
    height, gain = problem.channel.altitude_m, 0.0
    constraints = [v[0] == problem.start_m, cp.sum(cp.norm(cp.diff(v), axis=1)) <= 600.0]
    for n, k in np.argwhere(schedule):
        r0 = np.hypot(*(start[n] - problem.devices_m[k]))
        theta0 = np.arctan2(height, r0)
        s, theta, r = cp.Variable(), cp.Variable(), cp.Variable()
        tangent_at = min(theta0, (8.0 - fit.b2) / fit.b1_per_rad)
        e0 = np.exp(max(fit.b1_per_rad * tangent_at + fit.b2, -8.0))
        tangent_at = (np.log(e0) - fit.b2) / fit.b1_per_rad
        constraints += [
            s <= e0 * (1 + fit.b1_per_rad * (theta - tangent_at)),
            theta <= theta0 - height / (height**2 + r0**2) * (r - r0),
            r >= cp.norm(v[n] - problem.devices_m[k]),
        ]
        gain = gain + problem.importance[k] * (1 - cp.inv_pos(1 + s))
    reference = cp.Problem(cp.Maximize(gain), constraints)
    reference.solve(solver=cp.CLARABEL)

    def lower_bound(waypoints):
        total = 0.0
        for n, k in np.argwhere(schedule):
            r0 = np.hypot(*(start[n] - problem.devices_m[k]))
            intercept, slope = paper.tangent(fit, np.array([r0]), height_m=height)
            r = np.hypot(*(waypoints[n] - problem.devices_m[k]))
            total += problem.importance[k] * (1 - 1 / (intercept[0] - slope[0] * r))
        return total

    # 1 / (1 + S) is flat where S is in the thousands: Clarabel ends 1e-4 of the whole off the best.
    assert lower_bound(path) == pytest.approx(reference.value, rel=3e-4)


@pytest.mark.parametrize("kind", ["certified", "sqp", "paper"])
def test_planning_something_else_in_between_changes_nothing(kind):
    planner = make_planner(PlannerConfig(kind=kind))
    first = planner.plan(random_problem(1, budget=300.0))
    planner.plan(random_problem(2, budget=900.0))
    again = planner.plan(random_problem(1, budget=300.0))
    assert first.waypoints_m.tobytes() == again.waypoints_m.tobytes()
    assert (first.schedule == again.schedule).all()


def test_the_printed_version_runs_and_is_feasible():
    problem = random_problem(1)
    check_plan(problem, make_planner(PlannerConfig(kind="paper_literal")).plan(problem))


def test_the_walk_counts_each_device_once_and_keeps_to_the_budget(paper):
    problem = round_problem(
        devices_m=np.array([[100.0, 0.0], [110.0, 0.0], [-90.0, 0.0], [0.0, 700.0]]),
        importance=np.ones(4),
        start_m=np.zeros(2),
        steps=5,
        per_step=2,
        path_budget_m=400.0,
        channel=SUBURBAN,
    )
    walk = paper.greedy_walk(problem, lambda r: (np.asarray(r) < 30.0).astype(float))
    # The pair first, then the single one; the far one is out of reach, so the walk stays.
    assert walk.tolist() == [[0, 0], [100, 0], [-90, 0], [-90, 0], [-90, 0]]


@pytest.mark.parametrize(
    ("power", "budget_m", "way"),
    [
        # 100 m to what is worth 1, 30 m to what is worth 0.4, 104.403 m between them.
        (0.0, 204.404, [[100, 0], [0, 30], [0, 30]]),
        (0.0, 204.402, [[100, 0], [100, 0], [100, 0]]),
        (0.0, 100.0, [[100, 0], [100, 0], [100, 0]]),
        (0.0, 99.9, [[0, 30], [0, 30], [0, 30]]),
        (0.5, 204.404, [[100, 0], [0, 30], [0, 30]]),
        (1.0, 204.404, [[0, 30], [100, 0], [100, 0]]),
        (1.0, 29.9, [[0, 0], [0, 0], [0, 0]]),
    ],
)
def test_the_walk_goes_where_most_is_to_be_won_a_metre(paper, power, budget_m, way):
    problem = round_problem(
        np.array([[100.0, 0.0], [0.0, 30.0]]), np.array([1.0, 0.4]), np.zeros(2), 4, 1, budget_m,
        SUBURBAN,
    )  # fmt: skip
    walk = paper.greedy_walk(
        problem, lambda r: (np.asarray(r) < 20.0).astype(float), metre_power=power
    )
    assert walk.tolist() == [[0, 0], *way]


def test_right_below_the_start_a_metre_counts_as_one(paper):
    """Worth 0.9 at once, or 1 at two metres: 0.5 a metre."""
    problem = round_problem(
        np.array([[0.0, 0.0], [2.0, 0.0]]), np.array([0.9, 1.0]), np.zeros(2), 2, 1, 9.0, SUBURBAN
    )
    walks = [
        paper.greedy_walk(problem, lambda r: (np.asarray(r) < 1.0) * 1.0, metre_power=power)[1, 0]
        for power in (0.0, 1.0)
    ]
    assert walks == [2.0, 0.0]


@pytest.mark.parametrize(
    ("kind", "seed", "value"),
    [
        ("paper", 1, 2.9174035), ("paper_literal", 1, 1.9820546), ("paper_literal", 2, 3.2043289),
    ],
)  # fmt: skip
def test_what_the_alternation_comes_to_is_known(kind, seed, value):
    made = make_planner(PlannerConfig(kind=kind)).plan(random_problem(seed))
    assert made.value == pytest.approx(value, rel=1e-5)
