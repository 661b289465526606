"""A sweep: its runs handed out until all have ended, and what a person sees of it meanwhile."""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from fl.plugin_code import passed
from mission.base.console import PLAIN
from mission.base.errors import INTERRUPTED, AerofedError
from mission.base.tables import count
from mission.config.models import RunConfig
from mission.flight.flyers.choice import set_up
from mission.run.budget import rounds_paid_for
from mission.scenario.limits import budget_of, foreseen_performance
from mission.sweep.execute.engine import Engine, EngineChoice, execute_all
from mission.sweep.execute.worker import RunEnd, RunOrder
from mission.sweep.folder import SweepFolder, read_manifest, read_sweep, rounds_in
from mission.sweep.grid import Grid, SweepRun
from mission.sweep.outcome.view import METHOD
from mission.sweep.results import communities_of, read_run, write_results

Page: TypeAlias = Callable[[Path], object]


class RunsFailedError(AerofedError):
    """Some runs of a sweep failed; the others' results are there."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def sweep(
    grid: Grid,
    path: Path,
    *,
    data_dir: Path | None,
    run_figures: bool,
    engine: EngineChoice,
    console: Console,
    page: Page | None = None,
) -> int:
    """Execute a sweep, or go on with it; returns the exit code. `page` makes a page of its folder.

    Raises:
        InputError: wrong input; raised before anything is flown, if it can be found then.
        RunsFailedError: runs failed; raised after all are flown, naming each and why.
    """
    work = _Sweep(grid, SweepFolder(path), data_dir, run_figures, console)
    work.folder.check(grid, data_dir=data_dir)
    try:
        ends = work.fly(engine, page)
    except KeyboardInterrupt:
        done = sum(work.folder.done(run) for run in grid.runs)
        Lines(console).say(
            f"interrupted; {done} of {len(grid.runs)} runs are done; "
            "the same command goes on from here"
        )
        return INTERRUPTED
    failed = {name: end for name, end in ends.items() if end.exit_code}
    if failed:
        lines = [f"run {name} failed: {end.message}" for name, end in failed.items()]
        raise RunsFailedError("\n".join(lines), next(iter(failed.values())).exit_code)
    return 0


@dataclass(frozen=True)
class _Sweep:
    """A sweep under way: its runs, folder, data and console."""

    grid: Grid
    folder: SweepFolder
    data_dir: Path | None
    run_figures: bool
    console: Console

    def fly(self, engine: EngineChoice, page: Page | None) -> dict[str, RunEnd]:
        """Fly all runs not done yet, then write results; return how they ended, by name."""
        grid, folder = self.grid, self.folder
        todo = [run for run in grid.runs if not folder.done(run)]
        if why := same_by_design([run.config for run in todo]):
            Lines(self.console).say(why)
        if todo:
            # Once here, so that missing data is one line and not a failure of every run.
            set_up(todo[0].config, data_dir=self.data_dir)
        ends: dict[str, RunEnd] = {}
        with folder.lock():
            if todo:
                # Workers may start elsewhere: every path is made absolute here.
                data_dir = None if self.data_dir is None else self.data_dir.resolve()
                with closing(engine.make([r.config for r in todo], data_dir=data_dir)) as workers:
                    # Only now: an engine that is refused leaves nothing behind.
                    folder.claim(grid, data_dir=self.data_dir)
                    ends = self._execute(todo, workers, data_dir)
            else:
                folder.claim(grid, data_dir=self.data_dir)
            if any(folder.done(run) for run in grid.runs):
                _report(folder.path, self.console, page)
        return ends

    def _execute(
        self, todo: Sequence[SweepRun], workers: Engine, data_dir: Path | None
    ) -> dict[str, RunEnd]:
        every, console = self.grid.runs, self.console
        before = len(every) - len(todo)
        base, here = self.folder.path.resolve(), Path.cwd()
        plugins = read_manifest(base)["plugins"]
        objects = passed(plugins)

        def order(run: SweepRun) -> RunOrder:
            path = SweepFolder(base).run(run).path
            return RunOrder(
                run.name, run.config, path, data_dir, here, self.run_figures, plugins, objects
            )

        progress = Bar(console, self.folder, every) if console.is_terminal else Lines(console)
        ends: dict[str, RunEnd] = {}
        with closing(progress):
            if before:
                progress.say(f"{before} of {len(every)} runs are done already")
            slots = min(workers.slots, len(todo))
            progress.say(f"{count(len(todo), 'run')}, {slots} at a time")
            for run, end, running in execute_all(todo, workers, order=order):
                if run is None:
                    progress.update(done=before + len(ends), running=running)
                elif end is None:
                    progress.say(f"{run.name}: its worker died; another takes the run")
                else:
                    ends[run.name] = end
                    # Of a single run the error follows at once.
                    why = f": {end.message}" if len(todo) > 1 else ""
                    outcome = f"failed{why}" if end.exit_code else _outcome(self.folder, run)
                    progress.say(f"run {before + len(ends)}/{len(every)} {run.name}: {outcome}")
        return ends


def same_by_design(configs: Sequence[RunConfig]) -> str:
    """Why the fairness CoV makes no difference in a sweep that compares it; empty where it may."""
    if not {METHOD, "no_cov"} <= {config.mission.strategy for config in configs}:
        return ""
    period = min(config.learning.cov_period_rounds for config in configs)
    rounds = max(config.mission.rounds for config in configs)
    if rounds > period:
        return ""
    return (
        f"{METHOD} and no_cov are the same here: the CoV is first updated after round {period} "
        f"(learning.cov_period_rounds), and the runs end after round {rounds}; ask for more "
        "--rounds"
    )


def _outcome(folder: SweepFolder, run: SweepRun) -> str:
    result = read_run(folder.run(run), run)
    of, wall_s = result.summary, result.wall_s["total"]
    finals = ((name, of[f"final_accuracy_{name}"]) for name in communities_of([result]))
    accuracy = " ".join(f"{name} {value:.3f}" for name, value in finals)
    return f"{count(int(of['rounds']), 'round')} in {duration(wall_s)}, accuracy {accuracy}"


def _report(path: Path, console: Console, page: Page | None) -> None:
    # Only now: Altair takes half a second to import.
    from mission.sweep.outcome.figures import draw_sweep
    from mission.sweep.outcome.view import final_table

    state = read_sweep(path)
    write_results(path, state.results)
    draw_sweep(path.name, state.results, path / "figures")
    console.print(final_table(state.results))
    if state.missing:
        Lines(console).say(state.progress)
    if page is not None:
        page(path)
    made = f"aerofed report {path} makes a page of them"
    Lines(console).say(f"results in {path}{f'; {made}' if page is None else ': open report.html'}")


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
