"""Who looks on while a run goes on. Nothing of it is remembered, and nothing of it alters a run."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rich.console import Console


@dataclass(frozen=True)
class Audience:
    """Where a run is shown, and what else it shows."""

    console: Console
    quiet: bool = False  # only errors are printed
    live_port: int | None = None  # of Foxglove's view of the log; 0: any free one
    log_mavlink: bool = False  # what pilot and vehicle say goes into the log too

    def say(self, text: str) -> None:
        """A line for people."""
        if not self.quiet:
            self.console.print(text, soft_wrap=True, highlight=False, markup=False)

    @contextmanager
    def waiting(self, what: str) -> Iterator[None]:
        """Show on a terminal that something goes on while the block runs."""
        if self.quiet or not self.console.is_terminal:
            yield
            return
        with self.console.status(f"{what} ..."):
            yield
