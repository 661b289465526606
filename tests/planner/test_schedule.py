"""Scheduling against the linear program of the paper, solved by HiGHS."""

import json
import os
import subprocess
import sys

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


# The compiled assignment, run as plain Python: devices in clusters, so that steps overflow.
PROGRAM = """
import json
import numpy as np
from mission.planner.kernels.instance import Devices
from mission.planner.kernels.matching import make_matching, match
answers = []
for seed in range(60):
    rng = np.random.default_rng(seed)
    count, steps, per_step = rng.integers(1, 40), rng.integers(1, 8), rng.integers(1, 4)
    r = np.arange(2000.0)
    f = np.exp(-((r / 80.0) ** 2))
    rows = np.stack([f, np.gradient(f), np.gradient(np.gradient(f))], axis=1)
    u = rng.normal(0.0, rng.choice([10.0, 150.0]), (count, 2))
    way = rng.choice([1.0, 0.0], (steps, 1)) * rng.normal(0.0, 100.0, (steps, 2))
    devices = Devices(u, rng.random(count), rows)
    assigned = np.zeros(count, dtype=np.int64)
    room = make_matching(count, steps, per_step)
    value = match(way, int(per_step), devices, assigned, room)
    i = np.rint(np.hypot(*(way[:, None] - u).transpose(2, 0, 1)))
    d = np.hypot(*(way[:, None] - u).transpose(2, 0, 1)) - i
    i = i.astype(int)
    success = rows[i, 0] + (rows[i, 1] + 0.5 * rows[i, 2] * d) * d
    answers.append({"success": success.tolist(), "importance": devices.delta.tolist(),
                    "per_step": int(per_step), "value": float(value),
                    "assigned": assigned.tolist()})
print(json.dumps(answers))
"""


def test_the_compiled_assignment_is_optimal():
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    )  # fmt: skip
    crowded = 0
    for case in json.loads(run.stdout):
        success, importance = np.array(case["success"]), np.array(case["importance"])
        worth = success * importance
        best = worth[assign(success, importance, case["per_step"])].sum()
        assert case["value"] == pytest.approx(best, rel=1e-9, abs=1e-12)
        served = [(n, k) for k, n in enumerate(case["assigned"]) if n >= 0]
        assert sum(worth[n, k] for n, k in served) == pytest.approx(best, rel=1e-9, abs=1e-12)
        load = np.bincount([n for n, _ in served] or [0], minlength=len(success))
        assert load.max() <= case["per_step"]
        crowded += len(served) < len(importance)
    assert crowded > 20
