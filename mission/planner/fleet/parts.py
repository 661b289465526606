"""Plans of several aircraft as parts, one for each, that serve different devices."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mission.base.arrays import Bools, Floats
from mission.planner.evaluate import success
from mission.planner.improving import fitted, varied
from mission.planner.limited import servable
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem

Parts = list[RoundPlan]
# What changes may lose at first, by turn of all aircraft; they share the changes.
TOLERANCES = (0.02, 0.01, 0.01, 0.005, 0.0)
_GAIN = 1e-9  # of the value: less is no improvement


def alone_of(problem: RoundProblem) -> list[RoundProblem]:
    """Return the problem of each aircraft, with the metres and devices that its limits allow."""
    alone = [problem.alone(a) for a in range(len(problem.starts))]
    alone = [each.with_own(path_budget_m=each.most_m) for each in alone]
    importance = np.max([servable(each) for each in alone], axis=0)
    return [replace(each, importance=importance) for each in alone]


def one_of_each(parts: Sequence[RoundPlan | None]) -> Parts | None:
    """Return the parts; None where an aircraft has none."""
    made = [part for part in parts if part is not None]
    return made if len(made) == len(parts) else None


def total(parts: Parts) -> float:
    """What a joint plan is worth."""
    return sum(part.value for part in parts)


def served(part: RoundPlan) -> Bools:
    """(K,) whom a part serves."""
    return np.asarray(part.schedule.any(axis=(0, 1)), dtype=np.bool_)


def taken(parts: Parts, but: int) -> Bools:
    """(K,) whom the other aircraft serve."""
    none = np.zeros(parts[but].schedule.shape[-1], dtype=np.bool_)
    others = [served(part) for a, part in enumerate(parts) if a != but]
    return np.asarray(np.logical_or.reduce([none, *others]))


def masked(problem: RoundProblem, free: Bools) -> RoundProblem:
    """Return the problem without importance of devices that are not free (K,)."""
    return replace(problem, importance=np.where(free, problem.importance, 0.0))


def brought(problem: RoundProblem, part: RoundPlan) -> Floats:
    """(K,) what an aircraft's part brings of each device."""
    chance = success(problem.at(part.altitude_m), part.waypoints_m)
    return np.asarray((chance * part.schedule[0]).sum(axis=0) * problem.importance)


def part_along(
    problem: RoundProblem, waypoints_m: Floats, free: Bools, *, altitude_m: float | None = None
) -> RoundPlan | None:
    """Return an aircraft's best part along waypoints (N, 2) for devices that are free (K,), at an
    altitude that it is to keep where one is open; None where a few cuts do not make it fit."""
    part = fitted(masked(problem, free).at(altitude_m), waypoints_m)
    if part is None or altitude_m is None:
        return part
    return part.with_own(altitude_m=altitude_m)


def improved_in_turn(
    alone: Sequence[RoundProblem], parts: Parts, changes: int, *, seed: int = 0
) -> Parts:
    """Improve the parts by so many random changes in all (`native/variation.h`), an aircraft after
    the other: each may take a device that another one serves if it brings more of it."""
    each = max(1, changes // (len(TOLERANCES) * len(parts)))
    for turn, tolerance in enumerate(TOLERANCES):
        for a, problem in enumerate(alone):
            price = np.sum([np.zeros(len(problem.importance)), *(
                brought(alone[b], part) for b, part in enumerate(parts) if b != a
            )], axis=0)  # fmt: skip
            tried = varied(
                problem, parts[a], each, tolerance=tolerance, seed=seed + turn, price=price
            )
            if tried.value > parts[a].value * (1.0 + _GAIN):
                parts = _with(alone, parts, a, tried)
    return parts


def _with(alone: Sequence[RoundProblem], parts: Parts, own: int, tried: RoundPlan) -> Parts:
    """Return the parts with another one for an aircraft, whose devices the others then leave to it;
    or the parts as they are, if that is no better."""
    made = [*parts[:own], tried, *parts[own + 1 :]]
    for a in [*(a for a in range(len(parts)) if a != own), own]:
        one = part_along(
            alone[a], made[a].waypoints_m, ~taken(made, a), altitude_m=made[a].altitude_m
        )
        if one is None:
            return parts
        made[a] = one
    return made if total(made) > total(parts) * (1.0 + _GAIN) else parts
