"""How sharply corners must be flown, so that what the plan promises is what the flight brings.

An aircraft that does not stop rounds its corners, and passes the device below one at a distance.
Where the packet error rate rises from the first metre on, that costs more than the time it saves.
"""

import math

import numpy as np

from mission.base.arrays import Floats
from mission.planner.evaluate import objective
from mission.planner.performance import Foreseen
from mission.planner.problem import RoundPlan, RoundProblem
from mission.planner.stops import SAME_PLACE_M, stops_of

MOST_LOST = 0.01  # of the plan's value, with every corner cut as far as allowed
SHARES = (0.8, 0.6, 0.5, 0.4, 0.3, 0.2)  # of the widest radius
NARROWEST_M = 1.0  # narrower is no use to an aircraft that knows its place to a metre


def acceptance_radius(problem: RoundProblem, plan: RoundPlan, widest_m: float) -> float:
    """The widest acceptance radius in metres, up to `widest_m`, that costs the plan 1 % at most.

    Where none does, the narrowest. Corners around areas are cut by half of the margin at most.
    """
    problem = problem.at(plan.altitude_m)
    if not problem.airspace.is_open:
        widest_m = min(widest_m, problem.airspace.margin_m / 2.0)
    radii = _radii(widest_m)
    for radius in radii:
        passed = cut_corners(plan.route_m, radius)[plan.stops_at]
        flown = objective(problem, passed, plan.schedule)
        if flown >= (1.0 - MOST_LOST) * plan.value:
            return radius
    return radii[-1]


def sharpest(widest_m: float) -> float:
    """The narrowest acceptance radius in metres that any plan is flown with."""
    return _radii(widest_m)[-1]


def _radii(widest_m: float) -> list[float]:
    return [widest_m] + [share * widest_m for share in SHARES if share * widest_m > NARROWEST_M]


def cut_corners(waypoints_m: Floats, radius_m: float) -> Floats:
    """(N, 2) where each waypoint is passed by a path that cuts corners by up to a radius.

    A corner is cut along its bisector. The arc is a parabola that takes up half of either leg at
    most, so that its depth is limited to a quarter of the shorter leg times sin(phi / 2).
    """
    new = np.r_[True, np.hypot(*np.diff(waypoints_m, axis=0).T) > SAME_PLACE_M]
    at = np.cumsum(new) - 1
    points = np.array(waypoints_m[new])
    legs = np.diff(points, axis=0)
    lengths = np.hypot(*legs.T)
    # A path may come back in steps that are dropped: such a leg has no length and no direction.
    along = legs / np.maximum(lengths, 1e-9)[:, None]
    turn = np.diff(along, axis=0)  # its length is 2 sin(phi / 2)
    twice_sine = np.hypot(*turn.T)
    depth = np.minimum(radius_m, np.minimum(lengths[:-1], lengths[1:]) * twice_sine / 8.0)
    bends = twice_sine > 1e-9
    points[1:-1][bends] += (depth / np.where(bends, twice_sine, 1.0))[bends, None] * turn[bends]
    return np.asarray(points[at])


def foresee_round(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> Foreseen:
    """What the flight of a plan takes, in a problem with limits; `hold_s` as in `stops_of`."""
    assert problem.limits is not None
    return problem.limits.performance.foresee(*_flight(problem, plan, hold_s))


def share_of(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> float:
    """How much of the tighter limit the flight of a plan takes; more than 1 does not fit."""
    if problem.limits is None:
        return 0.0
    if math.isinf(problem.limits.energy_j):  # which takes most of the time to foresee
        _, taken_s = problem.limits.performance.timing(*_flight(problem, plan, hold_s))
        return taken_s / problem.limits.duration_s
    return problem.limits.share(foresee_round(problem, plan, hold_s=hold_s))


def _flight(
    problem: RoundProblem, plan: RoundPlan, hold_s: float
) -> tuple[Floats, list[float], float]:
    """Places of the stops, seconds of hover there, and the acceptance radius."""
    assert problem.limits is not None
    stops = stops_of(plan, hold_s=hold_s, upload_s=problem.upload_s)
    return (
        np.array([stop.xy_m for stop in stops]),
        [stop.hold_s for stop in stops],
        acceptance_radius(problem, plan, problem.limits.performance.widest_m),
    )
