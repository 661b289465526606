"""What `aerofed plan` does, apart from reading its arguments."""

import math
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from fl.plugin_code import label_of
from mission.base.console import PLAIN, Terminal
from mission.base.errors import InputError, PlanError
from mission.base.tables import number
from mission.config.models import RunConfig
from mission.planner.apart import nearest
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner
from mission.planner.files import NamedPlan, NamedProblem, read_problems, write_plans
from mission.planner.flyable import foresee_round
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem
from mission.scenario.scenario import Scenario, build_scenario
from mission.scenario.strategies import FIXED_PATHS, Optimised, Sortie, Strategy


@dataclass(frozen=True)
class PlanningTask:
    """Problems to plan, the strategy that plans them, and the scenario that they come from."""

    problems: Sequence[NamedProblem]
    strategy: Strategy
    about: str  # for people: whose plans they are
    scenario: Scenario | None = None  # None: the problems are of a file


def plan_problems(
    task: PlanningTask, *, out: Path | None = None, figure_dir: Path | None = None
) -> tuple[Sequence[NamedPlan], PlanError | None]:
    """Plan every problem, and write the plans and a picture of each where asked.

    Returns the plans, and an error with a line for each problem that could not be planned.

    A problem that cannot be planned costs none of the others' plans. Every plan is checked
    against its problem before anything is written.

    Raises:
        InputError: the output cannot be written, or a picture is there already.
        PlanError: none of the problems can be planned; nothing is written.
    """
    files = {entry.id: _file_name(n, entry.id) for n, entry in enumerate(task.problems)}
    there = [] if figure_dir is None else [figure_dir / file for file in files.values()]
    for picture in there:
        if picture.exists():
            raise InputError(f"{picture}: exists already; give another folder")
    plans, failure = _plan_each(task)
    if failure is not None and not plans:
        raise failure
    if out is not None:
        write_plans(out, plans)
    if figure_dir is not None:
        from mission.figures.plan import plan_picture
        from mission.figures.render import save_all

        problems = {entry.id: entry.problem for entry in task.problems}
        about = {"about": task.about, **_around(task.scenario)}
        pictures = {
            files[made.id]: plan_picture(problems[made.id], made.plan, title=made.id, **about)
            for made in plans
        }
        save_all(pictures, figure_dir)
    return plans, failure


def _around(scenario: Scenario | None) -> dict[str, Any]:
    """What pictures show beside the problem of a scenario: who flies and stands there, on what."""
    if scenario is None:
        return {}
    area = scenario.config.area
    return {
        "aircraft": scenario.aircraft,
        "communities": scenario.community_of,
        "size_m": area.size_m,
        "no_fly": [zone.model_dump() for zone in area.no_fly],
        "buildings": area.build().buildings,
    }


def _plan_each(task: PlanningTask) -> tuple[Sequence[NamedPlan], PlanError | None]:
    plans, failures = [], []
    for entry in task.problems:
        started = time.perf_counter()
        try:
            sortie = task.strategy.sortie(0, entry.problem)
            seconds = time.perf_counter() - started
            check_plan(entry.problem, sortie.plan, hold_s=sortie.hold_s)
            made = _timed(entry.problem, sortie)
        except PlanError as error:
            failures.append(f"problem {entry.id!r}: {error}")
        else:
            plans.append(NamedPlan(entry.id, made, seconds, sortie.hold_s))
    return plans, PlanError("\n".join(failures)) if failures else None


def _timed(problem: RoundProblem, sortie: Sortie) -> RoundPlan:
    """Return the plan with foreseen times and energies, where limited and not yet in it."""
    plan = sortie.plan
    paths = tuple(
        path
        if start.limits is None or path.foreseen is not None
        else replace(
            path, foreseen=foresee_round(problem.alone(a), plan.alone(a), hold_s=sortie.hold_s)
        )
        for a, (start, path) in enumerate(zip(problem.starts, plan.paths, strict=True))
    )
    return replace(plan, paths=paths)


def _file_name(number: int, name: str) -> str:
    """Return the picture's file name for a problem's id (free text), unique by the number."""
    safe = re.sub(r"[^A-Za-z0-9._-]+", "_", name)[:60]
    return f"{number:03d}-{safe}.png"


def first_round(config: RunConfig, data_dir: Path | None) -> PlanningTask:
    """The first round of a configuration, planned by its strategy.

    Raises:
        InputError: it flies nothing; or as `build_scenario`.
    """
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
    return PlanningTask(problems, scenario.strategy, about, scenario)


