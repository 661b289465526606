"""Scheduling against the linear program of the paper, solved by HiGHS."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from mission.planner.schedule import assign


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
    assert value == pytest.approx(linear_program(success, importance, per_step), rel=1e-9)


def test_what_is_worth_nothing_is_not_scheduled():
    schedule = assign(np.array([[0.0, 1.0, 1.0]]), np.array([1.0, 0.0, 1.0]), 3)
    assert schedule.tolist() == [[False, False, True]]


def test_more_places_than_devices():
    schedule = assign(np.array([[0.2, 0.3], [0.4, 0.1]]), np.ones(2), 50)
    assert schedule.tolist() == [[False, True], [True, False]]


def test_no_device_and_no_place():
    assert assign(np.zeros((3, 0)), np.zeros(0), 2).shape == (3, 0)
    assert not assign(np.ones((3, 2)), np.ones(2), 0).any()
