"""What shows a run in progress and never affects it: the terminal, the live view, its wall time.

A terminal's failure to write never ends the program that it reports on.
"""

import errno
import os
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import IO, Any, ClassVar

from rich.console import Console

TABLE_WIDTH = 80  # characters: what tables are made for
# Lines as they are: neither wrapped, coloured, nor read as markup.
PLAIN: dict[str, Any] = {"soft_wrap": True, "highlight": False, "markup": False}


class Terminal(Console):
    """A console that falls silent, instead of raising, when it can no longer be written.

    A closed pipe means that somebody has read enough; any other failure is kept in `failure` for
    the command line to report at its end.
    """

    failure: ClassVar[str | None] = None
    # Where it writes; None: to sys.stdout. In a command that is left to what others print there.
    stream: ClassVar[IO[str] | None] = None

    @classmethod
    def for_tables(cls, **options: Any) -> "Terminal":
        """Make a console `TABLE_WIDTH` wide at least: narrow terminals break lines, not numbers."""
        console = cls(**options)
        return console if console.width >= TABLE_WIDTH else cls(width=TABLE_WIDTH, **options)

    @property  # type: ignore[misc]  # nobody sets it
    def file(self) -> IO[str]:
        """The stream that it writes to."""
        return self.stream or sys.stdout

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does; nothing once the reader is gone."""
        try:
            super().print(*objects, **options)
        except OSError as error:
            self._fall_silent(error)

    def on_broken_pipe(self) -> None:
        """Go on silently; rich itself would exit."""
        self._fall_silent(BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE)))

    def _fall_silent(self, error: OSError) -> None:
        self.quiet = True
        # What is still buffered must not fail again when the interpreter ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())
        if error.errno != errno.EPIPE:
            Terminal.failure = error.strerror


@dataclass(frozen=True)
class RunConsole:
    """The terminal that a run reports to, quiet or not, and the port of its live view."""

    out: Console
    live_port: int | None = None  # of Foxglove's view of the log; 0: any free one

    def say(self, text: str) -> None:
        """Print a line as it is."""
        self.out.print(text, **PLAIN)

    def waiting(self, what: str) -> AbstractContextManager[object]:
        """Context manager: show `what` with a spinner while the block runs, on a terminal only."""
        return self.out.status(f"{what} ...") if self.out.is_terminal else nullcontext()


class Stopwatch:
    """Wall time (s) summed by phase."""

    def __init__(self) -> None:
        self._started = time.perf_counter()
        self._stopped: float | None = None
        self.wall_s: dict[str, float] = {}

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Count the time of a `with` block under `name`."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.wall_s[name] = self.wall_s.get(name, 0.0) + time.perf_counter() - started

    @property
    def total_s(self) -> float:
        """Wall seconds from when this stopwatch was made until it was stopped, or until now."""
        until = time.perf_counter() if self._stopped is None else self._stopped
        return until - self._started

    def stop(self) -> None:
        """Stop the total: it is the same from now on, whoever reads it."""
        self._stopped = time.perf_counter()
