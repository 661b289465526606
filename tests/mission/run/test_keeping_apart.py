"""Plans of several aircraft that keep a separation: paths exchanged, or layers of height."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import aerofed
from aerofed import PlannedPath, RoundPlan, RoundProblem, Sortie, Start
from mission.config.loading import load_config
from mission.flight.flyers.unflown import UnflownFlyer
from mission.planner.evaluate import objective
from mission.run.apart import planned_pairs
from mission.run.keeping_apart import kept_apart
from mission.run.outing import Outing, outings_of
from mission.scenario.limits import aircraft_of

DEVICES_M = np.array([(100.0, 100.0), (300.0, 100.0)])


def told(
    starts_m: Sequence[tuple[float, float]], ends_m: Sequence[tuple[float, float]], *, far_m: float
) -> tuple[RoundProblem, Sortie]:
    """A round in which the aircraft fly straight from starts to ends, and serve a device each."""
    problem = RoundProblem(
        devices_m=DEVICES_M,
        importance=np.ones(2),
        starts=tuple(Start(np.array(start_m), far_m) for start_m in starts_m),
        steps=2,
        per_step=1,
        channel=aerofed.channel("suburban"),
    )
    schedule = np.zeros((2, 2, 2), dtype=bool)
    for a, end_m in enumerate(ends_m):
        schedule[a, 1, np.linalg.norm(np.subtract(DEVICES_M, end_m), axis=1).argmin()] = True
    paths = tuple(
        PlannedPath(np.array(both, dtype=float)) for both in zip(starts_m, ends_m, strict=True)
    )
    value = sum(
        objective(problem.alone(a), path.waypoints_m, schedule[a]) for a, path in enumerate(paths)
    )
    return problem, Sortie(RoundPlan(paths, schedule, value, upper_bound=2.0))


def mended(
    problem: RoundProblem,
    sortie: Sortie,
    least_m: float,
    *,
    leaves: bool = False,
    off_s: float = 0.0,
) -> tuple[RoundPlan, str, float]:
    """The plan, what is said of it, and how near the two come by it."""
    config = load_config(Path("quickstart"), {"vehicles": 2, "mission.flight": "none"})
    fleet = aircraft_of(config)
    flyers = {n: UnflownFlyer(one.area, one.config.mission, ()) for n, one in enumerate(fleet)}
    ordered = partial(outings_of, fleet, flyers, problem)
    made, said = kept_apart(problem, sortie, ordered, least_m=least_m, leaves=leaves, off_s=off_s)
    outings: list[Outing] = ordered(made)
    for one in outings:
        one.order()
    ((_, near),) = planned_pairs(outings, leaving_m=least_m if leaves else None)
    return made.plan, said, near.away_m


HEAD_ON = told([(0, 100), (400, 100)], [(300, 100), (100, 100)], far_m=400.0)


def test_who_would_meet_exchange_their_paths() -> None:
    plan, said, near_m = mended(*HEAD_ON, 20.0)
    assert near_m == pytest.approx(200.0)
    ends_m = [path.waypoints_m[-1].tolist() for path in plan.paths]
    assert ends_m == [[100.0, 100.0], [300.0, 100.0]]
    assert plan.schedule.any(axis=1).tolist() == [[True, False], [False, True]]
    assert plan.upper_bound == 2.0
    assert "uav1 and uav2 would come within 0.0 m by plan, 20 m are kept: paths exchanged" in said


def test_where_an_exchange_does_not_help_they_fly_in_layers() -> None:
    """Beside each other to the same place."""
    problem, sortie = told([(0, 100), (0, 105)], [(300, 100), (300, 105)], far_m=400.0)
    plan, said, near_m = mended(problem, sortie, 13.0)
    assert near_m >= 13.0
    heights_m = sorted(path.altitude_m or 0.0 for path in plan.paths)
    assert heights_m == [53.5, 66.5]
    assert np.isnan(plan.upper_bound)  # it is of one height
    assert "heights 13 m apart" in said


def test_what_keeps_the_separation_is_left_as_it_is() -> None:
    problem, sortie = HEAD_ON[0], told([(0, 100), (400, 100)], [(100, 100), (300, 100)], far_m=400)
    plan, said, near_m = mended(problem, sortie[1], 20.0)
    assert plan is sortie[1].plan
    assert said == ""
    assert near_m == pytest.approx(200.0)


def test_homes_that_are_nearer_count_once_they_are_left() -> None:
    starts_m, ends_m = [(200, 100), (205, 100)], [(100, 100), (300, 100)]
    problem, sortie = told(starts_m, ends_m, far_m=400.0)
    assert mended(problem, sortie, 20.0, leaves=True)[1] == ""
    assert "would come within 5.0 m" in mended(problem, sortie, 20.0)[1]


def test_what_nothing_mends_is_said() -> None:
    problem, sortie = told([(0, 100), (0, 105)], [(300, 100), (300, 105)], far_m=400.0)
    plan, said, _ = mended(problem, sortie, 600.0)
    assert plan is sortie.plan
    assert said.endswith("no exchange of paths and no layers of height do that; flown as it is")


def test_one_may_be_later_than_the_other() -> None:
    """They cross 28 m apart, in time; a second later than the other one meets it."""
    problem, sortie = told([(200, 100), (180, -80)], [(200, -100), (380, -80)], far_m=400.0)
    least_m = mended(problem, sortie, 5.0)[2]
    assert mended(problem, sortie, least_m - 1.0)[1] == ""
    assert "would come within" in mended(problem, sortie, least_m - 1.0, off_s=1.0)[1]
