"""Many runs side by side: strategies, seeds and settings."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, SupportsIndex

from mission.api.configuring import Source, as_path, checked, folder
from mission.api.runs import Figure, Run, chosen, frame, load
from mission.base.errors import INTERRUPTED, InputError
from mission.base.run_folder import RUNS
from mission.config import STRATEGIES

if TYPE_CHECKING:
    import pandas as pd

    from mission.sweep.folder import SweepState


@dataclass(frozen=True)
class Sweep:
    """A sweep in its folder; of one that is not over, the runs that are done."""

    path: Path

    @cached_property
    def runs(self) -> "pd.DataFrame":
        """One row per run, with the columns of `runs.csv`."""
        return frame(None, [result.summary for result in self._state.results])

    @cached_property
    def rounds(self) -> "pd.DataFrame":
        """One row per round of every run, with the columns of `rounds.csv`."""
        return frame(None, [row for result in self._state.results for row in result.rounds])

    def run(self, name: str) -> Run:
        """One of its runs, by the name in column `run` of `runs`.

        Raises:
            InputError: there is none of that name.
        """
        runs = self.path / "runs"
        if not (runs / name).is_dir():
            there = ", ".join(sorted(path.name for path in runs.glob("*/"))) or "none"
            raise InputError(f"{self.path}: no run {name!r}; there are: {there}")
        return load(runs / name)

    def figure(self, name: str = "final") -> Figure:
        """A picture of the sweep, by the name of its file in `figures/`.

        Raises:
            InputError: there is none of that name.
        """
        from mission.sweep.outcome.figures import sweep_pictures

        return chosen(sweep_pictures(self.path.name, self._state.results), name, of=self.path)

    def report(self, target: Path | str | None = None) -> Path:
        """Write its page, as `aerofed report` does, and say where: one HTML file.

        Args:
            target: the file; default: `report.html` in the folder.

        Raises:
            InputError: no run is finished, or the file cannot be written.
        """
        from mission.report.sweep_page import write_sweep_report

        page = self.path / "report.html" if target is None else as_path(target, "target")
        return write_sweep_report(self.path, page)

    @cached_property
    def _state(self) -> "SweepState":
        from mission.sweep.folder import read_sweep

        return read_sweep(self.path)


def sweep(
    source: Source = "quickstart",
    *,
    strategies: "Sequence[str | Callable[..., object]]" = STRATEGIES,
    seeds: int = 3,
    settings: Mapping[str, Sequence[object]] | None = None,
    overrides: Mapping[str, object] | None = None,
    out: Path | str | None = None,
    data_dir: Path | str | None = None,
    jobs: int | None = None,
    engine: Literal["joblib", "ray"] = "joblib",
    address: str | None = None,
    run_figures: bool = False,
    quiet: bool = True,
) -> Sweep:
    """Fly every strategy with every seed and every value of every setting, in processes.

    Called again with the same `out` it goes on: finished runs are kept, and strategies, seeds and
    values may be added.

    Args:
        source: a configuration, as for `run`.
        strategies: which to compare; of your own as "package.module:factory", or the factory
            itself; tables call "mine=package.module:factory" by what is before the "=".
        seeds: how many, counting up from the configuration's.
        settings: values to sweep by dotted key: {"channel.extra_gain_db": [0.0, 3.0]}.
        overrides: values by dotted key that all runs have.
        out: folder for runs and results; default: runs/sweep-NAME.
        data_dir: folder with the data sets' files, where tasks need files.
        jobs: runs at a time; default: one a core.
        engine: "joblib", processes of this machine; "ray", a cluster.
        address: of the Ray cluster.
        run_figures: draw the pictures of every run, too; `run(name).figure()` draws one later.
        quiet: show nothing; False shows what `aerofed sweep` shows.

    Raises:
        AerofedError: a value is refused before anything flies, or runs failed, each named.
        KeyboardInterrupt: it was interrupted; the same call goes on.
    """
    from rich.console import Console

    from mission.config.loading import plain
    from mission.sweep.execute.engine import EngineChoice
    from mission.sweep.grid import Axis, make_grid

    chosen = EngineChoice(engine, jobs, address)
    for name, values in {"strategies": strategies, **(settings or {})}.items():
        if isinstance(values, str) or not isinstance(values, Iterable):
            raise InputError(f"{name} = {values!r}: must be a list of values, also where it is one")
    if not isinstance(seeds, SupportsIndex):
        raise InputError(f"seeds = {seeds!r}: must be a whole number")
    grid = make_grid(
        checked(source, overrides),
        strategies=[str(plain(strategy)) for strategy in strategies],
        seeds=seeds,
        axes=[Axis(key, tuple(map(plain, values))) for key, values in (settings or {}).items()],
        common=overrides,
        giver="sweep",
    )
    path = as_path(out, "out") if out is not None else RUNS / f"sweep-{grid.base.name}"
    data = folder(data_dir)
    from mission.sweep.sweep import sweep as execute

    code = execute(
        grid,
        path,
        data_dir=data,
        engine=chosen,
        run_figures=run_figures,
        console=Console(quiet=quiet),
    )
    if code == INTERRUPTED:
        raise KeyboardInterrupt(f"{path} was interrupted; the same call goes on")
    return Sweep(path)


def load_sweep(path: Path | str) -> Sweep:
    """Read a sweep that was flown, or is under way.

    Raises:
        InputError: not a sweep's folder, or none of its runs is done.
    """
    sweep = Sweep(as_path(path, "path"))
    _ = sweep._state
    return sweep
