"""A planning problem as the plain arrays that the native loops take."""

import numpy as np

from mission.base.arrays import Floats
from mission.planner.native.library import Devices, Limits, Relaxation
from mission.planner.problem import RoundProblem
from mission.planner.reward import Altitudes, conjugates, reward_table

# Tables are made for multiples of this reach, so that the rounds of a mission share them.
REACH_STEP_M = 512


def instance(problem: RoundProblem, *, towards_m: Altitudes = ()) -> tuple[Devices, Limits]:
    """Devices relative to the start, without those worth nothing, and what a plan may use.

    `towards_m` as in `reward_table`.
    """
    worth = problem.importance > 0.0
    u = np.ascontiguousarray(problem.devices_m[worth] - problem.start_m, dtype=np.float64)
    delta = np.ascontiguousarray(problem.importance[worth], dtype=np.float64)
    table = reward_table(problem.channel, _reach(problem, u), towards_m)
    limits = Limits(int(problem.steps), int(problem.per_step), float(problem.path_budget_m))
    return Devices(u, delta, table.rows), limits


def relax(problem: RoundProblem, devices: Devices, *, towards_m: Altitudes = ()) -> Relaxation:
    """The tables of the dual bound; `towards_m` as in `reward_table`."""
    reach = _reach(problem, devices.u)
    conjugate = conjugates(problem.channel, reach, towards_m)
    # No path comes nearer to a device than its distance from the start less the budget.
    nearest = np.maximum(0.0, np.hypot(*devices.u.T) - problem.path_budget_m)
    beyond = np.maximum(conjugate.radii_m[None, :], nearest[:, None])
    table = reward_table(problem.channel, reach, towards_m)
    promise = devices.delta[:, None] * table.upper(beyond)
    return Relaxation(
        conjugate.coefficients,
        conjugate.spacing,
        conjugate.radii_m[conjugate.ends[:, 1]],
        conjugate.ends,
        conjugate.row,
        conjugate.ladder,
        conjugate.radii_m,
        promise,
    )


def root_bound(promise: Floats, limits: Limits) -> float:
    """What the best N K_bar devices promise, each by itself."""
    places = limits.steps * limits.per_step
    return float(np.sort(promise)[::-1][:places].sum())


def _reach(problem: RoundProblem, u: Floats) -> int:
    """No device is ever further away than from the start, plus the budget."""
    farthest = float(np.hypot(*u.T).max()) + problem.path_budget_m
    return REACH_STEP_M * (int(farthest) // REACH_STEP_M + 1)
