"""The planner with a certificate: the true objective, and a bound that no plan exceeds."""

import math
from dataclasses import replace

import numpy as np

from mission.planner.arrays import instance, relax, root_bound
from mission.planner.evaluate import (
    check_problem,
    finish,
    fit_budget,
    objective,
    plan_without_moving,
)
from mission.planner.native.library import (
    MOST_DEVICES,
    Effort,
    Found,
    explore,
    lower_potentials,
    search_orders,
    search_places,
)
from mission.planner.problem import RoundPlan, RoundProblem

MAX_OPEN = 50_000
# Searches stop at steps and gains of some absolute size: importance that is larger or smaller than
# 2 to this power is scaled first.
USUAL_EXPONENT = 10
STARTS = 64  # devices that a first path is built towards
MIN_TRIES, MAX_TRIES = 40, 450
# Few stops are searched by where they are, many by the order of visits. In between the order
# settles it soon or never; with fewer places than devices, a stop being one place matters longer.
FEW_STEPS, SOME_STEPS, SOME_SCARCE_STEPS = 4, 5, 7
ORDER_NODES = 1500
TURNS = 400  # in which potentials are lowered, at most
# Success at a distance is tabled to this share (`mission.planner.reward`).
TABLED = 1e-4
# Beyond MOST_DEVICES a node costs more the more there are, and many never narrow the gap: this many
# divided by the devices are looked into.
SHARED_NODES = 40_000


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
        exponent = int(np.frexp(problem.importance.max())[1])
        if abs(exponent) > USUAL_EXPONENT:
            return self._in_usual_size(problem, exponent)
        devices, limits = instance(problem)
        relaxation = relax(problem, devices)
        count = len(devices.delta)
        first = explore(devices, limits, starts=STARTS, tries=tries(count))
        found = Found(*first, root_bound(relaxation.promise[:, 0], limits))
        scarce = limits.steps * limits.per_step < count
        by_place = limits.steps <= (SOME_SCARCE_STEPS if scarce else SOME_STEPS)
        order_nodes = min(ORDER_NODES, self._max_nodes // 2) if by_place else self._max_nodes
        if limits.steps > FEW_STEPS and count <= MOST_DEVICES:
            effort = self._effort(found, order_nodes)
            if effort is not None:
                found = search_orders(devices, limits, relaxation, plan=found, effort=effort)
        if by_place:
            most_nodes = self._max_nodes if count <= MOST_DEVICES else SHARED_NODES // count
            if (effort := self._effort(found, most_nodes)) is not None:
                found = search_places(devices, limits, plan=found, effort=effort)
        if self._max_nodes > 0 and found.value > 0.0 and found.gap > self._gap:
            turns = min(TURNS, self._max_nodes)
            found = lower_potentials(devices, limits, plan=found, gap=self._gap, turns=turns)
        made = finish(problem, fit_budget(problem.start_m + found.way, problem.path_budget_m))
        assert made.value <= found.bound * (1.0 + TABLED), (made.value, found)
        return RoundPlan(
            made.waypoints_m, made.schedule, made.value, max(found.bound, made.value), found.nodes
        )

    def _in_usual_size(self, problem: RoundProblem, exponent: int) -> RoundPlan:
        """The same problem in units of 2 ** exponent, which rounds nothing."""
        importance = np.ldexp(problem.importance, -exponent)
        plan = self.plan(replace(problem, importance=importance))
        value = objective(problem, plan.waypoints_m, plan.schedule)
        bound = max(math.ldexp(plan.upper_bound, exponent), value)
        return replace(plan, value=value, upper_bound=bound)

    def _effort(self, plan: Found, max_nodes: int) -> Effort | None:
        """What a search may look into until that many nodes; None where it need not begin."""
        left = min(max_nodes, self._max_nodes) - plan.nodes
        if left <= 0 or not plan.value > 0.0 or plan.gap <= self._gap:
            return None
        return Effort(self._gap, left, min(MAX_OPEN, left * (len(plan.assigned) + 2)))


def tries(devices: int) -> int:
    """How often the first plan is cut and mended: more for many devices, up to a limit."""
    return min(MIN_TRIES + devices, MAX_TRIES)
