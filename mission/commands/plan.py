"""`aerofed plan`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich import box
from rich.table import Table

from mission.base.errors import InputError
from mission.base.tables import number
from mission.base.terminal import PLAIN, Terminal
from mission.commands.options import Json, Overrides, load, print_json

if TYPE_CHECKING:
    from mission.config.models import RunConfig
    from mission.planner.config import PlannerConfig
    from mission.planner.files import NamedPlan, NamedProblem
    from mission.planner.problem import RoundPlan, RoundProblem
    from mission.scenario.scenario import Scenario
    from mission.scenario.strategies import Strategy


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

    Parameters
    ----------
    config
        TOML file whose first round is planned. Without one, that of the quick start.
    problem
        JSON file with a list of problems to plan instead; docs/planner.md describes it. Only
        the table planner of the configuration is used then.
    out
        JSON file for the plans.
    figure
        Folder for a picture of each plan: path, devices by importance, links by PER.
    qgc
        File for a QGroundControl plan of the first round.
    method
        The planner; overrides planner.kind.
    gap
        Relative gap to the bound at which `certified` may stop; overrides planner.gap.
    data_dir
        Folder with the data sets' files, where the configuration's tasks need files.
    set_
        Override any key of the configuration: --set mission.steps=8
    as_json
        Print the plans as JSON, as --out writes them.
    """
    from mission.commands.planning import plan_problems
    from mission.planner.files import plans_as_json
    from mission.scenario.strategies import FIXED_PATHS

    _check_targets(out, qgc, figure)
    resolved = load(config, set_, {"planner.kind": method, "planner.gap": gap})
    if problem is None:
        task = _first_round(resolved, data_dir)
    elif qgc is not None:
        raise InputError("--qgc: a problem file has no place on the globe; give a configuration")
    elif stray := [text for text in set_ if not text.startswith("planner.")]:
        raise InputError(f"--set {stray[0]}: of a problem file only planner.* can be set")
    else:
        task = _problems_of_file(problem, resolved)
    if isinstance(task.strategy, FIXED_PATHS) and (method is not None or gap is not None):
        raise InputError(
            f"--{'gap' if method is None else 'method'}: mission.strategy = "
            f"{resolved.mission.strategy!r} has a fixed path and asks no planner; leave it out"
        )
    scenario = task.scenario
    plans, failure = plan_problems(
        task.problems,
        method=lambda one: task.strategy.sortie(0, one),
        out=out,
        figure_dir=figure,
        about=task.about,
        communities=() if scenario is None else scenario.community_of,
        area=None if scenario is None else scenario.config.area,
    )
    if qgc is not None and scenario is not None:
        _write_qgc(qgc, task.problems[0].problem, plans[0], scenario)
    if as_json:
        print_json(plans_as_json(plans))
    elif not plans:
        Terminal(**PLAIN).print(f"no problems in {problem}")
    else:
        _show(plans, task.problems, resolved.planner)
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


@dataclass(frozen=True)
class _Task:
    """Problems to plan, the strategy that plans them, and the scenario that they come from."""

    problems: "Sequence[NamedProblem]"
    strategy: "Strategy"
    about: str  # for people: whose plans they are
    scenario: "Scenario | None" = None  # None: the problems are of a file


def _first_round(config: "RunConfig", data_dir: Path | None) -> _Task:
    from fl.plugin_code import label_of
    from mission.planner.files import NamedProblem
    from mission.scenario.scenario import build_scenario
    from mission.scenario.strategies import FIXED_PATHS

    scenario = build_scenario(config, data_dir=data_dir)
    if scenario.strategy is None:
        raise InputError(
            "mission.strategy = 'ideal': flies nothing, so there is no path to plan; give "
            "another, such as --set mission.strategy=cov"
        )
    fixed = isinstance(scenario.strategy, FIXED_PATHS)
    planner = "" if fixed else f" · planner {config.planner.kind}"
    strategy = label_of(config.mission.strategy)
    about = f"{config.name}{planner} · strategy {strategy} · seed {config.seed}"
    problems = (NamedProblem("round-1", scenario.first_problem()),)
    return _Task(problems, scenario.strategy, about, scenario)


def _problems_of_file(path: Path, config: "RunConfig") -> _Task:
    from mission.planner.factory import make_planner
    from mission.planner.files import read_problems
    from mission.scenario.strategies import Optimised

    problems = read_problems(path)
    strategy = Optimised(make_planner(config.planner), fairness=True)
    return _Task(problems, strategy, f"{path} · planner {config.planner.kind}")


