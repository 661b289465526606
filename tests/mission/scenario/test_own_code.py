"""A researcher's own strategy and planner: plugged in by import path, flown, and held to rules."""

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from small_runs import QUIET, refused, rows

import aerofed
from mission.base.errors import AerofedError, SolverError
from mission.cli import call
from mission.log import LogError
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.run.recorder import FolderRecorder
from mission.scenario.strategies import RoundInfo

SMALL = (
    "--set", "mission.steps=4", "mission.path_budget_m=250", "mission.devices_per_step=1",
    "communities.0.devices=3", "communities.1.devices=3", "learning.local_epochs=1",
    "communities.0.subset=0.2", "communities.1.subset=0.2",
)  # fmt: skip

MODULE = """
import numpy as np
from dataclasses import dataclass, replace
from mission.planner.evaluate import finish
from mission.planner.plan import RoundPlan
from mission.scenario.strategies import Barycenter, Sortie

class Stay:
    def plan(self, problem):
        return finish(problem, np.tile(problem.start_m, (problem.steps, 1)))

class Jump:
    def plan(self, problem):
        plan = Stay().plan(problem)
        return plan.with_own(waypoints_m=plan.waypoints_m + 1.0)

@dataclass
class Weighs:
    weights: object
    fairness = True
    approach_m = None
    def importance(self, info):
        return self.weights
    def sortie(self, round_index, problem):
        return Sortie(Jump().plan(problem))

class Weakest(Weighs):
    def importance(self, info):
        return np.where(np.isnan(info.accuracy), 2.0, 1.0 - info.accuracy)
    def sortie(self, round_index, problem):
        return Sortie(self.weights.plan(problem))

class Fails(Weighs):
    def sortie(self, round_index, problem):
        return self.deeper(problem)
    def deeper(self, problem):
        return np.linalg.inv(np.zeros((2, 2)))  # the culprit

class Leaves(Weighs):
    def sortie(self, round_index, problem):
        raise SystemExit(3)

class Hovers(Weighs):
    def sortie(self, round_index, problem):
        return Sortie(Stay().plan(problem), hold_s=-4.0)

class Overdone:
    def plan(self, problem):
        return finish(problem, np.tile(problem.start_m, (problem.steps, 1)), upper_bound=1e-9)

class FailsPlanning:
    def plan(self, problem):
        raise KeyError("no such thing")

class Together:
    several = True
    def plan(self, problem):
        plans = []
        for a, one in enumerate(problem.starts):
            free = np.arange(len(problem.devices_m)) % len(problem.starts) == a
            mine = replace(problem.alone(a), importance=np.where(free, problem.importance, 0.0))
            plans.append(finish(mine, np.vstack((one.start_m, problem.devices_m[a]))))
        return RoundPlan.together(plans)

class Apart(Together):
    several = False

class Unsure(Together):
    several = "yes"

class PlansNothing:
    def plan(self, problem):
        return None

def weakest(setting): return Weakest(setting.planner)
def fails(setting): return Fails(np.ones(6))
def wrong_shape(setting): return Weighs(np.ones(3))
def seventh(setting): return Weighs(np.eye(12)[7])
def negative(setting): return Weighs(-np.ones(6))
def jumps(setting): return Weighs(np.ones(6))
def leaves(setting): return Leaves(np.ones(6))
def hovers(setting): return Hovers(np.ones(6))
def lazy(setting): return object()
def raises(task): return {}[3]
def gives_three(task): return 3
number = 3
"""


