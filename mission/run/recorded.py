"""The frame of every flight into a folder: how it ended, summary, figures, report page."""

import math
import os
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Protocol

from mission.base.console import RunConsole, Stopwatch
from mission.base.errors import (
    INTERRUPTED,
    AerofedError,
    CallbackError,
    FlightError,
    InputError,
    LinkLostError,
    PlanError,
    TrainingError,
    UsersCodeError,
)
from mission.base.interrupts import ending_flights, run_flight
from mission.base.record_file import RecordFile
from mission.base.run_folder import RunFolder, environment, write_atomically
from mission.run.budget import RunTotals
from native.errors import first_line, printable

TRACEBACK = "traceback.txt"  # in the folder of a run that a researcher's own code ended


@dataclass
class Outcome:
    """Status and error of a flight, and of what is made of it afterwards."""

    # Until something else is known, so that a bug is a failure too.
    status: Literal["finished", "interrupted", "failed"] = "failed"
    error: AerofedError | None = None

    @contextmanager
    def flight(self) -> Iterator[None]:
        """Context manager for the flight: keeps its end, that is success, error or Ctrl-C."""
        with self.aside():
            yield
            self.status = "finished"

    @contextmanager
    def aside(self, what: str = "") -> Iterator[None]:
        """Context manager for what surrounds a flight (`what`): keeps a first error or Ctrl-C."""
        try:
            yield
        except KeyboardInterrupt:
            if self.error is None:
                self.status = "interrupted"
        except AerofedError as failure:
            self._failed(failure)
        except MemoryError:
            self._failed(AerofedError(f"{what and f'{what}: '}out of memory"))
        except Exception as failure:
            # What a library says that finds no memory for what it loads; else a bug.
            if not (what and isinstance(failure, ImportError | OSError)):
                self.status = "failed"
                raise
            self._failed(AerofedError(f"{what}: {first_line(failure)}"))

    def _failed(self, failure: AerofedError) -> None:
        if self.error is None:  # otherwise of what went wrong before
            self.status, self.error = "failed", failure

    @property
    def summary(self) -> dict[str, str]:
        """Status and error as `summary.json` has them."""
        why = {} if self.error is None else {"error": printable(self.error)}
        return {"status": self.status, **why}

    def raise_error(self, folder: Path, *, goes_on: str = "") -> None:
        """Raise the kept error, if any, with words on what is left in `folder` and how to go on.

        `goes_on`: how the run can be resumed, told where that can help once the cause is fixed.
        """
        if self.error is None:
            return
        left = f"; the files are in {folder}"
        cause = self.error.__cause__
        if isinstance(self.error, UsersCodeError) and cause is not None:
            path = folder / TRACEBACK
            lines = "".join(traceback.format_exception(cause))
            write_atomically(path, lines.encode("utf-8", "backslashreplace"))
            left += f"; the whole traceback is in {path}"
        # A full disk, or a callback, can be mended; the same plan, flight, training or code fails
        # again, and with other code the run would be another.
        again = PlanError | FlightError | TrainingError | UsersCodeError
        mended = isinstance(self.error, CallbackError | LinkLostError)
        if mended or not isinstance(self.error, again):
            left += goes_on
        raise self.error.in_words(f"{printable(self.error, most=20_000)}{left}") from cause


class Summary:
    """`summary.json`: what a run is, how it ended, what it added up to.

    It is written whole each time; "finished" last of all, so that such a folder has everything.
    """

    def __init__(self, folder: RunFolder, *, goes_on: str = "", **about: object) -> None:
        """Summary of a run; `about` holds its name, seed and the like, and `goes_on` says how one
        that is cut off can go on."""
        self.folder = folder
        self.goes_on = goes_on
        self._about = {**about, **environment()}

    def add(self, **about: object) -> None:
        """Add facts to the summary, written with the next status."""
        self._about |= about

    def started(self) -> None:
        """Write the summary with status "running"."""
        self._write({"status": "running", **self._about})

    def ended(self, outcome: Outcome, totals: RunTotals, stopwatch: Stopwatch) -> None:
        """Write the summary with status, error and totals."""
        if outcome.status == "finished":
            self.add(sha256=self.folder.digests())
        self._write({**outcome.summary, **self._about, **_totals(totals, stopwatch)})

    def _write(self, values: dict[str, object]) -> None:
        try:
            self.folder.write_summary(values)
        except InputError as error:
            raise error.in_words(f"{error}{self.goes_on}") from error.__cause__


