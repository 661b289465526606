"""Sequential quadratic programs, and changes at random: steps against cvxpy, what they keep to, and
what they bring."""

from typing import Any

import numpy as np
import pytest
from again import again
from one_aircraft import round_problem

from fl.radio.channel import CHANNEL_PRESETS
from flightdyn.config import LimitsConfig
from mission.base.airspace import Airspace
from mission.planner.certified import CertifiedPlanner
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import fit_budget, objective, plan_along
from mission.planner.factory import make_planner
from mission.planner.flyable import share_of
from mission.planner.improving import fitted, serving_fewer, varied
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.planner.sqp import (
    _DEGREES,
    SqpPlanner,
    StepProgram,
    ascended,
    reward_model,
    surroundings,
)

FLYING = Performance(20.0, 5.0, LimitsConfig())
WALLS = tuple(
    np.array([[x, low], [x + 20, low], [x + 20, low + 600], [x, low + 600]])
    for x, low in ((150.0, 0.0), (330.0, 200.0), (510.0, 0.0), (690.0, 200.0))
)
MAZE = Airspace(WALLS, None, 10.0)


def random_problem(seed, *, devices=12, steps=10, budget=800.0, preset="suburban", **more):
    rng = np.random.default_rng(seed)
    return round_problem(
        devices_m=rng.uniform(0, 800, (devices, 2)),
        importance=rng.uniform(0.2, 1.5, devices),
        start_m=rng.uniform(0, 100, 2),
        steps=steps,
        per_step=3,
        path_budget_m=budget,
        channel=CHANNEL_PRESETS[preset],
        **more,
    )


def zigzag(problem, length):
    rng = np.random.default_rng(4)
    way = np.cumsum(rng.normal(size=(problem.steps, 2)), axis=0) * 1e3
    return fit_budget(problem.start_m + way - way[0], length)


@pytest.mark.parametrize("budget", [701.0, 800.0])  # which holds a step of 40 m back, and does not
@pytest.mark.parametrize("steps", [3, 5, 12])
def test_a_step_agrees_with_cvxpy(steps, budget):
    import cvxpy as cp  # seconds, with scipy.stats: not of every process that collects

    problem = random_problem(steps, steps=steps, budget=budget)
    plan = plan_along(problem, zigzag(problem, 700.0))
    model = surroundings(problem, plan)
    step = StepProgram(steps).solve(model, 40.0)

    d, legs = cp.Variable((steps - 1, 2)), cp.Variable(steps - 1)
    straight = np.diff(plan.waypoints_m, axis=0)
    moved = straight + d - cp.vstack([np.zeros((1, 2)), d[:-1]])
    scale = 1.0 / np.abs(model.gradient).max()
    gain = cp.sum(cp.multiply(scale * model.gradient, d))
    for n, (xx, xy, yy) in enumerate(model.hessian * scale):
        block = np.array([[xx, xy], [xy, yy]]) + 1e-4 * np.eye(2)
        gain -= 0.5 * cp.quad_form(d[n], cp.psd_wrap(block))
    present = np.linalg.norm(straight, axis=1).sum()
    constraints = [cp.sum(legs) <= present + model.spare_m, cp.abs(d) <= 40.0]
    for n, (x, y) in enumerate(straight):
        for degrees in _DEGREES:
            angle = np.arctan2(y, x) + np.radians(degrees)
            constraints.append(moved[n] @ [np.cos(angle), np.sin(angle)] <= legs[n])
    reference = cp.Problem(cp.Maximize(gain), constraints)
    reference.solve(solver=cp.CLARABEL)
    d.value = step
    assert float(gain.value) == pytest.approx(reference.value, rel=1e-2)


def test_the_model_is_the_derivative_of_the_objective():
    problem = random_problem(2, devices=10, steps=6)
    plan = plan_along(problem, zigzag(problem, 600.0))
    gradient, hessian = reward_model(problem, plan)
    for n in range(1, 6):
        for i in range(2):
            up, down = plan.waypoints_m.copy(), plan.waypoints_m.copy()
            up[n, i] += 0.01
            down[n, i] -= 0.01
            worth = [objective(problem, way, plan.schedule[0]) for way in (up, down)]
            assert gradient[n, i] == pytest.approx((worth[0] - worth[1]) / 0.02, abs=1e-5)
    assert (hessian[:, 0] * hessian[:, 2] - hessian[:, 1] ** 2 > -1e-12).all()


