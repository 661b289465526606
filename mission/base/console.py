"""Where a run is shown while it goes on. Nothing of that is remembered, or alters the run."""

from contextlib import AbstractContextManager, nullcontext
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
        """Show on a terminal that something goes on while the block runs."""
        return self.out.status(f"{what} ...") if self.out.is_terminal else nullcontext()
