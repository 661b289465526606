"""Problems and plans of one aircraft, what is its own beside what is the round's."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from mission.base.arrays import Bools, Floats
from mission.planner.plan import PlannedPath, RoundPlan
from mission.planner.problem import RoundProblem, Start

_OWN = {field.name for field in fields(Start)}
_ORDER = ["devices_m", "importance", "start_m", "steps", "per_step", "path_budget_m", "channel"]


def round_problem(*first: Any, **given: Any) -> RoundProblem:
    given |= dict(zip(_ORDER, first, strict=False))
    own = {name: given.pop(name) for name in _OWN & given.keys()}
    return RoundProblem(**given, starts=(Start(**own),))


def changed(problem: RoundProblem, **other: Any) -> RoundProblem:
    own = {name: other.pop(name) for name in _OWN & other.keys()}
    return replace(problem.with_own(**own), **other)


def one_path(waypoints_m: Floats, schedule: Bools, *value: Any) -> RoundPlan:
    """A plan along (N, 2) waypoints with a schedule (N, K), its value, and a bound."""
    return RoundPlan((PlannedPath(waypoints_m),), np.asarray(schedule)[None], *value)