def _totals(totals: RunTotals, stopwatch: Stopwatch) -> dict[str, object]:
    flight_s = stopwatch.wall_s.get("fly", 0.0)
    return {
        "rounds": totals.rounds_done,
        "flown_in_rounds_m": totals.flown_m,
        "budget_used_m": totals.used.metres,
        "time_used_s": totals.used.seconds,
        "energy_used_j": None if math.isnan(totals.used.joules) else totals.used.joules,
        "simulated_s": totals.sim_s,
        "real_time_factor": totals.sim_s / flight_s if flight_s > 0.0 else 0.0,
        "battery_changes": totals.battery_changes,
        "delivered": totals.delivered,
        "scheduled": totals.scheduled,
        "accuracy": totals.accuracy,
        "untrained_accuracy": totals.untrained,
        "wall_s": {**stopwatch.wall_s, "total": stopwatch.total_s},
    }


_DRAWING = "drawing figures"


class Recorded(Protocol):
    """What is flown: the rounds of a run, or a plan file."""

    totals: RunTotals

    @property
    def files(self) -> Sequence[RecordFile]:
        """What it writes as it goes on."""

    async def run(self) -> None:
        """Fly everything, from start to end.

        Raises:
            AerofedError: what ends it before that.
        """

    def conclude(self, summary: Summary) -> None:
        """Add results to the folder and the summary, once the log is finished."""

    def show(self, console: RunConsole) -> None:
        """Print what was flown."""


@dataclass(frozen=True)
class Around:
    """Settings around a flight that alter none of its results: console, workers, figures, page."""

    console: RunConsole
    stopwatch: Stopwatch = field(default_factory=Stopwatch)  # may have counted the set-up already
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)  # devices that train at once
    figures: bool = True  # whether its pictures are drawn
    page: Callable[[Path], str] | None = None  # makes a page of the folder, last of all


def fly_recorded(
    opening: AbstractContextManager[Recorded], summary: Summary, around: Around
) -> int:
    """Fly what `opening` opens, with its log, and leave a summary however it ends.

    Returns the exit code.

    Raises:
        AerofedError: see the error's exit code; the summary says "failed" then.
    """
    console, stopwatch, page = around.console, around.stopwatch, around.page
    folder, outcome, goes_on = summary.folder, Outcome(), summary.goes_on
    flight: Recorded | None = None
    totals, made = RunTotals(), ""
    summary.started()
    if page is not None:
        with stopwatch("setup"):
            from mission.figures.render import begin_libraries  # with it Altair

            begin_libraries()  # of the page, while the flight is flown
    # An interrupted flight is written down, whatever else is pressed.
    with ending_flights():
        try:
            with outcome.aside("log"), opening as flight:
                totals = flight.totals
                with outcome.flight():
                    run_flight(flight.run())
        finally:
            if outcome.status != "finished":
                summary.ended(outcome, totals, stopwatch)
    if outcome.status == "finished":
        folder.discard_kept()
        (folder.path / TRACEBACK).unlink(missing_ok=True)  # of an attempt before
    try:
        if flight is not None:
            if outcome.status == "interrupted" and around.figures and totals.rounds_done:
                console.say("interrupted: drawing figures; Ctrl-C again leaves them out")
            with outcome.aside("figures"), stopwatch("figures"), console.waiting(_DRAWING):
                # Interrupted before its first round was over it has nothing to show.
                if around.figures and (outcome.status != "interrupted" or totals.rounds_done):
                    from mission.figures.run import draw_run

                    draw_run(folder.path)
                flight.conclude(summary)
                for file in flight.files:  # long after the last word, while figures were drawn
                    file.check()
    finally:
        # Last of all: a folder that says "finished" has everything. Its page shows the times in it.
        stopwatch.stop()
        summary.ended(outcome, totals, stopwatch)
    if page is not None and outcome.status == "finished":
        # It says that the flight is finished, and so comes after the summary that does: that stays
        # true where the page alone fails.
        with outcome.aside("figures"), console.waiting("writing the report"):
            goes_on = f"; aerofed report {folder.path} makes the page"  # all is flown
            try:
                made = page(folder.path)
            except InputError as error:
                again = f"{error}{goes_on} once that is mended"
                goes_on = ""
                raise error.in_words(again) from error.__cause__
    outcome.raise_error(folder.path, goes_on=goes_on)
    if flight is not None:
        flight.show(console)
    look = f": open {made} in a browser" if made else ""
    console.say(f"results in {folder.path}{look}")
    if outcome.status == "interrupted":
        console.say(f"interrupted{goes_on}")
        return INTERRUPTED
    return 0
