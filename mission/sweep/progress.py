"""What a person sees of a sweep: a bar with the time left, or a line for every run that ends."""

from collections.abc import Sequence

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from mission.base.terminal import PLAIN
from mission.run.budget import rounds_paid_for
from mission.scenario.limits import budget_of, foreseen_performance
from mission.sweep.folder import SweepFolder
from mission.sweep.grid import SweepRun
from mission.sweep.state import rounds_in

_SHOWN = 4  # runs at work, beside the bar


class Lines:
    """Progress display of a sweep for pipes and logs: plain lines, one for each run that ends."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def say(self, line: str) -> None:
        """Print a line."""
        self._console.print(line, **PLAIN)

    def update(self, *, done: int, running: Sequence[SweepRun]) -> None:
        """Update the counts of rounds and runs."""

    def close(self) -> None:
        """End the display."""


class Bar(Lines):
    """Progress display on a terminal: lines of ended runs; a bar over all rounds below them."""

    def __init__(self, console: Console, folder: SweepFolder, runs: Sequence[SweepRun]) -> None:
        super().__init__(console)
        self._folder, self._runs = folder, len(runs)
        budgets = {r.name: budget_of(r.config, foreseen_performance(r.config)) for r in runs}
        self._expected = {name: rounds_paid_for(budget) for name, budget in budgets.items()}
        self._over = {run.name for run in runs if folder.done(run)}
        self._at_work: set[str] = set()
        self._progress = Progress(
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("rounds  {task.description}", markup=False),
            TimeRemainingColumn(compact=True),
            console=console,
            transient=True,
        )
        self._task = self._progress.add_task("starting", total=sum(self._expected.values()))
        self._progress.start()

    def update(self, *, done: int, running: Sequence[SweepRun]) -> None:
        names = {run.name for run in running}
        self._over |= self._at_work - names
        self._at_work = names
        flown = {
            run.name: min(rounds_in(self._folder.run(run)), self._expected[run.name])
            for run in running
        }
        shown = [f"{name} {n}/{self._expected[name]}" for name, n in list(flown.items())[:_SHOWN]]
        more = " ..." if len(running) > _SHOWN else ""
        self._progress.update(
            self._task,
            completed=sum(self._expected[name] for name in self._over) + sum(flown.values()),
            description=f"{done}/{self._runs} runs  {', '.join(shown)}{more}",
        )

    def close(self) -> None:
        self._progress.stop()


def duration(seconds: float) -> str:
    """Format a duration: `45 s`, `12 min`, `3 h 20 min`."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