KINDS: dict[str, dict[str, Any]] = {
    "metres": {},
    "deadline": {"limits": RoundLimits(FLYING, 32.0)},
    "energy": {"limits": RoundLimits(FLYING, energy_j=8000.0)},
    "maze": {"airspace": MAZE, "budget": 1500.0},
    "maze and deadline": {
        "airspace": MAZE, "budget": 1500.0, "limits": RoundLimits(FLYING, 60.0),
    },
}  # fmt: skip


@pytest.mark.parametrize("seed", range(2))
def test_steps_never_lose_and_keep_to_the_metres(seed):
    problem = random_problem(seed)
    before = plan_along(problem, zigzag(problem, 640.0))
    after = ascended(problem, before)
    check_plan(problem, after)
    assert after.value > before.value * 1.01


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("tolerance", [0.0, 0.02])
def test_changes_at_random_never_lose_and_keep_to_all_limits(kind, tolerance):
    for seed in range(2):
        problem = random_problem(seed, **KINDS[kind])
        before = fitted(problem, zigzag(problem, 0.8 * problem.path_budget_m))
        assert before is not None
        after = varied(problem, before, 1000, tolerance=tolerance, seed=seed)
        check_plan(problem, after)
        assert after.value > before.value * 1.01
        assert np.array_equal(after.waypoints_m[0], before.waypoints_m[0])
        assert varied(problem, after, 0).value == after.value


def climbed(problem, plan, *, tries):
    """What a hill climber makes of a plan: waypoints moved, straightened, put elsewhere at random;
    it shares nothing with the improver but what a plan is worth and takes."""
    rng, best = np.random.default_rng(1), plan
    for turn in range(tries):
        stride, kind = 60.0 * (1.0 - turn / tries) + 2.0, rng.random()
        way, n = best.waypoints_m.copy(), int(rng.integers(1, problem.steps))
        if kind < 0.5:
            way[n] += rng.normal(0.0, stride, 2)
        elif kind < 0.7:
            way[n:] += rng.normal(0.0, stride, 2)
        elif kind < 0.8:
            way[n] = (way[n - 1] + way[min(n + 1, problem.steps - 1)]) / 2.0
        elif kind < 0.9:
            near = problem.devices_m[rng.integers(len(problem.devices_m))]
            place = near + rng.normal(0.0, stride / 2.0, 2)
            way = np.insert(np.delete(way, n, axis=0), rng.integers(1, len(way)), place, axis=0)
        else:
            way = way[0] + (way - way[0]) * (1.0 + rng.normal(0.0, 0.03))
        other = plan_along(problem, way)
        if other.path_m > problem.most_m or other.value <= best.value:
            continue
        other = serving_fewer(problem, other)
        if share_of(problem, other) <= 1.0 and other.value > best.value:
            best = other
    return best.value


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["energy", "maze and deadline", *again(["maze", "deadline"])])
def test_no_hill_climber_finds_much_better_plans(kind):
    for seed, preset in ((3, "suburban+10dB"), (5, "suburban")):
        problem = random_problem(seed, preset=preset, **KINDS[kind])
        plan = make_planner(PlannerConfig()).plan(problem)
        check_plan(problem, plan)
        assert climbed(problem, plan, tries=250) <= 1.015 * plan.value


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["suburban+10dB", "suburban", "suburban+30dB"])
def test_both_beat_the_alternation(preset):
    for seed in range(2):
        problem = random_problem(seed, preset=preset)
        paper = make_planner(PlannerConfig(kind="paper")).plan(problem).value
        certified = CertifiedPlanner().plan(problem)
        sqp = SqpPlanner().plan(problem)
        check_plan(problem, sqp)
        assert paper <= certified.value * (1 + 1e-3)
        assert certified.value * 0.9 <= sqp.value <= certified.upper_bound


def test_hundreds_of_devices():
    problem = random_problem(0, devices=300, steps=30)
    plan = SqpPlanner().plan(problem)
    check_plan(problem, plan)
    assert plan.schedule.sum() > 60
    assert np.isnan(plan.upper_bound)