def _write_qgc(
    path: Path, problem: "RoundProblem", made: "NamedPlan", scenario: "Scenario"
) -> None:
    from mission.flight.missions.plan_file import write_round_plan
    from mission.flight.missions.round_mission import flight_of_round

    mission = scenario.config.mission
    flight = flight_of_round(problem, made.plan, hold_s=made.hold_s, mission=mission)
    write_round_plan(path, flight, scenario.area)


def _row(named: "NamedPlan") -> dict[str, float]:
    """Return a plan's row of the table, by heading; NaN for what the plan does not have."""
    made = named.plan
    flights = [path.foreseen for path in made.paths if path.foreseen]  # where it is limited
    heights = {path.altitude_m for path in made.paths}
    return {
        "value": made.value,
        "upper\nbound": made.upper_bound,
        "gap\n%": 100.0 * made.gap,
        "path\nm": made.path_m,
        "alt.\nm": (heights.pop() if len(heights) == 1 else None) or math.nan,
        "takes\ns": max((flight.duration_s for flight in flights), default=math.nan),
        "takes\nkJ": sum(flight.energy_j for flight in flights) / 1000.0 or math.nan,
        "served": int(made.schedule.sum()),
        "nodes": made.nodes,
        "ms": 1e3 * named.time_s,
    }


def _nobody(problem: "RoundProblem", made: "RoundPlan") -> str:
    """Return in words why a plan serves nobody."""
    if not len(problem.devices_m):
        return "there are no devices"
    if not problem.importance.any():
        return "the importance of every device is 0"
    away_m, most_m, aircraft = min(
        (math.dist(device_m, start.start_m), problem.alone(a).most_m, a)
        for a, start in enumerate(problem.starts)
        for device_m in problem.devices_m
    )
    if away_m <= most_m:
        return _no_upload_fits(problem.alone(aircraft), made.alone(aircraft)) or (
            "no update gets through from anywhere on the way: look at the channel "
            "(aerofed link-budget)"
        )
    return (
        f"no device is in reach: the nearest lies {away_m:.0f} m from the start, and the path may "
        f"be {most_m:.0f} m long"
    )


def _no_upload_fits(problem: "RoundProblem", made: "RoundPlan") -> str:
    """Why no upload fits into the limits beside the path, in words; empty where one does."""
    limits, upload_s, flight = problem.limits, problem.upload_s, made.foreseen
    if limits is None or upload_s is None or flight is None:
        return ""
    hover = limits.performance.foresee_hover(float(upload_s.min()))
    for unit, needed, allowed, taken in (
        ("s", hover.duration_s, limits.duration_s, flight.duration_s),
        ("J", hover.energy_j, limits.energy_j, flight.energy_j),
    ):
        if needed > allowed - taken:
            return (
                f"no update can be sent: of the {allowed:.0f} {unit} that the round may take, the "
                f"path leaves {allowed - taken:.0f}, and the quickest upload takes {needed:.0f}: "
                "allow more, or send faster (channel.upload_rate_bps)"
            )
    return ""


_DIGITS = {"value": 4, "upper\nbound": 4, "gap\n%": 2, "served": 0, "nodes": 0, "ms": 0}


def _show(
    plans: "Sequence[NamedPlan]", problems: "Sequence[NamedProblem]", planner: "PlannerConfig"
) -> None:
    """Print the plans as a table, then notes: loose bounds, cut searches, plans serving nobody."""
    _print(plans)
    if loose := planner.loosely_proven([named.plan.gap for named in plans]):
        Terminal(**PLAIN).print(loose)
    limits = (start.limits for entry in problems for start in entry.problem.starts)
    told = {each.performance.best_speeds for each in limits if each and each.energy_j < math.inf}
    for line in sorted(told):
        Terminal(**PLAIN).print(line)
    by_id = {entry.id: entry.problem for entry in problems}
    for named in plans:
        if named.plan.ended:
            Terminal(**PLAIN).print(f"{named.id}: the search: {named.plan.ended}")
        if not named.plan.schedule.any():
            Terminal(**PLAIN).print(f"{named.id}: {_nobody(by_id[named.id], named.plan)}")


def _print(plans: "Sequence[NamedPlan]") -> None:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, collapse_padding=True)
    table.add_column("problem", overflow="fold")
    rows = [_row(named) for named in plans]
    # Only some plans may choose their altitude, or have limits of time and energy.
    headings = [name for name in rows[0] if not all(math.isnan(row[name]) for row in rows)]
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for named, row in zip(plans, rows, strict=True):
        cells = (number(row[heading], _DIGITS.get(heading, 1)) for heading in headings)
        table.add_row(named.id, *cells)
    Terminal.for_tables().print(table)
