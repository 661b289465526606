"""The dual bound of one visiting order, against the primal program solved by cvxpy.

The compiled functions call each other only; here they run as plain Python in a process of their
own, where numba is switched off.
"""

import json
import os
import subprocess
import sys

import cvxpy as cp
import numpy as np
import pytest

from fl.radio import CHANNEL_PRESETS, average_per

PROGRAM = """
import json, sys
import numpy as np
from fl.radio import CHANNEL_PRESETS
from mission.planner.arrays import instance, relax
from mission.planner.kernels.dual import minimise
from mission.planner.kernels.lagrangian import FREE, make_work, spline
from mission.planner.problem import RoundProblem
answers = []
for case in json.load(sys.stdin):
    u = np.array(case["u"])
    m = len(u)
    problem = RoundProblem(u, np.array(case["delta"]), np.zeros(2), m, 1, case["length"],
                           CHANNEL_PRESETS[case["preset"]])
    devices, limits = instance(problem)
    relaxation = relax(problem, devices)
    last = len(relaxation.radii) - 1
    rows = np.array([relaxation.row[lo, hi] for lo, hi in case["intervals"]])
    factor = np.array([FREE if merged else 1.0 for merged in case["merged"]])
    bound, steps, centred = minimise(
        m, np.arange(m), rows, factor, devices, relaxation, limits.length, case["eps"], -1e9, 0.0,
        np.zeros((m, 2)), np.array([0.003]), make_work(m))
    past = []
    for row in range(0, len(rows)):
        c, ds, hi = relaxation.coefficients[rows[row]], relaxation.spacing[rows[row]], \
            relaxation.hi[rows[row]]
        s = ds * np.array([0.0, 0.4, 7.3, 30.0, len(c) - 3 - 1e-9, len(c) - 3, len(c) + 20.0])
        past.append([s.tolist(), [spline(x, c, ds, hi)[0] for x in s]])
    ends = [[float(relaxation.radii[e]) for e in relaxation.ends[row]] for row in rows]
    answers.append({"bound": float(bound), "steps": steps, "centred": bool(centred),
                    "ends": ends, "splines": past})
print(json.dumps(answers))
"""


def envelope(channel, lo, hi):
    """Lines whose least is the concave envelope on [0, hi] of f on [lo, hi]."""
    r = np.linspace(lo, hi, 1500)
    f = 1 - average_per(channel, r)
    hull = [int(f.argmax())]
    for i in range(hull[0] + 1, len(r)):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            if (f[b] - f[a]) * (r[i] - r[a]) <= (f[i] - f[a]) * (r[b] - r[a]):
                hull.pop()
            else:
                break
        hull.append(i)
    slope = np.diff(f[hull]) / np.diff(r[hull])
    return np.r_[0.0, slope], np.r_[f.max(), f[hull][:-1] - slope * r[hull][:-1]]


def primal(case, ends):
    """The most a path in this order can earn with every f replaced by its envelope."""
    channel = CHANNEL_PRESETS[case["preset"]]
    u, delta = np.array(case["u"]), np.array(case["delta"])
    m = len(u)
    v, gain = cp.Variable((m, 2)), cp.Variable(m)
    leg = cp.vstack([v[:1], cp.diff(v, axis=0)]) if m > 1 else v
    constraints = [cp.sum(cp.norm(leg, axis=1)) <= case["length"]]
    for k, (lo, hi) in enumerate(ends):
        slope, offset = envelope(channel, lo, hi)
        distance = cp.norm(v[k] - u[k])
        constraints.append(distance <= hi)
        away = cp.Variable(nonneg=True)
        constraints += [away >= distance, gain[k] <= slope * away + offset]
        if case["merged"][k]:
            constraints.append(leg[k] == 0)
    program = cp.Problem(cp.Maximize(delta @ gain), constraints)
    program.solve(solver=cp.CLARABEL)
    assert program.status == cp.OPTIMAL
    return program.value


def cases():
    rng = np.random.default_rng(11)
    for preset in ("suburban+10dB", "suburban", "suburban-log-variance", "high-rise"):
        for m in (1, 3, 6):
            # A walk with legs of about 200 m, a budget that forces it to cut corners.
            u = np.cumsum(rng.normal(scale=140.0, size=(m, 2)), axis=0)
            walk = np.hypot(*np.diff(np.vstack([[0, 0], u]), axis=0).T).sum()
            merged = [False] * m
            intervals = [[0, -1]] * m
            if m == 6:
                u[3] = u[2] + 8.0
                merged[3] = True
                intervals = [[0, -1], [2, -1], [0, 7], [0, -1], [3, -1], [0, -1]]
            yield {
                "preset": preset,
                "u": u.tolist(),
                "delta": rng.uniform(0.5, 1.5, m).tolist(),
                "length": 0.85 * walk,
                "intervals": intervals,
                "merged": merged,
                "eps": 1e-5,
            }


@pytest.fixture(scope="module")
def answers():
    given = list(cases())
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM], input=json.dumps(given), capture_output=True, text=True,
        check=True, env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    )  # fmt: skip
    return list(zip(given, json.loads(run.stdout), strict=True))


def test_the_bound_is_the_optimum_of_the_primal_program(answers):
    for case, answer in answers:
        best = primal(case, answer["ends"])
        assert answer["centred"]
        assert answer["bound"] >= best * (1 - 1e-6)
        assert answer["bound"] == pytest.approx(best, rel=0.01)


def test_splines_stay_above_past_their_last_knot_too(answers):
    for case, answer in answers:
        channel = CHANNEL_PRESETS[case["preset"]]
        for (lo, hi), (slopes, values) in zip(answer["ends"], answer["splines"], strict=True):
            r = np.linspace(lo, hi, 4000)
            f = 1 - average_per(channel, r)
            for s, value in zip(slopes, values, strict=True):
                exact = (f + s * r).max()
                assert exact - 1e-12 <= value <= exact + 0.02 * f.max()
