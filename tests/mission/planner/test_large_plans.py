"""The bound of a hundred devices and more, against paths that share nothing with it."""

import numpy as np
import pytest
from test_certificate import random_problem
from test_places import best_assignment

from mission.planner.certified import CertifiedPlanner
from mission.planner.evaluate import fit_budget

pytestmark = pytest.mark.slow


def exchanged(problem, *, turns, seed):
    """The best value of paths over devices, changed at random: one put in, out or elsewhere."""
    rng = np.random.default_rng(seed)
    count = len(problem.devices_m)
    order: list[int] = []
    best = 0.0
    for _ in range(turns):
        trial = list(order)
        if trial and rng.random() < 0.4:
            trial.pop(rng.integers(len(trial)))
        if len(trial) + 1 < problem.steps:
            new = int(rng.integers(count))
            if new not in trial:
                stops = np.vstack([problem.start_m, problem.devices_m[[*trial]]])
                legs = np.linalg.norm(stops - problem.devices_m[new], axis=1)
                detour = legs + np.append(legs[1:], 0.0)
                detour[:-1] -= np.linalg.norm(np.diff(stops, axis=0), axis=1)
                trial.insert(int(detour.argmin()), new)
        route = np.vstack([problem.start_m, problem.devices_m[trial]])
        way = fit_budget(route, problem.path_budget_m)
        value = best_assignment(problem, way)
        if value >= best:
            best, order = value, trial
    return best


@pytest.mark.parametrize(
    ("devices", "channel", "turns"),
    [(100, "suburban+10dB", 150), (100, "suburban+30dB", 150), (1000, "suburban", 10)],
)
def test_paths_changed_at_random_lie_below_the_bound(devices, channel, turns):
    problem = random_problem(devices, devices=devices, steps=50, preset=channel)
    plan = CertifiedPlanner().plan(problem)
    found = exchanged(problem, turns=turns, seed=1)
    assert 0.1 * plan.value <= found <= plan.upper_bound
