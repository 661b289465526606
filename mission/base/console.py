"""What shows a run in progress and never affects it: the terminal, the live view, its wall time."""

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass

from rich.console import Console

from mission.base.terminal import PLAIN


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
