"""How a flight ended, and the summary that says so: the first thing that went wrong counts."""

import math
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from aerofed_errors import first_line, told
from mission.base.errors import (
    AerofedError,
    CallbackError,
    FlightError,
    InputError,
    LinkLostError,
    PlanError,
    TrainingError,
    UsersCodeError,
)
from mission.base.run_folder import RunFolder, environment, write_atomically
from mission.base.stopwatch import Stopwatch
from mission.run.budget import RunTotals

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
        why = {} if self.error is None else {"error": told(self.error)}
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
        raise self.error.in_words(f"{told(self.error, most=20_000)}{left}") from cause


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
