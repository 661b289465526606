"""The planner with a certificate: the true objective, and a bound that no plan exceeds."""

import math
from dataclasses import dataclass, replace

import numpy as np

from mission.base.arrays import Floats
from mission.planner.evaluate import bounded, check_problem, finish, fit_budget, plan_without_moving
from mission.planner.improving import improved
from mission.planner.native.crews import Crew, polished, search_orders
from mission.planner.native.library import (
    MOST_DEVICES,
    Devices,
    Found,
    Goal,
    PathLimits,
    Relaxation,
    explore,
    match,
    search_places,
)
from mission.planner.plan import Planner, RoundPlan, relative_gap
from mission.planner.problem import RoundProblem
from mission.planner.reward import Altitudes, conjugates, reward_table

REACH_STEP_M = 512  # of tables, so that the rounds of a mission share them
# Searches stop at steps and gains of some absolute size: importance that is larger or smaller than
# 2 to this power is scaled first.
USUAL_EXPONENT = 10
STARTS = 64  # devices that a first path is built towards
MIN_TRIES, MAX_TRIES = 40, 450
MANY_TRIES = 3000  # where a search has ended early, which could have improved the plan
# Few stops are searched by where they are, many by the order of visits. In between the order
# settles it soon or never, with this share of the nodes; with fewer places than devices, a stop
# being one place matters longer.
SOME_STEPS, SOME_SCARCE_STEPS = 5, 6
ORDER_SHARE = {2: 0.0, 3: 0.0, 4: 0.03, 5: 0.3, 6: 0.3}
# Beyond MOST_DEVICES a node costs more the more there are, and many never narrow the gap: this many
# divided by the devices are looked into.
SHARED_NODES = 40_000
_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)  # of an explored path: where improvements begin on a grid
PROMISED = "its bound is what each device promises from the best place in reach"
UNSEARCHED = f"with over {MOST_DEVICES} devices and {SOME_STEPS} steps nothing is searched"


class CertifiedPlanner:
    """Greedy insertions and Newton ascent, then branch and bound to a relative gap.

    The bound is valid at any size: where the nodes run out it is what has been proven until then,
    and with many steps and over 40 devices with importance the sum of their own best rewards.

    Args:
        gap: (bound - value) / bound that is enough.
        max_nodes: nodes looked into at most. They are counted, never timed, so that a problem
            has the same plan on every machine.
    """

    def __init__(self, *, gap: float = 0.01, max_nodes: int = 60_000) -> None:
        self.goal = Goal(gap, max_nodes)

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanInputError: the problem makes no sense.
        """
        if (at_rest := plan_without_moving(problem)) is not None:
            return at_rest
        if (plan := in_usual_size(self, problem)) is not None:
            return plan
        case = case_of(problem)
        found = case.explored()
        if problem.per_grid is not None:
            return self._on_grid(problem, found)
        found = search(case, found, self.goal)
        made = finished(problem, problem.start_m + found.way)
        # Who is without hope counts in the search's value, and not in the plan's.
        lost = relative_gap(made.value, found.value)
        if (
            found.value > 0.0
            and relative_gap(made.value, found.bound) > self.goal.gap >= found.gap > lost
        ):
            found = search(case, found, replace(self.goal, gap=found.gap - lost))
            made = finished(problem, problem.start_m + found.way)
        return replace(bounded(problem, made, found.bound, found.nodes), ended=found.ended)

    def _on_grid(self, problem: RoundProblem, found: Found) -> RoundPlan:
        """Plan on a PER grid, whose reward has many local maxima: improve several paths by random
        changes, no branch and bound; the bound is the sum of the devices' own best rewards."""
        ways = [problem.start_m + share * found.way for share in _SHARES]
        assert problem.per_grid is not None
        ways += [
            np.linspace(problem.start_m, place_m, problem.steps)
            for place_m in problem.per_grid.best_places(problem.start_m, problem.path_budget_m)
        ]
        plans = [finished(problem, way) for way in ways]
        best = improved(problem, plans, found.bound * (1.0 - self.goal.gap))
        best = bounded(problem, best, found.bound, 0)
        return best if best.gap <= self.goal.gap else replace(best, ended=PROMISED)


