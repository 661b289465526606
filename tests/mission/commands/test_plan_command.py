"""`aerofed plan` and `aerofed link-budget` as a user calls them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import small_runs

from fl.radio import channel
from fl.radio.channel import CHANNEL_PRESETS
from flightdyn.config import LimitsConfig
from mission.analysis.load import load_run
from mission.base.errors import InputError, PlanError
from mission.cli import call
from mission.commands.planning import show
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import finish
from mission.planner.files import NamedPlan, NamedProblem, read_problems
from mission.planner.limits import RoundLimits
from mission.planner.performance import Foreseen, Performance
from mission.planner.plan import PlannedPath, RoundPlan
from mission.planner.problem import RoundProblem, Start

FLYING = Performance(20.0, 5.0, LimitsConfig())
CHANNEL = {
    "altitude_m": 60.0, "alpha_los": 2.27, "alpha_nlos": 3.64, "beta_los_db": -30.0,
    "beta_nlos_db": -40.0, "sigma_los": 0.3257, "sigma_nlos": 0.5149, "a1_per_rad": 24.64,
    "a2": 3.6835, "tx_power_db": -3.0, "noise_db": -95.0, "snr_threshold": 10.0,
}  # fmt: skip
PROBLEM = {
    "id": "pair", "devices": [[100.0, 0.0], [0.0, 300.0]], "importance": [1.0, 0.5],
    "start": [0.0, 0.0], "steps": 3, "per_step": 1, "path_budget_m": 250.0, "channel": CHANNEL,
}  # fmt: skip


def test_a_problem_file_is_planned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, out = tmp_path / "problems.json", tmp_path / "plans.json"
    source.write_text(json.dumps([PROBLEM]))
    more = ["--out", str(out), "--figure", str(tmp_path / "pictures")]
    assert call(["plan", "--problem", str(source), *more]) == 0
    assert "pair" in capsys.readouterr().out
    plan = json.loads(out.read_text())["pair"]
    assert plan["waypoints"][0] == [0.0, 0.0]
    assert 0.0 < plan["value"] <= plan["upper_bound"] <= 1.5
    assert plan["gap"] <= 0.01
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 1


def test_a_plan_that_is_proven_less_closely_than_asked_for_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "problems.json"
    source.write_text(json.dumps([PROBLEM, {**PROBLEM, "id": "same"}]))
    assert call(["plan", "--problem", str(source), "--set", "planner.max_nodes=0"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "2 of 2 plans are proven less closely than planner.gap = 0.01 asks" in said
    assert "same: the search: it may look into no node" in said
    assert call(["plan", "--problem", str(source)]) == 0
    assert "less closely" not in capsys.readouterr().out


def test_a_plan_that_serves_nobody_says_how_far_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "problems.json"
    source.write_text(json.dumps([{**PROBLEM, "devices": [[3000.0, 4000.0], [9000.0, 0.0]]}]))
    assert call(["plan", "--problem", str(source)]) == 0
    assert (
        "pair: no device is in reach: the nearest lies 5000 m from the start, and the path may be "
        "250 m long" in capsys.readouterr().out
    )
    source.write_text(json.dumps([{**PROBLEM, "channel": {**CHANNEL, "noise_db": 95.0}}]))
    assert call(["plan", "--problem", str(source)]) == 0
    assert "pair: no update gets through from anywhere" in capsys.readouterr().out
    source.write_text(json.dumps([{**PROBLEM, "importance": [0.0, 0.0]}]))
    assert call(["plan", "--problem", str(source)]) == 0
    assert "pair: the importance of every device is 0" in capsys.readouterr().out
    source.write_text(json.dumps([PROBLEM]))
    assert call(["plan", "--problem", str(source)]) == 0
    assert "reach" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        ("round_deadline_s=100", "of the 100 s that the round may take, the path leaves 100, and"),
        ("round_energy_j=9000", "of the 9000 J that the round may take, the path leaves 9000, and"),
    ],
)
def test_uploads_that_fit_into_no_round_are_not_blamed_on_the_channel(
    capsys: pytest.CaptureFixture[str], limit: str, words: str
) -> None:
    slow = ("--set", "channel.upload_rate_bps=1000", "--set", "mission.steps=3")
    assert call(["plan", *slow, "--set", f"mission.{limit}"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"round-1: no update can be sent: {words} the quickest upload takes" in said
    assert "gets through" not in said
    assert ("power is least at 9.1 m/s" in said) == limit.startswith("round_energy")


def test_a_configuration_s_first_round_is_planned(tmp_path: Path) -> None:
    qgc, out = tmp_path / "first.plan", tmp_path / "plans.json"
    assert call(["plan", "--qgc", str(qgc), "--out", str(out), "--method", "paper"]) == 0
    plan = json.loads(out.read_text())["round-1"]
    assert (len(plan["waypoints"]), plan["upper_bound"]) == (10, None)
    assert "hold_s" not in plan
    assert json.loads(qgc.read_text())["fileType"] == "Plan"


STRATEGIES = ("cov", "no_cov", "barycenter", "rectangular")


def planned(tmp_path: Path, strategy: str, *more: str) -> dict[str, Any]:
    out = tmp_path / f"{strategy}.json"
    chosen = ("--set", f"mission.strategy={strategy}", *more)
    assert call(["plan", "--out", str(out), *chosen]) == 0
    return json.loads(out.read_text())["round-1"]


@pytest.mark.slow
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_the_plan_is_the_one_of_the_strategy_s_own_first_round(
    tmp_path: Path, strategy: str
) -> None:
    more = (*small_runs.SETTINGS, "--set", "mission.flight=none")
    plan = planned(tmp_path, strategy, *more)
    run = tmp_path / "run"
    chosen = (
        "--set",
        f"mission.strategy={strategy}",
        *more,
        "--quiet",
        "--no-report",
    )
    assert call(["run", "--rounds", "1", "--out", str(run), *chosen]) == 0
    flown = load_run(run).data
    assert plan["value"] == flown.rounds[0].plan_objective
    assert plan["waypoints"] == flown.plans[0].waypoints_m.tolist()


def test_a_fixed_path_is_planned_with_its_hover_and_asks_no_planner(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    qgc = tmp_path / "first.plan"
    plan = planned(tmp_path, "barycenter", "--qgc", str(qgc), "--set", "mission.hover_s=7")
    assert plan["hold_s"] == 7.0
    assert len({tuple(point) for point in plan["waypoints"]}) == 1
    items = json.loads(qgc.read_text())["mission"]["items"]
    assert 7.0 in [item["params"][0] for item in items]
    assert planned(tmp_path, "rectangular")["waypoints"][0] == [160.0, 160.0]
    more = ["--set", "mission.strategy=rectangular", "--method", "sqp"]
    assert call(["plan", *more]) == InputError.exit_code
    words = "--method: mission.strategy = 'rectangular' has a fixed path and asks no planner"
    assert words in capsys.readouterr().err


def test_where_nothing_is_flown_nothing_is_planned(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["plan", "--set", "mission.strategy=ideal"]) == InputError.exit_code
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert "mission.strategy = 'ideal': flies nothing" in printed.err


class NoWayAcross:
    """Fails on problems of two steps; others are planned."""

    def plan(self, problem: RoundProblem) -> RoundPlan:
        if problem.steps == 2:
            raise PlanError("no way across")
        return finish(problem, np.tile(problem.start_m, (problem.steps, 1)))


@pytest.mark.slow
def test_a_problem_that_fails_is_named_and_the_others_are_planned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mission.commands.planning.make_planner", lambda _: NoWayAcross())
    source, out, pictures = (tmp_path / name for name in ("problems.json", "plans.json", "figures"))
    more = [{**PROBLEM, "id": "x", "steps": 2}, {**PROBLEM, "id": "y"}]
    source.write_text(json.dumps([PROBLEM, *more]))
    tokens = ["plan", "--problem", str(source), "--out", str(out), "--figure", str(pictures)]
    assert call(tokens) == PlanError.exit_code
    assert list(json.loads(out.read_text())) == ["pair", "y"]
    assert sorted(path.name for path in pictures.iterdir()) == ["000-pair.png", "002-y.png"]
    printed = capsys.readouterr()
    assert "pair" in printed.out
    assert printed.err.count("\n") == 1
    assert "problem 'x': no way across" in printed.err


def test_where_every_problem_fails_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mission.scenario.scenario.make_planner", lambda _: NoWayAcross())
    out, qgc = tmp_path / "plans.json", tmp_path / "first.plan"
    tokens = ["plan", "--set", "mission.steps=2", "--out", str(out), "--qgc", str(qgc)]
    assert call(tokens) == PlanError.exit_code
    assert not out.exists()
    assert not qgc.exists()
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "problem 'round-1': no way across" in printed.err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"importance": [1.0, -0.5]}, ["pair", "importance", "-0.5"]),
        ({"devices": [[1.0, 2.0]]}, ["pair", "devices"]),
        ({"steps": 0}, ["pair", "steps", "0"]),
        ({"colour": 1}, ["pair", "colour"]),
    ],
)
def test_a_wrong_problem_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict[str, object], words: list[str]
) -> None:
    source, out = tmp_path / "problems.json", tmp_path / "plans.json"
    source.write_text(json.dumps([{**PROBLEM, **change}]))
    assert call(["plan", "--problem", str(source), "--out", str(out)]) == 2
    printed = capsys.readouterr().err
    for word in ("problems.json", *words):
        assert word in printed
    assert not out.exists()


def test_what_a_problem_file_cannot_be_told_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "problems.json"
    source.write_text(json.dumps([PROBLEM]))
    assert call(["plan", "--problem", str(source), "--set", "planner.gap=0.1"]) == 0
    assert call(["plan", "--problem", str(source), "--set", "mission.steps=3"]) == 2
    assert "--set mission.steps=3: of a problem file only" in capsys.readouterr().err


def test_pictures_that_are_there_already_stay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, picture = tmp_path / "problems.json", tmp_path / "000-pair.png"
    source.write_text(json.dumps([PROBLEM]))
    picture.write_text("mine")
    assert call(["plan", "--problem", str(source), "--figure", str(tmp_path)]) == 2
    assert f"{picture}: exists already" in capsys.readouterr().err
    assert picture.read_text() == "mine"


def test_a_narrow_terminal_cuts_no_number(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    assert call(["plan", "--set", "planner.gap=0.5"]) == 0
    assert "…" not in capsys.readouterr().out


def test_a_wrong_method_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["plan", "--method", "best"]) == 2
    assert "--method best: must be one of" in capsys.readouterr().err


def test_link_budget_prints_and_warns(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["link-budget"]) == 0
    printed = capsys.readouterr()
    assert "served radius (PER 0.5): 185 m" in printed.out
    assert "stand-in for the PER in the planners paper and paper_literal, over the" in printed.out
    assert printed.err == ""
    assert call(["link-budget", "--set", "channel.preset=literal"]) == 0
    assert "warning: PER straight overhead" in capsys.readouterr().err


def test_link_budget_is_of_each_height_and_warns_above_a_half(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def told(*settings: str) -> Any:
        words = [word for each in settings for word in ("--set", each)]
        assert call(["link-budget", "--json", *words]) == 0
        return json.loads(capsys.readouterr().out)

    suburban = CHANNEL_PRESETS["suburban"]
    one = told("mission.altitude_m=80")
    assert one["altitude_m"] == 80.0
    assert one["distance_m"] == [0, 25, 50, 75, 100, 150, 200, 300, 400, 600, 800]
    assert one["per"] == pytest.approx(suburban.per(one["distance_m"], 80.0).tolist())
    assert one["overhead"]["per"] == one["per"][0]
    two = told("mission.altitude_m=[40, 120]")
    assert [each["altitude_m"] for each in two] == [40.0, 120.0]
    assert [each["per"][6] for each in two] == [float(suburban.per(200.0, h)) for h in (40, 120)]
    # At 60 m as many packets are lost as the threshold is high.
    middle = 10 ** (one["overhead"]["snr_los_db"] / 10)
    warned = [
        told(f"channel.snr_threshold={share * middle}", "mission.altitude_m=80")["warning"]
        for share in (0.99, 1.01)
    ]
    assert [bool(each) for each in warned] == [False, True]


@pytest.mark.slow
def test_the_table_fits_eighty_columns_with_all_that_may_be_limited(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    limits = ("mission.altitude_m=[40, 120]", "mission.round_deadline_s=40", "planner.gap=0.5")
    assert call(["plan", "--set", *limits]) == 0
    text = capsys.readouterr().out
    assert "…" not in text
    head, _, row = text.splitlines()[-3:]
    assert " ".join(head.split()) == "problem value bound % m m s kJ served nodes ms"
    assert row.split()[0] == "round-1"
    assert 40.0 <= float(row.split()[5]) <= 120.0
    assert float(row.split()[6]) <= 40.0


def test_a_number_that_only_some_plans_have_has_its_column(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "problems.json"
    both = [{**PROBLEM, "id": "a", "altitudes_m": [40.0, 120.0]}, {**PROBLEM, "deadline_s": 60.0}]
    source.write_text(json.dumps(both))
    assert call(["plan", "--problem", str(source)]) == 0
    head, _, first, second = capsys.readouterr().out.splitlines()[-4:]
    assert " ".join(head.split()) == "problem value bound % m m s kJ served nodes ms"
    assert (first.split()[6:8], second.split()[5]) == (["-", "-"], "-")


def test_no_problem_has_no_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    none = tmp_path / "none.json"
    none.write_text("[]")
    assert call(["plan", "--problem", str(none)]) == 0
    assert capsys.readouterr().out == f"no problems in {none}\n"


def test_plans_of_several_aircraft_have_a_picture_and_no_single_mission(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["plan", "--set", "vehicles=2", "--set", "mission.steps=3"]
    assert call([*words, "--figure", str(tmp_path / "pictures")]) == 0
    assert (tmp_path / "pictures" / "000-round-1.png").exists()
    capsys.readouterr()
    assert call([*words, "--qgc", str(tmp_path / "a.plan")]) == 2
    assert "--qgc: a file has the mission of one aircraft, and there are 2" in (
        capsys.readouterr().err
    )
    assert not (tmp_path / "a.plan").exists()


def test_the_table_has_the_numbers_of_each_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of one that serves two within a bound, and of one that serves nobody and has none."""
    (source := tmp_path / "problems.json").write_text(json.dumps([PROBLEM]))
    (pair,) = read_problems(source)
    waypoints = np.array([[0.0, 0.0], [90.0, 0.0], [90.0, 40.0]])
    served = np.array([[False, False], [True, False], [False, True]])
    made = RoundPlan((PlannedPath(waypoints),), served[None], 0.75, 1.0, nodes=17)
    nobody = RoundPlan((PlannedPath(waypoints[:1].repeat(3, axis=0)),), 0 * served[None] > 0, 0.0)
    plans = [NamedPlan("pair", made, 0.0126), NamedPlan("pair", nobody, 1.5)]
    show(plans, [pair], PlannerConfig(gap=0.2))
    head, _, first, second, loose, note = capsys.readouterr().out.splitlines()[-6:]
    assert " ".join(head.split()) == "problem value bound % m served nodes ms"
    assert first.split() == ["pair", "0.7500", "1.0000", "25.00", "130.0", "2", "17", "13"]
    assert second.split() == ["pair", "0.0000", "-", "-", "0.0", "0", "0", "1500"]
    assert loose.startswith("1 of 2 plans is proven less closely than planner.gap = 0.2 asks")
    assert note.startswith("pair: no update gets through from anywhere on the way")
    show(plans[:1], [pair], PlannerConfig(gap=0.3))
    assert "less closely" not in capsys.readouterr().out


