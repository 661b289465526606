"""Joint plans of several aircraft that metres alone limit, and their proof."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mission.base.arrays import Floats, Ints
from mission.planner.certified import STARTS, tries
from mission.planner.fleet.parts import Parts, improved_in_turn, one_of_each, part_along
from mission.planner.fleet.prices import columns_of, search_prices
from mission.planner.fleet.team import Team, owners, partitions, team_of
from mission.planner.native.crews import search_orders
from mission.planner.native.library import MOST_DEVICES, Found, Goal, explore
from mission.planner.problem import RoundProblem

CHANGES = 20_000  # at random: more bring nothing
_STARTS, _TRIES = 8, 8  # of an aircraft's path within a first plan
_AGAIN, _VARIED = 4, 2  # first plans in which each is planned again, and that are changed at random
# Of the nodes, how many the search of orders may look into, by its devices at most: before prices,
# and once they are at their end.
_ORDER_SHARES = {12: (0.2, 1.0), 20: (0.07, 0.0), MOST_DEVICES: (0.01, 0.0)}
_PRICE_SHARE = 8  # times the nodes: of all searches of one aircraft


@dataclass(frozen=True)
class Joint:
    """A joint plan in the search's form, with the prices that its bound is from."""

    team: Team
    found: Found
    prices: Floats | None = None  # (K,) of the devices worth something; None: by orders


def plan_jointly(
    alone: Sequence[RoundProblem],
    goal: Goal,
    *,
    prices_wanted: bool = False,
    begun: Found | None = None,
) -> Joint:
    """Plan for aircraft that metres alone limit, a problem for each, at one altitude each.

    Prices are looked for where the search of orders does not meet the goal, or if they are wanted.
    `begun` is what was found with a looser goal.
    """
    team = team_of(alone)
    plans = first_plans(team)
    found, count = begun or plans[0], len(team.delta)
    if goal.max_nodes <= 0 or not team.searchable or not found.value > 0.0:
        return Joint(team, max(_varied(alone, team, plans), found, key=lambda plan: plan.value))
    first, last = next(shares for most, shares in _ORDER_SHARES.items() if count <= most)
    found = _by_orders(team, found, goal, first)
    if found.gap <= goal.gap and not prices_wanted:
        return Joint(team, found)
    varied = _varied(alone, team, plans)
    if varied.value > found.value:
        found = replace(varied, bound=found.bound, nodes=found.nodes)
    columns = [column for plan in (*plans, varied, found) for column in columns_of(team, plan)]
    rest = replace(goal, max_nodes=_PRICE_SHARE * goal.max_nodes)
    found, prices = search_prices(team, found, columns, rest)
    return Joint(team, _by_orders(team, found, goal, last), prices)


def _by_orders(team: Team, found: Found, goal: Goal, share: float) -> Found:
    """Search the orders of all aircraft together, with a share of the goal's nodes."""
    most = found.nodes + int(share * goal.max_nodes)
    left = replace(goal, max_nodes=most).left(found, most, len(team.cases))
    if left is None or not team.one_radio:
        return found
    return search_orders(team.joint, plan=found, goal=left)


def first_plans(team: Team) -> list[Found]:
    """Return plans of one after another, of sectors and of clusters; the best first."""
    devices = team.cases[0].devices
    aircraft = range(len(team.cases))
    plans = [_one_after_another(team, order) for order in (aircraft, aircraft[::-1])]
    starts_m = devices.u[0] - np.stack([case.devices.u[0] for case in team.cases])  # from the first
    for part in partitions(devices.u, team.delta, starts_m):
        ways = [_way(team, a, np.where(part == a, 0.0, team.delta)) for a in aircraft]
        plans.append(team.plan_along(np.stack(ways)))
    plans.sort(key=lambda plan: -plan.value)
    plans[:_AGAIN] = [_each_again(team, plan) for plan in plans[:_AGAIN]]
    return sorted(plans, key=lambda plan: -plan.value)


def owners_of(problem: RoundProblem, found: Found) -> Ints:
    """(K,) the aircraft that serves each device of the problem, -1: nobody."""
    whose = np.full(len(problem.importance), -1)
    whose[problem.importance > 0.0] = owners(found, problem.steps)
    return whose


def parts_along(
    alone: Sequence[RoundProblem], found: Found, ways: Floats | None = None
) -> Parts | None:
    """Return a plan in parts that keep to all that their problems ask for; None where one of them
    does not fit. Other `ways` (A, N, 2) than its own serve the same devices."""
    whose, ways = owners_of(alone[0], found), found.way if ways is None else ways
    return one_of_each([
        part_along(problem, problem.start_m + ways[a], whose == a)
        for a, problem in enumerate(alone)
    ])  # fmt: skip


def _varied(alone: Sequence[RoundProblem], team: Team, plans: list[Found]) -> Found:
    """Return the best of a few plans after changes at random, climbed."""
    made = []
    for seed, plan in enumerate(plans[:_VARIED]):
        parts = parts_along(alone, plan)
        if parts is None:
            continue
        parts = improved_in_turn(alone, parts, CHANGES // _VARIED, seed=seed)
        ways = [
            part.waypoints_m - problem.start_m for part, problem in zip(parts, alone, strict=True)
        ]
        made.append(team.plan_along(np.stack(ways)))
    return max([*made, plans[0]], key=lambda plan: plan.value)


def _way(team: Team, aircraft: int, taken: Floats, *, longer: bool = False) -> Floats:
    """Return a path (N, 2) of one aircraft where others bring `taken` (K,) already; looked for
    `longer`, as where there is no other aircraft."""
    case = team.cases[aircraft]
    devices = replace(case.devices, price=np.ascontiguousarray(taken))
    starts, attempts = (STARTS, tries(len(taken))) if longer else (_STARTS, _TRIES)
    return explore(devices, case.limits, starts=starts, tries=attempts)[1]


def _one_after_another(team: Team, order: Sequence[int]) -> Found:
    plan = team.plan_along(np.zeros((len(team.cases), team.cases[0].limits.steps, 2)))
    for a in order:
        plan = _again(team, plan, a, longer=True)
    return plan


def _each_again(team: Team, plan: Found) -> Found:
    """Plan each aircraft once more for what the others leave, where that is better."""
    for a in range(len(team.cases)):
        plan = max(plan, _again(team, plan, a), key=lambda plan: plan.value)
    return plan


def _again(team: Team, plan: Found, aircraft: int, *, longer: bool = False) -> Found:
    """Return the plan with another path of one aircraft, for what the others leave to it."""
    ways, left = plan.way.copy(), np.delete(team.brought(plan), aircraft, axis=0)
    ways[aircraft] = _way(team, aircraft, left.max(axis=0, initial=0.0), longer=longer)
    return team.plan_along(ways)
