"""Inputs at the edge of sense: each has a defined answer, the same for every method."""

import dataclasses
from typing import Any, get_args

import numpy as np
import pytest
from one_aircraft import changed, round_problem

from fl.radio.channel import CHANNEL_PRESETS, average_per
from flightdyn.config import LimitsConfig
from mission.base.errors import InfeasiblePlanError, PlanInputError
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig, PlannerKind
from mission.planner.factory import make_planner
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.planner.plan import PlannedPath

KINDS = tuple(kind for kind in get_args(PlannerKind) if kind != "import")
BASE = round_problem(
    devices_m=np.array([[100.0, 0.0], [100.0, 300.0], [400.0, 0.0], [0.0, 0.0]]),
    importance=np.array([1.0, 2.0, 1.0, 0.5]),
    start_m=np.zeros(2),
    steps=4,
    per_step=2,
    path_budget_m=500.0,
    channel=CHANNEL_PRESETS["suburban"],
)


def plan(kind, **changes):
    problem = changed(BASE, **changes)
    answer = make_planner(PlannerConfig(kind=kind)).plan(problem)
    check_plan(problem, answer)
    if np.isfinite(answer.upper_bound):
        assert answer.value <= answer.upper_bound * (1 + 1e-9)
    return answer


@pytest.mark.parametrize("kind", KINDS)
class TestDefinedAnswers:
    def test_one_step_serves_from_the_start(self, kind):
        answer = plan(kind, steps=1, per_step=1)
        assert answer.waypoints_m.tolist() == [[0, 0]]
        assert answer.schedule.tolist() == [[[True, False, False, False]]]
        near = 1 - average_per(BASE.channel, 100.0)
        assert answer.value == pytest.approx(float(near)) == answer.upper_bound

    def test_no_budget_serves_from_the_start_at_every_step(self, kind):
        answer = plan(kind, path_budget_m=0.0)
        assert np.all(answer.waypoints_m == 0.0)
        assert answer.schedule.sum() == 2  # the others are heard once in a hundred times at most
        assert 0.0 < answer.upper_bound - answer.value < 0.01 * BASE.importance.sum()

    def test_nothing_matters(self, kind):
        answer = plan(kind, importance=np.zeros(4))
        assert answer.value == answer.upper_bound == answer.gap == 0.0
        assert not answer.schedule.any()

    def test_no_device(self, kind):
        answer = plan(kind, devices_m=np.zeros((0, 2)), importance=np.zeros(0))
        assert answer.value == 0.0
        assert answer.schedule.shape == (1, 4, 0)

    def test_nothing_in_reach(self, kind):
        answer = plan(kind, devices_m=BASE.devices_m + 1e5)
        assert answer.value < 1e-9

    def test_one_device(self, kind):
        answer = plan(kind, devices_m=np.array([[300.0, 0.0]]), importance=np.ones(1))
        # The printed version may wander off, whatever it started from.
        assert kind == "paper_literal" or answer.value == pytest.approx(1.0, abs=1e-3)

    def test_coincident_devices_and_one_right_below_the_start(self, kind):
        answer = plan(kind, devices_m=np.zeros((4, 2)))
        assert answer.value == pytest.approx(4.5, abs=1e-3)

    def test_more_places_than_devices(self, kind):
        assert plan(kind, per_step=50).value > 0.0

    def test_fewer_places_than_devices(self, kind):
        assert plan(kind, steps=3, per_step=1).schedule.sum() <= 3

    def test_start_outside_the_area(self, kind):
        assert plan(kind, start_m=np.array([-300.0, -200.0])).path_m <= 500.001

    def test_a_channel_that_loses_everything(self, kind):
        answer = plan(kind, channel=CHANNEL_PRESETS["literal"])
        assert answer.value < 1e-3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"devices_m": np.zeros((4, 3))}, r"devices has shape \(4, 3\): must be \(K, 2\)"),
        ({"importance": np.ones(3)}, r"importance has shape \(3,\): must be \(4,\)"),
        ({"start_m": np.zeros(3)}, r"start has shape \(3,\): must be \(2,\)"),
        ({"importance": np.array([1, 1, np.nan, 1])}, r"importance\[2\] = nan: must be a finite"),
        ({"devices_m": np.full((4, 2), np.inf)}, r"devices\[0\]\[0\] = inf: must be a finite"),
        ({"start_m": np.array([0, np.nan])}, r"start\[1\] = nan: must be a finite"),
        ({"importance": np.array([1, -0.5, 1, 1])}, r"importance\[1\] = -0.5: must be 0 or more"),
        ({"path_budget_m": -1.0}, "path_budget_m = -1.0: must be 0 or more"),
        ({"path_budget_m": float("nan")}, "path_budget_m = nan: must be a finite number"),
        ({"steps": 0}, "steps = 0: must be a whole number of 1 or more"),
        ({"per_step": 0}, "per_step = 0: must be a whole number of 1 or more"),
        ({"per_step": 2**63}, r"per_step = 92.*: must be .* 1 or more, 1000000 at most"),
        ({"importance": np.full(4, 1.7e308)}, r"importance sums to inf: 1e\+307 at most"),
    ],
)
def test_a_problem_without_sense_is_refused(changes, message):
    for kind in KINDS:
        with pytest.raises(PlanInputError, match=message):
            plan(kind, **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"waypoints_m": np.array([[1.0, 0], [0, 0], [0, 0], [0, 0]])}, "lies 1.0000 m from"),
        ({"waypoints_m": np.array([[0.0, 0], [501, 0], [501, 0], [501, 0]])}, "1.0000 m longer"),
        ({"schedule": np.ones((1, 4, 4), dtype=bool)}, "4 devices in one step: at most 2"),
        ({"schedule": np.eye(4, dtype=bool)[None, :, [0, 0, 0, 0]]}, "4 devices in one step"),
        (
            {"schedule": np.tile([True, False, False, False], (1, 4, 1))},
            "device 0 is scheduled 4",
        ),
        ({"value": 17.0}, "claims a value of 17.0"),
        ({"upper_bound": 0.01}, "claims that none is worth more than 0.01, and is worth"),
        ({"schedule": np.zeros((1, 4, 3))}, r"1 paths and a schedule \(1, 4, 3\): .* \(1, 4, 4\)"),
        ({"waypoints_m": np.full((4, 2), np.nan)}, "not finite"),
    ],
)
def test_an_infeasible_plan_is_found_out(changes, message):
    good = plan("paper")
    if "waypoints_m" in changes:
        changes = {"paths": (PlannedPath(**changes),)}
    with pytest.raises(InfeasiblePlanError, match=message):
        check_plan(BASE, dataclasses.replace(good, **changes))


