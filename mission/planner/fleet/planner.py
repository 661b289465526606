"""The planner of rounds for one aircraft or several."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mission.planner.apart import hovering
from mission.planner.certified import in_usual_size
from mission.planner.evaluate import bounded, check_problem, success_bounds
from mission.planner.fleet.joint import Joint, first_plans, parts_along, plan_jointly
from mission.planner.fleet.mending import kept_apart
from mission.planner.fleet.parts import (
    Parts,
    alone_of,
    brought,
    improved_in_turn,
    part_along,
    total,
)
from mission.planner.fleet.prices import CALL_NODES, SLACK, bound_at
from mission.planner.fleet.team import LEAST_M, team_of
from mission.planner.fleet.within import completed, drawn_plans, planned_within, shared_out
from mission.planner.flyable import foresee_round
from mission.planner.limited import reach_bound
from mission.planner.native.library import Goal, assign
from mission.planner.plan import Planner, RoundPlan, relative_gap
from mission.planner.problem import RoundProblem
from mission.planner.timed import cases_of, timed_bound

_HEIGHTS = 5  # altitudes at which first plans are compared
_LAST_CHANGES = 4000  # at random, of a plan that is close enough to its bound
_GAIN = 1e-6  # of the value: a plan that falls short of the ideal by less fits
SUMMED = (
    "its bound sums prices of devices and bounds of each aircraft alone, which leave out part of "
    "the time that corners and ways around areas take"
)


@dataclass(frozen=True)
class FleetPlanner:
    """Planner that plans for several aircraft jointly, and hands rounds of one to `inner`.

    With a goal it proves a bound; without one, shares of first plans are planned by `inner`.
    `sharing`, which proves little, plans them in its place where there is a goal. A `joint` planner
    of users' own plans for all at once in place of both.
    """

    inner: Planner
    goal: Goal | None = None
    sharing: Planner | None = None
    joint: Planner | None = None

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanError: what `inner` raises; the problem makes no sense.
            BoundError: the plan is worth more than the bound that was proven.
        """
        planned = self.inner.plan if len(problem.starts) == 1 else self._planned
        if len(problem.starts) == 1 and not hovering(problem):
            return planned(problem)
        check_problem(problem)
        if (plan := in_usual_size(self, problem)) is not None:
            return plan
        return kept_apart(problem, planned(problem), planned)

    def _planned(self, problem: RoundProblem) -> RoundPlan:
        """Plan for several aircraft, however near they come to each other."""
        if self.joint is not None:
            return self.joint.plan(problem)
        alone = alone_of(problem)
        moving = problem.steps > 1 and any(each.most_m > 0.0 for each in alone)
        if not moving or not alone[0].importance.any():
            (parts, bound), nodes, ended = _at_rest(alone), 0, ""
            if total(parts) < bound:  # who serves whom depends on heights, and on time
                shares = shared_out(alone, [parts], self.sharing or self.inner)
                parts = max([parts, *shares], key=total)
        elif self.goal is None:
            drawn = list(drawn_plans(alone, _free(alone)))
            parts = max(shared_out(alone, drawn, self.inner), key=total)
            bound, nodes, ended = math.nan, 0, ""
        else:
            parts, bound, nodes, ended = self._proven(alone, self.goal)
            if total(parts) < bound:
                parts = improved_in_turn(alone, parts, _LAST_CHANGES)
        parts = [
            part if each.limits is None else part.with_own(foreseen=foresee_round(each, part))
            for each, part in zip(alone, parts, strict=True)
        ]
        made = bounded(problem, RoundPlan.together(parts), bound, nodes)
        met = self.goal is None or made.gap <= self.goal.gap
        return replace(made, ended="" if met else ended)

    def _proven(self, alone: list[RoundProblem], goal: Goal) -> tuple[Parts, float, int, str]:
        """Return a plan, its bound, nodes looked into, and why no more is proven."""
        free = _free(alone)
        chosen = any(each.altitudes_m for each in alone)
        timed = any(each.limits and each.limits.each for each in alone)
        timed = timed or alone[0].ready_in_s is not None
        ideal = alone[0].airspace.is_open and not chosen and not timed
        joint = plan_jointly(free, goal, prices_wanted=not ideal)
        parts, found = parts_along(alone, joint.found), joint.found
        if ideal and joint.team.searchable and parts is not None:
            # Who is without hope counts in the search's value, and not in the plan's.
            lost = relative_gap(total(parts), found.value)
            if relative_gap(total(parts), found.bound) > goal.gap >= found.gap > lost:
                found = plan_jointly(free, replace(goal, gap=found.gap - lost), begun=found).found
                parts = parts_along(alone, found) or parts
            return parts, found.bound, found.nodes, found.ended
        bound = reach_bound(alone) if chosen else min(found.bound, reach_bound(alone))
        enough, nodes = bound * (1.0 - goal.gap), found.nodes
        if chosen or parts is None or total(parts) < found.value * (1.0 - _GAIN):
            begun = [] if parts is None else [parts]
            inner = self.sharing or self.inner
            parts = planned_within(alone, free, begun, inner=inner, enough=enough)
        if joint.prices is not None and total(parts) < enough:
            summed, more = _summed(alone, joint, parts, goal)
            bound, nodes = min(bound, summed), nodes + more
        return parts, bound, nodes, SUMMED