def test_the_table_has_what_flights_take_and_how_far_apart_they_are(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two fly side by side, 25 m apart, and one of the two plans has one height for both."""
    monkeypatch.setenv("COLUMNS", "120")
    devices_m = np.array([[50.0, 0.0], [50.0, 25.0]])
    starts = tuple(
        Start(np.array([0.0, y]), path_budget_m=400.0, limits=RoundLimits(FLYING))
        for y in (0.0, 25.0)
    )
    apart = RoundProblem(
        devices_m=devices_m, importance=np.ones(2), starts=starts, steps=2, per_step=1,
        channel=CHANNEL_PRESETS["suburban"], separation_m=20.0,
    )  # fmt: skip
    anyhow = replace(apart, separation_m=0.0)
    served = np.zeros((2, 2, 2), dtype=np.bool_)
    served[0, 1, 0] = served[1, 1, 1] = True

    def plan(*heights: float | None, value: float) -> RoundPlan:
        paths = tuple(
            PlannedPath(
                np.array([[0.0, y], [100.0, y]]), altitude_m=height_m,
                foreseen=Foreseen(np.array([0.0, lasts_s]), lasts_s, energy_j),
            )
            for y, height_m, lasts_s, energy_j in zip(
                (0.0, 25.0), heights, (30.0, 45.5), (6000.0, 1550.0), strict=True
            )
        )  # fmt: skip
        return RoundPlan(paths, served, value, 2.0, nodes=3)

    plans = [
        NamedPlan("same", plan(60.0, 60.0, value=1.5), 0.001),
        NamedPlan("two", plan(40.0, 60.0, value=1.25), 0.0125),
        NamedPlan("none", plan(None, None, value=1.0), 2.0),
    ]
    problems = [NamedProblem("same", apart), NamedProblem("two", anyhow)]
    show(plans, [*problems, NamedProblem("none", anyhow)], PlannerConfig(gap=0.9))
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    head, units, _, *rows = lines[:6]
    assert (head, units) == (
        ["upper", "gap", "path", "alt.", "takes", "takes", "apart"],
        ["problem", "value", "bound", "%", "m", "m", "s", "kJ", "m", "served", "nodes", "ms"],
    )
    assert [row[:9] for row in rows] == [
        ["same", "1.5000", "2.0000", "25.00", "200.0", "60.0", "45.5", "7.5", "25.0"],
        ["two", "1.2500", "2.0000", "37.50", "200.0", "-", "45.5", "7.5", "-"],
        ["none", "1.0000", "2.0000", "50.00", "200.0", "-", "45.5", "7.5", "-"],
    ]
    assert [row[9:] for row in rows] == [["2", "3", "1"], ["2", "3", "12"], ["2", "3", "2000"]]


def test_a_device_at_the_end_of_the_longest_path_is_in_reach(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "problems.json"
    for away_m, words in ((250.0, "no update gets through"), (251.0, "no device is in reach")):
        deaf = {"channel": {**CHANNEL, "noise_db": 95.0}, "devices": [[0.0, -away_m], [999.0, 0.0]]}
        source.write_text(json.dumps([PROBLEM | deaf]))
        assert call(["plan", "--problem", str(source)]) == 0
        assert f"pair: {words}" in capsys.readouterr().out


def test_link_budget_prints_a_row_for_each_distance(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = channel.LogisticFit(12.345, -1.005, 0.0625)
    monkeypatch.setattr(channel, "fit_logistic", lambda _: fit)
    monkeypatch.setattr(channel, "served_radius_m", lambda _: 0.6)
    monkeypatch.setattr(channel, "average_per", lambda _, r_m: r_m / 1000.0)
    assert call(["link-budget", "--set", "mission.altitude_m=[40, 120.5]"]) == 0
    first, second = capsys.readouterr().out.split("channel suburban, ")[1:]
    assert second.startswith("120.5 m above\noverhead: SNR ")
    assert first.startswith("40 m above\noverhead: SNR ")
    assert [line.split() for line in first.splitlines()[3:]] == [
        ["distance", "m", "PER"],
        *([f"{m}", f"{m / 1000:.4f}"] for m in (0, 25, 50, 75, 100, 150, 200, 300, 400, 600, 800)),
        [],
        ["served", "radius", "(PER", "0.5):", "1", "m"],
        first.splitlines()[-1].split(),
    ]
    assert first.splitlines()[-1].endswith("b1 = 12.35 per rad, b2 = -1.00, wrong by 0.062 at most")
    monkeypatch.setattr(channel, "served_radius_m", lambda _: 0.0)
    assert call(["link-budget"]) == 0
    assert "served radius (PER 0.5): none, not even straight overhead" in capsys.readouterr().out
