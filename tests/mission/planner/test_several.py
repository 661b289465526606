"""Rounds of several aircraft: their problems, plans and files, and what checks them."""

import dataclasses
import doctest
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import aerofed
from fl.radio.channel import CHANNEL_PRESETS
from flightdyn.config import LimitsConfig
from mission.base.errors import InfeasiblePlanError, PlanError, PlanInputError
from mission.planner import plan as plans
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import check_problem, finish
from mission.planner.factory import make_planner
from mission.planner.files import NamedPlan, plans_as_json, problems_of
from mission.planner.fleet.planner import FleetPlanner
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.planner.plan import PlannedPath, RoundPlan
from mission.planner.problem import RoundProblem, Start
from mission.scenario import strategies

FLYING = Performance(20.0, 5.0, LimitsConfig())
HOMES = np.array([[0.0, 0.0], [1000.0, 0.0]])
DEVICES = [[100.0, 0.0], [0.0, 100.0], [900.0, 0.0], [1000.0, 100.0]]


def two(**more: Any) -> RoundProblem:
    """One aircraft at the origin, at the channel's altitude; one 1 km east, 30 m high."""
    usual: dict[str, Any] = {
        "devices_m": DEVICES, "importance": [1.0, 0.5, 1.0, 0.5],
        "starts": (Start(HOMES[0], 400.0), Start(HOMES[1], 300.0, altitude_m=30.0)),
        "steps": 3, "per_step": 1, "channel": CHANNEL_PRESETS["suburban"],
    }  # fmt: skip
    return RoundProblem(**{**usual, **more})


def over_devices(problem: RoundProblem) -> RoundPlan:
    """Each aircraft over the two devices at its end of the area."""
    ways = ([[0, 0], [100, 0], [0, 100]], [[1000, 0], [900, 0], [1000, 100]])
    near = ([1, 1, 0, 0], [0, 0, 1, 1])
    return RoundPlan.together([
        finish(dataclasses.replace(problem.alone(a), importance=problem.importance * near[a]), way)
        for a, way in enumerate(ways)
    ])  # fmt: skip


def test_a_plan_of_several_is_worth_the_sum_of_its_parts() -> None:
    problem = two()
    plan = over_devices(problem)
    check_plan(problem, plan)
    channel = problem.channel
    overhead = [1.0 - channel.per(0.0, height) for height in (channel.altitude_m, 30.0)]
    assert plan.value == pytest.approx(1.5 * sum(overhead), rel=1e-12)
    assert plan.schedule.shape == (2, 3, 4)
    assert plan.path_m == pytest.approx(2 * (100 + 100 * 2**0.5))
    for wrong in (plan.value * 1.001, plan.value - 0.01):
        with pytest.raises(InfeasiblePlanError, match="claims a value"):
            check_plan(problem, dataclasses.replace(plan, value=wrong))


def other_path(plan: RoundPlan, aircraft: int, **own: Any) -> RoundPlan:
    paths = list(plan.paths)
    paths[aircraft] = dataclasses.replace(paths[aircraft], **own)
    return dataclasses.replace(plan, paths=tuple(paths))


def other_schedule(plan: RoundPlan, *sent: tuple[int, int, int]) -> RoundPlan:
    schedule = plan.schedule.copy()
    for at in sent:
        schedule[at] = True
    return dataclasses.replace(plan, schedule=schedule)


def test_each_rule_holds_for_each_aircraft() -> None:
    problem, good = two(), over_devices(two())
    far = np.array([[1000, 0], [900, 0], [1000, 201]])
    for plan, words in (
        (other_path(good, 1, waypoints_m=far + 1.0), "^aircraft 1: the first waypoint lies 1.41"),
        (other_path(good, 1, waypoints_m=far), r"^aircraft 1: the path is 24\.50\d\d m longer"),
        (other_path(good, 0, waypoints_m=far), "^aircraft 0: the first waypoint lies 1000.0"),
        (other_path(good, 1, altitude_m=40.0), "^aircraft 1: an altitude of 40 m: .* one of 30 m"),
        (other_schedule(good, (0, 0, 2), (0, 0, 3)), "^aircraft 0: 2 devices in one step"),
        (other_schedule(good, (0, 0, 2)), "^device 2 is scheduled 2 times"),
        (good.alone(0), "^1 paths and a schedule .*: must be 2 and"),
    ):
        with pytest.raises(InfeasiblePlanError, match=words):
            check_plan(problem, plan)


@pytest.mark.parametrize("shape", [(1, 3), (3, 4), (2, 3, 4), (1, 2, 4), (1, 3, 4, 1)])
def test_a_schedule_is_of_each_aircraft_step_and_device(shape: tuple[int, ...]) -> None:
    path = PlannedPath(np.zeros((3, 2)))
    assert RoundPlan((path,), np.zeros((1, 3, 4), dtype=bool), 0.0).schedule.shape == (1, 3, 4)
    with pytest.raises(
        PlanInputError, match=r"^schedule has shape .*: must be \(1, 3, K\), for each"
    ):
        RoundPlan((path,), np.zeros(shape, dtype=bool), 0.0)


def test_limits_of_time_are_each_ones_own() -> None:
    """At 20 m/s and 5 m/s2 a leg of 100 m takes 9 s: two are too much for 10 s, not for 40 s."""
    limits = [RoundLimits(FLYING, 40.0), RoundLimits(FLYING, 10.0)]
    starts = [dataclasses.replace(s, limits=of) for s, of in zip(two().starts, limits, strict=True)]
    problem, plan = two(starts=starts), over_devices(two())
    with pytest.raises(InfeasiblePlanError, match=r"^aircraft 1: the flight takes .* are 10$"):
        check_plan(problem, plan)
    check_plan(two(starts=[starts[0], two().starts[1]]), plan)


