"""The Python API: its names, what it returns, and that it flies within a running event loop."""

import asyncio
import fcntl
import inspect
import math
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from drawing import outlined
from one_aircraft import changed, round_problem

import aerofed
from fl.radio.channel import CHANNEL_PRESETS, average_per
from mission.base.errors import LIMITS_NOT_MET, PlanError, PlanInputError
from mission.base.interrupts import in_a_thread, run_flight
from mission.base.run_folder import RunFolder
from mission.cli import call
from mission.log.records import UplinkRecord
from mission.log.tables import read_table

SMALL = {
    "mission.steps": 4,
    "mission.path_budget_m": 250.0,
    "mission.altitude_m": 30.0,
    "vehicle.parameters.MPC_TKO_SPEED": 5.0,
    "vehicle.parameters.MPC_LAND_SPEED": 1.5,
    "planner.gap": 0.1,
    "mission.rounds": 2,
    "communities.0.devices": 3,
    "communities.1.devices": 3,
    "communities.0.subset": 0.2,
    "communities.1.subset": 0.2,
    "learning.local_epochs": 1,
}
TABLES = ("rounds.csv", "aircraft.csv", "uplinks.csv", "learning.csv", "flight.mcap")


HERE = (400, 400)  # where the problem begins
PATH = (aerofed.PlannedPath(np.zeros((1, 2))),)
UNTYPED: Any = aerofed  # as a notebook calls it


class Gives:
    """A planner that gives whatever it was told to."""

    def __init__(self, plan: object) -> None:
        self._plan = plan

    def plan(self, _problem: aerofed.RoundProblem) -> Any:
        return self._plan


def problem(**other: object) -> Any:
    """A problem as a notebook writes it, with plain lists and tuples."""
    known: dict[str, object] = {
        "devices_m": [(100, 200), (300, 400), (500, 600)], "importance": [1, 2, 0.5],
        "start_m": (400, 400), "steps": 3, "per_step": 1, "path_budget_m": 300,
        "channel": aerofed.channel(),
    }  # fmt: skip
    return round_problem(**{**known, **other})


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> aerofed.Run:
    """Flown as a notebook flies: an event loop is running."""

    async def cell() -> aerofed.Run:
        return aerofed.run("quickstart", SMALL, out=tmp_path_factory.mktemp("api") / "out")

    with outlined():
        return asyncio.run(cell())


def test_the_public_names() -> None:
    assert aerofed.__all__ == [
        "AerofedError", "Airspace", "Algorithm", "Area", "Belief", "Callback", "CallbackContext",
        "Channel", "DeviceData", "Figure", "Foreseen", "Heard", "ImportanceStrategy", "InputError",
        "LearningConfig", "LimitsNotMetError", "LinkTerms",
        "LocalResult", "LocalSettings", "MissionConfig", "Partition", "PartitionTask",
        "Performance", "PlanError", "PlannedPath", "Planner", "Radio", "RoundInfo", "RoundLearning",
        "RoundLimits", "RoundPlan", "RoundProblem", "RoundRecord", "RoundReport", "Run",
        "RunConfig", "Samples", "Sortie", "StaleStart", "Start", "Strategy", "StrategyContext",
        "Sweep",
        "Trainer", "TrainingDevice", "Update", "UplinkRecord", "UsersCodeError", "channel",
        "compare", "config", "finish", "first_problem", "fit_budget", "fly", "load", "load_sweep",
        "plan", "resume", "run", "sweep", "vehicle", "vehicles",
    ]  # fmt: skip


@pytest.mark.parametrize("name", aerofed.__all__)
def test_every_public_name_is_documented(name: str) -> None:
    found = getattr(aerofed, name)
    assert inspect.getdoc(found)
    page = (Path(__file__).parents[3] / "docs" / "api.md").read_text(encoding="utf-8")
    assert f"\n### {name}\n" in page or f"`{name}`" in page
    if inspect.isclass(found) and found.__module__.startswith("mission.api"):
        for member, value in vars(found).items():
            if not member.startswith("_") and (callable(value) or hasattr(value, "func")):
                assert inspect.getdoc(value), member


