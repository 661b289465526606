"""What a plan is worth, where its bound ends, and which problems and paths are refused: by numbers
worked out by hand, at, below and above each border."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from one_aircraft import changed, one_path, round_problem
from scipy.optimize import brentq

from fl.radio.channel import CHANNEL_PRESETS, average_per
from fl.radio.per_grid import PerGrid
from flightdyn.config import LimitsConfig
from mission.base.airspace import Airspace
from mission.base.errors import PlanInputError
from mission.planner.check import check_plan
from mission.planner.evaluate import (
    bounded,
    check_problem,
    distances,
    finish,
    fit_budget,
    in_time,
    objective,
    path_length,
    plan_along,
    plan_without_moving,
    scheduled,
    success,
    success_bounds,
)
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.planner.plan import BoundError, RoundPlan
from mission.planner.problem import RoundProblem, Start

CHANNEL = CHANNEL_PRESETS["suburban"]
PAPER = RoundLimits(Performance(20.0, 5.0, None), 1e6)  # always at 20 m/s
GUIDED = RoundLimits(Performance(20.0, 5.0, LimitsConfig()), 1e6)
WAY = np.array([[0.0, 0.0], [200.0, 0.0], [200.0, 300.0]])


def problem(**more: Any) -> RoundProblem:
    """Three devices beside the corners of `WAY`, three steps for one each."""
    usual = {
        "devices_m": np.array([[3.0, 4.0], [200.0, -90.0], [320.0, 350.0]]),
        "importance": np.array([1.0, 0.5, 2.0]),
        "start_m": np.zeros(2),
        "steps": 3,
        "per_step": 1,
        "path_budget_m": 500.0,
        "channel": CHANNEL,
    }
    return round_problem(**{**usual, **more})


def heard(metres: float, height_m: float = CHANNEL.altitude_m) -> float:
    return 1.0 - float(average_per(CHANNEL, metres, height_m=height_m))


def test_a_plan_is_worth_what_each_step_brings_of_whom_it_serves() -> None:
    given = problem()
    metres = [[5.0, math.hypot(200, 90), math.hypot(320, 350)],
              [math.hypot(197, 4), 90.0, math.hypot(120, 350)],
              [math.hypot(197, 296), 390.0, 130.0]]  # fmt: skip
    np.testing.assert_allclose(distances(given, WAY), metres, rtol=1e-14)
    chances = [[heard(far) for far in row] for row in metres]
    np.testing.assert_allclose(success(given, WAY), chances, rtol=1e-12)
    schedule = np.array([[0, 0, 0], [1, 1, 0], [0, 0, 1]])
    worth = chances[1][0] + 0.5 * chances[1][1] + 2.0 * chances[2][2]
    assert objective(given, WAY, schedule) == pytest.approx(worth, rel=1e-12)
    assert path_length(WAY) == 500.0
    best = finish(given, WAY, upper_bound=9.0, nodes=7)
    assert (best.upper_bound, best.nodes, best.path.wait_s) == (9.0, 7, 0.0)
    assert best.schedule[0].tolist() == np.eye(3, dtype=bool).tolist()
    assert math.isnan(finish(given, WAY).upper_bound)
    assert finish(given, WAY).nodes == 0


def test_who_is_ready_when_a_step_begins_is_in_time() -> None:
    """At 20 m/s the steps begin after 0, 10 and 25 s; the last 4 s later with a hover before it."""
    ready = {"ready_in_s": np.array([0.0, 10.0, 25.0]), "limits": PAPER}
    given = problem(**ready)
    plan = one_path(WAY, np.zeros((3, 3), dtype=bool), 0.0)
    at_once = in_time(given, plan)
    assert at_once.tolist() == [[[True, False, False], [True, True, False], [True, True, True]]]
    sooner = dataclasses.replace(given, ready_in_s=np.array([0.0, 10.001, 25.001]))
    assert in_time(sooner, plan)[0, :, 0].all()
    assert in_time(sooner, plan)[0, [1, 2], [1, 2]].tolist() == [False, False]
    assert in_time(sooner, plan, hold_s=4.0)[0].tolist()[2] == [True, True, True]
    # Whose step begins too early is not served, unless a hover comes before it.
    waited = problem(limits=PAPER, ready_in_s=np.array([99.0, 99.0, 25.5]))
    for made in (plan_along, scheduled, finish):
        assert [made(waited, WAY).value > 0.0, made(waited, WAY, hold_s=1.0).value > 0.0] == [
            False,
            True,
        ]
    # Each of two in its own time: the second flies the way back, 300 m first.
    two = RoundProblem(
        given.devices_m, given.importance,
        (given.start, Start(WAY[2], 500.0, PAPER)), 3, 1, CHANNEL, ready_in_s=given.ready_in_s,
    )  # fmt: skip
    both = RoundPlan.together([plan, one_path(WAY[::-1], np.zeros((3, 3), dtype=bool), 0.0)])
    assert in_time(two, both)[0].tolist() == at_once[0].tolist()
    assert in_time(two, both)[1].tolist() == [[1, 0, 0], [1, 1, 0], [1, 1, 1]]
    late = dataclasses.replace(two, ready_in_s=np.array([14.9, 10.1, 15.1]))
    assert in_time(late, both)[:, 1].tolist() == [[False, False, False], [True, True, False]]
    none = dataclasses.replace(two, ready_in_s=None)
    assert in_time(none, both).shape == (2, 3, 3)
    assert in_time(none, both).all()


def test_arrays_may_lie_in_memory_in_any_way() -> None:
    usual = problem(limits=GUIDED, ready_in_s=np.zeros(3))
    plan = finish(usual, WAY)
    turned = problem(
        limits=GUIDED, ready_in_s=np.zeros(6)[::2], start_m=np.zeros(4)[::-2],
        devices_m=np.asfortranarray(usual.devices_m), importance=usual.importance[::-1][::-1],
    )  # fmt: skip
    same = one_path(WAY[::-1][::-1], np.asfortranarray(plan.schedule[0]), plan.value)
    check_plan(turned, same)
    assert finish(turned, np.asfortranarray(WAY)).value == plan.value


def test_a_path_is_shrunk_about_its_start_onto_its_budget() -> None:
    way = WAY + np.array([10.0, -20.0])
    assert fit_budget(way, 500.0) is way
    short = fit_budget(way, 250.0)
    np.testing.assert_allclose(short, [[10, -20], [110, -20], [110, 130]], rtol=1e-11)
    assert path_length(short) <= 250.0
    np.testing.assert_array_equal(fit_budget(way, 0), np.tile(way[0], (3, 1)))
    for wrong in (-1e-9, math.nan, "800", None):
        with pytest.raises(PlanInputError, match=r"^path_budget_m = .*: must be a number of m"):
            fit_budget(way, wrong)  # type: ignore[arg-type]  # as a user may
    with pytest.raises(PlanInputError, match=r"^waypoints_m\[1\]\[0\] = inf: must be a finite"):
        fit_budget([[0.0, 0.0], [math.inf, 0.0]], 1.0)


def test_paths_end_with_their_budget_and_begin_at_the_start_to_a_millimetre() -> None:
    given = problem()
    for inside in (WAY + np.array([0.0009, 0.0]), WAY * (1.0 + 0.9e-3 / 500.0)):
        assert finish(given, inside).path_m == pytest.approx(500.0, abs=1e-3)
    for beyond, words in (
        (WAY + np.array([0.0, 0.0011]), r"waypoints_m\[0\] = .*lies 0.0011 m from .* \[0.0, 0.0\]"),
        (WAY * (1.0 + 1.1e-3 / 500.0), "waypoints_m: the path is 500.001 m long, .* is 500;"),
    ):
        with pytest.raises(PlanInputError, match=words):
            finish(given, beyond)
    # Among areas what exceeds the budget is cut off.
    corner = Airspace((np.array([[400.0, 0], [450, 0], [450, 50]]),), None, 5.0)
    cut = finish(problem(airspace=corner, path_budget_m=350.0), WAY)
    np.testing.assert_allclose(cut.waypoints_m[-1], [200.0, 150.0], atol=1e-6)
    with pytest.raises(PlanInputError, match=r"waypoints_m has shape \(3, 2\): must be \(4, 2\)"):
        finish(problem(steps=4), WAY)
    with pytest.raises(PlanInputError, match=r"^importance\[0\] = -1.0: must be 0 or more"):
        finish(problem(importance=[-1, 0, 0]), WAY)


@pytest.mark.parametrize("metres", [[0.0, 0.0, 0.0], [120.0, 130.0, 170.0], [230.0, 240.0, 250.0]])
def test_the_best_of_all_altitudes_is_found_to_a_decimetre(metres: list[float]) -> None:
    """Right above devices the lowest; the farther away they are, the higher."""
    away = np.array([[far, 0.0] for far in metres])
    given = problem(devices_m=away, steps=1, per_step=3, altitudes_m=(25.03, 333.31))
    made = finish(given, np.zeros((1, 2)))
    heights = np.r_[25.03, np.arange(251, 3334) / 10.0, 333.31]
    chances = 1.0 - average_per(CHANNEL, np.array(metres), height_m=heights[:, None])
    worth = chances @ given.importance
    assert made.value == pytest.approx(max(worth), rel=1e-12)
    assert made.altitude_m == heights[int(np.argmax(worth))]
    narrow = changed(given, altitudes_m=(60.0, 60.02))
    assert finish(narrow, np.zeros((1, 2))).altitude_m in (60.0, 60.02)


def test_a_value_may_exceed_its_bound_by_the_rounding_of_tables() -> None:
    plan = one_path(WAY, np.eye(3, dtype=bool), 1.0)
    for bound, upper in ((2.0, 2.0), (1.0, 1.0), (0.99991, 1.0)):
        made = bounded(problem(), plan, bound, 5)
        assert (made.upper_bound, made.nodes) == (upper, 5)
    with pytest.raises(BoundError):
        bounded(problem(), plan, 0.99989, 5)


HOPELESS_M = brentq(lambda far: heard(far) - 0.01, 10.0, 1000.0)  # where 1 % get through


@pytest.mark.parametrize("budget_m", [0.0, 300.0])
def test_where_nobody_is_heard_once_in_a_hundred_times_nothing_can_be_had(budget_m: float) -> None:
    nothing = one_path(np.zeros((3, 2)), np.zeros((3, 3), dtype=bool), 0.0)

    def bound(**more: Any) -> float:
        given = problem(path_budget_m=budget_m, **more)
        plans = [nothing] * len(given.starts)
        return bounded(given, RoundPlan.together(plans), 0.5, 1).upper_bound

    edge_m, importance = HOPELESS_M + budget_m, np.array([0.25, 0.5, 0.0])
    start_m = np.array([3e3, -2e3])
    for beyond_m, most in ((0.5, 0.0), (-0.5, 0.5)):
        # One of no importance is near; of the other two the second decides.
        at = edge_m + beyond_m
        devices_m = start_m + np.array([[0.0, 2e3], [-at * 0.6, at * 0.8], [1.0, 0.0]])
        far: dict[str, Any] = {
            "devices_m": devices_m, "importance": importance, "start_m": start_m
        }  # fmt: skip
        assert bound(**far) == most
        ready, upload = {"ready_in_s": np.ones(3), "limits": PAPER}, {"upload_s": np.ones(3)}
        assert bound(**far, **upload) == most
        assert bound(**far, **ready) == most
        assert bound(**far, **ready, **upload) == 0.5  # while one sends, others get ready
    # One of two aircraft is near enough.
    starts = (Start(np.array([9e3, 0.0]), budget_m), Start(start_m, budget_m))
    given = RoundProblem(devices_m, importance, starts, 3, 1, CHANNEL)
    both = RoundPlan.together([nothing, nothing])
    assert bounded(given, both, 0.5, 1).upper_bound == 0.5
    away = dataclasses.replace(given, starts=starts[:1] * 2)
    assert bounded(away, both, 0.5, 1).upper_bound == 0.0
    assert math.isnan(bounded(given, both, math.nan, 1).upper_bound)


def test_at_rest_the_bound_has_the_best_places_whoever_is_without_hope() -> None:
    devices_m = np.array([[100.0, 0.0], [0.0, 0.0], [0.0, HOPELESS_M + 2.0], [0.0, 150.0]])
    importance = np.array([1.0, 0.1, 70.0, 0.2])
    given = problem(devices_m=devices_m, importance=importance, path_budget_m=0.0, steps=1)
    chances = np.array([heard(far) for far in np.hypot(*devices_m.T)])
    assert 0.005 < chances[2] < 0.01
    worth = sorted((chances * importance).tolist(), reverse=True)
    for steps, per_step in ((1, 1), (1, 2), (2, 1), (3, 3)):
        made = plan_without_moving(dataclasses.replace(given, steps=steps, per_step=per_step))
        assert made is not None
        places = steps * per_step
        assert made.upper_bound == pytest.approx(sum(worth[:places]), rel=1e-12)
        served = sorted(chances[[0, 1, 3]] * importance[[0, 1, 3]])[::-1][:places]
        assert made.value == pytest.approx(sum(served), rel=1e-12)
    # Each of what moving is for is needed: a second step, metres, a device, importance.
    move = {"steps": 2, "path_budget_m": 1.0, "importance": np.full(4, 0.1)}
    assert plan_without_moving(changed(given, **move)) is None
    for none in ({"steps": 1}, {"path_budget_m": 0.0}, {"importance": np.zeros(4)},
                 {"devices_m": np.zeros((0, 2)), "importance": np.zeros(0)}):  # fmt: skip
        assert plan_without_moving(changed(given, **{**move, **none})) is not None


def test_success_at_open_altitudes_has_a_row_for_each_half_metre() -> None:
    """Between samples f lies above their chord by an eighth of its second difference, here twice
    that."""
    far = np.array([0.0, 80.0, 200.0])
    given = problem(altitudes_m=(40.0, 47.6))
    heights = np.linspace(40.0, 47.6, 18)  # 15.2 half metres, and both ends
    f = np.array([[heard(r, h) for r in far] for h in heights])
    bends = np.abs(f[2:] - 2.0 * f[1:-1] + f[:-2]).max(axis=0)
    np.testing.assert_allclose(success_bounds(given, far), f + bends / 4.0, rtol=1e-9)
    fixed = success_bounds(problem(), far)
    np.testing.assert_allclose(fixed, [[heard(r) for r in far]], rtol=1e-12)
    chances = np.zeros((3, 21, 21))
    chances[1, 10, 10], chances[2, 20, 10] = 0.75, 0.5
    grid = PerGrid(chances, (0.0, 0.0), 100.0)
    here = problem(per_grid=grid, start_m=np.array([1000.0, 1000.0]), path_budget_m=700.0)
    assert success_bounds(here, far).tolist() == [[0.0, 0.75, 0.0]]
    farther = changed(here, path_budget_m=1000.0)
    assert success_bounds(farther, far).tolist() == [[0.0, 0.75, 0.5]]


@pytest.mark.parametrize(
    ("right", "wrong", "words"),
    [
        ({"steps": 1_000_000}, {"steps": 1_000_001}, "steps = 1000001: .* or more, 1000000 at"),
        ({"per_step": 1_000_000}, {"per_step": 1_000_001}, "per_step = 1000001: must be a whole"),
        ({"steps": 1, "per_step": 1}, {"steps": 1.0}, "steps = 1.0: must be a whole number of 1"),
        ({"importance": [5e306, 5e306, 0]}, {"importance": [9e306, 2e306, 0]}, "sums to 1.1e.307"),
        ({"importance": [0, 0, 0]}, {"importance": [0, 0, -1e-9]}, r"importance\[2\] = -1e-09: mu"),
        ({"upload_s": [0, 1, 2]}, {"upload_s": [0, 1, -2]}, r"upload_s\[2\] = -2.0: must be 0 or"),
        ({"upload_s": None}, {"upload_s": [0, 1]}, r"upload_s has shape \(2,\): must be \(3,\)"),
        (
            {"ready_in_s": [0, 1, 2], "limits": PAPER},
            {"ready_in_s": [0, math.inf, 2], "limits": PAPER},
            r"ready_in_s\[1\] = inf: must be a finite",
        ),
        (
            {"ready_in_s": None},
            {"ready_in_s": [0, 0, 0]},
            "ready_in_s needs limits, whose performance",
        ),
        (
            {"separation_m": 5, "limits": PAPER},
            {"separation_m": 5},
            "separation_m needs limits of each, whose performance",
        ),
        (
            {"separation_m": 0},
            {"separation_m": -1.0, "limits": PAPER},
            "separation_m = -1.0: must be a number of metres, 0 or more",
        ),
        ({"late_s": 0}, {"late_s": -0.5}, "late_s = -0.5: must be a number of seconds, 0 or more"),
        ({"late_s": 1e300}, {"late_s": math.inf}, "late_s = inf: must be a number of seconds"),
        ({"late_s": 1}, {"late_s": "1"}, "late_s = '1': must be a number of seconds"),
        ({"path_budget_m": 0}, {"path_budget_m": -1e-9}, "path_budget_m = -1e-09: must be 0 or mo"),
        ({"path_budget_m": 1}, {"path_budget_m": "1"}, "path_budget_m = '1': must be a number of"),
        (
            {"altitudes_m": (0.1, 0.2)},
            {"altitudes_m": (0.0, 0.2)},
            r"altitudes_m = \[0.0, 0.2\]: must be two heights above 0, the lower first",
        ),
        ({"altitudes_m": [40, 50]}, {"altitudes_m": (50.0, 50.0)}, r"altitudes_m = \[50.0, 50.0"),
        (
            {"altitudes_m": None},
            {"altitudes_m": (40.0,)},
            r"altitudes_m = \(40.0,\): must be two h",
        ),
        (
            {"altitudes_m": None},
            {"altitudes_m": (1, 2, 3)},
            "altitudes_m = .*: must be two heights",
        ),
        ({"altitudes_m": None}, {"altitudes_m": 40.0}, "altitudes_m = 40.0: must be two heights"),
        (
            {"altitude_m": 30},
            {"altitude_m": 30, "altitudes_m": (40.0, 50.0)},
            "altitude_m = 30: .* and None where altitudes_m are given",
        ),
        ({"channel": CHANNEL}, {"channel": "urban"}, "channel = 'urban': must be a Channel"),
    ],
)
def test_a_problem_is_taken_to_its_borders_and_no_further(
    right: dict[str, Any], wrong: dict[str, Any], words: str
) -> None:
    check_problem(problem(**right))
    with pytest.raises(PlanInputError, match=f"^{words}" if words[0] != "s" else words):
        check_problem(problem(**wrong))


def test_a_height_of_one_of_several_is_above_0() -> None:
    def check(height_m: float) -> None:
        starts = problem().starts * 2
        own = (starts[0], dataclasses.replace(starts[0], altitude_m=height_m))
        check_problem(dataclasses.replace(problem(), starts=own))

    check(0.1)
    with pytest.raises(PlanInputError, match=r"^starts\[1\].altitude_m = 0.0: must be a height"):
        check(0.0)
    with pytest.raises(PlanInputError, match=r"^starts\[1\].altitudes_m\[0\] = inf: must be a fi"):
        check(math.inf)


def test_what_is_no_problem_is_refused() -> None:
    with pytest.raises(PlanInputError, match=r"^problem = 3: must be a RoundProblem"):
        check_problem(3)  # type: ignore[arg-type]  # as a user may


def test_a_round_lasts_no_longer_than_its_metres_and_uploads_take() -> None:
    """Two legs of 250 m from rest to rest take 250 / 20 + 20 / 5 + 0.7 s each, a tenth more at
    most; among areas there may be any number of legs."""
    upload_s = np.array([1.0, 2.0, 4.0])
    given = problem(limits=GUIDED, upload_s=upload_s)
    assert given.longest_s == pytest.approx(1.1 * 2 * (12.5 + 4.7) + 7.0)
    assert changed(given, upload_s=None).longest_s == pytest.approx(1.1 * 2 * 17.2)
    assert changed(given, steps=1).longest_s == 7.0
    assert changed(given, limits=RoundLimits(GUIDED.performance, 30.0)).longest_s == 30.0
    wall = Airspace((np.array([[400.0, 0], [450, 0], [450, 50]]),), None, 5.0)
    assert changed(given, airspace=wall).longest_s == 1e6
    assert (given.legs, changed(given, airspace=wall).legs) == (2, math.inf)
    assert given.most_m == 500.0
    # Within 20 s from rest to rest, 0.7 s of them until it stands: 15.3 s at 20 m/s.
    assert changed(given, limits=RoundLimits(GUIDED.performance, 20.0)).most_m == pytest.approx(
        15.3 * 20.0, rel=0.02
    )
    assert changed(given, limits=RoundLimits(PAPER.performance, 20.0)).most_m == 400.0
