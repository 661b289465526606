"""`aerofed sweep`."""

from contextlib import suppress
from pathlib import Path
from typing import Literal

from mission.base.console import Terminal
from mission.base.errors import InputError
from mission.commands.options import Flag, Json, Overrides, print_json
from mission.config import STRATEGIES

_PIPE_WIDTH = 160  # a file needs no line breaks


def sweep(
    config: Path,
    *,
    strategies: str = ",".join(STRATEGIES),
    seeds: int = 3,
    rounds: int | None = None,
    jobs: int | None = None,
    out: Path | None = None,
    data_dir: Path | None = None,
    set_: Overrides = (),
    run_figures: bool = True,
    engine: Literal["joblib", "ray"] = "joblib",
    address: str | None = None,
    no_report: Flag = False,
    as_json: Json = False,
) -> int:
    """Fly many runs side by side: strategies x seeds x settings, with tables and figures.

    An interrupted sweep goes on when the same command is given again.

    Example: aerofed sweep paper --data-dir data --seeds 3 --set learning.mu=0,0.1

    Args:
        config: TOML file, or quickstart, paper, paper-sweep, apart, town, city or munich.
        strategies: Strategies to compare, separated by commas; package.module:factory is one of
            your own, and mine=package.module:factory is called "mine" in tables and pictures.
        seeds: Number of seeds, counting up from the seed of the configuration.
        rounds: Rounds at most; overrides mission.rounds.
        jobs: Runs at a time, one core each. Default: one for each core.
        out: Folder for the runs and the results. Default: runs/sweep-NAME.
        data_dir: Folder with the data sets' files, where the configuration's tasks need files.
        set_: Override any key; values separated by commas are swept: --set
            channel.extra_gain_db=0,3
        run_figures: Draw every run's own pictures too; they take a third of a run that is not
            flown.
        engine: joblib: processes of this machine; ray: a Ray cluster (pip install 'aerofed[ray]').
        address: HOST:PORT of a Ray cluster that this machine is part of; without it, Ray is started
            on this machine. The machines of the cluster need not share a folder.
        no_report: Leave out report.html, the page that is written into the folder at the end.
        as_json: Print nothing but the results as JSON, one row per run, at the end.
    """
    from mission.sweep.execute.engine import EngineChoice
    from mission.sweep.grid import make_grid, parse_axis

    chosen = EngineChoice(engine, jobs, address)
    names = [name.strip() for name in strategies.split(",")]
    if not all(names):
        raise InputError(f"--strategies {strategies}: expected names separated by commas")
    grid = make_grid(
        config,
        strategies=names,
        seeds=seeds,
        axes=[parse_axis(text) for text in set_],
        common={} if rounds is None else {"mission.rounds": rounds},
    )
    if data_dir is not None and not data_dir.is_dir():
        raise InputError(f"--data-dir {data_dir}: no such folder")
    from mission.base.run_folder import RUNS
    from mission.sweep.folder import SweepFolder

    # Only now, so that wrong input is answered at once: torch and cvxpy take seconds to import.
    from mission.sweep.sweep import sweep as execute

    console = Terminal.for_tables(quiet=as_json)
    if not console.is_terminal:
        console = Terminal(width=_PIPE_WIDTH, quiet=as_json)
    folder = out or RUNS / f"sweep-{grid.base.name}"
    SweepFolder(folder).check(grid, data_dir=data_dir)  # or the results printed were another's
    try:
        return execute(
            grid,
            folder,
            data_dir=data_dir,
            run_figures=run_figures,
            engine=chosen,
            console=console,
            page=None if no_report else _page,
        )
    finally:
        if as_json:
            with suppress(InputError):  # no run is done: why is said on standard error
                _print_results(folder)


def _page(folder: Path) -> None:
    from mission.report.sweep_page import write_sweep_report

    write_sweep_report(folder, folder / "report.html")


def _print_results(folder: Path) -> None:
    from mission.sweep.folder import read_sweep

    state = read_sweep(folder)
    runs = [{**result.point.keys, **result.summary} for result in state.results]
    print_json({"folder": folder, "runs": runs, "missing": state.missing})
