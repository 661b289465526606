"""Plans of several aircraft that come too near to each other, mended.

Paths are exchanged between aircraft, or flown the other way round; where that costs much, or does
not do, aircraft are put into layers of altitude; else they wait before they leave, and whom no wait
helps stays where it is. Whoever made the plan, it is mended here.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, permutations, product

import numpy as np

from mission.base.arrays import Floats
from mission.base.errors import InfeasiblePlanError
from mission.planner.apart import (
    flown,
    height_of,
    hovering,
    keep_apart,
    layer_m,
    layered_by,
    pair_of,
    too_near,
)
from mission.planner.check import check_plan
from mission.planner.evaluate import objective
from mission.planner.fleet.parts import (
    Parts,
    alone_of,
    masked,
    one_of_each,
    part_along,
    served,
)
from mission.planner.fleet.within import completed
from mission.planner.flyable import foresee_round
from mission.planner.improving import fitted
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem

Again = Callable[[RoundProblem], RoundPlan]
Tried = Iterator[tuple[RoundPlan, str]]

LITTLE = 0.01  # of the value: what one way may cost before the next is tried, too
_ORDERS = 24  # in which paths are exchanged, and aircraft have way, at most
_TURNS = 2**4  # of exchanged paths, at most: each of four aircraft either way round
_LOWEST_M, _HIGHEST_M = 10.0, 500.0
_WAITS_S = tuple(range(0, 61, 2))


def kept_apart(
    problem: RoundProblem, plan: RoundPlan, again: Again | None = None, *, hold_s: float = 0.0
) -> RoundPlan:
    """Return the plan if its aircraft keep apart, else a mended one that says what it cost; where
    nothing mends it, the plan itself says so.

    `again` plans a round without looking at distances: layers are planned anew. Without it they are
    flown on the paths that there are. Each aircraft hovers `hold_s` at every stop (`stops_of`).
    """
    found = too_near(problem, plan, hold_s=hold_s)
    if found is None:
        return plan
    case, made = _Mending(problem, alone_of(problem), plan, hold_s), list[tuple[RoundPlan, str]]()
    for tried in (case.exchanged(), case.layered(again), case.in_turn()):
        best_first = sorted(tried, key=lambda one: -one[0].value)
        mended = next((one for one in best_first if case.keeps(one[0])), None)
        if mended is not None:
            made.append(mended)
            if mended[0].value >= plan.value * (1.0 - LITTLE):
                break
    said = f"{found.words}, {problem.separation_m:g} m are kept"
    if not made:
        return replace(plan, mended=f"{said}: no other paths, heights or waits do that")
    best, how = max(made, key=lambda one: one[0].value)
    change = best.value / plan.value - 1.0 if plan.value else 0.0
    return replace(best, mended=f"{said}: {how}; the value changes by {100 * change:+.2f} %")


@dataclass(frozen=True)
class _Mending:
    """A plan whose aircraft come too near to each other, and the ways to mend it."""

    problem: RoundProblem
    alone: Sequence[RoundProblem]  # of each
    plan: RoundPlan
    hold_s: float

    def keeps(self, made: RoundPlan) -> bool:
        """Whether aircraft keep apart by another plan, which is right otherwise, too."""
        if not keep_apart(self.problem, made, hold_s=self.hold_s):
            return False
        try:
            check_plan(self.problem, made, hold_s=self.hold_s)
        except InfeasiblePlanError:
            return False
        return True

    def exchanged(self) -> Tried:
        """Yield plans in which aircraft have each other's paths."""
        plan = self.plan
        for ways, whose in _swapped(self.problem, plan):
            parts = [
                part_along(
                    each, ways[a], served(plan.alone(whose[a])), altitude_m=self._height_m(a)
                )
                for a, each in enumerate(self.alone)
            ]
            if made := one_of_each(parts):
                whole = _whole(self.alone, completed(self.alone, made), plan)
                yield whole, "paths are exchanged"

    def layered(self, again: Again | None) -> Tried:
        """Yield a plan of aircraft at altitudes that are a layer apart, about the planned ones,
        with the bound of plans at these; none where they have no such altitudes."""
        problem, plan = self.problem, self.plan
        spare_m = layered_by(problem)
        each = [(problem.alone(a), plan.alone(a)) for a in range(len(plan.paths))]
        ranges = []
        for one, part in each:
            height_m = height_of(one, part)
            ranges.append(one.altitudes_m or (height_m - spare_m, height_m + spare_m))
        lowest = max(_LOWEST_M, *(low for low, _ in ranges))
        highest = min(_HIGHEST_M, *(high for _, high in ranges))
        gap, count = layer_m(problem), len(each)
        room = (count - 1) * gap
        if not room or room > highest - lowest:
            return
        middle = float(np.mean([height_of(*one) for one in each]))
        bottom = min(max(middle - room / 2.0, lowest), highest - room)
        heights = [bottom + gap * rank for rank in range(count)]

        def worth(order: tuple[int, ...]) -> float:
            return sum(
                objective(one.at(heights[rank]), part.waypoints_m, part.schedule[0])
                for (one, part), rank in zip(each, order, strict=True)
            )

        order = max(_orders(count), key=worth)
        starts = tuple(
            replace(start, altitudes_m=None, altitude_m=heights[rank])
            for start, rank in zip(problem.starts, order, strict=True)
        )
        at = replace(problem, starts=starts, separation_m=0.0)
        made = _same_paths(at, plan) if again is None else again(at)
        paths = tuple(
            replace(path, altitude_m=start.altitude_m)
            for path, start in zip(made.paths, starts, strict=True)
        )
        flown_at = ", ".join(f"{path.altitude_m:g}" for path in paths)
        yield replace(made, paths=paths), f"flown at {flown_at} m"

    def in_turn(self) -> Tried:
        """Yield plans in which aircraft leave after waits, or stay where they are."""
        count = len(self.alone)
        tried = [found for order in _orders(count) if (found := self._waiting(order)) is not None]
        if not tried:  # all stay, which is no nearer than they start
            stay = [self._with_wait(a, math.inf) for a in range(count)]
            tried = [(one_of_each(stay) or [], [math.inf] * count)]
        for parts, waits in tried:
            told = [
                f"{self.problem.name_of(a)} "
                f"{'stays' if math.isinf(wait) else f'waits for {wait:g} s'}"
                for a, wait in enumerate(waits)
                if wait
            ]
            yield _whole(self.alone, parts, self.plan), ", ".join(told)

    def _waiting(self, order: Sequence[int]) -> tuple[Parts, list[float]] | None:
        """Let each aircraft of an order wait until it keeps apart from those before it, or stay."""
        parts, waits = dict[int, RoundPlan](), [0.0] * len(order)
        tracks = hovering(self.problem)
        for a in order:
            for wait_s in (*map(float, _WAITS_S), math.inf):
                part = self._with_wait(a, wait_s)
                if part is None:
                    continue
                track = flown(self.alone[a], part, hold_s=self.hold_s)
                if all(pair_of(self.problem, track, other)[-1] <= 0.0 for other in tracks):
                    parts[a], waits[a] = part, wait_s
                    tracks.append(track)
                    break
            else:
                return None
        return [parts[a] for a in sorted(parts)], waits

    def _with_wait(self, aircraft: int, wait_s: float) -> RoundPlan | None:
        """Return an aircraft's part after a wait; one without end: where it stands."""
        each, part = self.alone[aircraft], self.plan.alone(aircraft)
        way, height_m = part.waypoints_m, self._height_m(aircraft)
        if math.isinf(wait_s):
            way, wait_s = np.tile(each.start_m, (len(way), 1)), 0.0
        made = fitted(masked(each, served(part)).at(height_m), way, wait_s=wait_s)
        return made and made.with_own(altitude_m=height_m)

    def _height_m(self, aircraft: int) -> float | None:
        """The altitude that was chosen for an aircraft, where there is a choice."""
        chosen = self.alone[aircraft].altitudes_m is not None
        return self.plan.paths[aircraft].altitude_m if chosen else None


