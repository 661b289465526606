"""Wall time by phase."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Adds up wall seconds under names."""

    def __init__(self) -> None:
        self._started = time.perf_counter()
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
        """Wall seconds since this stopwatch was made."""
        return time.perf_counter() - self._started
