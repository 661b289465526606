"""What a person sees of a sweep: a bar with the time left, or a line for every run that ends."""

import math
import time
from collections.abc import Sequence
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from mission.config import MissionConfig
from mission.sweep.folder import SweepFolder
from mission.sweep.grid import SweepRun


class SweepProgress(Protocol):
    """Shows a sweep as it goes."""

    def say(self, line: str) -> None:
        """Something worth a line."""
        ...

    def update(self, *, done: int, running: Sequence[SweepRun]) -> None:
        """How many runs are done, and which are at work."""
        ...

    def close(self) -> None:
        """Leave the terminal as it should stay."""
        ...


class TimeLeft:
    """Estimates the time left from the rounds that this sweep has flown.

    A round is taken to cost as much path as it may; runs that spend less have more of them.
    """

    def __init__(self, folder: SweepFolder, runs: Sequence[SweepRun]) -> None:
        self._folder = folder
        self._rounds = {run.name: expected_rounds(run.config.mission) for run in runs}
        self._ended_rounds = 0
        self._started = time.monotonic()

    def ended(self, run: SweepRun) -> None:
        """A run is over and has no rounds left."""
        self._ended_rounds += self._rounds.pop(run.name, 0)

    def share(self, running: Sequence[SweepRun]) -> float:
        """The part of this sweep's rounds that is done, 0..1."""
        at_work = sum(min(self._flown(run), self._rounds.get(run.name, 0)) for run in running)
        total = self._ended_rounds + sum(self._rounds.values())
        return (self._ended_rounds + at_work) / total if total else 1.0

    def text(self, running: Sequence[SweepRun]) -> str:
        """`about 12 min left`, as soon as there is something to go by."""
        share = self.share(running)
        if share <= 0.0:
            return ""
        left_s = (time.monotonic() - self._started) * (1.0 / share - 1.0)
        return f"about {duration(left_s)} left"

    def _flown(self, run: SweepRun) -> int:
        try:
            return max(0, self._folder.run(run).rounds.read_bytes().count(b"\n") - 1)
        except FileNotFoundError:
            return 0


class Lines:
    """Plain lines, for pipes and logs."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def say(self, line: str) -> None:
        self._console.print(line, soft_wrap=True, highlight=False, markup=False)

    def update(self, *, done: int, running: Sequence[SweepRun]) -> None:
        """Only what ends is worth a line in a file."""

    def close(self) -> None: ...


class Bar:
    """A bar over all rounds, with the runs at work, under the lines of those that ended."""

    def __init__(self, console: Console, time_left: TimeLeft, *, runs: int) -> None:
        self._time_left, self._runs = time_left, runs
        self._progress = Progress(
            BarColumn(),
            TextColumn("{task.description}", markup=False),
            console=console,
            transient=True,
        )
        self._task: TaskID = self._progress.add_task("starting", total=1.0)
        self._progress.start()

    def say(self, line: str) -> None:
        self._progress.console.print(line, soft_wrap=True, highlight=False, markup=False)

    def update(self, *, done: int, running: Sequence[SweepRun]) -> None:
        names = ", ".join(run.name for run in running[:4]) + (" ..." if len(running) > 4 else "")
        parts = (f"{done}/{self._runs} runs", self._time_left.text(running), names)
        self._progress.update(
            self._task,
            completed=self._time_left.share(running),
            description="  ".join(part for part in parts if part),
        )

    def close(self) -> None:
        self._progress.stop()


def expected_rounds(mission: MissionConfig) -> int:
    """How many rounds the path budget pays for, where it ends a run before its last round."""
    cost = mission.hover_cost_m if mission.strategy == "barycenter" else mission.path_budget_m
    if cost == 0.0:
        return mission.rounds
    return min(mission.rounds, math.ceil(mission.total_budget_m / cost))


def duration(seconds: float) -> str:
    """`45 s`, `12 min`, `3 h 20 min`."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
