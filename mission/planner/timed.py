"""Bounds of rounds in which devices take time: hovers while they send, turns once they are ready.

The search of visiting orders (`native/search.h`) counts in metres. A hover is as many metres as
would be flown meanwhile, a stop what starting and braking take beyond the leg to it. A device that
gets ready late leaves so many metres for what comes after its turn. Where joules are limited, a
metre is what the cheapest of them takes.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from flightdyn.foresight import SETTLING_S
from mission.base.arrays import Floats
from mission.planner.certified import Case, Goal, case_of
from mission.planner.native.library import MOST_DEVICES, Found, search_orders
from mission.planner.performance import AHEAD_S, AHEAD_SHARE
from mission.planner.problem import RoundProblem

_PARTS = 4  # of altitudes that are open
_SHARED_NODES = 24_000  # looked into, divided by the devices, for each limit
_LEGS_M = np.linspace(0.0, 200.0, 401)  # whose joules are compared with those of a stop
_FAR_M = 1e4
_BRAKES_M = np.linspace(0.0, 100.0, 101)


@dataclass(frozen=True)
class PathAllowance:
    """Limit of time or energy in metres of path: the whole, and what hovers, stops, turns take."""

    whole: float
    hover: Floats  # (K,) while each device sends
    stop: tuple[float, float]  # at least, and from a leg of another length on, as many more
    # The same of time, where the round's are of energy; (K,) of time that are left from a device's
    # turn on, its hover included.
    sends: Floats
    turn: tuple[float, float]
    after: Floats

    def search(self, case: Case, worth: Floats, value: float, goal: Goal) -> float:
        """Return an upper bound on plans for importance `worth` (K,), given a known `value`."""
        each = (self.hover, self.sends, self.after)
        hover, sends, after = (np.ascontiguousarray(metres[worth > 0.0]) for metres in each)
        devices = replace(case.devices, hover=hover, sends=sends, after=after)
        limits = replace(case.limits, length=self.whole, stop=self.stop, turn=self.turn)
        nobody = np.full(len(devices.delta), -1)
        found = Found(value, np.zeros((limits.steps, 2)), nobody, math.inf)
        effort = goal.effort(found, goal.max_nodes)
        if effort is None:
            return math.inf
        return search_orders(devices, limits, case.relaxation, plan=found, effort=effort).bound


def timed_bound(problem: RoundProblem, value: float, goal: Goal) -> float:
    """Return an upper bound on plans with hovers and turns; infinity where none is proven.

    `value` is that of the best plan so far.
    """
    count = int(np.count_nonzero(problem.importance))
    timed = problem.limits is not None and (problem.upload_s is not None or _late(problem).any())
    ordered = problem.per_grid is None and count <= MOST_DEVICES  # else no order is searched
    if not (timed and ordered and count and problem.steps > 1 and problem.most_m > 0.0):
        return math.inf
    most_nodes = _SHARED_NODES // count // (1 if problem.altitudes_m is None else _PARTS)
    goal, worst = replace(goal, max_nodes=min(goal.max_nodes, most_nodes)), 0.0
    limits = [allowance for allowance in _limits(problem) if allowance.whole > 0.0]
    for case in _cases(problem):
        bound = math.inf
        for allowance in limits:
            if bound > worst:  # what is no more than elsewhere need not be lowered further
                enough = max(value, worst * (1.0 - goal.gap))
                bound = min(bound, allowance.search(case, problem.importance, enough, goal))
        worst = max(worst, bound)
    return worst


def _cases(problem: RoundProblem) -> Iterator[Case]:
    """Yield search inputs: at the fixed altitude, or at both ends of each part of open ones."""
    if problem.altitudes_m is None:
        yield case_of(problem)
        return
    for ends_m in pairwise(np.linspace(*problem.altitudes_m, _PARTS + 1).tolist()):
        for altitude_m, other_m in (ends_m, ends_m[::-1]):
            yield case_of(problem.at(altitude_m), towards_m=(other_m,))


def _late(problem: RoundProblem) -> Floats:
    """(K,) seconds into the round, as foreseen, before which a device's turn is too early."""
    if problem.ready_in_s is None:
        return np.zeros(len(problem.importance))
    assert problem.limits is not None
    if problem.limits.performance.guidance is None:
        return problem.ready_in_s
    late_s = (problem.ready_in_s + AHEAD_S) / (1.0 - AHEAD_SHARE)
    return np.where(problem.ready_in_s > 0.0, late_s, 0.0)


def _limits(problem: RoundProblem) -> Iterator[PathAllowance]:
    """Yield the round's limits of time and of energy, converted to metres."""
    assert problem.limits is not None
    limits, performance = problem.limits, problem.limits.performance
    upload_s = np.zeros(len(problem.importance)) if problem.upload_s is None else problem.upload_s
    hovers = bool(upload_s[problem.importance > 0.0].min() > 0.0)
    most_s, rate = problem.longest_s, performance.fastest_mps
    sends, stop = rate * upload_s, performance.stop_m if hovers else (0.0, 0.0)
    after = rate * np.maximum(0.0, most_s - _late(problem))
    if math.isfinite(most_s):
        whole, turns = rate * most_s, after
        if not hovers:
            whole = performance.longest_m(most_s)
        if problem.upload_s is None:  # at its end a flight has to brake
            _, brake = performance.stop_m
            whole = min(whole, problem.most_m)
            turns = np.where(after > brake, after - brake / 2.0, after**2 / max(2.0 * brake, 1e-9))
        yield PathAllowance(whole, sends, stop, sends, stop, turns)
    if math.isfinite(limits.energy_j) and problem.upload_s is not None:
        # What all of the legs may spare is had at once, so that each of them takes it all.
        none = 0.0 if problem.airspace.is_open else math.inf
        least_j = partial(performance.least_j, legs=none)
        spared_j = least_j(_FAR_M) - performance.least_j(_FAR_M, problem.legs)
        per_m = performance.cheapest_j(none)
        sooner_j = performance.hover_j(SETTLING_S - performance.stopping_s)
        beyond = (np.array([least_j(leg) for leg in _LEGS_M]) - sooner_j) / per_m - _LEGS_M
        least = np.array([(beyond - _braking(brake))[1:].min() for brake in _BRAKES_M])
        best = int(np.where(least >= 0.0, least + _BRAKES_M, -1.0).argmax())  # beyond a long leg
        each = (float(least[best]), float(_BRAKES_M[best])) if hovers else stop
        hover = upload_s * performance.hover_j(1.0) / per_m
        yield PathAllowance((limits.energy_j + spared_j) / per_m, hover, each, sends, stop, after)


def _braking(brake_m: float) -> Floats:
    """Metres of starting and braking beyond each of `_LEGS_M`, as `native/rewards.h` has them."""
    return np.where(brake_m > _LEGS_M, 2.0 * np.sqrt(_LEGS_M * brake_m) - _LEGS_M, brake_m)
