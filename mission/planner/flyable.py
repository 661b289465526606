"""Flights of plans: stops, acceptance radius of the corners, and predicted time and energy.

Waypoints that coincide become one stop, with several time steps. An aircraft that does not stop
rounds its corners, and passes the device below one at a distance. Where the packet error rate rises
from the first metre on, that costs more than the time it saves.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mission.base.arrays import Bools, Floats
from mission.planner.native.rounds import Round
from mission.planner.performance import Foreseen
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem

SAME_PLACE_M = 0.5  # waypoints nearer than this are flown as one; no flight tells them apart


@dataclass(frozen=True)
class Stop:
    """One place to pass or to hover at, and the plan's time steps that are served there."""

    xy_m: Floats  # (2,) area coordinates
    steps: tuple[int, ...]
    hold_s: float = 0.0
    slots_s: tuple[float, ...] = ()  # when each step begins, after the arrival; the first at 0


def stops_of(
    plan: RoundPlan, *, hold_s: float = 0.0, upload_s: Floats | None = None
) -> tuple[Stop, ...]:
    """Merge consecutive waypoints closer than `SAME_PLACE_M` to the first of them.

    `hold_s` is the least hover at every stop but the first; with one stop in all, at that one.
    Corners between waypoints are stops without a step, and without a hover. `upload_s` (K,) is how
    long each device sends: each step then lasts until its devices have sent, one after another,
    and a stop until all of its steps have.
    """
    _, steps, devices = plan.schedule.shape
    round_ = Round(
        np.zeros((devices, 2)), np.zeros(devices), steps=steps, per_step=1, upload_s=upload_s,
        hold_s=hold_s,
    )  # fmt: skip
    evaluation = round_.judged(plan.as_candidate)
    of_step = evaluation.stop_of[plan.stops_at]
    stops: list[Stop] = []
    for index, at in enumerate(np.flatnonzero(np.diff(evaluation.stop_of, prepend=-1)).tolist()):
        here = np.flatnonzero(of_step == index)
        slots_s = tuple(evaluation.offset_s[here].tolist())
        stops.append(
            Stop(plan.route_m[at], tuple(here.tolist()), float(evaluation.hold_s[index]), slots_s)
        )
    return tuple(stops)


def cut_behind(stops: Sequence[Stop], serves: Bools) -> Iterator[tuple[Stop, ...]]:
    """Cut stops behind each with a step that `serves` (N,): there the aircraft holds, and each part
    begins where the last one has ended."""
    last = len(stops) - 1
    cuts = [at for at, stop in enumerate(stops) if serves[list(stop.steps)].any()]
    first, here = 0, stops[0]
    for end in dict.fromkeys((*cuts, last)):
        yield (here, *stops[first + 1 : end + 1])
        first, here = end, Stop(stops[end].xy_m, ())


def acceptance_radius(problem: RoundProblem, plan: RoundPlan, widest_m: float) -> float:
    """The widest acceptance radius in metres, up to `widest_m`, that costs the plan 1 % at most.

    Where none does, the narrowest. Corners around areas are cut by half of the margin at most.
    """
    round_ = problem.at(plan.altitude_m).judged_with(widest_m=widest_m)
    return round_.judged(plan.as_candidate).radius_m


def foresee_round(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> Foreseen:
    """Predict times and energy of a plan's flight; needs limits; `hold_s` as in `stops_of`."""
    limits = problem.at(plan.altitude_m).limits
    assert limits is not None
    performance = limits.performance
    stops = stops_of(plan, hold_s=hold_s, upload_s=problem.upload_s)
    return performance.foresee(
        np.array([stop.xy_m for stop in stops]),
        [stop.hold_s for stop in stops],
        acceptance_radius(problem, plan, performance.widest_m),
    )


def share_of(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> float:
    """How much of the tighter limit the flight of a plan takes; more than 1 does not fit."""
    if problem.limits is None:
        return 0.0
    return problem.at(plan.altitude_m).judged_with(hold_s=hold_s).judged(plan.as_candidate).share