def fly(out: Path, *more: str, rounds: int = 1) -> int:
    return call(["run", "--out", str(out), "--rounds", str(rounds), *QUIET, *SMALL, *more])


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A module in the working directory, which is where a researcher's stands."""
    (tmp_path / "own_code.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    monkeypatch.delitem(sys.modules, "own_code", raising=False)


@pytest.mark.usefixtures("own")
def test_a_plan_has_the_strategy_s_own_importance() -> None:
    problem = aerofed.first_problem("quickstart", {"mission.strategy": "own_code:seventh"})
    assert problem.importance.tolist() == [0.0] * 7 + [1.0] + [0.0] * 4


def of_two(factory: str) -> aerofed.RoundPlan:
    problem = aerofed.RoundProblem(
        devices_m=np.array([(150.0, 0.0), (150.0, 5.0)]), importance=np.ones(2),
        starts=tuple(
            aerofed.Start(np.array([0.0, y]), 400.0, RoundLimits(Performance(20.0, 5.0, None)))
            for y in (0.0, 5.0)
        ),
        steps=2, per_step=1, channel=aerofed.channel("suburban"), separation_m=12.0,
    )  # fmt: skip
    planner = make_planner(PlannerConfig(kind="import", factory=f"own_code:{factory}"))
    made = planner.plan(problem)
    check_plan(problem, made)
    return made


@pytest.mark.usefixtures("own")
def test_a_planner_of_several_is_given_all_aircraft() -> None:
    """And what comes too near is mended all the same."""
    made = of_two("Together")
    assert made.schedule.any(axis=1).tolist() == [[True, False], [False, True]]
    assert "12 m are kept: flown at " in made.mended


@pytest.mark.usefixtures("own")
def test_another_planner_is_asked_for_each() -> None:
    """Which it plans for as if it were the only one."""
    assert of_two("Apart").schedule.any(axis=(1, 2)).all()
    with pytest.raises(AerofedError, match="several is 'yes': must be True or False"):
        of_two("Unsure")


@pytest.mark.slow
def test_the_worked_example_flies_by_age(tmp_path: Path) -> None:
    out = tmp_path / "age"
    more = ("mission.strategy=examples.staleness:make", "mission.flight=none")
    assert fly(out, *more, rounds=4) == 0
    shares = [float(device["p"]) for device in rows(out / "devices.csv")]
    last_heard = [0] * len(shares)
    uplinks = rows(out / "uplinks.csv")
    assert any(uplink["delivered"] == "true" for uplink in uplinks)
    ages = set()
    for number in range(1, 5):
        served = [uplink for uplink in uplinks if int(uplink["round"]) == number]
        for uplink in served:
            device = int(uplink["device"])
            age = number - last_heard[device]
            ages.add(age)
            assert float(uplink["importance"]) == pytest.approx(shares[device] * age, rel=1e-12)
        for uplink in served:
            if uplink["delivered"] == "true":
                last_heard[int(uplink["device"])] = number
    assert len(ages) > 1


@pytest.mark.slow
@pytest.mark.usefixtures("own")
def test_a_strategy_knows_the_accuracies_that_arrived(tmp_path: Path) -> None:
    out = tmp_path / "weakest"
    more = ("mission.strategy=own_code:weakest", "mission.flight=none")
    assert fly(out, *more, rounds=3) == 0
    received = {
        (int(row["round"]), int(row["device"])): float(row["received_accuracy"])
        for row in rows(out / "learning.csv")
    }
    weights = set()
    for uplink in rows(out / "uplinks.csv"):
        known = received[int(uplink["round"]) - 1, int(uplink["device"])]
        weight = float(uplink["importance"])
        assert weight == pytest.approx(2.0 if math.isnan(known) else 1.0 - known, rel=1e-12)
        weights.add(weight)
    assert len(weights) > 1


def test_age_of_information() -> None:
    info = RoundInfo(
        7, np.ones(3), np.ones(3), np.ones(3), np.zeros(3, np.int64), np.array([0, 6, 3]),
        np.full(3, np.nan), np.zeros(3), np.zeros(3, np.int64),
    )  # fmt: skip
    assert info.age_rounds.tolist() == [7, 1, 4]


@pytest.mark.slow
@pytest.mark.usefixtures("own")
def test_an_own_planner_flies(tmp_path: Path) -> None:
    more = ("planner.kind=import", "planner.factory=own_code:Stay")
    assert fly(tmp_path / "out", *more) == 0
    assert [float(row["plan_path_m"]) for row in rows(tmp_path / "out" / "rounds.csv")] == [0.0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "code", "words"),
    [
        ("mission.strategy=own_code:lazy", 2, ["mission.strategy", "object without", "sortie"]),
        ("mission.strategy=own_code:nothing", 2, ["mission.strategy", "own_code:nothing"]),
        ("mission.strategy=own_code:number", 2, ["own_code:number", "int, not callable"]),
        ("mission.strategy=no_such.module:make", 2, ["no_such.module:make", "no_such"]),
        ("mission.strategy=best", 2, ["mission.strategy = 'best'", "'no_cov'", "package.module"]),
        ("mission.strategy=own_code:", 2, ["mission.strategy = 'own_code:'"]),
        ("mission.strategy=no_cof", 2, ["did you mean no_cov?"]),
        (
            "mission.strategy=own_code:wrong_shape",
            2,
            ["what importance() in round 1 gives is of shape (3,), not (6,)"],
        ),
        (
            "mission.strategy=own_code:negative",
            2,
            ["what importance() in round 1 gives holds -1.0 at [0]: must be finite and 0 or more"],
        ),
        ("mission.strategy=own_code:jumps", 3, ["own_code:jumps", "round 1", "1.4142 m from"]),
        ("mission.strategy=own_code:leaves", 2, ["own_code:leaves", "round 1: SystemExit: 3"]),
        ("mission.strategy=own_code:hovers", 2, ["hold_s = -4.0: must be a finite number of 0"]),
        ("planner.kind=import planner.factory=own_code:Overdone", 3, ["none is worth more than"]),
        ("planner.kind=import planner.factory=own_code:lazy", 2, ["planner.factory", "lazy"]),
        ("planner.kind=import planner.factory=own_code:Jump", 3, ["own_code:Jump", "1.4142 m"]),
        ("planner.kind=import", 2, ["planner: kind = 'import' needs factory = 'package.module:"]),
        (
            "planner.kind=import planner.factory=own_code:PlansNothing",
            2,
            ["planner.factory = 'own_code:PlansNothing': plan() gives a NoneType, not a RoundPlan"],
        ),
        (
            "planner.factory=own_code:Stay",
            2,
            ["planner: factory belongs to kind = 'import', but kind is 'certified'"],
        ),
        (
            "communities.1.partition=own_code:raises",
            2,
            ["communities.1.partition = 'own_code:raises': the partition: KeyError: 3 (", "raises"],
        ),
        (
            "communities.1.partition=own_code:gives_three",
            2,
            ["communities.1.partition = 'own_code:gives_three'", "'int' object is not iterable\n"],
        ),
        (
            "communities.1.task=own_code:lazy",
            2,
            ["communities.1.task = 'own_code:lazy': the factory gives an obj"],
        ),
        ("planner.kind=import planner.factory=stay", 2, ["planner.factory = 'stay'"]),
    ],
)
@pytest.mark.usefixtures("own")
def test_what_breaks_the_rules_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], settings: str, code: int, words: list[str]
) -> None:
    assert fly(tmp_path / "out", *settings.split()) == code
    refused(capsys, *words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = y", "cannot be imported: NameError: name 'y' is not defined"),
        ("def broken(:", "cannot be imported: SyntaxError: "),
        ("", "cannot be imported: AttributeError: "),
        ("def make(setting): return y", "calling it fails: NameError: name 'y' is not defined"),
    ],
)
@pytest.mark.parametrize("within", ["", ".inner"])
def test_own_code_that_is_unfinished_is_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    text: str,
    words: str,
    within: str,
) -> None:
    """In a module, and in the package around one, which is imported with it."""
    name = f"unfinished_{len(text)}{'_package' if within else ''}"
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").write_text(text)
    (tmp_path / name / "inner.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    out = tmp_path / "out"
    assert fly(out, f"mission.strategy={name}{within}:make") == 2
    refused(capsys, words)
    assert not out.exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("failure", "resumed"),
    [(LogError(Path("flight.mcap"), "no room"), True), (SolverError("OSQP", "max_iter"), False)],
)
def test_an_error_of_any_kind_names_the_folder(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    failure: AerofedError,
    resumed: bool,
) -> None:
    def fail(*_: object) -> None:
        raise failure

    monkeypatch.setattr(FolderRecorder, "finished", fail)
    out = tmp_path / "out"
    assert fly(out) == failure.exit_code
    goes_on = f"; aerofed run --resume {out} goes on" if resumed else ""
    assert capsys.readouterr().err == f"aerofed: {failure}; the files are in {out}{goes_on}\n"


