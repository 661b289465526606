"""Joint plans whose aircraft come too near to each other, mended.

Paths are exchanged between aircraft, or flown the other way round; where that costs much, or does
not do, aircraft are put into layers of altitude; else they wait before they leave, and whom no wait
helps stays where it is.
"""
# ruff: noqa: ARG001 - a way need not know all that another asks for.

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from mission.base.arrays import Floats
from mission.planner.apart import (
    TOLERANCE_M,
    flown,
    height_of,
    layer_m,
    layered_by,
    nearest_of,
    too_near,
)
from mission.planner.evaluate import objective
from mission.planner.fleet.parts import Parts, masked, part_along, served, total
from mission.planner.fleet.within import completed
from mission.planner.flyable import foresee_round
from mission.planner.improving import fitted
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem

Again = Callable[[RoundProblem], RoundPlan]

LITTLE = 0.01  # of the value: what one way may cost before the next is tried, too
_ORDERS = 24  # in which paths are exchanged, and aircraft have way, at most
_LOWEST_M, _HIGHEST_M = 10.0, 500.0
_WAITS_S = tuple(range(0, 61, 2))


def kept_apart(
    problem: RoundProblem,
    alone: Sequence[RoundProblem],
    plan: RoundPlan,
    again: Again,
) -> RoundPlan:
    """Return the plan if its aircraft keep apart, else a mended one that says what it cost.

    `again` plans a round without looking at distances: layers are planned anew.
    """
    found = too_near(problem, plan)
    if found is None:
        return plan
    enough, made = plan.value * (1.0 - LITTLE), list[tuple[RoundPlan, str]]()
    for way in (_exchanged, _layered, _in_turn):
        mended = way(problem, alone, plan, again)
        if mended is not None:
            made.append(mended)
            if mended[0].value >= enough:
                break
    best, how = max(made, key=lambda one: one[0].value)
    change = best.value / plan.value - 1.0 if plan.value else 0.0
    return replace(best, mended=f"{found.words}: {how}; the value changes by {100 * change:+.2f} %")


def _exchanged(
    problem: RoundProblem, alone: Sequence[RoundProblem], plan: RoundPlan, again: Again
) -> tuple[RoundPlan, str] | None:
    """Return the best plan in which aircraft have each other's paths and keep apart."""
    tried = []
    for ways, whose in _swapped(problem, plan):
        parts = [
            part_along(
                each, ways[a], served(plan.alone(whose[a])), altitude_m=_height(each, plan, a)
            )
            for a, each in enumerate(alone)
        ]
        made = [part for part in parts if part is not None]
        if len(made) == len(alone):
            made = completed(alone, made)
            tried.append(_whole(alone, made, plan))
    for one in sorted(tried, key=lambda one: -one.value):
        if too_near(problem, one) is None:
            return one, "paths are exchanged"
    return None


def _swapped(
    problem: RoundProblem, plan: RoundPlan
) -> Iterator[tuple[list[Floats], tuple[int, ...]]]:
    """Yield waypoints (N, 2) for each aircraft, and whose they were: of others, and turned."""
    aircraft, starts = range(len(plan.paths)), [start.start_m for start in problem.starts]
    turns = [(False,) * len(aircraft), *product((False, True), repeat=len(aircraft))]
    seen = set()
    for turned in turns:
        for whose in list(permutations(aircraft))[:_ORDERS]:
            ways = []
            for a in aircraft:
                way = plan.paths[whose[a]].waypoints_m[1:]
                ways.append(np.vstack((starts[a][None], way[::-1] if turned[a] else way)))
            key = np.stack(ways).tobytes()
            if key not in seen:
                seen.add(key)
                yield ways, whose


def _height(each: RoundProblem, plan: RoundPlan, aircraft: int) -> float | None:
    """The altitude that was chosen for an aircraft, where there is a choice."""
    return plan.paths[aircraft].altitude_m if each.altitudes_m is not None else None


def _whole(alone: Sequence[RoundProblem], parts: Parts, plan: RoundPlan) -> RoundPlan:
    """Return parts as a plan with the bound of the first one."""
    parts = [
        part.with_own(foreseen=foresee_round(each, part))
        for each, part in zip(alone, parts, strict=True)
    ]
    made = RoundPlan.together(parts)
    return replace(plan, paths=made.paths, schedule=made.schedule, value=made.value)


