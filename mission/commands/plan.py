"""`aerofed plan`."""

from pathlib import Path
from typing import Literal

from mission.base.console import PLAIN, Terminal
from mission.base.errors import InputError
from mission.commands.options import Json, Overrides, load, print_json


def plan(
    config: Path | None = None,
    *,
    problem: Path | None = None,
    out: Path | None = None,
    figure: Path | None = None,
    qgc: Path | None = None,
    method: Literal["certified", "sqp", "paper", "paper_literal"] | None = None,
    gap: float | None = None,
    data_dir: Path | None = None,
    set_: Overrides = (),
    as_json: Json = False,
) -> int:
    """Plan rounds without flying them: path, schedule, value and a bound that no plan can exceed.

    Example: aerofed plan --problem problems.json --out plans.json --figure pictures

    Args:
        config: TOML file whose first round is planned. Without one, that of the quick start.
        problem: JSON file with a list of problems to plan instead; docs/planner.md describes it.
            Only the table planner of the configuration is used then.
        out: JSON file for the plans.
        figure: Folder for a picture of each plan: path, devices by importance, links by PER.
        qgc: File for a QGroundControl plan of the first round.
        method: The planner; overrides planner.kind.
        gap: Relative gap to the bound at which `certified` may stop; overrides planner.gap.
        data_dir: Folder with the data sets' files, where the configuration's tasks need files.
        set_: Override any key of the configuration: --set mission.steps=8
        as_json: Print the plans as JSON, as --out writes them.
    """
    _check_targets(out, qgc, figure)
    resolved = load(config, set_, {"planner.kind": method, "planner.gap": gap})
    # Only now, so that wrong input is answered at once.
    from mission.commands import planning
    from mission.planner.files import plans_as_json
    from mission.scenario.strategies import FIXED_PATHS

    if problem is None:
        if qgc is not None and len(resolved.aircraft) > 1:
            raise InputError(
                f"--qgc: a file has the mission of one aircraft, and there are "
                f"{len(resolved.aircraft)} (vehicles); aerofed run writes plans/ with one for each"
            )
        task = planning.first_round(resolved, data_dir)
    elif qgc is not None:
        raise InputError("--qgc: a problem file has no place on the globe; give a configuration")
    elif stray := [text for text in set_ if not text.startswith("planner.")]:
        raise InputError(f"--set {stray[0]}: of a problem file only planner.* can be set")
    else:
        task = planning.problems_of_file(problem, resolved)
    if isinstance(task.strategy, FIXED_PATHS) and (method is not None or gap is not None):
        raise InputError(
            f"--{'gap' if method is None else 'method'}: mission.strategy = "
            f"{resolved.mission.strategy!r} has a fixed path and asks no planner; leave it out"
        )
    plans, failure = planning.plan_problems(task, out=out, figure_dir=figure)
    if qgc is not None and task.scenario is not None:
        planning.write_qgc(qgc, task.problems[0].problem, plans[0], task.scenario)
    if as_json:
        print_json(plans_as_json(plans))
    elif not plans:
        Terminal(**PLAIN).print(f"no problems in {problem}")
    else:
        planning.show(plans, task.problems, resolved.planner)
    if failure is not None:
        raise failure
    return 0


def _check_targets(out: Path | None, qgc: Path | None, figure: Path | None) -> None:
    """Refuse outputs that cannot be written, before anything is planned."""
    for path in (out, qgc):
        if path is not None and path.exists():
            raise InputError(f"{path}: exists already; give another name")
        if path is not None and not path.parent.is_dir():
            raise InputError(f"{path}: cannot write: no folder {path.parent}")
    if figure is not None and figure.exists() and not figure.is_dir():
        raise InputError(f"{figure}: not a folder")
