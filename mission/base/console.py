"""Where a run is shown while it goes on. Nothing of that is remembered, or alters the run."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from mission.base.terminal import PLAIN


@dataclass(frozen=True)
class RunConsole:
    """The terminal that a run reports to, and the port of its live view."""

    out: Console
    quiet: bool = False  # only errors are printed
    live_port: int | None = None  # of Foxglove's view of the log; 0: any free one

    def say(self, text: str) -> None:
        """Print a line, unless quiet."""
        if not self.quiet:
            self.out.print(text, **PLAIN)

    def show(self, table: Table) -> None:
        """Print a table, unless quiet."""
        if not self.quiet:
            self.out.print(table)

    @contextmanager
    def waiting(self, what: str) -> Iterator[None]:
        """Show on a terminal that something goes on while the block runs."""
        if self.quiet or not self.out.is_terminal:
            yield
            return
        with self.out.status(f"{what} ..."):
            yield
