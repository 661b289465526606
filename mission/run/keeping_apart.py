"""Plans of a round in which each pair keeps the separation: mended where two come too near.

First the aircraft exchange paths, then they are flown in layers of height; of what keeps the
separation, what is worth most. Layers do so always, unless heights run out; among areas, which
may differ with the height, there are none.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import permutations
from typing import TypeAlias

import numpy as np

from mission.config.vehicles import HIGHEST_M, LOWEST_M
from mission.planner.evaluate import objective
from mission.planner.fleet.parts import part_along
from mission.planner.plan import PlannedPath, RoundPlan
from mission.planner.problem import RoundProblem
from mission.run.apart import planned_pairs
from mission.run.outing import Outing
from mission.scenario.strategies import Sortie

# What flying adds to a plan: errors of estimate and track, by which planned distances are greater,
# and by how much one may be later than another. Nothing where nobody flies.
MARGIN_M, OFF_S = 3.0, 1.0
_MOST_ORDERS = 4  # aircraft of which all orders are tried
_LAYER_M = 10.0  # between layers at least

Ordered: TypeAlias = Callable[[Sortie], Sequence[Outing]]


def kept_apart(
    problem: RoundProblem,
    sortie: Sortie,
    ordered: Ordered,
    *,
    least_m: float,
    off_s: float = 0.0,
    leaves: bool,
) -> tuple[Sortie, str]:
    """Return the sortie with a plan in which pairs keep `least_m`, also where one is by `off_s`
    later than the other, and words on what was changed.

    `ordered` gives the outings of a sortie. Where the aircraft are to leave their homes, a pair
    counts from when it is so far apart.
    """

    def nearest(plan: RoundPlan) -> tuple[float, str]:
        outings = ordered(replace(sortie, plan=plan))
        for one in outings:
            one.order()
        pairs = planned_pairs(outings, leaving_m=least_m if leaves else None, off_s=off_s)
        return min((near.away_m, " and ".join(names)) for names, near in pairs)

    plan = sortie.plan
    near_m, who = nearest(plan)
    if near_m >= least_m:
        return sortie, ""
    said = f"{who} would come within {near_m:.1f} m by plan, {least_m:g} m are kept"
    mended = [*_exchanged(problem, plan), *_layered(problem, plan, max(least_m, _LAYER_M))]
    for made, how in sorted(mended, key=lambda one: -one[0].value):
        if nearest(made)[0] >= least_m:
            lost = 0.0 if plan.value == 0.0 else made.value / plan.value - 1.0
            return replace(sortie, plan=made), f"{said}: {how}, value {lost:+.1%}"
    return sortie, f"{said}: no exchange of paths and no layers of height do that; flown as it is"


def _exchanged(problem: RoundProblem, plan: RoundPlan) -> Iterator[tuple[RoundPlan, str]]:
    """Yield plans in which aircraft fly each other's paths, serving the same devices."""
    count = len(plan.paths)
    if count > _MOST_ORDERS:
        return
    for order in list(permutations(range(count)))[1:]:
        parts = []
        for own, other in enumerate(order):
            alone, path = problem.alone(own), plan.paths[other]
            waypoints_m = np.vstack((alone.start_m, path.waypoints_m[1:]))
            free = np.asarray(plan.schedule[other].any(axis=0))
            parts.append(part_along(alone, waypoints_m, free, altitude_m=path.altitude_m))
        fitting = [part for part in parts if part is not None]
        if len(fitting) == count:
            yield _bounded(RoundPlan.together(fitting), plan), "paths exchanged"


def _layered(
    problem: RoundProblem, plan: RoundPlan, step_m: float
) -> Iterator[tuple[RoundPlan, str]]:
    """Yield plans at heights about those planned, for each order of the aircraft."""
    count = len(plan.paths)
    half_m = (count - 1) * step_m / 2.0
    if not problem.airspace.is_open or 2.0 * half_m > HIGHEST_M - LOWEST_M:
        return  # areas may be other ones at other heights
    ranks = range(count)
    orders = permutations(ranks) if count <= _MOST_ORDERS else [tuple(ranks)]
    planned_m = [
        problem.alone(a).at(path.altitude_m).channel.altitude_m for a, path in enumerate(plan.paths)
    ]
    middle_m = (min(planned_m) + max(planned_m)) / 2.0
    middle_m = min(max(middle_m, LOWEST_M + half_m), HIGHEST_M - half_m)
    for order in orders:
        paths, value = list[PlannedPath](), 0.0
        for a, rank in enumerate(order):
            height_m = middle_m - half_m + rank * step_m
            own = problem.alone(a).at(height_m)
            paths.append(replace(plan.paths[a], altitude_m=height_m, foreseen=None))
            value += objective(own, plan.paths[a].waypoints_m, plan.schedule[a])
        made = replace(plan, paths=tuple(paths), value=value, upper_bound=math.nan)
        yield made, f"heights {step_m:g} m apart"


def _bounded(made: RoundPlan, plan: RoundPlan) -> RoundPlan:
    return replace(made, upper_bound=plan.upper_bound, nodes=plan.nodes, ended=plan.ended)
