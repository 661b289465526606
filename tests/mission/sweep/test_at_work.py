"""Runs handed to an engine, and what is shown of a sweep at work; no run is flown."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console
from test_sweep_results import result

from mission.base.errors import InputError
from mission.config.loading import builtin_config
from mission.sweep.execute.engine import EngineChoice, execute_all
from mission.sweep.execute.worker import RunEnd
from mission.sweep.folder import Missing, SweepFolder, SweepState
from mission.sweep.grid import make_grid
from mission.sweep.sweep import Bar, duration


def test_the_bar_counts_rounds_and_names_the_runs_at_work(tmp_path: Path) -> None:
    grid = make_grid(
        builtin_config("quickstart.toml"),
        strategies=("cov", "ideal"),
        seeds=1,
        common={"mission.rounds": 10},
    )
    folder, (cov, ideal) = SweepFolder(tmp_path), grid.runs
    screen = Console(width=120, force_terminal=True)
    with screen.capture() as capture:
        bar = Bar(screen, folder, grid.runs)
        for run, rounds in ((cov, 4), (ideal, 12)):
            table = folder.run(run).rounds
            table.parent.mkdir(parents=True)
            table.write_text("header\n" + rounds * "row\n")
        bar.update(done=0, running=[cov, ideal])
        bar.update(done=1, running=[cov])  # the ideal is over
        bar.close()
    shown = capture.get()
    assert "14/20" in shown
    assert "1/2 runs  cov-seed1 4/10" in shown


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        *((0.4, "0 s"), (89.0, "89 s"), (89.9, "90 s"), (90.0, "2 min"), (100.0, "2 min")),
        *((149.0, "2 min"), (600.0, "10 min"), (5369.0, "89 min"), (5371.0, "1 h 30 min")),
        *((7200.0, "2 h 0 min"), (7169.0, "1 h 59 min"), (12_000, "3 h 20 min")),
    ],
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


class Scripted:
    """An engine that ends the runs at work as a script has it: by name, an end each time."""

    def __init__(self, slots: int, **script: list[RunEnd | None]) -> None:
        self.slots, self._script = slots, script
        self.started: list[str] = []
        self._at_work: list[str] = []

    def start(self, order: Any) -> None:
        self.started.append(order)
        self._at_work.append(order)
        assert len(self._at_work) <= self.slots

    def wait(self, timeout_s: float) -> dict[str, RunEnd | None]:
        assert timeout_s == 0.5
        name = self._at_work.pop(0)
        return {name: self._script[name].pop(0)}

    def close(self) -> None:
        raise AssertionError("the engine stays open")


def test_a_run_whose_worker_dies_is_handed_out_three_times() -> None:
    runs: Any = [SimpleNamespace(name=name) for name in "abc"]
    fine, bad = RunEnd(0), RunEnd(3, "no")
    engine = Scripted(2, a=[None, None, None], b=[fine], c=[None, bad])
    told = [
        (None if run is None else run.name, end, "".join(each.name for each in running))
        for run, end, running in execute_all(runs, engine, order=lambda run: run.name)  # type: ignore[arg-type, return-value]  # names stand for orders
    ]
    assert engine.started == ["a", "b", "c", "a", "c", "a"]
    given_up = RunEnd(1, "its worker died 3 times (out of memory?)")
    assert [each for each in told if each[0]] == [
        *(("a", None, "b"), ("b", fine, "c"), ("c", None, "a")),
        *(("a", None, "c"), ("c", bad, "a"), ("a", given_up, "")),
    ]
    assert [each[2] for each in told if each[0] is None] == ["b", "c", "a", "c", "a", ""]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"name": "dask"}, "engine = dask: must be joblib or ray"),
        ({"jobs": 0}, "jobs = 0: at least 1"),
        ({"address": "h:1"}, "address = h:1: belongs to engine = ray"),
        ({"name": "ray", "address": "ray://h:1"}, "address = ray://h:1: must be HOST:PORT"),
    ],
)
def test_engines_that_are_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        EngineChoice(**given)
    assert EngineChoice(jobs=1).name == "joblib"
    assert EngineChoice("ray", address="h:1").jobs is None


def test_progress_counts_runs_and_names_six() -> None:
    def state(done: int, missing: int) -> SweepState:
        runs = tuple(result(seed, [], []) for seed in range(done))
        gone = tuple(Missing(f"m{k}", "cov", "failed") for k in range(missing))
        return SweepState({}, runs, gone)

    assert state(4, 0).progress == "All 4 runs are done."
    assert state(1, 2).progress == "1 of 3 runs are done; missing: m0, m1."
    assert state(0, 6).progress == "0 of 6 runs are done; missing: m0, m1, m2, m3, m4, m5."
    assert state(2, 8).progress == (
        "2 of 10 runs are done; missing: m0, m1, m2, m3, m4, m5 and 2 more."
    )
    assert (state(2, 8).planned, state(2, 0).planned) == (10, 2)
    assert (state(2, 8).seeds("cov"), state(2, 0).seeds("cov")) == ("2 of 10", "2")
    assert (state(2, 8).seeds("ideal"), state(0, 1).seeds("cov")) == ("0", "0 of 1")


def test_the_bar_shows_four_runs_of_more(tmp_path: Path) -> None:
    grid = make_grid(
        builtin_config("quickstart.toml"), strategies=("cov",), seeds=6,
        common={"mission.rounds": 10},
    )  # fmt: skip
    for running, end in ((5, "cov-seed4 0/10 ..."), (4, "cov-seed4 0/10")):
        screen = Console(width=200, force_terminal=True)
        with screen.capture() as capture:
            bar = Bar(screen, SweepFolder(tmp_path), grid.runs)
            bar.update(done=0, running=grid.runs[:running])
            bar.close()
        shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capture.get())
        (line,) = {line for line in re.split(r"[\r\n]+", shown) if "0/6 runs" in line}
        assert "0/60" in line
        assert line.removesuffix(" --:--").rstrip().endswith(end)