def test_a_false_value_is_found_out_in_any_unit() -> None:
    tiny = dataclasses.replace(BASE, importance=BASE.importance * 1e-15)
    good = plan("paper", importance=tiny.importance)
    check_plan(tiny, good)
    with pytest.raises(InfeasiblePlanError, match="claims a value of"):
        check_plan(tiny, dataclasses.replace(good, value=5.0 * good.value))


@pytest.mark.parametrize(("away_m", "budget_m"), [(320.0, 0.0), (3000.0, 2600.0), (3000.0, 2680.0)])
@pytest.mark.parametrize("timed", [False, True])
def test_where_nobody_is_in_reach_nothing_is_left_out(
    away_m: float, budget_m: float, timed: bool
) -> None:
    """Success falls below 1 % within 360 m of a device; one of no importance does not count."""
    limits = RoundLimits(Performance(20.0, 5.0, LimitsConfig()), 200.0) if timed else None
    far: dict[str, Any] = {
        "devices_m": np.array([[away_m, 0.0], [0.0, 4000.0], [10.0, 0.0]]),
        "importance": np.array([1.0, 0.5, 0.0]),
    }
    made = plan("certified", **far, path_budget_m=budget_m, limits=limits)
    assert (made.value, made.upper_bound, made.gap) == (0.0, 0.0, 0.0)
    assert plan("certified", **far, path_budget_m=away_m).value > 0.9
