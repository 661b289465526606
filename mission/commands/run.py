"""`aerofed run`."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mission.base.console import Stopwatch
from mission.base.errors import InputError
from mission.base.run_folder import RunFolder, output_folder
from mission.base.user_files import read_json
from mission.commands.options import (
    LIVE_PORT,
    Flag,
    Json,
    Limits,
    Overrides,
    console,
    load,
    print_json,
)


def run(
    config: Path | None = None,
    *,
    out: Path | None = None,
    data_dir: Path | None = None,
    seed: int | None = None,
    rounds: int | None = None,
    set_: Overrides = (),
    gcs: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    vehicle: str | None = None,
    live: Flag = False,
    live_port: int = LIVE_PORT,
    resume: Path | None = None,
    limit: Limits = (),
    junit: Path | None = None,
    no_report: Flag = False,
    quiet: Flag = False,
    as_json: Json = False,
) -> int:
    """Fly the rounds of a configuration: plan, fly, gate, learn; and leave a folder.

    Example: aerofed run paper --data-dir data --rounds 6 --out paper6
    Example: aerofed run --gcs udpout://127.0.0.1:14550 --set link.speed=1
    Example: aerofed run my.toml --vehicle udpin://0.0.0.0:14540
    Example: aerofed run --resume paper6 --rounds 20

    Args:
        config: TOML file, or quickstart, paper, apart, town, city or munich. Without one, the
            quick-start is flown.
        out: Folder for the results; it must be new or empty. Default: a new one under runs/.
        data_dir: Folder with the data sets' files, where the configuration's tasks need files.
        seed: Root of all randomness; overrides the configuration.
        rounds: Rounds at most; overrides mission.rounds. With --resume it lengthens a run, also one
            that is finished: all files become those of a run that began with so many.
        set_: Override any key: --set mission.strategy=no_cov --set
            vehicle.aircraft.wind.speed_mps=8
        gcs: A ground station that sees the simulated vehicle in flight; give it once for each
            station. udpout://127.0.0.1:14550 is QGroundControl on this machine; overrides link.gcs.
        vehicle: Fly an external autopilot (PX4, ArduPilot, aerofed sitl) instead of the simulated
            vehicle: a MAVSDK URL such as udpin://0.0.0.0:14540; overrides link.kind and link.url.
        live: Show the run live in Foxglove, for programs on this machine only.
        live_port: Port of the live view; 0 takes a free one.
        resume: Go on with the run in this folder, from its last finished round; takes no other
            setting than --rounds: the folder has them all, also --no-report. What judges it may be
            given again: --limit and --junit.
        limit: NAME=VALUE, once for each limit on a number of `aerofed compare`, beside those of the
            table [limits]: exit code 6 and a line for each that is not met.
        junit: Also write the verdict into this file, as JUnit's XML.
        no_report: Leave out report.html, the page that is written into the folder at the end.
        quiet: Print nothing but errors.
        as_json: Print nothing but the run's summary as JSON, at the end.
    """
    watching = console(quiet=quiet or as_json, live=live, live_port=live_port)
    stopwatch = Stopwatch()
    if resume is not None:
        others = {
            "a configuration": config, "--out": out, "--data-dir": data_dir, "--seed": seed,
            "--vehicle": vehicle, "--set": set_ or None, "--gcs": gcs or None,
            "--no-report": no_report or None,
        }  # fmt: skip
        if given := [name for name, value in others.items() if value is not None]:
            raise InputError(
                f"--resume takes no other setting, and not {', '.join(given)}: the folder has them "
                "all but --rounds, --limit and --junit"
            )
        from mission.run.resume import read_checkpoint

        if rounds is not None or RunFolder(resume).status() != "finished":
            read_checkpoint(resume)  # refuses what cannot be resumed, before the rest is imported
        with stopwatch("setup"), watching.waiting("loading"):
            from mission.analysis.limits import given_limits, limits_in
            from mission.run.recorded import Around
            from mission.run.session import resume_session
        bounds = given_limits(limit, limits_in(RunFolder(resume).config))
        around = Around(watching, stopwatch, page=write_page)
        return judged(
            lambda: resume_session(resume, around, rounds=rounds), resume, bounds, junit,
            as_json=as_json, quiet=watching.out.quiet,
        )  # fmt: skip
    options = {
        "seed": seed,
        "mission.rounds": rounds,
        "link.gcs": list(gcs) or None,
        "link.kind": None if vehicle is None else "external",
        "link.url": vehicle,
    }
    resolved = load(config, set_, options)
    if bounds := bounds_of(resolved.limits, limit):
        from mission.analysis.limits import check_flown

        check_flown(resolved.mission.strategy)
    if data_dir is not None and not data_dir.is_dir():
        raise InputError(f"--data-dir {data_dir}: no such folder")
    with output_folder(out, resolved.run_name) as folder:
        RunFolder(folder).check()
        with stopwatch("setup"), watching.waiting("loading"):
            from mission.config.preflight import load_data

            load_data(resolved, data_dir)
            if not no_report:
                from mission.figures.render import begin_libraries

                begin_libraries()  # of the page: a core is idle while the rest is loaded
            # Only now, so that wrong input is answered at once: cvxpy and the rest take a second.
            from mission.run.recorded import Around
            from mission.run.session import fly_session
        around = Around(watching, stopwatch, page=None if no_report else write_page)
        return judged(
            lambda: fly_session(resolved, folder, around, data_dir=data_dir), folder, bounds, junit,
            as_json=as_json, quiet=watching.out.quiet,
        )  # fmt: skip


def bounds_of(table: Mapping[str, object] | None, options: Sequence[str]) -> dict[str, float]:
    """The limits of a configuration's table, under those of `--limit`.

    Raises:
        InputError: one of them is not a valid limit.
    """
    if not (table or options):
        return {}
    from mission.analysis.limits import given_limits

    return given_limits(options, table)


def judged(
    fly: Callable[[], int],
    folder: Path,
    bounds: Mapping[str, float],
    junit: Path | None,
    *,
    as_json: bool,
    quiet: bool,
) -> int:
    """Fly, and judge what was flown if it has limits or `junit` is wanted; return the exit code.

    However that ends, the summary is printed if `as_json`."""
    more: dict[str, object] = {}
    try:
        if (code := fly()) or not (bounds or junit):
            return code
        from mission.analysis.limits import every_verdict
        from mission.analysis.load import load_run, vehicles_of
        from mission.analysis.several import NOTHING, load_several
        from mission.commands.compare import in_json, tell_verdict

        # Without limits the file says that a flight was, and may say that none was.
        flew = bool(bounds or vehicles_of(folder)) or load_run(folder).data.plans
        several = load_several((folder,)) if flew else NOTHING
        its = every_verdict(several, bounds)
        more = in_json([item for each in its for item in each])
        return tell_verdict(several, bounds, its, junit, quiet=quiet)
    finally:
        summary = RunFolder(folder).summary
        if as_json and summary.is_file():
            print_json({"folder": folder, **read_json(summary), **more})


def write_page(folder: Path) -> str:
    """Write the report into the folder of a finished flight; return the file's name."""
    from mission.report.page import write_report

    return write_report(folder).name
