"""How a flight ended, whatever comes after it, and what every flight has around it."""

import io
import itertools
import json
import traceback
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from mission.base.console import RunConsole, Stopwatch
from mission.base.errors import (
    AerofedError,
    FlightError,
    InputError,
    PlanError,
    SolverError,
    TrainingError,
    UsersCodeError,
)
from mission.base.record_file import RecordFile
from mission.base.run_folder import RunFolder
from mission.run.budget import RunTotals
from mission.run.recorded import Around, Outcome, Summary, fly_recorded


def test_what_goes_wrong_first_counts() -> None:
    outcome = Outcome()
    with outcome.flight():
        raise FlightError("lost")
    with outcome.aside("figures"):
        raise InputError("no log to draw")
    assert outcome.summary == {"status": "failed", "error": "lost"}
    with pytest.raises(AerofedError, match=r"^lost; the files are in out$") as caught:
        outcome.raise_error(Path("out"))
    assert caught.value.exit_code == FlightError.exit_code


@pytest.mark.parametrize(
    ("end", "status"), [(None, "finished"), (KeyboardInterrupt, "interrupted")]
)
def test_a_figure_that_fails_is_a_failure(end: type[BaseException] | None, status: str) -> None:
    outcome = Outcome()
    with outcome.flight():
        if end is not None:
            raise end
    assert outcome.summary == {"status": status}
    outcome.raise_error(Path("out"))
    with outcome.aside("figures"):
        raise InputError("no room")
    assert outcome.summary == {"status": "failed", "error": "no room"}


def test_a_bug_is_raised_and_a_failure() -> None:
    outcome = Outcome()
    with pytest.raises(ZeroDivisionError), outcome.flight():
        raise ZeroDivisionError
    assert outcome.summary == {"status": "failed"}


@pytest.mark.parametrize(
    ("end", "status"), [(None, "interrupted"), (FlightError("lost"), "failed")]
)
@pytest.mark.slow
def test_ctrl_c_while_figures_are_drawn_is_an_interruption(
    end: FlightError | None, status: str
) -> None:
    outcome = Outcome()
    with outcome.flight():
        if end is not None:
            raise end
    with outcome.aside("figures"):
        raise KeyboardInterrupt
    assert outcome.status == status


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (InputError("no room"), "no room; the files are in out; resume"),
        (FlightError("lost"), "lost; the files are in out"),
        (TrainingError("diverged"), "diverged; the files are in out"),
        (PlanError("no plan"), "no plan; the files are in out"),
    ],
)
def test_an_error_that_can_be_mended_says_how_to_go_on(error: AerofedError, said: str) -> None:
    with pytest.raises(type(error)) as caught:
        Outcome(error=error).raise_error(Path("out"), goes_on="; resume")
    assert str(caught.value) == said


def test_an_error_in_other_words_stays_what_it_is(tmp_path: Path) -> None:
    outcome = Outcome()
    with outcome.flight():
        raise SolverError("OSQP", "max_iter")
    with pytest.raises(SolverError, match=f"OSQP.*no usable solution; .* in {tmp_path}") as raised:
        outcome.raise_error(tmp_path)
    assert (raised.value.exit_code, raised.value.status) == (3, "max_iter")


def test_what_is_raised_keeps_its_cause_and_where_it_came_from(tmp_path: Path) -> None:
    slip, outcome = KeyError("weights"), Outcome()
    with outcome.flight():
        raise UsersCodeError("theirs") from slip
    with pytest.raises(
        UsersCodeError, match=r"^theirs; the files are in .*; the whole traceback"
    ) as theirs:
        outcome.raise_error(tmp_path)
    assert theirs.value.__cause__ is slip
    assert outcome.error is not None
    ours = Outcome(error=FlightError("lost"))
    with pytest.raises(FlightError) as lost:
        ours.raise_error(tmp_path)
    assert lost.value.__cause__ is None
    assert lost.value.__context__ is None
    frames = [frame.name for frame in traceback.extract_tb(theirs.value.__traceback__)]
    assert frames.index("raise_error") < frames.index("flight")  # down to where it was raised


def test_a_bug_in_the_figures_is_a_failure_too() -> None:
    outcome = Outcome()
    with outcome.flight():
        pass
    with pytest.raises(KeyError), outcome.aside("figures"):
        raise KeyError("column")
    assert outcome.summary == {"status": "failed"}


class Flight:
    """Flies nothing; it shows how long that took."""

    def __init__(self, stopwatch: Stopwatch) -> None:
        self.totals = RunTotals()
        self.files: tuple[RecordFile, ...] = ()
        self.stopwatch = stopwatch

    async def run(self) -> None:
        pass

    def conclude(self, summary: Summary) -> None:
        pass

    def show(self, console: RunConsole) -> None:
        console.say(f"{self.stopwatch.total_s} {json.dumps(self.stopwatch.wall_s)}")


def test_terminal_page_and_summary_tell_the_same_wall_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = SimpleNamespace(perf_counter=itertools.count(1000).__next__)  # each a second later
    monkeypatch.setattr("mission.base.console.time", looks)
    stopwatch, folder, screen = Stopwatch(), RunFolder(tmp_path), io.StringIO()
    seen: list[object] = []

    def page(path: Path) -> str:
        looks.perf_counter()
        seen.append(RunFolder(path).read_summary()["wall_s"])
        return "report.html"

    code = fly_recorded(
        nullcontext(Flight(stopwatch)),
        Summary(folder),
        Around(RunConsole(Console(file=screen, width=200)), stopwatch, figures=False, page=page),
    )
    assert code == 0
    total_s, wall_s = screen.getvalue().splitlines()[0].split(" ", 1)
    assert int(total_s) < 100
    told = {**json.loads(wall_s), "total": int(total_s)}
    assert seen == [told]
    assert folder.read_summary()["wall_s"] == told


def test_a_summary_that_cannot_be_written_says_how_the_run_goes_on(tmp_path: Path) -> None:
    nowhere = RunFolder(tmp_path / "gone")
    with pytest.raises(InputError, match=r"summary\.json: cannot write: .*; it goes on$"):
        Summary(nowhere, goes_on="; it goes on").started()
