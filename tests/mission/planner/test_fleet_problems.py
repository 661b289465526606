"""The benchmark's problems of several aircraft: plans keep to the rules, and their distance."""

import json
from copy import deepcopy
from typing import Any

import fleet_problems
import pytest
from test_round_problems import FOLDER, evaluator

from mission.planner.apart import nearest
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner
from mission.planner.files import NamedPlan, plans_as_json, problems_of

PLANS, PROBLEMS = (
    json.loads((FOLDER / name).read_text(encoding="utf-8"))
    for name in ("fleet-plans.json", "fleet-problems.json")
)


def test_the_file_holds_what_the_generator_makes() -> None:
    made = json.loads(json.dumps(fleet_problems.problems()))
    assert [entry["id"] for entry in PROBLEMS] == [entry["id"] for entry in made] == list(PLANS)
    assert len(PROBLEMS) == 60
    for ours, theirs in zip(made, PROBLEMS, strict=True):
        for key, value in theirs.items():  # trigonometry differs in the last digit by machine
            if key not in ("areas", "channel"):
                assert ours[key] == value, f"{theirs['id']}: {key}"


def test_our_plans_keep_to_the_rules() -> None:
    waits = layers = 0
    for entry in PROBLEMS:
        plan = PLANS[entry["id"]]
        value, *_ = evaluator.evaluate(entry, plan)
        assert value == pytest.approx(plan["value"], rel=1e-9)
        assert value <= plan["upper_bound"] * (1.0 + 1e-9)
        waits += "waits" in plan.get("mended", "")
        layers += "flown at" in plan.get("mended", "")
    assert waits + layers > 0  # so that both rules are tried


@pytest.mark.parametrize("number", [2, 12])  # from corners: they count from the start
def test_the_evaluator_agrees_with_our_own_check(number: int) -> None:
    entry = PROBLEMS[number]
    (named,) = problems_of([entry], "benchmark")
    made = make_planner(PlannerConfig(max_nodes=100)).plan(named.problem)
    check_plan(named.problem, made)
    near = nearest(named.problem, made)
    assert near is not None
    told = json.loads(json.dumps(plans_as_json([NamedPlan(named.id, made, 0.0)])))[named.id]
    value, duration_s, _ = evaluator.evaluate(entry, told)
    assert value == pytest.approx(made.value, rel=1e-12)
    longest_s = max(path.foreseen.duration_s for path in made.paths if path.foreseen)
    assert duration_s == pytest.approx(longest_s, rel=1e-9)
    evaluator.evaluate(entry | {"separation_m": near.away_m}, told)
    with pytest.raises(evaluator.BrokenRuleError, match="m apart at"):
        evaluator.evaluate(entry | {"separation_m": near.away_m + 0.1}, told)


def _both(plan: dict[str, Any]) -> None:
    first, second = plan["vehicles"][:2]
    second["schedule"] = deepcopy(first["schedule"])


def _fewer(plan: dict[str, Any]) -> None:
    plan["vehicles"].pop()


def _high(plan: dict[str, Any]) -> None:
    plan["vehicles"][0]["altitude_m"] = 90.0


def _far(plan: dict[str, Any]) -> None:
    plan["vehicles"][1]["waypoints"][-1] = plan["vehicles"][1]["route"][-1] = [2000.0, 0.0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_both, "sends to two"), (_fewer, "1 vehicles, there are 2"), (_high, "an altitude of 90"),
        (_far, "vehicle 1: .* m, .* are allowed"),
    ],
)  # fmt: skip
def test_a_plan_that_breaks_a_rule_is_refused(change: Any, words: str) -> None:
    broken = deepcopy(PLANS["two-12-0"])
    change(broken)
    with pytest.raises(evaluator.BrokenRuleError, match=words):
        evaluator.evaluate(PROBLEMS[0], broken)