def test_devices_that_get_ready_are_heard_in_time_by_each() -> None:
    starts = [dataclasses.replace(s, limits=RoundLimits(FLYING, 60.0)) for s in two().starts]
    at_once, plan = two(starts=starts, ready_in_s=[0, 0, 0, 0]), over_devices(two())
    check_plan(at_once, plan)
    # The one over (1000, 100) is served at the end of 241 m, some 20 s into the round.
    for ready_s, lost in ((3.0, 0.0), (50.0, 0.5)):
        late = two(starts=starts, ready_in_s=[0, 0, 0, ready_s])
        value = plan.value - lost * (1.0 - float(late.channel.per(0.0, 30.0)))
        check_plan(late, dataclasses.replace(plan, value=value))


def test_a_planner_for_one_says_so() -> None:
    for kind in ("certified", "sqp", "paper"):
        planner = make_planner(PlannerConfig(kind=kind))
        assert isinstance(planner, FleetPlanner)
        with pytest.raises(PlanError, match=r"^there are 2 aircraft"):
            planner.inner.plan(two())


def test_a_start_that_makes_no_sense_is_named() -> None:
    ours, theirs = two().starts
    for other, words in (
        ({"path_budget_m": -1.0}, r"^starts\[1\].path_budget_m = -1.0: must be 0 or more"),
        ({"altitudes_m": (50.0, 40.0), "altitude_m": None}, r"^starts\[1\].altitudes_m = \[50.0,"),
        ({"altitudes_m": (40.0, 50.0)}, r"^starts\[1\].altitude_m = 30.0: .* None where altitudes"),
        ({"start_m": [1.0]}, r"^starts\[1\].start has shape \(1,\)"),
    ):
        with pytest.raises(PlanInputError, match=words):
            check_problem(two(starts=(ours, dataclasses.replace(theirs, **other))))
    for none in ((), [3], ours):
        with pytest.raises(PlanInputError, match=r"^starts = .*: must be a tuple of Start"):
            two(starts=none)


ENTRY: dict[str, Any] = {
    "id": "a", "devices": DEVICES, "importance": [1, 0.5, 1, 0.5], "steps": 3, "per_step": 1,
    "channel": dataclasses.asdict(CHANNEL_PRESETS["suburban"]), "path_budget_m": 400,
    "deadline_s": 90,
    "vehicles": [
        {"start": [0, 0]},
        {"start": [1000, 0], "path_budget_m": 300, "altitude_m": 30, "deadline_s": 60},
    ],
}  # fmt: skip


def test_a_problem_file_has_several_vehicles() -> None:
    (entry,) = problems_of([ENTRY], "problems.json")
    first, second = entry.problem.starts
    assert (first.start_m.tolist(), second.start_m.tolist()) == ([0.0, 0.0], [1000.0, 0.0])
    assert (first.path_budget_m, second.path_budget_m) == (400.0, 300.0)
    assert (first.altitude_m, second.altitude_m) == (None, 30.0)
    assert [s.limits and s.limits.duration_s for s in (first, second)] == [90.0, 60.0]
    assert entry.problem.alone(1).channel.altitude_m == 30.0
    plan = over_devices(entry.problem)
    made = json.loads(json.dumps(plans_as_json([NamedPlan("a", plan, 0.1)])))["a"]
    assert [np.array(each["schedule"]).shape for each in made["vehicles"]] == [(3, 4), (3, 4)]
    assert made["vehicles"][1]["waypoints"][1] == [900.0, 0.0]
    assert made["value"] == plan.value


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"start": [0, 0]}, "give either start, or vehicles with the start of each"),
        ({"vehicles": None}, "give either start, or vehicles with the start of each"),
        ({"vehicles": []}, "vehicles"),
        ({"path_budget_m": None}, "path_budget_m is missing: give it here, or each of the"),
        ({"vehicles": [{"start": [0, 0], "altitude_m": 40, "altitudes_m": [40, 50]}]}, "not both"),
        ({"vehicles": [{"path_budget_m": 9}]}, r"vehicles\[0\].start|vehicles.0.start"),
        ({"vehicles": [{"start": [0, 0], "speed": 3}]}, "speed"),
    ],
)
def test_vehicles_that_make_no_sense_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(PlanInputError, match=words) as error:
        problems_of([{**ENTRY, **changes}], "problems.json")
    assert str(error.value).startswith("problems.json: [0] (id 'a')")


def test_a_height_of_its_own_rules_out_a_choice_of_all() -> None:
    (entry,) = problems_of([{**ENTRY, "altitudes_m": [40, 80]}], "p")
    assert [start.altitudes_m for start in entry.problem.starts] == [(40.0, 80.0), None]


def test_the_toys_in_the_docstrings_run() -> None:
    for module in (plans, strategies):
        found = doctest.testmod(module)
        assert found.attempted > 3
        assert found.failed == 0


def test_a_single_vehicle_is_a_problem_of_one(tmp_path: Path) -> None:
    alone = {**ENTRY, "vehicles": [{"start": [0, 0], "altitude_m": 40}]}
    plan = aerofed.plan(alone)
    assert plan.waypoints_m[0].tolist() == [0.0, 0.0]
    (entry,) = problems_of([alone], str(tmp_path))
    assert entry.problem.channel.altitude_m == 40.0
    assert "waypoints" in json.dumps(plans_as_json([NamedPlan("a", plan, 0.1)]))
    assert isinstance(plan.path, PlannedPath)
