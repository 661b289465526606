"""The planner with a certificate: the true objective, and a bound that no plan exceeds."""

from mission.planner.arrays import instance, relax, root_bound
from mission.planner.evaluate import check_problem, finish, fit_budget, plan_without_moving
from mission.planner.native.library import (
    MOST_DEVICES, Effort, Found, explore, search_orders, search_places,
)  # fmt: skip
from mission.planner.problem import RoundPlan, RoundProblem

MAX_OPEN = 50_000
STARTS = 64  # devices that a first path is built towards
MIN_TRIES, MAX_TRIES = 40, 450
# Where the stops are is searched where they are few. With one more than that, the order of visits
# often settles it sooner, or it never does.
FEW_STEPS = 4
ORDER_NODES = 1500


class CertifiedPlanner:
    """Greedy insertions and Newton ascent, then branch and bound to a relative gap.

    The gap is honest at any size: where the nodes run out, or with many steps and more than 40
    devices worth something, it is what has been proven until then.

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
        relaxation = relax(problem, devices)
        tried = tries(len(devices.delta))
        first = explore(devices, limits, starts=STARTS, tries=tried)
        found = Found(*first, root_bound(relaxation.promise[:, 0], limits))
        if limits.steps > FEW_STEPS and len(devices.delta) <= MOST_DEVICES:
            # With more devices, the search cannot narrow the gap in any time worth waiting for.
            most = ORDER_NODES if limits.steps == FEW_STEPS + 1 else self._max_nodes
            if effort := self._effort(found, most):
                found = search_orders(devices, limits, relaxation, plan=found, effort=effort)
        if limits.steps <= FEW_STEPS + 1 and (effort := self._effort(found, self._max_nodes)):
            found = search_places(devices, limits, plan=found, effort=effort)
        made = finish(problem, fit_budget(problem.start_m + found.way, problem.path_budget_m))
        return RoundPlan(
            made.waypoints_m, made.schedule, made.value, max(found.bound, made.value), found.nodes
        )

    def _effort(self, plan: Found, max_nodes: int) -> Effort | None:
        """What a search may look into until that many nodes; None where it need not begin."""
        left = min(max_nodes, self._max_nodes) - plan.nodes
        if left <= 0 or not plan.value > 0.0 or plan.gap <= self._gap:
            return None
        return Effort(self._gap, left, min(MAX_OPEN, left * (len(plan.assigned) + 2)))


def tries(devices: int) -> int:
    """How often the first plan is cut and mended: more for many devices, up to a limit."""
    return min(MIN_TRIES + devices, MAX_TRIES)
