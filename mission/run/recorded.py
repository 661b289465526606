"""The frame of every flight into a folder: outcome, summary, figures, report page."""

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from mission.base.console import RunConsole
from mission.base.errors import INTERRUPTED, InputError
from mission.base.interrupts import ending_flights, run_flight
from mission.base.record_file import RecordFile
from mission.base.stopwatch import Stopwatch
from mission.run.budget import RunTotals
from mission.run.outcome import TRACEBACK, Outcome, Summary

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
    page: Callable[[Path], object] | None = None  # makes a page of the folder, last of all


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
    totals = RunTotals()
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
                page(folder.path)
            except InputError as error:
                again = f"{error}{goes_on} once that is mended"
                goes_on = ""
                raise error.in_words(again) from error.__cause__
    outcome.raise_error(folder.path, goes_on=goes_on)
    if flight is not None:
        flight.show(console)
    look = ": open report.html in a browser" if page and outcome.status == "finished" else ""
    console.say(f"results in {folder.path}{look}")
    if outcome.status == "interrupted":
        console.say(f"interrupted{goes_on}")
        return INTERRUPTED
    return 0