@pytest.mark.parametrize(
    ("setting", "doing", "error", "culprit"),
    [
        (
            ("mission.strategy=own_code:fails",),
            "mission.strategy = 'own_code:fails': sortie() in round 1",
            "LinAlgError: Singular matrix",
            "# the culprit",
        ),
        (
            ("planner.kind=import", "planner.factory=own_code:FailsPlanning"),
            "planner.factory = 'own_code:FailsPlanning': plan()",
            "KeyError: 'no such thing'",
            "raise KeyError",
        ),
    ],
)
def test_own_code_that_fails_in_flight_is_named_with_its_line(
    own: None,  # noqa: ARG001
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    setting: tuple[str, ...],
    doing: str,
    error: str,
    culprit: str,
) -> None:
    out = tmp_path / "run"
    assert fly(out, *setting) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{doing}: {error}" in line
    if culprit:
        lines = MODULE.splitlines()
        number = next(i for i, text in enumerate(lines, 1) if culprit in text)
        assert f"{tmp_path / 'own_code.py'}, line {number})" in line
    assert f"the whole traceback is in {out / 'traceback.txt'}" in line
    whole = (out / "traceback.txt").read_text()
    assert whole.startswith("Traceback")
    assert error.partition(":")[0] in whole
    assert json.loads((out / "summary.json").read_text())["status"] == "failed"
