"""What is compiled ahead for planning is all that planning calls."""

import numpy as np
import pytest

from fl.kernels.ahead import without_compiler
from fl.radio import CHANNEL_PRESETS
from mission.planner.certified import CertifiedPlanner
from mission.planner.kernels import exploration, search
from mission.planner.problem import RoundProblem
from mission.planner.sqp import SqpPlanner


@pytest.mark.parametrize("planner", [CertifiedPlanner(), SqpPlanner()])
def test_rehearsals_leave_nothing_to_compile(planner):
    rng = np.random.default_rng(1)
    problem = RoundProblem(
        rng.uniform(0.0, 800.0, (12, 2)), rng.uniform(0.5, 1.5, 12), np.zeros(2), 6, 2, 800.0,
        CHANNEL_PRESETS["suburban"],
    )  # fmt: skip
    exploration.rehearse()
    search.rehearse()
    with without_compiler():
        plan = planner.plan(problem)
    assert plan.value > 0.0
    assert plan.nodes > 0 or isinstance(planner, SqpPlanner)
