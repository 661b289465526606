"""Plans and bounds as an earlier implementation of the same search made them.

`known_plans.json` was written by the planner of commit 4001ba8, given the reward's present table,
and where stops are scarce (three cases) by the first one that decides early which stops are one.
Its plans and bounds check those of today's search, which has to prove as much; the reward's table
was numpy's then, which moves plans by up to `MOVED`. First plans (`first`) are today's: the same on
every processor, as all they are made of is our own arithmetic.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from one_aircraft import round_problem

from fl.radio.channel import CHANNEL_PRESETS
from mission.planner.certified import CertifiedPlanner, ExploringPlanner
from mission.planner.sqp import SqpPlanner

MOVED = 2e-4  # relative

CASES = json.loads(Path(__file__).with_name("known_plans.json").read_text())


def problem(case):
    devices = case["devices"]
    rng = np.random.default_rng(case["seed"])
    community = rng.integers(0, 10, devices)
    weight = rng.uniform(0.5, 1.5, 10)[community] * rng.choice([1.0, 1.5], devices)
    return round_problem(
        rng.uniform(0.0, 800.0, (devices, 2)), weight / devices, rng.uniform(0.0, 800.0, 2),
        case["steps"], case["per_step"], case["path_budget_m"], CHANNEL_PRESETS[case["channel"]],
    )  # fmt: skip


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            case,
            id="{channel}-{devices}-{steps}-{seed}".format(**case),
            marks=[pytest.mark.slow] if case["devices"] >= 100 else [],
        )
        for case in CASES
    ],
)
def test_plans_and_bounds_are_those_that_are_known(case):
    given = problem(case)
    plan = CertifiedPlanner(max_nodes=500).plan(given)
    again = CertifiedPlanner(max_nodes=500).plan(given)
    assert np.array_equal(plan.waypoints_m, again.waypoints_m)
    assert (plan.upper_bound, plan.nodes) == (again.upper_bound, again.nodes)
    # Nobody is scheduled whose success is below 1 %, as these plans did.
    hopeless = 0.01 * given.importance[~plan.schedule.any(axis=(0, 1))].sum()
    enough_places = case["devices"] <= case["steps"] * case["per_step"]
    if case["steps"] > 4 and enough_places:
        assert case["certified"] <= plan.upper_bound * (1.0 + 1e-9)
        assert plan.value <= case["upper_bound"] * (1.0 + 1e-9)
        known_gap = 1.0 - case["certified"] / case["upper_bound"]
        assert plan.gap <= max(0.01, known_gap) + MOVED + hopeless / plan.upper_bound
    else:  # another search, or a bound that was not one: places were given up for good
        assert plan.value + hopeless >= case["certified"] * (1.0 - MOVED)
    if case["steps"] <= 4:
        assert plan.gap <= 0.01 + hopeless / plan.upper_bound + 1e-9
    first = CertifiedPlanner(max_nodes=0).plan(given)
    assert first.value == pytest.approx(case["first"], rel=1e-12)
    explored = ExploringPlanner().plan(given)
    assert SqpPlanner().plan(given).value >= explored.value
    assert explored.value + hopeless >= case["sqp"] * (1.0 - 1e-3)
