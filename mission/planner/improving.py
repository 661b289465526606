"""Local search on plans by random changes: threshold accepting (`native/variation.h`)."""

from mission.planner.fitting import fitted, varied
from mission.planner.problem import RoundPlan, RoundProblem

_CHANGES, _USUAL = 40_000, 120  # that are tried at random, for so many devices times steps
_FEWEST, _PAIRS = 200, 250  # of them; of outlines and vertices, whose ways take as long as a look
# How many plans are improved, by which share of the changes, and what they may lose on the way.
_STAGES = ((30, 0.2, 0.02), (4, 1.0, 0.01), (1, 2.0, 0.01), (1, 1.0, 0.0))
# The same where hovers and readiness are both timed: a small change costs a device its turn.
_RUGGED = ((30, 0.2, 0.05), (10, 0.8, 0.05), (4, 1.6, 0.05), (1, 3.0, 0.02), (1, 2.0, 0.0))
_ON_GRID = 0.5
_SERVED = 6  # devices that are as much work to leave out, one by one, as a look
_ALIKE = 0.003  # of the value: plans that differ by less are taken for one


def improved(problem: RoundProblem, plans: list[RoundPlan], enough: float) -> RoundPlan:
    """Return the best plan of a staged local search: all `plans` briefly, the best of those longer,
    until one is worth `enough`; an open altitude is chosen anew for each of the best."""
    changes, some = changes_for(problem), plans
    timed = problem.upload_s is not None and problem.ready_in_s is not None
    for stage, (most, share, tolerance) in enumerate(_RUGGED if timed else _STAGES):
        if max(map(_value, some)) >= enough:
            break
        some = [
            varied(problem, plan, int(share * changes), tolerance=tolerance, seed=seed)
            for seed, plan in enumerate(_best(some, most))
        ]
        if problem.altitudes_m is not None and stage > 0:
            some = [fitted(problem, plan.waypoints_m, above=plan.value) or plan for plan in some]
    return max(some, key=_value)


def changes_for(problem: RoundProblem) -> int:
    """Return how many random changes to try: fewer where evaluating one takes longer."""
    work, devices = 1.0, len(problem.devices_m)
    limits = () if problem.limits is None else problem.limits.each
    energy = any("energy_j" in limit.counted for limit in limits)  # takes most of the work
    if problem.ready_in_s is not None:
        work += 2
    if energy:
        work += 1
    if not problem.airspace.is_open:
        ways = 1 + problem.airspace.outlines.pairs // _PAIRS
        work += (1 if problem.limits is None else 4) * ways
    if problem.upload_s is not None:
        work += 3
        if energy:
            work += 15
        elif limits:
            work += devices / _SERVED
    if problem.per_grid is not None:  # many summits, and a look is short
        work *= _ON_GRID
    size = max(1.0, problem.steps * devices / _USUAL)
    return max(_FEWEST, int(_CHANGES / (work * size**0.25)))


def _value(plan: RoundPlan) -> float:
    return plan.value


def _best(plans: list[RoundPlan], most: int) -> list[RoundPlan]:
    """Best plans first, at most so many, without those of nearly equal value."""
    some: list[RoundPlan] = []
    for plan in sorted(plans, key=_value, reverse=True):
        if not some or some[-1].value > plan.value * (1.0 + _ALIKE):
            some.append(plan)
    return some[:most]