def _free(alone: Sequence[RoundProblem]) -> list[RoundProblem]:
    """Return the problems without areas and limits, each at one altitude: where there is a choice
    all at the same share of theirs, that at which first plans are worth most."""

    def at(share: float) -> list[RoundProblem]:
        between = [
            each.altitudes_m and float(np.interp(share, (0, 1), each.altitudes_m)) for each in alone
        ]
        return [each.unlimited.at(height) for each, height in zip(alone, between, strict=True)]

    def value(share: float) -> float:
        return first_plans(team_of(at(share)))[0].value

    shares = np.linspace(0.0, 1.0, _HEIGHTS).tolist()
    return at(max(shares, key=value) if any(each.altitudes_m for each in alone) else 0.0)


def _at_rest(alone: Sequence[RoundProblem]) -> tuple[Parts, float]:
    """Return the best plan of aircraft that stay where they are, and its bound."""
    standing = [each.with_own(path_budget_m=0.0) for each in alone]
    chances = [
        success_bounds(each, np.hypot(*(each.devices_m - each.start_m).T)).max(axis=0)
        for each in standing
    ]
    steps, importance = alone[0].steps, alone[0].importance
    each_step = np.repeat(chances, steps, axis=0)
    given = assign(each_step, importance, alone[0].per_step)
    whose = np.asarray(given.reshape(len(alone), steps, -1).any(axis=1))
    parts = [
        part_along(each, np.tile(each.start_m, (steps, 1)), mine)
        for each, mine in zip(alone, whose, strict=True)
    ]
    made = [part for part in parts if part is not None]
    assert len(made) == len(alone)  # any limits allow to stay
    return completed(alone, made), float((given * each_step * importance).sum())


def _summed(
    alone: Sequence[RoundProblem], joint: Joint, parts: Parts, goal: Goal
) -> tuple[float, int]:
    """Return the sum of prices and of what each aircraft alone earns at them at most, within its
    limits and over its altitudes, and the nodes looked into."""
    assert joint.prices is not None
    worth = alone[0].importance > 0.0
    prices = np.zeros(len(worth))
    prices[worth] = joint.prices
    bound, nodes = float(prices.sum()), 0
    scale = joint.found.value / len(alone)
    begun = Goal(0.0, CALL_NODES, SLACK * goal.gap * scale, scale)
    for a, each in enumerate(alone):
        moving = each.with_own(path_budget_m=max(each.path_budget_m, LEAST_M)).unlimited
        own, more = bound_at(cases_of(moving), joint.prices, joint.found.way[a], begun)
        # delta f - price <= (delta - price) f, as f <= 1
        left = np.maximum(0.0, each.importance - prices)
        share = np.divide(left, each.importance, out=np.zeros(len(left)), where=worth)
        value = float((brought(each, parts[a]) * share).sum())
        own = (
            min(own, timed_bound(replace(each, importance=left), value, goal))
            if left.any()
            else 0.0
        )
        bound, nodes = bound + own, nodes + more
    return bound, nodes
