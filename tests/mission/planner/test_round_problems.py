"""The benchmark's problems, and its evaluator, which knows nothing of our code."""

import importlib.util
import json
from copy import deepcopy
from pathlib import Path
from typing import Any

import best_plans
import numpy as np
import pytest
import round_problems
from one_aircraft import one_path

from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner
from mission.planner.files import NamedPlan, plans_as_json, problems_of
from mission.planner.flyable import acceptance_radius, foresee_round
from mission.planner.improving import fitted

FOLDER = Path(round_problems.__file__).parents[1] / "data" / "problems"


def _module(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


evaluator = _module(FOLDER / "evaluate.py")


def some_plan(entry: dict[str, Any], seed: int) -> tuple[Any, Any, dict[str, Any]]:
    """A problem of ours, a plan that keeps to its limits along a way at random, and its entry."""
    (named,) = problems_of([entry], "benchmark")
    rng = np.random.default_rng(seed)
    way = rng.uniform(0.0, 800.0, (named.problem.steps, 2))
    way[0] = named.problem.start_m
    plan = fitted(named.problem, way)
    assert plan is not None
    made = plans_as_json([NamedPlan(named.id, plan, 0.0)])[named.id]
    return named.problem, plan, json.loads(json.dumps(made))


def test_the_file_holds_what_the_generator_makes() -> None:
    stored = json.loads((FOLDER / "problems.json").read_text(encoding="utf-8"))
    made = json.loads(json.dumps(round_problems.problems()))
    assert len(stored) == 300
    assert [entry["id"] for entry in stored] == [entry["id"] for entry in made]
    for ours, theirs in zip(made, stored, strict=True):
        for key, value in theirs.items():  # trigonometry differs in the last digit by machine
            if key not in ("areas", "channel"):
                assert ours[key] == value, f"{theirs['id']}: {key}"


@pytest.mark.parametrize("seed", range(6))
def test_corners_are_as_sharp_as_the_evaluator_has_them(seed: int) -> None:
    """Paths with repeats, with steps that are dropped, with legs that leave no room for a cut."""
    rng, height_m = np.random.default_rng(seed), 10.0
    entry: dict[str, Any] = round_problems.problem(next(iter(round_problems.KINDS)), seed)
    route = np.cumsum(rng.normal(0.0, [[80.0], [0.3], [8.0]] * 3, (9, 2)), axis=0) + 400.0
    route[[3, 8]] = route[[1, 5]]
    steps = rng.integers(0, 9, len(entry["devices"]))
    entry["steps"], entry["devices"] = 9, route[steps].tolist()  # right below, as far as they go
    channel = entry["channel"]
    channel |= {"altitude_m": height_m, "beta_los_db": 0.0, "noise_db": 0.0, "snr_threshold": 1.0}
    channel["tx_power_db"] = 10.0 * channel["alpha_los"] * np.log10(height_m)  # as good as not
    (named,) = problems_of([entry], "benchmark")
    schedule, radii = np.arange(9)[:, None] == steps, set()
    for radius in evaluator.RADIUS_M * np.array(evaluator.RADIUS_SHARES):
        cut = evaluator.cut_corners(route, radius)
        value = evaluator.worth(entry, height_m, cut, schedule) / 0.99 * (1.0 - 1e-12)
        ours = acceptance_radius(named.problem, one_path(route, schedule, value), 5.0)
        theirs = evaluator.radius_of(entry, height_m, route, list(range(9)), schedule, value)
        assert ours == theirs
        radii.add(ours)
    assert len(radii) > 1


@pytest.mark.parametrize("kind", round_problems.KINDS)
def test_the_evaluator_agrees_with_our_own_check(kind: str) -> None:
    for number in range(3):
        entry = round_problems.problem(kind, number)
        problem, plan, before = some_plan(entry, number)
        check_plan(problem, plan)
        value, duration_s, energy_j = evaluator.evaluate(entry, before)
        assert value == pytest.approx(plan.value, rel=1e-12)
        # Without a limit nothing is foreseen: one that is never reached changes nothing else.
        timed, plan, told = some_plan({"deadline_s": 3600.0, **entry}, number)
        assert told == before
        foreseen = foresee_round(timed, plan)
        assert duration_s == pytest.approx(foreseen.duration_s, rel=1e-12)
        assert energy_j == pytest.approx(foreseen.energy_j, rel=1e-9)


def test_our_plans_keep_to_the_rules() -> None:
    plans = json.loads((FOLDER / "plans.json").read_text(encoding="utf-8"))
    stored = json.loads((FOLDER / "problems.json").read_text(encoding="utf-8"))
    assert list(plans) == [entry["id"] for entry in stored]
    limited = 0
    for entry in stored[::7]:
        plan = plans[entry["id"]]
        value, duration_s, energy_j = evaluator.evaluate(entry, plan)
        assert value == pytest.approx(plan["value"], rel=1e-9)
        assert value <= plan["upper_bound"] * (1.0 + 1e-9)
        if {"deadline_s", "energy_j"} & {*entry}:
            assert duration_s == pytest.approx(plan["duration_s"], rel=1e-9)
            assert energy_j == pytest.approx(plan["energy_j"], rel=1e-9)
            limited += 1
        else:  # nobody asked
            assert not {"duration_s", "energy_j"} & {*plan}
    assert limited == 17


@pytest.mark.parametrize("number", [10, 19])
def test_plans_within_all_limits_are_near_the_best_known(number: int) -> None:
    """Two that a shorter search leaves a quarter and more below."""
    entry = round_problems.problem("all-12x10", number)
    known = json.loads((FOLDER / "plans.json").read_text(encoding="utf-8"))[entry["id"]]
    (named,) = problems_of([entry], "benchmark")
    assert make_planner(PlannerConfig()).plan(named.problem).value > 0.95 * known["value"]


def test_the_better_plan_and_the_tighter_bound_are_kept() -> None:
    entries = [round_problems.problem("all-12x10", number) for number in range(3)]
    made = [[some_plan(entry, seed)[2] for entry in entries] for seed in (1, 2)]
    for plans, bounds in zip(made, ((9.0, 8.0, 7.0), (8.0, 9.0, 7.0)), strict=True):
        for plan, bound in zip(plans, bounds, strict=True):
            plan["upper_bound"] = bound
    names = [str(entry["id"]) for entry in entries]
    known, new = (dict(zip(names, plans, strict=True)) for plans in made)
    del new[names[2]]
    best = best_plans.best_known(entries, known, new, "a stranger")
    for name in names[:2]:
        values = known[name]["value"], new[name]["value"]
        assert best[name]["value"] == max(values)
        assert best[name].get("origin") == ("a stranger" if values[1] > values[0] else None)
        assert best[name]["upper_bound"] == 8.0
        assert best[name]["gap"] == pytest.approx(1.0 - max(values) / 8.0)
    told = {name: best[names[2]][name] for name in ("gap", "duration_s", "energy_j")}
    assert best[names[2]] == known[names[2]] | told
    _, *takes = evaluator.evaluate(entries[2], best[names[2]])
    assert [told["duration_s"], told["energy_j"]] == takes
    known[names[0]]["upper_bound"] = -1.0
    with pytest.raises(ValueError, match="a bound says"):
        best_plans.best_known(entries, known, new, "a stranger")


def _farther(_: dict[str, Any], plan: dict[str, Any]) -> None:
    plan["waypoints"][-1] = plan["route"][-1] = [2000.0, 2000.0]


def _elsewhere(_: dict[str, Any], plan: dict[str, Any]) -> None:
    plan["waypoints"][0] = plan["route"][0] = [401.0, 400.0]


def _twice(_: dict[str, Any], plan: dict[str, Any]) -> None:
    for row in plan["schedule"][1:3]:
        row[:] = [1] + [0] * (len(row) - 1)


def _crowded(_: dict[str, Any], plan: dict[str, Any]) -> None:
    plan["schedule"] = [[0] * 12 for _ in plan["schedule"]]
    plan["schedule"][1][:4] = [1, 1, 1, 1]


def _high(_: dict[str, Any], plan: dict[str, Any]) -> None:
    plan["altitude_m"] = 130.0


def _hurried(entry: dict[str, Any], _: dict[str, Any]) -> None:
    entry["deadline_s"] = 5.0


def _weak(entry: dict[str, Any], _: dict[str, Any]) -> None:
    entry["energy_j"] = 900.0


def _through(entry: dict[str, Any], plan: dict[str, Any]) -> None:
    x, y = plan["route"][1]
    entry["areas"] = [[[x - 5, y - 5], [x + 5, y - 5], [x + 5, y + 5], [x - 5, y + 5]]]


def _off_route(_: dict[str, Any], plan: dict[str, Any]) -> None:
    plan["route"] = plan["route"][::-1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_farther, "m are allowed|m, 800"), (_elsewhere, "start"), (_twice, "twice"),
        (_crowded, "too many"), (_high, "altitude"), (_hurried, "deadline_s"), (_weak, "energy_j"),
        (_through, "of an area"), (_off_route, "route"),
    ],
)  # fmt: skip
def test_a_plan_that_breaks_a_rule_is_refused(change: Any, words: str) -> None:
    entry = round_problems.problem("all-12x10", 3)
    entry = {k: v for k, v in entry.items() if k != "areas"} | {"areas": []}
    _, _, plan = some_plan(entry, 1)
    evaluator.evaluate(entry, plan)
    broken_entry, broken_plan = deepcopy(entry), deepcopy(plan)
    change(broken_entry, broken_plan)
    with pytest.raises(evaluator.BrokenRuleError, match=words):
        evaluator.evaluate(broken_entry, broken_plan)


def test_who_is_served_too_early_brings_nothing() -> None:
    entry = round_problems.problem("ready-12x10", 0)
    entry["ready_in_s"] = [0.0] * 12
    _, _, plan = some_plan(entry, 2)
    value, _, _ = evaluator.evaluate(entry, plan)
    assert value > 0.0
    late, _, _ = evaluator.evaluate(entry | {"ready_in_s": [1000.0] * 12}, plan)
    assert late == 0.0