def test_importing_it_brings_nothing_heavy() -> None:
    code = "import sys, aerofed; print(*(m for m in sys.argv[1:] if m in sys.modules))"
    heavy = ("pandas", "torch", "altair", "mavsdk", "jsbsim", "cvxpy", "scipy", "asyncio.events")
    command = [sys.executable, "-c", code, *heavy[:-1]]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


OWN_MODULES = """
import sys
for name in sys.argv[1:]:
    open(f"{name}.py", "w").write("raise AssertionError")
import aerofed
print(aerofed.config().name)
"""


@pytest.mark.slow
def test_a_script_may_stand_beside_modules_of_our_names(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(OWN_MODULES)
    command = [sys.executable, str(script), "mission", "fl", "native", "sitl", "flightdyn"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert (done.stdout, done.stderr) == ("quickstart\n", "")
    script.write_text(
        "import types, sys; sys.modules['fl'] = types.ModuleType('fl'); import aerofed"
    )
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "ImportError: aerofed: another module is called 'fl': None; rename it" in done.stderr


@pytest.mark.slow
def test_a_run_in_a_running_loop_is_that_of_the_command_line(
    run: aerofed.Run, tmp_path: Path
) -> None:
    sets = [f"{key}={value}" for key, value in SMALL.items()]
    few = ("--quiet", "--no-report")
    assert call(["run", "--out", str(tmp_path / "cli"), *few, "--set", *sets]) == 0
    for name in TABLES:
        assert (run.path / name).read_bytes() == (tmp_path / "cli" / name).read_bytes()


@pytest.mark.slow
def test_tables_are_data_frames(run: aerofed.Run) -> None:
    assert run.status == "finished"
    assert run.rounds["round"].tolist() == [1, 2]
    assert {"accuracy_digits", "cov_digits", "true_objective"} <= set(run.rounds.columns)
    written = pd.read_csv(run.path / "rounds.csv")
    pd.testing.assert_frame_equal(run.rounds, written)
    records = read_table(run.path / "uplinks.csv", UplinkRecord)
    assert run.uplinks["device"].tolist() == [item.device for item in records]
    assert run.uplinks["delivered"].dtype == bool
    assert len(run.learning) == 6 * 3
    assert run.aircraft["flown_path_m"].tolist() == run.rounds["flown_path_m"].tolist()
    assert run.learning["loss"].notna().sum() == run.uplinks["delivered"].sum()
    assert set(run.track["round"]) == {0, 1, 2}
    first = run.track[run.track["round"] == 1]
    steps = np.diff(first[["true_x_m", "true_y_m"]].to_numpy(), axis=0)
    assert np.hypot(*steps.T).sum() == pytest.approx(run.rounds["flown_path_m"][0], abs=0.5)
    assert run.config.mission.rounds == 2
    assert run.summary["seed"] == 1
    assert len(run.table("plans")) == 2 * 4


@pytest.mark.slow
def test_a_figure_is_shown_and_saved(run: aerofed.Run, tmp_path: Path) -> None:
    figure = aerofed.load(run.path).figure("map")
    assert figure._repr_png_() == (run.path / "figures" / "map.png").read_bytes()
    assert figure.save(tmp_path / "map.svg").read_bytes().startswith(b"<svg")
    with pytest.raises(aerofed.InputError, match="no figure 'mpa'; there are: 'map', 'rounds'"):
        run.figure("mpa")


@pytest.mark.slow
def test_a_page_is_written_where_asked(run: aerofed.Run, tmp_path: Path) -> None:
    assert run.report() == run.path / "report.html"
    page = run.report(str(tmp_path / "page.html"))
    assert page.read_bytes() == (run.path / "report.html").read_bytes()
    with pytest.raises(aerofed.InputError, match=r"page\.html: cannot write"):
        run.report(tmp_path / "none" / "page.html")


@pytest.mark.slow
def test_a_log_by_itself(run: aerofed.Run) -> None:
    log = aerofed.load(run.path / "flight.mcap")
    pd.testing.assert_frame_equal(log.rounds, run.rounds)
    assert set(log.table("learning")["community"]) == {"digits", "colour-shapes"}
    with pytest.raises(aerofed.InputError, match="a log has no table of devices"):
        _ = log.learning
    with pytest.raises(aerofed.InputError, match="no table 'plan'; there are: track, plans"):
        log.table("plan")


@pytest.mark.slow
def test_runs_compare_as_on_the_command_line(run: aerofed.Run) -> None:
    table = aerofed.compare(run, run.path / "flight.mcap")
    assert table.index.tolist() == ["out", "flight.mcap"]
    assert table.loc["out", "flown_path_m"] == pytest.approx(run.rounds["flown_path_m"].sum())
    rounds = aerofed.compare(run, by_round=True)
    assert rounds.loc[("out", 2), "delivered"] == run.rounds["delivered"][1]
    assert len(aerofed.compare(run, rounds=1, by_round=True)) == 1
    twice = aerofed.compare(run, aerofed.load(run.path))
    assert twice.index.tolist() == ["out"] * 2


def test_plans() -> None:
    problem = aerofed.first_problem("quickstart", {"mission.steps": 4})
    plan = aerofed.plan(problem, gap=0.05)
    assert plan.waypoints_m.shape == (4, 2)
    assert plan.gap <= 0.05

    class Stay:
        def plan(self, problem: aerofed.RoundProblem) -> aerofed.RoundPlan:
            return aerofed.finish(problem, np.tile(problem.start_m, (problem.steps, 1)))

    assert aerofed.plan(problem, Stay()).path_m == 0.0


def test_a_plan_for_the_keys_of_a_problem_file() -> None:
    entry = {
        "devices": [[100.0, 0.0], [0.0, 300.0]], "importance": [1.0, 0.5], "start": [0.0, 0.0],
        "steps": 3, "per_step": 1, "path_budget_m": 800, "deadline_s": 20.0,
        "channel": asdict(aerofed.channel("suburban")),
    }  # fmt: skip
    plan = aerofed.plan(entry)
    assert plan.foreseen is not None
    assert plan.foreseen.duration_s <= 20.0
    with pytest.raises(aerofed.InputError, match="deadline_s = -1: must be greater than 0"):
        aerofed.plan({**entry, "deadline_s": -1})


def test_lists_and_tuples_are_arrays() -> None:
    arrays = problem(
        devices_m=np.array([(100.0, 200.0), (300.0, 400.0), (500.0, 600.0)]),
        importance=np.array([1.0, 2.0, 0.5]),
        start_m=np.array([400.0, 400.0]),
    )
    plan = aerofed.plan(problem())
    assert plan.waypoints_m.tolist() == aerofed.plan(arrays).waypoints_m.tolist()
    way = [(400, 400), (300, 400), (200, 400)]
    made = aerofed.finish(problem(), way)
    assert made.path_m == pytest.approx(200.0)
    # What rounding adds to a path that just fits is nobody's mistake.
    nudged = [(400, 400 + 1e-7), (300, 400), (200 - 1e-7, 400)]
    assert aerofed.finish(changed(problem(), path_budget_m=200.0), nudged).path_m > 200.0
    assert aerofed.fit_budget(way, 100).tolist()[-1] == pytest.approx([300.0, 400.0])
    plain = UNTYPED.RoundPlan(
        [UNTYPED.PlannedPath(way)], made.schedule.astype(int).tolist(), made.value
    )
    assert aerofed.plan(problem(), Gives(plain)) is plain
    with pytest.raises(aerofed.InputError, match="ready_in_s needs limits"):
        aerofed.finish(problem(ready_in_s=np.zeros(3)), way)


def test_a_plan_is_printed_in_a_line() -> None:
    many = np.full((300, 2), 400.0)
    crowd = problem(devices_m=many, importance=np.ones(300), steps=40, per_step=2)
    printed = repr(aerofed.finish(crowd, np.full((40, 2), 400.0)))
    assert printed.startswith("RoundPlan(value=")
    assert "path_m=0.0; 80 of 300 devices served in 40 steps" in printed
    assert len(printed) < 120


def test_channels() -> None:
    per = aerofed.channel("suburban").per([0.0, 100.0], 60.0)
    assert per == pytest.approx(average_per(CHANNEL_PRESETS["suburban"], [0.0, 100.0]))
    low = aerofed.channel("suburban", altitude_m=30.0)
    assert low.per(100.0) == aerofed.channel("suburban").per(100.0, 30.0)
    assert aerofed.channel("suburban", extra_gain_db=3.0).per(100.0) < per[1]


@pytest.mark.parametrize("distance_m", [[3.0, -5.0], [float("nan")], -5.0])
def test_no_distance_has_no_error_rate(distance_m: list[float] | float) -> None:
    with pytest.raises(ValueError, match=r"distance_m holds (-5\.0|nan): must be 0 or more"):
        aerofed.channel("suburban").per(distance_m)


def test_configurations(tmp_path: Path) -> None:
    base = aerofed.config("quickstart")
    assert aerofed.config(base, {"mission.rounds": 3}).mission.rounds == 3
    assert base.mission.rounds == 6
    (tmp_path / "own.toml").write_text(base.to_toml())
    assert (
        aerofed.config(tmp_path / "own.toml") == base == aerofed.config(str(tmp_path / "own.toml"))
    )


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: aerofed.config("quikstart"), "quikstart: no such .* did you mean quickstart"),
        (lambda: aerofed.config("none.toml"), "none.toml: cannot be read"),
        (
            lambda: aerofed.config("quickstart", {"mission.round": 3}),
            "^overrides: mission.round: unknown key; did you mean rounds",
        ),
        (
            lambda: aerofed.config(aerofed.config(), {"mission.rounds": 0}),
            "^overrides: mission.rounds = 0: must be greater than or equal to 1",
        ),
        (lambda: aerofed.run(data_dir="nowhere"), "data_dir = 'nowhere': no such folder"),
        (lambda: aerofed.channel("rural"), "channel: preset = 'rural': no such channel"),
        (lambda: aerofed.channel(gain=3.0), "channel: gain: unknown key"),
        (lambda: aerofed.channel(altitude_m=0.0), "channel: altitude_m = 0.0: must be above 0"),
        (lambda: aerofed.load("nowhere"), "nowhere: no such run folder"),
        (lambda: aerofed.load_sweep("nowhere"), "nowhere"),
        (lambda: aerofed.resume("nowhere"), "^nowhere: no such folder"),
        (lambda: aerofed.first_problem("paper"), "give their folder .* in Python data_dir"),
        (lambda: aerofed.run("paper"), "needs files: give their folder .* in Python data_dir"),
        (lambda: aerofed.sweep("paper"), "needs files: give their folder .* in Python data_dir"),
        (lambda: aerofed.run(out="/proc/a"), r"/proc/a: cannot write .* name another folder$"),
        (lambda: aerofed.Sweep(Path("some")).run("nope"), "^some: no run 'nope'; there are: none"),
        (lambda: aerofed.run(overrides={"limits.cros": 1.0}), "^limits: cros: the comparison has"),
        (
            lambda: aerofed.run("paper", {"limits.failsafes": 0}, strategy="ideal"),
            "^limits: mission.strategy = 'ideal' flies nothing that they could judge$",
        ),
        (aerofed.compare, "give at least one run"),
        (lambda: aerofed.compare("x", rounds=0), "rounds = 0: must be at least 1"),
        (
            lambda: aerofed.plan(aerofed.first_problem(), "best"),
            "planner: kind = 'best': must be 'certified'",
        ),
        (lambda: aerofed.sweep(strategies=["cov", "cov"]), "'cov' is named twice"),
        (lambda: aerofed.sweep(jobs=0), "^jobs = 0: at least 1"),
        (lambda: aerofed.sweep(address="x:1"), "^address = x:1: belongs to engine = ray"),
        (lambda: UNTYPED.sweep(engine="spark"), "^engine = spark: must be joblib or ray"),
        (lambda: UNTYPED.sweep(seeds=1.5), "seeds = 1.5: must be a whole number"),
        (lambda: aerofed.sweep(strategies="cov"), "strategies = 'cov': must be a list"),
        (lambda: aerofed.sweep(strategies=[]), "strategies: at least one"),
        (lambda: aerofed.sweep(strategies=["c"]), "^sweep: mission.strategy = 'c'"),
        (lambda: UNTYPED.sweep(settings={"seed": 3}), "seed = 3: must be a list of values"),
        (lambda: UNTYPED.run(5), "^source = 5: must be a configuration's name, its file, or"),
        (lambda: UNTYPED.run("quickstart", 3), r"^overrides = 3: must be a dictionary"),
        (lambda: UNTYPED.run(out=5), "^out = 5: must be a path"),
        (lambda: UNTYPED.run(data_dir=5), "^data_dir = 5: must be a path"),
        (lambda: UNTYPED.sweep(out=5), "^out = 5: must be a path"),
        (lambda: UNTYPED.load(5), "^path = 5: must be a path"),
        (lambda: UNTYPED.compare(5), "^path = 5: must be a path"),
        (lambda: UNTYPED.load_sweep(5), "^path = 5: must be a path"),
        (lambda: UNTYPED.resume(5), "^path = 5: must be a path"),
        (lambda: UNTYPED.channel(5), "^channel: preset = 5: must be"),
        (lambda: UNTYPED.plan(3), r"^problem = 3: must be a RoundProblem"),
        (lambda: UNTYPED.plan(problem(), 3), r"^planner = 3: must be a planner's name, or an"),
        (lambda: UNTYPED.plan(problem(), Gives(3)), r"^planner: plan\(problem\) gave 3: must be"),
        (lambda: aerofed.plan(problem(channel="urban")), "^channel = 'urban': must be a Channel"),
        (lambda: aerofed.plan(problem(steps="8")), "^steps = '8': must be a whole number"),
        (lambda: aerofed.plan(problem(per_step=1.5)), "^per_step = 1.5: must be a whole number"),
        (lambda: aerofed.plan(problem(path_budget_m="9")), "^path_budget_m = '9': must be"),
        (lambda: aerofed.plan(problem(altitudes_m=60)), "^altitudes_m = 60: must be two heights"),
        (lambda: aerofed.plan(problem(altitudes_m=(60,))), "^altitudes_m = .* two heights"),
        (lambda: aerofed.plan(problem(start_m=4)), r"^start has shape \(\): must be"),
        (lambda: aerofed.plan(problem(upload_s=4)), r"^upload_s has shape \(\): must be"),
        (lambda: problem(start_m="home"), "^start_m = 'home': must be an array of numbers"),
        (lambda: problem(importance=None), "^importance = null: must be an array of numbers"),
        (lambda: problem(importance=["1"]), r"^importance = \['1'\]: must be an array of numbers"),
        (lambda: aerofed.plan(problem(upload_s=[1, 1, -1])), r"^upload_s\[2\] = -1.0: must be 0"),
        (lambda: UNTYPED.RoundPlan(PATH, [[[0.5]]], 1.0), "^schedule = .*: must be an array"),
        (lambda: problem(devices_m=[(1, 2), (3,)]), r"^devices_m = \[.*: must be an array of"),
        (lambda: UNTYPED.PlannedPath([0, 0]), r"^waypoints_m has .* \(2,\): .* \(N, 2\)"),
        (lambda: UNTYPED.RoundPlan(PATH, [[1]], 1.0), r"^schedule has .* \(1, 1\): .* \(1, 1, K\)"),
        (lambda: aerofed.fit_budget([(1, 2, 3)], 9.0), r"^waypoints_m has shape \(1, 3\): must be"),
        (lambda: aerofed.finish(problem(), [(0, 0)]), r"^waypoints_m has .*: must be \(\d, 2\)"),
        (lambda: aerofed.fit_budget([(0, 0), (9, 0)], -5), "^path_budget_m = -5: must be a number"),
        (lambda: aerofed.fit_budget([(0, 0), (9, 0)], math.nan), "^path_budget_m = nan: must be"),
        (lambda: UNTYPED.fit_budget([(0, 0)], "9"), "^path_budget_m = '9': must be a number"),
        (lambda: aerofed.fit_budget([(0, math.nan)], 5), r"^waypoints_m\[0\]\[1\] = nan: must be"),
        (lambda: aerofed.finish(problem(), [HERE, (math.inf, 0), HERE]), r"m\[1\]\[0\] = inf: mu"),
        (lambda: aerofed.finish(problem(), [(0, 0), HERE, HERE]), "lies 565.7 m from the problem"),
        (lambda: aerofed.finish(problem(), [HERE, (4000, 400), HERE]), "the path is 7200 m long"),
        (lambda: UNTYPED.RoundPlan(PATH, [[[1]]], "x"), "^value = 'x': must be a number"),
        (lambda: UNTYPED.RoundPlan(PATH, [[[1]]], 1, None), "^upper_bound = null: must be a"),
        (lambda: UNTYPED.PlannedPath([(0, 0)], altitude_m="x"), "^altitude_m = 'x': must be a"),
        # As they were written when a round had one aircraft.
        (lambda: UNTYPED.RoundPlan([(0, 0)], [[1]], 1.0), r"^paths = .*tuple of PlannedPath, one"),
        (lambda: UNTYPED.RoundPlan(waypoints_m=[(0, 0)], schedule=[[1]], value=1.0),
         r"^waypoints_m: each aircraft has its own: paths=\(PlannedPath\(waypoints_m, "),
        (lambda: replace(problem(), path_budget_m=9.0), r"problem.with_own\(path_budget_m=...\)"),
        (lambda: UNTYPED.RoundProblem([], [], (0, 0), 1, 1, 9.0, 0), r"^starts = .* of Start, one"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_an_input_error(wrong: object, words: str) -> None:
    assert callable(wrong)
    with pytest.raises(aerofed.InputError, match=words):
        wrong()


@pytest.mark.parametrize("fly", [aerofed.run, aerofed.sweep])
def test_a_folder_in_use_names_the_argument(tmp_path: Path, fly: Callable[..., object]) -> None:
    lock = tmp_path / ".lock" if fly is aerofed.sweep else RunFolder(tmp_path).checkpoint / ".lock"
    lock.parent.mkdir(exist_ok=True)
    with lock.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(aerofed.InputError, match=r"or name another$"):
            fly(out=tmp_path)


def test_a_file_where_runs_belong_names_the_argument(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("runs").touch()
    with pytest.raises(aerofed.InputError, match=r"^runs: .* name another folder$"):
        aerofed.run()


def test_a_problem_that_makes_no_sense() -> None:
    channel = aerofed.channel()
    problem = round_problem(
        np.zeros((2, 2)), np.ones(3), np.zeros(2), steps=2, per_step=1, path_budget_m=1.0,
        channel=channel,
    )  # fmt: skip
    with pytest.raises(PlanInputError, match="importance has shape"):
        aerofed.plan(problem)
    assert issubclass(PlanInputError, PlanError | aerofed.AerofedError)


def in_a_notebook(cell: object) -> object:
    """Ctrl-C comes out of the cell, not as asyncio's cancellation of all."""
    loop = asyncio.new_event_loop()
    try:
        return loop.run_until_complete(cell)  # type: ignore[arg-type]
    finally:
        loop.close()


def test_a_failed_callback_that_was_passed_says_where_the_run_goes_on(tmp_path: Path) -> None:
    def full(_: object) -> None:
        raise OSError("no space left")

    def callback(_: object) -> SimpleNamespace:
        return SimpleNamespace(round_finished=full, close=lambda: None)

    words = r"aerofed\.resume\('.*'\) goes on in this process alone, with 'python:callback"
    with pytest.raises(aerofed.AerofedError, match=words) as error:
        aerofed.run("quickstart", {**SMALL, "callbacks": [callback]}, out=tmp_path / "cut")
    assert "no space left" in str(error.value)
    assert "aerofed run --resume" not in str(error.value)


@pytest.mark.slow
@pytest.mark.parametrize("wait", [in_a_notebook, asyncio.run])
def test_an_interrupted_notebook_keeps_what_was_flown_and_goes_on(
    run: aerofed.Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    wait: Callable[[Any], object],
) -> None:
    from mission.run.callbacks import RoundReport
    from mission.run.recorder import FolderRecorder

    finished = FolderRecorder.finished

    def press(self: FolderRecorder, report: RoundReport, *learnt: Any) -> None:
        finished(self, report, *learnt)
        if report.round.round == 1:
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)

    async def cell() -> aerofed.Run:
        return aerofed.run("quickstart", SMALL, out=tmp_path / "cut")

    async def again() -> aerofed.Run:
        return aerofed.resume(tmp_path / "cut")

    with monkeypatch.context() as patch:
        patch.setattr(FolderRecorder, "finished", press)
        with pytest.raises(KeyboardInterrupt, match="resume"):
            wait(cell())
    assert aerofed.load(tmp_path / "cut").status == "interrupted"
    with pytest.raises(aerofed.InputError, match=r"or go on with it: aerofed run --resume .*cut$"):
        aerofed.run("quickstart", SMALL, out=tmp_path / "cut")
    wait(again())
    for name in TABLES:
        assert (tmp_path / "cut" / name).read_bytes() == (run.path / name).read_bytes()


def test_an_interruption_before_the_flight_begins_ends_it_as_it_begins() -> None:
    begun = threading.Event()

    async def flight() -> None:
        await asyncio.sleep(3600.0)

    def work() -> None:
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        begun.set()
        run_flight(flight())

    with pytest.raises(KeyboardInterrupt):
        in_a_thread(work)
    assert begun.is_set()


def test_a_run_is_judged_by_its_limits_also_when_it_is_gone_on_with(tmp_path: Path) -> None:
    out, verdict = tmp_path / "out", tmp_path / "verdict.xml"
    hovering = aerofed.config("quickstart", {"mission.strategy": "barycenter"})
    keys = {**SMALL, "limits.height_max_m": 1e-4, "mission.replan": "stop"}
    with pytest.raises(aerofed.LimitsNotMetError, match="height_max_m"):
        aerofed.run(hovering, keys, strategy="cov", out=out)  # only then it may be replanned
    with pytest.raises(aerofed.LimitsNotMetError, match="height_max_m"):
        aerofed.resume(out)
    given = ["--limit", "height_max_m=9", "--limit", "cross_track_max_m=1e-4", "--junit"]
    assert call(["run", "--resume", str(out), "--quiet", *given, str(verdict)]) == LIMITS_NOT_MET
    assert 'failures="1"' in verdict.read_text()
    for text, words in (("a = [", "not valid TOML"), ("limits = [1]", "limits is no table")):
        (out / "config.toml").write_text(text)
        with pytest.raises(aerofed.InputError, match=f"config.toml: {words}"):
            aerofed.resume(out)


@pytest.mark.slow
def test_sweeps(tmp_path: Path) -> None:
    async def cell() -> aerofed.Sweep:
        return aerofed.sweep(
            "quickstart", strategies=["cov", "ideal"], seeds=1,
            overrides={**SMALL, "mission.flight": "none"},
            settings={"area.home_m": [(200, 300), np.array([200.5, 300.0])]},
            out=tmp_path / "s", jobs=1,
        )  # fmt: skip

    swept = asyncio.run(cell())
    assert len(swept.runs) == 4
    assert set(swept.runs["area.home_m"]) == {"[200, 300]", "[200.5, 300.0]"}
    assert len(swept.rounds) == 8
    written = pd.read_csv(tmp_path / "s" / "runs.csv")
    pd.testing.assert_frame_equal(swept.runs, written, check_dtype=False)
    one = swept.run(swept.runs["run"][0])
    assert len(one.rounds) == 2
    assert swept.figure("final")._repr_png_().startswith(b"\x89PNG")
    assert len(aerofed.load_sweep(tmp_path / "s").runs) == 4
    with pytest.raises(aerofed.AerofedError, match="no run 'cov'; there are: cov-"):
        aerofed.load_sweep(tmp_path / "s").run("cov")
    assert aerofed.load_sweep(tmp_path / "s").report() == tmp_path / "s" / "report.html"
    assert (tmp_path / "s" / "report.html").is_file()


def test_overrides_may_be_arrays_and_their_scalars() -> None:
    overrides = {
        "communities.0.positions_m": np.array([[10.0, 20.0], [30.0, 40.0]], np.float32),
        "area.home_m": (np.float32(1.0), np.float64(3.0)),
        "mission.rounds": np.int64(2),
        "communities.0.devices": 2,
        "communities.0.coverage": False,
    }
    config = aerofed.config("quickstart", overrides)
    assert config.communities[0].positions_m == ((10.0, 20.0), (30.0, 40.0))
    assert (config.area.home_m, config.mission.rounds) == ((1.0, 3.0), 2)
