"""Prices on "each device once", and plans packed from the paths that they bring.

For any prices lambda_k >= 0 no plan of several aircraft is worth more than

    sum_k lambda_k + sum_a B_a(lambda),

where B_a bounds what aircraft a alone earns if serving device k costs lambda_k (Lagrangian
relaxation). B_a is proven by the search of one aircraft. The prices are those that the paths found
so far ask for (column generation), the softer the more is left to prove. The paths, packed, mend
who serves whom.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from mission.base.arrays import Floats
from mission.planner.certified import Case, branched
from mission.planner.fleet.packing import Column, Market, packed
from mission.planner.fleet.team import Team
from mission.planner.native.crews import alike, search_orders
from mission.planner.native.library import MOST_DEVICES, Found, Goal, match

SOFT = 0.03  # of what is left to prove: over how much the market is smooth, at most
CALMER, SHARPER = 0.6, 0.3  # times that after a step in vain, and after one without a new path
SHARPEST = 1e-5  # of the value: as good as not smooth
# Looked into in a call of one aircraft's search at most: at prices that are given, and on the way.
CALL_NODES, STEP_NODES = 10_000, 160_000
VAIN = 0.02  # of what is left: a step that takes off less was in vain
MOST_STEPS = 150
# After so many steps the gap is to be under this share of what it was.
PACE_STEPS, STALLED = 12, 0.95
SLACK = 0.25  # of the gap asked for: by how much the bounds of all aircraft together may be loose
FAR_SLACK = 0.15  # the same, of the gap that is left, while that is more
LEAST_STEPS = 5  # for which orders are searched
PACKED = 120  # columns that are packed at most
PACK_EVERY = 4  # steps
ENDED = "prices ended after {calls} searches of one aircraft, of {nodes} nodes in all"
_FEEBLE = 1e-7  # of the value: a gain that is none


def columns_of(team: Team, plan: Found) -> list[Column]:
    """Return the paths of a plan that can serve somebody."""
    groups = enumerate(alike(team.cases).tolist())
    columns = [column_along(team, group, plan.way[a]) for a, group in groups]
    return [column for column in columns if column.brought.any()]


def column_along(team: Team, group: int, way: Floats) -> Column:
    """Return a path (N, 2) with all that an aircraft can bring along it."""
    devices = team.cases[group].devices
    _, assigned = match(devices, team.cases[group].limits, way)
    served, brought = np.flatnonzero(assigned >= 0), np.zeros(len(assigned))
    brought[served] = devices.brought(served, way[assigned[served]])
    return Column(group, way, brought)


@dataclass
class _Search:
    """Prices and paths of one round."""

    team: Team
    goal: Goal
    best: Found
    columns: list[Column]

    def __post_init__(self) -> None:
        self.alike = alike(self.team.cases)
        self.groups, self.counts = np.unique(self.alike, return_counts=True)
        self.row = {int(group): i for i, group in enumerate(self.groups)}
        self.market = Market(self.counts, self.team.delta)
        for column in self.columns:
            self.market.add(self.row[column.group], column.brought)
        self.prices = np.zeros(len(self.team.delta))
        self.bound, self.nodes = np.inf, 0
        self.calls = 0
        self.cut = False  # whether one of the calls has ended early

    def run(self) -> Found:
        inwards = 0.0  # weight of the best prices so far, after steps in vain
        soft = left = np.inf
        for step in range(MOST_STEPS):
            if self.done and step > 0:
                break
            if step and step % PACE_STEPS == 0:
                if self.bound - self.best.value > STALLED * left:
                    break
                left = self.bound - self.best.value
            soft = min(soft, SOFT * (self.best.bound - self.best.value))
            soft = max(soft, SHARPEST * self.best.value)
            prices = (1.0 - inwards) * self.market.prices(soft) + inwards * self.prices
            before, self.cut = self.bound - self.best.value, False
            useful = self._look(prices)
            better = self.bound - self.best.value < (1.0 - VAIN) * before
            if (step + 1) % PACK_EVERY == 0:
                self._pack()
            inwards = 0.0 if better else 0.5 * (1.0 + inwards)
            if self.cut:
                continue
            if not (useful or better) and soft <= SHARPEST * self.best.value:
                break
            soft *= (1.0 if better else CALMER) * (1.0 if useful else SHARPER)
        if not self.done:
            self._pack()
        return self.best

    @property
    def done(self) -> bool:
        return self.best.gap <= self.goal.gap or self.nodes >= self.goal.max_nodes

    def _look(self, prices: Floats) -> bool:
        """Bound the round at these prices; whether a path was found that the market lacks."""
        useful, total = False, float(prices.sum())
        most = self.market.most_after(prices)
        for group, count in zip(self.groups.tolist(), self.counts.tolist(), strict=True):
            case = priced(self.team.cases[group], prices)
            mine = [column for column in self.columns if column.group == group]
            way = max(mine, key=lambda column: column.after(prices)).way if mine else None
            found = self._searched(case, way)
            total += count * found.bound
            column = column_along(self.team, group, found.way)
            if column.after(prices) > most[self.row[group]] + _FEEBLE * self.best.value:
                useful = True
                self._add(column)
        if total < self.bound:
            self.bound, self.prices = total, prices
            self.best = replace(self.best, bound=min(self.best.bound, total))
        return useful

    def _searched(self, case: Case, way: Floats | None) -> Found:
        way = np.zeros((case.limits.steps, 2)) if way is None else way
        begun = case.polished(way)
        aircraft = len(self.team.cases)
        scale, left = self.best.value / aircraft, (self.best.bound - self.best.value) / aircraft
        slack = max(SLACK * self.goal.gap * scale, FAR_SLACK * left)
        found = searched_alone(case, begun, Goal(0.0, STEP_NODES, slack, scale))
        self.nodes += found.nodes
        self.calls += 1
        self.cut |= found.nodes >= STEP_NODES
        return found

    def _add(self, column: Column) -> None:
        self.columns.append(column)
        self.market.add(self.row[column.group], column.brought)

    def _pack(self) -> None:
        """Make a plan of the paths that are worth most at the best prices."""
        most = self.market.most_after(self.prices)
        lost = [most[self.row[one.group]] - one.after(self.prices) for one in self.columns]
        some = [self.columns[i] for i in np.argsort(lost, kind="stable")[:PACKED]]
        chosen = packed(some, [self.row[one.group] for one in some], self.counts)
        ways = np.zeros_like(self.best.way)
        free = {int(group): np.flatnonzero(self.alike == group) for group in self.groups}
        for column in (some[i] for i in chosen):
            ways[free[column.group][0]], free[column.group] = column.way, free[column.group][1:]
        plan = self.team.plan_along(ways)
        if plan.value > self.best.value:
            self.best = replace(plan, bound=self.best.bound)
            for column in columns_of(self.team, plan):
                self._add(column)


def search_prices(
    team: Team, plan: Found, columns: Iterable[Column], goal: Goal
) -> tuple[Found, Floats]:
    """Improve on a plan of several aircraft and lower its bound by prices, until the goal is met,
    its nodes are used up, or no prices are better. Returns the prices (K,) of the best bound."""
    search = _Search(team, goal, plan, list(columns))
    found = search.run()
    ended = "" if found.gap <= goal.gap else ENDED.format(nodes=search.nodes, calls=search.calls)
    return replace(found, nodes=plan.nodes + search.nodes, ended=ended), search.prices


def priced(case: Case, prices: Floats) -> Case:
    """Return the search input of an aircraft for which serving device k costs prices (K,)."""
    relaxation = case.relaxation
    promise = np.maximum(0.0, relaxation.promise - prices[:, None])
    return replace(
        case,
        devices=replace(case.devices, price=np.ascontiguousarray(prices)),
        relaxation=replace(relaxation, promise=promise),
    )


def searched_alone(case: Case, begun: Found, goal: Goal) -> Found:
    """Search for one aircraft's best plan: by orders, unless steps are very few."""
    if case.limits.steps < LEAST_STEPS or len(begun.assigned) > MOST_DEVICES:
        return branched(case, begun, goal)
    left = goal.left(begun, goal.max_nodes)
    return begun if left is None else search_orders([case], plan=begun, goal=left)


def bound_at(cases: Iterable[Case], prices: Floats, way: Floats, goal: Goal) -> tuple[float, int]:
    """Return an upper bound of what an aircraft earns at prices (K,) in the worst of its cases, and
    the nodes looked into; a path (N, 2) to begin with is given."""
    worst, nodes = 0.0, 0
    for case in cases:
        one = priced(case, prices)
        begun = one.polished(way)
        found = searched_alone(one, begun, goal)
        worst, nodes = max(worst, found.bound), nodes + found.nodes
    return worst, nodes
