"""What every flight into a folder has around it: how it ended, its summary, its pictures."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeAlias

from mission.base.console import RunConsole
from mission.base.errors import INTERRUPTED, InputError
from mission.base.interrupted_files import InterruptedFiles
from mission.base.interrupts import one_interruption, run_flight
from mission.base.stopwatch import Stopwatch
from mission.run.budget import RunTotals
from mission.run.outcome import TRACEBACK, Outcome
from mission.run.summary import Summary

Page: TypeAlias = Callable[[Path], object]  # makes a page of a flight's folder, in it


class Recorded(Protocol):
    """What is flown: the rounds of a run, or a plan file."""

    totals: RunTotals

    async def run(self) -> None:
        """Fly it.

        Raises:
            AerofedError: what ends it before that.
        """

    def conclude(self, summary: Summary) -> None:
        """Tabulate what was flown, from the finished log."""

    def show(self, console: RunConsole) -> None:
        """What it came to, for people."""


def fly_recorded(
    opening: AbstractContextManager[Recorded],
    summary: Summary,
    *,
    console: RunConsole,
    stopwatch: Stopwatch,
    figures: bool = True,
    page: Page | None = None,
    goes_on: str = "",
) -> int:
    """Fly what `opening` opens, with its log, and leave a summary however it ends.

    Returns the exit code. Without `figures` nothing is drawn. `page` makes a page of the folder,
    last of all. `goes_on` says how a flight that was cut off can go on.

    Raises:
        AerofedError: see the error's exit code; the summary says "failed" then.
    """
    attempt = _Attempt(summary, console, stopwatch, goes_on)
    attempt.fly(opening)
    attempt.draw_and_tabulate(figures=figures, page_follows=page is not None)
    if page is not None and attempt.finished:
        attempt.make(page)
    attempt.raise_error()
    return attempt.show(page_made=page is not None and attempt.finished)


@dataclass
class _Attempt:
    """A flight into a folder, from its first word in the summary to its last one for people."""

    summary: Summary
    console: RunConsole
    stopwatch: Stopwatch
    goes_on: str
    outcome: Outcome = field(default_factory=Outcome)
    flight: Recorded | None = None  # None: it was not opened

    @property
    def folder(self) -> Path:
        return self.summary.folder.path

    @property
    def finished(self) -> bool:
        return self.outcome.status == "finished"

    @property
    def totals(self) -> RunTotals:
        return RunTotals.before(0) if self.flight is None else self.flight.totals

    def fly(self, opening: AbstractContextManager[Recorded]) -> None:
        self.summary.started()
        # An interrupted flight is written down before another interruption is heard.
        with one_interruption():
            try:
                with self.outcome.aside("log"), opening as self.flight, self.outcome.flight():
                    run_flight(self.flight.run())
            finally:
                if not self.finished:
                    self.summarise()
        if self.finished:
            InterruptedFiles(self.summary.folder).discard()
            (self.folder / TRACEBACK).unlink(missing_ok=True)  # of an attempt before

    def draw_and_tabulate(self, *, figures: bool, page_follows: bool) -> None:
        try:
            if self.flight is not None:
                with (
                    self.outcome.post_processing(),
                    self.stopwatch("figures"),
                    self.console.waiting("drawing figures"),
                ):
                    if page_follows:
                        from mission.figures.render import begin_libraries  # with it Altair

                        begin_libraries()
                    if figures:
                        from mission.figures.run import draw_run

                        draw_run(self.folder)
                    self.flight.conclude(self.summary)
        finally:
            # Last of all: a folder that says "finished" has everything. Its page shows the times
            # in it.
            self.stopwatch.stop()
            self.summarise()

    def make(self, page: Page) -> None:
        # It says that the flight is finished, and so comes after the summary that does.
        with self.outcome.post_processing(), self.console.waiting("writing the report"):
            try:
                page(self.folder)
            except InputError as error:
                self.goes_on = ""  # all is flown
                again = f"aerofed report {self.folder} makes the page once that is mended"
                raise error.in_words(f"{error}; {again}") from error.__cause__
        if not self.finished:
            self.summarise()

    def summarise(self) -> None:
        self.summary.ended(self.outcome, self.totals, self.stopwatch)

    def raise_error(self) -> None:
        # The files of a resumed run's flights are kept where it has not caught up with them.
        kept = InterruptedFiles(self.summary.folder).path.exists()
        flown = self.totals.sim_s > 0.0 or self.totals.rounds_done > 0 or kept
        self.outcome.raise_error(self.folder, flown=flown, goes_on=self.goes_on)

    def show(self, *, page_made: bool) -> int:
        """For people; returns the exit code."""
        if self.flight is not None:
            self.flight.show(self.console)
        look = ": open report.html in a browser" if page_made else ""
        self.console.say(f"results in {self.folder}{look}")
        if self.outcome.status == "interrupted":
            self.console.say(f"interrupted{self.goes_on}")
            return INTERRUPTED
        return 0