def problems_of_file(path: Path, config: RunConfig) -> PlanningTask:
    """The problems of a file, planned by the configured planner; raises as `read_problems`."""
    problems = read_problems(path)
    strategy = Optimised(make_planner(config.planner), fairness=True)
    return PlanningTask(problems, strategy, f"{path} · planner {config.planner.kind}")


def write_qgc(path: Path, problem: RoundProblem, made: NamedPlan, scenario: Scenario) -> None:
    """Write a QGroundControl plan of a round."""
    # Only here: it takes a third of a second to import.
    from mission.flight.missions.plan_file import write_round_plan
    from mission.flight.missions.round_mission import flight_of_round

    mission = scenario.config.mission
    flight = flight_of_round(problem, made.plan, hold_s=made.hold_s, mission=mission)
    write_round_plan(path, flight, scenario.area)


def _row(named: NamedPlan, problem: RoundProblem) -> dict[str, float]:
    """Return a plan's row of the table, by heading; NaN for what the plan does not have."""
    made = named.plan
    flights = [path.foreseen for path in made.paths if path.foreseen]  # where it is limited
    heights = {path.altitude_m for path in made.paths}
    near = nearest(problem, made, hold_s=named.hold_s) if problem.separation_m else None
    return {
        "value": made.value,
        "upper\nbound": made.upper_bound,
        "gap\n%": 100.0 * made.gap,
        "path\nm": made.path_m,
        "alt.\nm": (heights.pop() if len(heights) == 1 else None) or math.nan,
        "takes\ns": max((flight.duration_s for flight in flights), default=math.nan),
        "takes\nkJ": sum(flight.energy_j for flight in flights) / 1000.0 or math.nan,
        "apart\nm": math.nan if near is None else near.away_m,
        "served": int(made.schedule.sum()),
        "nodes": made.nodes,
        "ms": 1e3 * named.time_s,
    }


def _nobody(problem: RoundProblem, made: RoundPlan) -> str:
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


def _no_upload_fits(problem: RoundProblem, made: RoundPlan) -> str:
    """Why no upload fits into the limits beside the path, in words; empty where one does."""
    limits, upload_s, flight = problem.limits, problem.upload_s, made.foreseen
    if limits is None or upload_s is None or flight is None:
        return ""
    hover = limits.performance.foresee_hover(float(upload_s.min()))
    for limit in limits.each:
        needed, left = limit.taken(hover), limit.most - limit.taken(flight)
        if needed > left:
            return (
                f"no update can be sent: of the {limit.most:.0f} {limit.unit} that the round may "
                f"take, the path leaves {left:.0f}, and the quickest upload takes {needed:.0f}: "
                "allow more, or send faster (channel.upload_rate_bps)"
            )
    return ""


_DIGITS = {"value": 4, "upper\nbound": 4, "gap\n%": 2, "served": 0, "nodes": 0, "ms": 0}


def show(
    plans: Sequence[NamedPlan], problems: Sequence[NamedProblem], planner: PlannerConfig
) -> None:
    """Print the plans as a table, then notes: loose bounds, cut searches, plans serving nobody."""
    by_id = {entry.id: entry.problem for entry in problems}
    _print(plans, by_id)
    if loose := planner.loosely_proven([named.plan.gap for named in plans]):
        Terminal(**PLAIN).print(loose)
    limits = (start.limits for entry in problems for start in entry.problem.starts)
    told = {each.performance.best_speeds for each in limits if each and each.energy_j < math.inf}
    for line in sorted(told):
        Terminal(**PLAIN).print(line)
    for named in plans:
        if named.plan.mended:
            Terminal(**PLAIN).print(f"{named.id}: {named.plan.mended}")
        if named.plan.ended:
            Terminal(**PLAIN).print(f"{named.id}: the search: {named.plan.ended}")
        if not named.plan.schedule.any():
            Terminal(**PLAIN).print(f"{named.id}: {_nobody(by_id[named.id], named.plan)}")


def _print(plans: Sequence[NamedPlan], problems: Mapping[str, RoundProblem]) -> None:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, collapse_padding=True)
    table.add_column("problem", overflow="fold")
    rows = [_row(named, problems[named.id]) for named in plans]
    # Only some plans may choose their altitude, or have limits of time and energy.
    headings = [name for name in rows[0] if not all(math.isnan(row[name]) for row in rows)]
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for named, row in zip(plans, rows, strict=True):
        cells = (number(row[heading], _DIGITS.get(heading, 1)) for heading in headings)
        table.add_row(named.id, *cells)
    Terminal.for_tables().print(table)
