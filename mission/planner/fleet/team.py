"""Search inputs of a round for several aircraft.

Each aircraft's part of the round is a problem of its own, with the same devices, importance, steps
and places a step; only "each device once" couples them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mission.base.arrays import Floats, Ints
from mission.planner.certified import Case, instance, reach_of, relax
from mission.planner.native.crews import polished
from mission.planner.native.library import MOST_DEVICES, Found, assign
from mission.planner.problem import RoundProblem

LEAST_M = 1e-3  # of a path: an aircraft that may not move is searched as one that hardly may


@dataclass(frozen=True)
class Team:
    """Search inputs of A aircraft: for each its own case, for all together those of a search."""

    cases: tuple[Case, ...]
    joint: tuple[Case, ...]  # with the same promises, where they have the same radii

    @cached_property
    def promise(self) -> Floats:
        """(A, K) upper bound of what each device brings to each aircraft."""
        return np.stack([case.relaxation.promise[:, 0] for case in self.cases])

    @cached_property
    def delta(self) -> Floats:
        """(K,) importance of the devices that are worth something."""
        return self.cases[0].devices.delta

    @cached_property
    def one_radio(self) -> bool:
        """Whether all aircraft hear alike, as those at the same altitude do."""
        radii = {case.relaxation.coefficients.tobytes() for case in self.cases}
        return len(radii) == 1

    @property
    def searchable(self) -> bool:
        """Whether there is a search for so many devices, on a channel and not on a grid."""
        devices = self.cases[0].devices
        return len(devices.delta) <= MOST_DEVICES and devices.grid is None

    @cached_property
    def first_bound(self) -> float:
        """Sum of the A N K_bar largest promises: what the best served devices bring at most."""
        limits = self.cases[0].limits
        places = len(self.cases) * limits.steps * limits.per_step
        return float(np.sort(self.promise.max(axis=0))[::-1][:places].sum())

    def plan_along(self, ways: Floats) -> Found:
        """Return the best plan near paths (A, N, 2), with the first bound."""
        return Found(*polished(self.cases, ways), self.first_bound)

    def brought(self, plan: Found) -> Floats:
        """(A, K) what each device brings to the aircraft that serves it, 0 to the others."""
        steps, worth = self.cases[0].limits.steps, np.zeros(self.promise.shape)
        for a, case in enumerate(self.cases):
            mine = np.flatnonzero(owners(plan, steps) == a)
            worth[a, mine] = case.devices.brought(mine, plan.way[a, plan.assigned[mine] % steps])
        return worth


def team_of(problems: Sequence[RoundProblem]) -> Team:
    """Return the search inputs of a round, one problem for each aircraft."""
    reach_m = max(map(reach_of, problems))
    cases = []
    for problem in problems:
        moving = problem.with_own(path_budget_m=max(problem.path_budget_m, LEAST_M))
        devices, limits = instance(moving, reach_m=reach_m)
        cases.append(Case(devices, limits, relax(moving, devices, reach_m=reach_m)))
    best = np.max([case.relaxation.promise for case in cases], axis=0) if one_size(cases) else None
    joint = [
        case if best is None else replace(case, relaxation=replace(case.relaxation, promise=best))
        for case in cases
    ]
    return Team(tuple(cases), tuple(joint))


def one_size(cases: Sequence[Case]) -> bool:
    """Whether the tables of all aircraft are of the same radii."""
    return len({case.relaxation.promise.shape for case in cases}) == 1


def owners(plan: Found, steps: int) -> Ints:
    """(K,) the aircraft that serves each device, -1: nobody."""
    return np.where(plan.assigned >= 0, plan.assigned // steps, -1)


TURNS, DRAWS = 12, 8  # of the sweep, and of first centres of clusters
_MOVES = 8  # of centres


def partitions(devices_m: Floats, worth: Floats, starts_m: Floats) -> Iterator[Ints]:
    """Yield partitions (K,) of devices (K, 2) worth (K,) over aircraft that start at (A, 2):
    sectors about the middle of the starts, and clusters (k-means). Where starts differ, each part
    goes to an aircraft near it."""
    aircraft = len(starts_m)
    offset = devices_m - starts_m.mean(axis=0)
    bearing = np.arctan2(offset[:, 1], offset[:, 0])
    for turn in range(TURNS):
        order = np.argsort((bearing - 2.0 * np.pi * turn / TURNS) % (2.0 * np.pi), kind="stable")
        share = np.cumsum(worth[order]) - worth[order] / 2.0
        part = np.empty(len(worth), dtype=np.int64)
        part[order] = np.minimum(share / worth.sum() * aircraft, aircraft - 1).astype(np.int64)
        yield _to_nearest(part, devices_m, starts_m)
    for draw in range(DRAWS):
        centres = _first_centres(devices_m, aircraft, draw)
        for _ in range(_MOVES):
            part = _distances(devices_m, centres).argmin(axis=1)
            centres = _centres(part, devices_m, worth, centres)
        yield _to_nearest(part, devices_m, starts_m)


def _first_centres(devices_m: Floats, aircraft: int, draw: int) -> Floats:
    """(A, 2) places of devices; some twice where there are fewer."""
    order = np.random.Generator(np.random.PCG64(draw)).permutation(len(devices_m))
    return devices_m[np.resize(order, aircraft)]


def _centres(part: Ints, devices_m: Floats, worth: Floats, before: Floats) -> Floats:
    """(A, 2) centres of the parts; those of empty parts stay."""
    centres = before.copy()
    for a in np.unique(part[worth > 0.0]):
        mine = part == a
        centres[a] = worth[mine] @ devices_m[mine] / worth[mine].sum()
    return centres


def _to_nearest(part: Ints, devices_m: Floats, starts_m: Floats) -> Ints:
    """Number the parts so that they are as near to the starts of their aircraft as may be."""
    centres = _centres(part, devices_m, np.ones(len(part)), starts_m)
    far_m = _distances(centres, starts_m)  # of a part from a start
    given = assign(1.0 + far_m.max() - far_m, np.ones(len(starts_m)), 1)
    return np.asarray(given.argmax(axis=1)[part])


def _distances(a_m: Floats, b_m: Floats) -> Floats:
    return np.asarray(np.hypot(*np.moveaxis(a_m[:, None] - b_m[None], -1, 0)))
