"""The planner with a certificate: the true objective, and a bound that no plan exceeds."""

from mission.planner.arrays import instance, relax, root_bound
from mission.planner.evaluate import check_problem, finish, fit_budget, plan_without_moving
from mission.planner.native.library import MOST_DEVICES, explore, search
from mission.planner.problem import RoundPlan, RoundProblem

MAX_OPEN = 50_000
STARTS = 64  # devices that a first path is built towards
MIN_TRIES, MAX_TRIES = 40, 450


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
        count = len(devices.delta)
        relaxation = relax(problem, devices)
        value, way, assigned = explore(devices, limits, starts=STARTS, tries=tries(count))
        bound = root_bound(relaxation.promise[:, 0], limits)
        # Beyond, the search cannot narrow the gap in any time worth waiting for.
        nodes = self._max_nodes if count <= MOST_DEVICES else 0
        if nodes > 0 and 0.0 < value < (1.0 - self._gap) * bound:
            bound, nodes = search(
                devices,
                limits,
                relaxation,
                gap=self._gap,
                max_nodes=nodes,
                max_open=min(MAX_OPEN, nodes * (count + 2)),
                value=value,
                way=way,
                assigned=assigned,
            )
        else:
            nodes = 0
        made = finish(problem, fit_budget(problem.start_m + way, problem.path_budget_m))
        return RoundPlan(made.waypoints_m, made.schedule, made.value, max(bound, made.value), nodes)


def tries(devices: int) -> int:
    """How often the first plan is cut and mended: more for many devices, up to a limit."""
    return min(MIN_TRIES + devices, MAX_TRIES)
