"""Scheduling against the linear program of the paper, solved by HiGHS, and SciPy's assignment."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment, linprog

from mission.planner.native.library import Devices, PathLimits, assign, match


def linear_program(success, importance, per_step):
    """The relaxation omega in [0, 1] as it stands in the paper."""
    steps, devices = success.shape
    once = np.tile(np.eye(devices), steps)
    full = np.kron(np.eye(steps), np.ones(devices))
    result = linprog(
        -(success * importance).ravel(),
        A_ub=np.vstack([once, full]),
        b_ub=np.r_[np.ones(devices), np.full(steps, per_step)],
        bounds=(0, 1),
        method="highs",
    )
    return -result.fun


@settings(deadline=None)  # a loaded machine is no failure
@given(st.integers(1, 6), st.integers(1, 9), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_the_schedule_is_as_good_as_the_relaxed_linear_program(steps, devices, per_step, seed):
    rng = np.random.default_rng(seed)
    success = rng.random((steps, devices)) ** 3
    importance = rng.random(devices)
    schedule = assign(success, importance, per_step)
    assert schedule.sum(axis=0).max() <= 1
    assert schedule.sum(axis=1).max() <= per_step
    value = (success * importance)[schedule].sum()
    best = linear_program(success, importance, per_step)
    assert value >= best * (1.0 - 1e-9)
    assert value <= best * (1.0 + 1e-7)  # HiGHS keeps constraints, and costs, to 1e-7


def test_what_is_worth_nothing_is_not_scheduled():
    schedule = assign(np.array([[0.0, 1.0, 1.0]]), np.array([1.0, 0.0, 1.0]), 3)
    assert schedule.tolist() == [[False, False, True]]


def test_more_places_than_devices():
    schedule = assign(np.array([[0.2, 0.3], [0.4, 0.1]]), np.ones(2), 50)
    assert schedule.tolist() == [[False, True], [True, False]]


def test_no_device_and_no_place():
    assert assign(np.zeros((3, 0)), np.zeros(0), 2).shape == (3, 0)
    assert not assign(np.ones((3, 2)), np.ones(2), 0).any()


def crowds():
    """Devices in clusters, so that steps overflow; positions, table and limits."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        count, steps, per_step = rng.integers(1, 40), rng.integers(2, 9), rng.integers(1, 4)
        r = np.arange(2000.0)
        f = np.exp(-((r / 80.0) ** 2))
        rows = np.stack([f, np.gradient(f), np.gradient(np.gradient(f))], axis=1)
        u = rng.normal(0.0, rng.choice([10.0, 150.0]), (count, 2))
        way = rng.choice([1.0, 0.0], (steps, 1)) * rng.normal(0.0, 100.0, (steps, 2))
        yield Devices(u, rng.random(count), rows), PathLimits(int(steps), int(per_step), 1.0), way


def optimum(worth, per_step):
    """What SciPy's assignment earns with `per_step` copies of every step."""
    copies = np.repeat(worth, per_step, axis=0)
    return copies[linear_sum_assignment(copies, maximize=True)].sum()


def test_the_assignment_of_a_search_is_optimal():
    crowded = 0
    for devices, limits, way in crowds():
        value, assigned = match(devices, limits, way)
        distance = np.hypot(*(way[:, None] - devices.u).transpose(2, 0, 1))
        i = np.rint(distance).astype(int)
        d = distance - i
        f, f1, f2 = devices.rows[i].transpose(2, 0, 1)
        worth = (f + (f1 + 0.5 * f2 * d) * d) * devices.delta
        best = optimum(worth, limits.per_step)
        assert value == pytest.approx(best, rel=1e-9, abs=1e-12)
        served = [(n, k) for k, n in enumerate(assigned) if n >= 0]
        assert sum(worth[n, k] for n, k in served) == pytest.approx(best, rel=1e-9, abs=1e-12)
        load = np.bincount([n for n, _ in served] or [0], minlength=limits.steps)
        assert load.max() <= limits.per_step
        crowded += len(served) < len(devices.delta)
        schedule = assign(worth / devices.delta, devices.delta, limits.per_step)
        assert worth[schedule].sum() == pytest.approx(best, rel=1e-9, abs=1e-12)
    assert crowded > 20
