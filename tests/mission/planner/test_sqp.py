"""The quadratic programs of `sqp`: against cvxpy, and what they are for."""

import cvxpy as cp
import numpy as np
import pytest
from scipy.optimize import linprog

from fl.radio.channel import CHANNEL_PRESETS
from mission.planner.arrays import instance
from mission.planner.certified import CertifiedPlanner
from mission.planner.check import check_plan
from mission.planner.evaluate import path_length
from mission.planner.paper.alternation import PaperPlanner
from mission.planner.problem import RoundProblem
from mission.planner.sqp import DIRECTIONS, SqpPlanner, StepProgram, ascend, match, model


def random_problem(seed, *, devices, steps, budget=800.0, preset="suburban"):
    rng = np.random.default_rng(seed)
    return RoundProblem(
        devices_m=rng.uniform(0, 800, (devices, 2)),
        importance=rng.uniform(0.2, 1.5, devices),
        start_m=rng.uniform(0, 800, 2),
        steps=steps,
        per_step=3,
        path_budget_m=budget,
        channel=CHANNEL_PRESETS[preset],
    )


def zigzag(problem, length):
    rng = np.random.default_rng(4)
    way = np.cumsum(rng.normal(size=(problem.steps, 2)), axis=0)
    way -= way[0]
    return way * length / path_length(way)


@pytest.mark.parametrize("steps", [3, 5, 12])
def test_a_step_agrees_with_cvxpy(steps):
    problem = random_problem(steps, devices=12, steps=steps)
    devices, limits = instance(problem)
    way = zigzag(problem, 700.0)
    _, at, served = match(way, devices, limits)
    gradient, hessian = model(way, at, served, devices)
    step = StepProgram(steps).solve(way, gradient, hessian, budget_m=800.0, trust_m=40.0)

    d = cp.Variable((steps - 1, 2))
    legs = cp.Variable(steps - 1)
    moved = way[1:] + d
    previous = cp.vstack([way[:1], moved[:-1]])
    scale = 1.0 / np.abs(gradient[1:]).max()
    curved = 0.0
    for n in range(steps - 1):
        xx, xy, yy = hessian[n + 1] * scale
        block = np.array([[xx, xy], [xy, yy]]) + 1e-4 * np.eye(2)
        curved += cp.quad_form(d[n], cp.psd_wrap(block))
    constraints = [cp.sum(legs) <= 800.0, cp.abs(d) <= 40.0]
    for i in range(DIRECTIONS):
        angle = 2 * np.pi * i / DIRECTIONS
        direction = np.array([np.cos(angle), np.sin(angle)]) / np.cos(np.pi / DIRECTIONS)
        constraints.append((moved - previous) @ direction <= legs)
    gain = cp.sum(cp.multiply(scale * gradient[1:], d)) - 0.5 * curved
    reference = cp.Problem(cp.Maximize(gain), constraints)
    reference.solve(solver=cp.CLARABEL)
    d.value = step
    assert float(gain.value) == pytest.approx(reference.value, rel=5e-3)
    assert path_length(np.vstack([way[:1], way[1:] + step])) <= 800.0 + 1.0


def test_the_model_is_the_derivative_of_the_objective():
    problem = random_problem(2, devices=10, steps=6)
    devices, limits = instance(problem)
    way = zigzag(problem, 600.0)
    _, at, served = match(way, devices, limits)
    gradient, _ = model(way, at, served, devices)

    def earned(points):
        from fl.radio.channel import average_per

        r = np.hypot(*(points[at] - devices.u[served]).T)
        return ((1 - average_per(problem.channel, r)) * devices.delta[served]).sum()

    for n in range(1, 6):
        for i in range(2):
            up, down = way.copy(), way.copy()
            up[n, i] += 0.01
            down[n, i] -= 0.01
            slope = (earned(up) - earned(down)) / 0.02
            assert gradient[n, i] == pytest.approx(slope, abs=1e-5)


def test_neighbours_only_lose_nothing_in_the_assignment():
    problem = random_problem(8, devices=40, steps=6, preset="suburban+10dB")
    devices, limits = instance(problem)
    way = zigzag(problem, 800.0)
    value, _, _ = match(way, devices, limits)
    from fl.radio.channel import average_per

    distance = np.hypot(*(way[:, None] - devices.u).transpose(2, 0, 1))
    worth = (1 - average_per(problem.channel, distance)) * devices.delta
    once, full = np.tile(np.eye(40), 6), np.kron(np.eye(6), np.ones(40))
    best = -linprog(
        -worth.ravel(), A_ub=np.vstack([once, full]), b_ub=np.r_[np.ones(40), np.full(6, 3)],
        bounds=(0, 1), method="highs",
    ).fun  # fmt: skip
    assert value == pytest.approx(best, rel=2e-3)


def test_the_ascent_never_loses_and_keeps_the_budget():
    for seed in range(3):
        problem = random_problem(seed, devices=30, steps=12)
        devices, limits = instance(problem)
        way = zigzag(problem, 790.0)
        before = match(way, devices, limits)[0]
        after_way = ascend(way, devices, limits)
        assert match(after_way, devices, limits)[0] > before * 1.01
        assert path_length(after_way) <= 800.0 + 1e-6
        assert np.array_equal(after_way[0], way[0])


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["suburban+10dB", "suburban", "suburban+30dB"])
def test_both_beat_the_alternation(preset):
    for seed in range(3):
        problem = random_problem(seed, devices=12, steps=10, preset=preset)
        paper = PaperPlanner().plan(problem).value
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
