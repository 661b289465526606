"""Bounds of rounds in which devices take time: hovers while they send, turns once they are ready.

The search of visiting orders (`native/search.h`) counts in metres. A hover is as many metres as
would be flown meanwhile, a stop what starting and braking take beyond the leg to it. A device that
gets ready late leaves so many metres for what comes after its turn. Where joules are limited, a
metre is what the cheapest of them takes.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from mission.base.arrays import Floats
from mission.planner.certified import Case, case_of
from mission.planner.limits import PathAllowance
from mission.planner.native.crews import search_orders
from mission.planner.native.library import MOST_DEVICES, Found, Goal
from mission.planner.performance import AHEAD_S, AHEAD_SHARE
from mission.planner.problem import RoundProblem

_PARTS = 4  # of altitudes that are open
_FIRST_NODES = 60  # after which the bounds of several altitudes are compared
# A search closes more nodes where it aims higher, and may prove more. What has missed its aim
# tries again, higher by this share of what it has missed.
_HIGHER = 0.75
_SHARED_NODES = 24_000  # looked into, divided by the devices, for each limit


def searched(
    allowance: PathAllowance, case: Case, worth: Floats, value: float, goal: Goal
) -> float:
    """Return an upper bound on plans for importance `worth` (K,), given a known `value`."""
    each = (allowance.hover, allowance.sends, allowance.after)
    hover, sends, after = (np.ascontiguousarray(metres[worth > 0.0]) for metres in each)
    devices = replace(case.devices, hover=hover, sends=sends, after=after)
    limits = replace(case.limits, length=allowance.whole, stop=allowance.stop, turn=allowance.turn)
    nobody = np.full(len(devices.delta), -1)
    found = Found(value, np.zeros((limits.steps, 2)), nobody, math.inf)
    if (left := goal.left(found, goal.max_nodes)) is None:
        return math.inf
    case = replace(case, devices=devices, limits=limits)
    return search_orders([case], plan=found, goal=left).bound


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

    def lowered(case: Case, allowance: PathAllowance, target: float) -> float:
        return searched(allowance, case, problem.importance, target, goal)

    def promised(case: Case) -> float:
        brief = replace(goal, max_nodes=min(goal.max_nodes, _FIRST_NODES))
        return searched(limits[0], case, problem.importance, value, brief) if limits else math.inf

    # Once the largest bound is known, those of the others need not be lowered as far.
    for case in sorted(cases_of(problem), key=promised, reverse=True):
        target, bound, best = max(value, worst * (1.0 - goal.gap)), math.inf, None
        for allowance in limits:
            if bound > worst and (found := lowered(case, allowance, target)) < bound:
                bound, best = found, allowance
        if best is not None and (missed := bound * (1.0 - goal.gap) - target) > 0.0:
            bound = min(bound, lowered(case, best, target + _HIGHER * missed))
        worst = max(worst, bound)
    return worst


def cases_of(problem: RoundProblem) -> Iterator[Case]:
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
    """Yield what the round lasts at most, then its limits of something else, in metres."""
    assert problem.limits is not None
    limits, performance = problem.limits, problem.limits.performance
    upload_s = np.zeros(len(problem.importance)) if problem.upload_s is None else problem.upload_s
    hovers = bool(upload_s[problem.importance > 0.0].min() > 0.0)
    most_s, rate = problem.longest_s, performance.fastest_mps
    sends, stop = rate * upload_s, performance.stop_m if hovers else (0.0, 0.0)
    after = rate * np.maximum(0.0, most_s - _late(problem))
    time = PathAllowance(math.inf, sends, stop, sends, stop, after)
    if math.isfinite(most_s):
        whole, turns = rate * most_s, after
        if not hovers:
            whole = performance.longest_m(most_s)
        if problem.upload_s is None:  # at its end a flight has to brake
            _, brake = performance.stop_m
            whole = min(whole, problem.most_m)
            turns = np.where(after > brake, after - brake / 2.0, after**2 / max(2.0 * brake, 1e-9))
        yield replace(time, whole=whole, after=turns)
    for limit in limits.each if problem.upload_s is not None else ():
        allowance = limit.allowance(upload_s, time, legs=problem.legs, hovers=hovers)
        if allowance is not None:
            yield allowance