class ExploringPlanner:
    """Heuristic planner for any number of devices: insertion, then ruin and recreate; no bound.

    Args:
        starts: devices that first paths are built towards.
        tries: ruin-and-recreate steps on the best of them; by default more for more devices.
    """

    def __init__(self, *, starts: int = STARTS, tries: int | None = None) -> None:
        self._starts, self._tries = starts, tries

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanInputError: the problem makes no sense.
        """
        if (at_rest := plan_without_moving(problem)) is not None:
            return at_rest
        if (plan := in_usual_size(self, problem)) is not None:
            return plan
        devices, limits = instance(problem)
        attempts = tries(len(devices.delta)) if self._tries is None else self._tries
        _, way, _ = explore(devices, limits, starts=self._starts, tries=attempts)
        return finished(problem, problem.start_m + way)


def finished(problem: RoundProblem, way: Floats) -> RoundPlan:
    """Return the plan along a path (N, 2), shrunk to the metres that the round may fly."""
    return finish(problem, fit_budget(way, problem.path_budget_m))


def in_usual_size(planner: Planner, problem: RoundProblem) -> RoundPlan | None:
    """Plan with importance scaled by a power of 2, which rounds nothing; None where its size is
    usual, so that no scaling is needed."""
    exponent = int(np.frexp(problem.importance.max(initial=0.0))[1])
    if abs(exponent) <= USUAL_EXPONENT:
        return None
    check_problem(problem)  # before it is another
    importance = np.ldexp(problem.importance, -exponent)
    plan = planner.plan(replace(problem, importance=importance))
    value, bound = (math.ldexp(of, exponent) for of in (plan.value, plan.upper_bound))
    return replace(plan, value=value, upper_bound=bound)


@dataclass(frozen=True)
class Case(Crew):
    """Input of a search: devices and limits of a problem, and the tables of its dual bound."""

    def explored(self, attempts: int | None = None) -> Found:
        """Plan heuristically, with `attempts` ruin-and-recreate steps (None: by device count)."""
        attempts = attempts or tries(len(self.devices.delta))
        first = explore(self.devices, self.limits, starts=STARTS, tries=attempts)
        return Found(*first, self.first_bound)

    def along(self, way: Floats) -> Found:
        """Return the plan along a path (N, 2) with its best assignment of devices to steps."""
        value, assigned = match(self.devices, self.limits, way)
        return Found(value, way, assigned, self.first_bound)

    def polished(self, way: Floats) -> Found:
        """Return the best plan near a path (N, 2)."""
        return Found(*polished([self], way), self.first_bound)

    @property
    def first_bound(self) -> float:
        """First upper bound: sum of the N K_bar largest rewards that devices reach on their own."""
        places = self.limits.steps * self.limits.per_step
        return float(np.sort(self.relaxation.promise[:, 0])[::-1][:places].sum())


def case_of(problem: RoundProblem, *, towards_m: Altitudes = ()) -> Case:
    """Return the search input of a problem, f raised towards other altitudes (`reward_table`)."""
    devices, limits = instance(problem, towards_m=towards_m)
    return Case(devices, limits, relax(problem, devices, towards_m=towards_m))


def search(case: Case, found: Found, goal: Goal) -> Found:
    """Improve a plan and lower its bound by branch and bound, until goal or nodes end it."""
    count = len(case.devices.delta)
    found = branched(case, found, goal)
    if goal.max_nodes > 0 and count <= MOST_DEVICES and found.value > 0.0 and found.gap > goal.gap:
        other = case.explored(min(MANY_TRIES, goal.max_nodes))
        if other.value > found.value:
            found = replace(other, bound=found.bound, nodes=found.nodes, ended=found.ended)
    if found.bound > 0.0 and found.gap > goal.gap and not found.nodes:
        found = replace(found, ended=UNSEARCHED if goal.max_nodes else "it may look into no node")
    return found


def branched(case: Case, found: Found, goal: Goal) -> Found:
    """Improve a plan and lower its bound by the searches that suit its steps and devices."""
    devices, limits = case.devices, case.limits
    count = len(devices.delta)
    scarce = limits.steps * limits.per_step < count
    by_place = limits.steps <= (SOME_SCARCE_STEPS if scarce else SOME_STEPS)
    order_nodes = int(goal.max_nodes * ORDER_SHARE[limits.steps]) if by_place else goal.max_nodes
    if count <= MOST_DEVICES and (more := goal.left(found, order_nodes)) is not None:
        found = search_orders([case], plan=found, goal=more)
    if by_place:
        most_nodes = goal.max_nodes if count <= MOST_DEVICES else SHARED_NODES // count
        if (more := goal.left(found, most_nodes)) is not None:
            found = search_places(devices, limits, plan=found, goal=more)
    return found


def tries(devices: int) -> int:
    """Return how many ruin-and-recreate steps a first plan gets: more for more devices, capped."""
    return min(MIN_TRIES + devices, MAX_TRIES)


def instance(
    problem: RoundProblem, *, towards_m: Altitudes = (), reach_m: int | None = None
) -> tuple[Devices, PathLimits]:
    """Return the devices with importance above 0, relative to the start, and a path's limits.

    `towards_m` as in `reward_table`; tables cover `reach_m` (None: that of the problem).
    """
    worth = problem.importance > 0.0
    u = np.ascontiguousarray(problem.devices_m[worth] - problem.start_m, dtype=np.float64)
    delta = np.ascontiguousarray(problem.importance[worth], dtype=np.float64)
    reach_m, grid = reach_m or reach_of(problem), problem.per_grid
    table = reward_table(problem.channel, reach_m, towards_m)
    if grid is not None:
        grid = grid.seen_from(np.flatnonzero(worth), problem.start_m)
    limits = PathLimits(int(problem.steps), int(problem.per_step), float(problem.path_budget_m))
    return Devices(u, delta, table.rows, grid=grid), limits


def relax(
    problem: RoundProblem,
    devices: Devices,
    *,
    towards_m: Altitudes = (),
    reach_m: int | None = None,
) -> Relaxation:
    """The tables of the dual bound; `towards_m` and `reach_m` as in `instance`."""
    reach = reach_m or reach_of(problem)
    tables = conjugates(problem.channel, reach, towards_m)
    # No path comes nearer to a device than its distance from the start less the budget.
    nearest = np.maximum(0.0, np.hypot(*devices.u.T) - problem.path_budget_m)
    beyond = np.maximum(tables.radii_m[None, :], nearest[:, None])
    upper = reward_table(problem.channel, reach, towards_m).upper(beyond)
    if devices.grid is not None:
        best = devices.grid.best_within(np.zeros(2), problem.path_budget_m)
        upper = np.broadcast_to(best[:, None], upper.shape)
    return Relaxation(**vars(tables), promise=devices.delta[:, None] * upper)


def reach_of(problem: RoundProblem) -> int:
    """Return the metres of distance that tables must cover: from the start to the farthest device
    with importance, plus the budget, rounded up to a multiple of `REACH_STEP_M`."""
    worth = problem.importance > 0.0
    far = np.hypot(*(problem.devices_m[worth] - problem.start_m).T)
    return REACH_STEP_M * (int(far.max() + problem.path_budget_m) // REACH_STEP_M + 1)
