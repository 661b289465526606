"""How much of a sweep is done, and when it will be over."""

import heapq
import math
import time
from collections.abc import Sequence

from mission.run.budget import rounds_paid_for
from mission.scenario.limits import budget_of
from mission.sweep.folder import SweepFolder
from mission.sweep.grid import SweepRun
from mission.sweep.results import read_run
from mission.sweep.state import rounds_in

_LEAST_S = 5.0  # less is not told by the second


class TimeLeft:
    """Estimates the end of a sweep from how long the rounds of its runs have taken so far.

    A strategy's rounds are taken to go on as they went, in runs of earlier calls too; a run of a
    strategy of which nothing was flown yet costs the mean of the others. Runs that wait go to
    whichever slot is free first, as they do in the engine.
    """

    def __init__(
        self, folder: SweepFolder, runs: Sequence[SweepRun], *, todo: Sequence[SweepRun], slots: int
    ) -> None:
        self._folder, self._slots, self._runs = folder, slots, tuple(runs)
        self._left = {run.name: run for run in todo}
        # Rounds by run, once: each takes milliseconds, and the display asks twice a second.
        self._expected = {run.name: rounds_paid_for(budget_of(run.config)) for run in runs}
        self._running: tuple[SweepRun, ...] = ()
        self._begun: dict[str, float] = {}
        self._spent: dict[str, tuple[float, int]] = {}  # seconds and rounds, by strategy
        for run in runs:
            if run.name not in self._left:
                seconds = read_run(folder.run(run), run).wall_s.get("total", 0.0)
                self._spent = self._with(run, seconds)

    def at_work(self, running: Sequence[SweepRun]) -> None:
        """Which runs are at work now."""
        now = time.monotonic()
        self._begun = {run.name: self._begun.get(run.name, now) for run in running}
        self._running = tuple(running)

    def ended(self, run: SweepRun) -> None:
        """A run that was at work is over."""
        now = time.monotonic()
        self._spent = self._with(run, now - self._begun.get(run.name, now))
        del self._left[run.name]

    def rounds(self, run: SweepRun) -> tuple[int, int]:
        """Flown so far, and expected in all."""
        expected = self._expected[run.name]
        return min(rounds_in(self._folder.run(run)), expected), expected

    def share(self) -> float:
        """The part of the sweep's rounds that is done, 0..1."""
        total = sum(self._expected.values())
        left = sum(self._expected[name] for name in self._left)
        return 1.0 - (left - sum(self.rounds(run)[0] for run in self._running)) / total

    def text(self) -> str:
        """`about 12 min left`, as soon as there is something to go by."""
        now, spent = time.monotonic(), self._spent
        for run in self._running:
            spent = self._with(run, now - self._begun[run.name], spent)
        pace = {name: s / rounds for name, (s, rounds) in spent.items() if rounds and s > 0.0}
        known = [
            pace[run.strategy] * self._expected[run.name]
            for run in self._runs
            if run.strategy in pace
        ]
        if not known:
            return ""
        free_at = [0.0] * self._slots
        waiting = (run for name, run in self._left.items() if name not in self._begun)
        for run in (*self._running, *waiting):
            flown, expected = self.rounds(run) if run.name in self._begun else (0, 1)
            whole = (
                pace[run.strategy] * self._expected[run.name]
                if run.strategy in pace
                else math.fsum(known) / len(known)
            )
            heapq.heapreplace(free_at, free_at[0] + whole * (1.0 - flown / expected))
        left_s = max(free_at)
        # All rounds are flown, but a run is not over before its last files are written.
        return f"about {duration(left_s)} left" if left_s >= _LEAST_S else "a few seconds left"

    def _with(
        self, run: SweepRun, seconds: float, spent: dict[str, tuple[float, int]] | None = None
    ) -> dict[str, tuple[float, int]]:
        spent = self._spent if spent is None else spent
        before, rounds = spent.get(run.strategy, (0.0, 0))
        flown = rounds_in(self._folder.run(run))
        return {**spent, run.strategy: (before + seconds, rounds + flown)}


def duration(seconds: float) -> str:
    """`45 s`, `12 min`, `3 h 20 min`."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
