"""What a person sees of a sweep: a bar with the time left, or a line for every run that ends."""

from collections.abc import Sequence

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from mission.base.terminal import PLAIN
from mission.sweep.grid import SweepRun
from mission.sweep.timeleft import TimeLeft

_SHOWN = 4  # runs at work, under the bar


class Lines:
    """Plain lines, for pipes and logs, where only what ends is worth one."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def say(self, line: str) -> None:
        """Something worth a line."""
        self._console.print(line, **PLAIN)

    def update(self, *, done: int, running: Sequence[SweepRun]) -> None:
        """How many runs are done, and which are at work."""

    def close(self) -> None:
        """Leave the terminal as it should stay."""


class Bar(Lines):
    """A bar over all rounds, with the runs at work, under the lines of those that ended."""

    def __init__(self, console: Console, time_left: TimeLeft, *, runs: int) -> None:
        super().__init__(console)
        self._time_left, self._runs = time_left, runs
        self._progress = Progress(
            BarColumn(),
            TextColumn("{task.description}", markup=False),
            console=console,
            transient=True,
        )
        self._task: TaskID = self._progress.add_task("starting", total=1.0)
        self._progress.start()

    def update(self, *, done: int, running: Sequence[SweepRun]) -> None:
        at_work = [
            f"{run.name} {flown}/{expected}"
            for run in running[:_SHOWN]
            for flown, expected in (self._time_left.rounds(run),)
        ]
        more = " ..." if len(running) > _SHOWN else ""
        parts = (f"{done}/{self._runs} runs", self._time_left.text(), ", ".join(at_work) + more)
        self._progress.update(
            self._task,
            completed=self._time_left.share(),
            description="  ".join(part for part in parts if part),
        )

    def close(self) -> None:
        self._progress.stop()
