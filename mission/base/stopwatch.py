"""Wall time by phase of a run: set-up, flight, planning, learning, figures."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


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