def _orders(count: int) -> Iterator[tuple[int, ...]]:
    """Yield orders of so many aircraft: all of four, of more those that begin alike."""
    return islice(permutations(range(count)), _ORDERS)


def _swapped(
    problem: RoundProblem, plan: RoundPlan
) -> Iterator[tuple[list[Floats], tuple[int, ...]]]:
    """Yield waypoints (N, 2) for each aircraft, and whose they were: of others, and turned."""
    aircraft, starts = range(len(plan.paths)), [start.start_m for start in problem.starts]
    turns = islice(product((False, True), repeat=len(aircraft)), _TURNS)
    seen = set()
    for turned in turns:
        for whose in _orders(len(aircraft)):
            ways = []
            for a in aircraft:
                way = plan.paths[whose[a]].waypoints_m[1:]
                ways.append(np.vstack((starts[a][None], way[::-1] if turned[a] else way)))
            key = np.stack(ways).tobytes()
            if key not in seen:
                seen.add(key)
                yield ways, whose


def _whole(alone: Sequence[RoundProblem], parts: Parts, plan: RoundPlan) -> RoundPlan:
    """Return parts as a plan with the bound of the first one."""
    parts = [
        part.with_own(foreseen=foresee_round(each, part))
        for each, part in zip(alone, parts, strict=True)
    ]
    made = RoundPlan.together(parts)
    return replace(plan, paths=made.paths, schedule=made.schedule, value=made.value)


def _same_paths(problem: RoundProblem, plan: RoundPlan) -> RoundPlan:
    """Return the plan as it is flown at other altitudes, whose bound nobody knows."""
    alone = alone_of(problem)
    paths = tuple(replace(path, altitude_m=None) for path in plan.paths)
    made = replace(plan, paths=paths, upper_bound=math.nan)
    fitting = [
        part_along(each, path.waypoints_m, served(plan.alone(a)))
        for a, (each, path) in enumerate(zip(alone, plan.paths, strict=True))
    ]
    parts = one_of_each(fitting)
    return _whole(alone, parts, made) if parts else made
