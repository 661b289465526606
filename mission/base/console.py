"""The terminal and the live view that show a run in progress; they never affect the run."""

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
        """Context manager: show `what` with a spinner while the block runs, on a terminal only."""
        return self.out.status(f"{what} ...") if self.out.is_terminal else nullcontext()