def _layered(
    problem: RoundProblem, alone: Sequence[RoundProblem], plan: RoundPlan, again: Again
) -> tuple[RoundPlan, str] | None:
    """Return a plan of aircraft at altitudes that are a layer apart, about the planned ones, with
    the bound of plans at these; None where they have no such altitudes."""
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
    if room > highest - lowest:
        return None
    middle = float(np.mean([height_of(*one) for one in each]))
    bottom = min(max(middle - room / 2.0, lowest), highest - room)
    heights = [bottom + gap * rank for rank in range(count)]

    def worth(order: tuple[int, ...]) -> float:
        return sum(
            objective(one.at(heights[rank]), part.waypoints_m, part.schedule[0])
            for (one, part), rank in zip(each, order, strict=True)
        )

    order = max(list(permutations(range(count)))[:_ORDERS], key=worth)
    starts = tuple(
        replace(start, altitudes_m=None, altitude_m=heights[rank])
        for start, rank in zip(problem.starts, order, strict=True)
    )
    made = again(replace(problem, starts=starts, separation_m=0.0))
    paths = tuple(
        replace(path, altitude_m=heights[rank])
        for path, rank in zip(made.paths, order, strict=True)
    )
    made = replace(made, paths=paths)
    told = ", ".join(f"{path.altitude_m:g}" for path in paths)
    return None if too_near(problem, made) else (made, f"flown at {told} m")


def _in_turn(
    problem: RoundProblem, alone: Sequence[RoundProblem], plan: RoundPlan, again: Again
) -> tuple[RoundPlan, str]:
    """Return the best plan in which aircraft leave after waits, or stay where they are."""
    best: tuple[Parts, list[float]] | None = None
    for order in list(permutations(range(len(alone))))[:_ORDERS]:
        found = _waiting(problem, alone, plan, order)
        if found is not None and (best is None or total(found[0]) > total(best[0])):
            best = found
    if best is None:  # all stay, which is no nearer than they start
        stay = [_with_wait(alone, plan, a, math.inf) for a in range(len(alone))]
        best = [part for part in stay if part is not None], [math.inf] * len(alone)
    parts, waits = best
    told = [
        f"aircraft {a} stays" if math.isinf(wait) else f"aircraft {a} waits for {wait:g} s"
        for a, wait in enumerate(waits)
        if wait
    ]
    return _whole(alone, parts, plan), ", ".join(told)


def _waiting(
    problem: RoundProblem,
    alone: Sequence[RoundProblem],
    plan: RoundPlan,
    order: Sequence[int],
) -> tuple[Parts, list[float]] | None:
    """Let each aircraft of an order wait until it keeps apart from those before it, or stay."""
    parts, waits = list[RoundPlan | None]([None] * len(alone)), [0.0] * len(alone)
    tracks = list[Floats]()
    for a in order:
        for wait_s in (*map(float, _WAITS_S), math.inf):
            part = _with_wait(alone, plan, a, wait_s)
            if part is None:
                continue
            count = math.ceil(foresee_round(alone[a], part).duration_s * 20.0) + 2
            track = flown(alone[a], part, count)
            least = problem.separation_m - TOLERANCE_M
            if all(nearest_of(track, other, problem.separation_m)[0] >= least for other in tracks):
                parts[a], waits[a] = part, wait_s
                tracks.append(track)
                break
        else:
            return None
    made = [part for part in parts if part is not None]
    return made, waits


def _with_wait(
    alone: Sequence[RoundProblem], plan: RoundPlan, aircraft: int, wait_s: float
) -> RoundPlan | None:
    """Return an aircraft's part after a wait; one without end: where it stands."""
    each, part = alone[aircraft], plan.alone(aircraft)
    way, height_m = part.waypoints_m, _height(each, plan, aircraft)
    if math.isinf(wait_s):
        way, wait_s = np.tile(each.start_m, (len(way), 1)), 0.0
    made = fitted(masked(each, served(part)).at(height_m), way, wait_s=wait_s)
    return made and made.with_own(altitude_m=height_m)
