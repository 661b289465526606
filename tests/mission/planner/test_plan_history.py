"""A plan is a function of its problem alone, not of what was planned before."""

import dataclasses

import numpy as np
import pytest

from fl.radio.channel import CHANNEL_PRESETS
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner
from mission.planner.problem import RoundProblem


def problem(seed: int) -> RoundProblem:
    rng = np.random.default_rng(seed)
    return RoundProblem(
        devices_m=rng.uniform(0.0, 800.0, (6, 2)),
        importance=rng.uniform(0.1, 1.0, 6),
        start_m=rng.uniform(0.0, 800.0, 2),
        steps=5,
        per_step=3,
        path_budget_m=300.0,
        channel=CHANNEL_PRESETS["suburban"],
    )


@pytest.mark.parametrize("kind", ["certified", "sqp", "paper"])
def test_planning_something_else_in_between_changes_nothing(kind: str) -> None:
    planner = make_planner(PlannerConfig(kind=kind))
    first = planner.plan(problem(1))
    planner.plan(dataclasses.replace(problem(2), path_budget_m=900.0))
    again = planner.plan(problem(1))
    assert first.waypoints_m.tobytes() == again.waypoints_m.tobytes()
    assert (first.schedule == again.schedule).all()
