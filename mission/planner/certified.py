"""The planner with a certificate: the true objective, and a bound that no plan exceeds."""

import numpy as np

from mission.planner.evaluate import check_problem, finish, fit_budget, plan_without_moving
from mission.planner.kernels.entry import plan
from mission.planner.kernels.instance import Devices, Limits, Problem, Relaxation
from mission.planner.problem import Floats, RoundPlan, RoundProblem
from mission.planner.reward import conjugates, reward_table

# The order of a node's devices is a 64-bit mask of gaps; beyond this many a bound of 1 % is out
# of reach anyway.
MAX_DEVICES = 40
MAX_OPEN = 50_000
# Tables are made for multiples of this reach, so that the rounds of a mission share them.
REACH_STEP_M = 512


class CertifiedPlanner:
    """Greedy insertions and Newton ascent, then branch and bound to a relative gap.

    The gap is honest at any size: where the nodes run out, or with more than 40 devices worth
    something, it is what has been proven until then.

    Args:
        gap: (bound - value) / bound that is enough.
        max_nodes: nodes looked into at most. They are counted, never timed, so that a problem
            has the same plan on every machine.
    """

    def __init__(self, *, gap: float = 0.01, max_nodes: int = 20_000) -> None:
        self._gap = gap
        self._max_nodes = max_nodes

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanInputError: the problem makes no sense.
        """
        check_problem(problem)
        if (at_rest := plan_without_moving(problem)) is not None:
            return at_rest
        devices, limits = instance(problem)
        way = np.zeros((problem.steps, 2))
        assigned = np.full(len(devices.delta), -1, dtype=np.int64)
        relaxation = relax(problem, devices)
        bound = root_bound(relaxation.promise[:, 0], limits)
        nodes = self._max_nodes if len(assigned) <= MAX_DEVICES else 0
        pool = min(MAX_OPEN, nodes * (len(assigned) + 2))
        _, proven, nodes = plan(
            Problem(devices, limits, relaxation), self._gap, nodes, pool, way, assigned
        )
        bound = min(bound, proven)
        waypoints = fit_budget(problem.start_m + way, problem.path_budget_m)
        done = finish(problem, waypoints, nodes=nodes)
        return RoundPlan(
            done.waypoints_m, done.schedule, done.value, max(bound, done.value), done.nodes
        )


def instance(problem: RoundProblem) -> tuple[Devices, Limits]:
    """The problem as the compiled loops take it, without the devices worth nothing."""
    worth = problem.importance > 0.0
    u = np.ascontiguousarray(problem.devices_m[worth] - problem.start_m, dtype=np.float64)
    table = reward_table(problem.channel, _reach(problem, u))
    delta = np.ascontiguousarray(problem.importance[worth], dtype=np.float64)
    limits = Limits(int(problem.steps), int(problem.per_step), float(problem.path_budget_m))
    return Devices(u, delta, table.rows), limits


def relax(problem: RoundProblem, devices: Devices) -> Relaxation:
    """The tables of the dual bound."""
    reach = _reach(problem, devices.u)
    conjugate = conjugates(problem.channel, reach)
    # No path comes nearer to a device than its distance from the start less the budget.
    nearest = np.maximum(0.0, np.hypot(*devices.u.T) - problem.path_budget_m)
    beyond = np.maximum(conjugate.radii_m[None, :], nearest[:, None])
    promise = devices.delta[:, None] * reward_table(problem.channel, reach).upper(beyond)
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
