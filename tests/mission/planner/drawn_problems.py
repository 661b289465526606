"""Problems drawn from a seed, and plans of them that are checked."""

from typing import Any

import numpy as np
from one_aircraft import round_problem

from fl.radio.channel import CHANNEL_PRESETS
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem


def drawn_problem(seed: int = 1, *, devices: int = 8, **more: Any) -> RoundProblem:
    rng = np.random.default_rng(seed)
    usual = {
        "devices_m": rng.uniform(0, 800, (devices, 2)),
        "importance": rng.uniform(0.2, 1.0, devices),
        "start_m": np.array([400.0, 400.0]),
        "steps": 6,
        "per_step": 2,
        "path_budget_m": 800.0,
        "channel": CHANNEL_PRESETS["suburban"],
    }
    return round_problem(**{**usual, **more})


def plan(given: RoundProblem, kind: str = "certified", **options: Any) -> RoundPlan:
    made = make_planner(PlannerConfig(kind=kind, **options)).plan(given)
    check_plan(given, made)
    return made
