"""What `aerofed plan` does, apart from reading its arguments."""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from mission.base.errors import InputError, PlanError
from mission.config.area import AreaConfig
from mission.planner.check import check_plan
from mission.planner.files import NamedPlan, NamedProblem, write_plans
from mission.planner.flyable import foresee_round
from mission.planner.problem import RoundPlan, RoundProblem
from mission.scenario.strategies import Sortie


def plan_problems(
    problems: Sequence[NamedProblem],
    *,
    method: Callable[[RoundProblem], Sortie],
    out: Path | None = None,
    figure_dir: Path | None = None,
    about: str = "",
    communities: Sequence[str] = (),
    area: AreaConfig | None = None,
) -> tuple[Sequence[NamedPlan], PlanError | None]:
    """Plan every problem, and write the plans and a picture of each where asked.

    Returns the plans, and an error with a line for each problem that could not be planned.

    A problem that cannot be planned costs none of the others' plans. Every plan is checked
    against its problem before anything is written. `about` says on the pictures whose they are,
    `communities` colours their devices, and `area` is what they stand on.

    Raises:
        InputError: the output cannot be written, or a picture is there already.
        PlanError: none of the problems can be planned; nothing is written.
    """
    files = {entry.id: _file_name(n, entry.id) for n, entry in enumerate(problems)}
    there = [] if figure_dir is None else [figure_dir / file for file in files.values()]
    for picture in there:
        if picture.exists():
            raise InputError(f"{picture}: exists already; give another folder")
    plans, failure = _plan_each(problems, method)
    if failure is not None and not plans:
        raise failure
    if out is not None:
        write_plans(out, plans)
    if figure_dir is not None:
        from mission.figures.plan import plan_picture
        from mission.figures.render import save_all

        tasks = {entry.id: entry.problem for entry in problems}
        pictures = {
            files[made.id]: plan_picture(
                tasks[made.id],
                made.plan,
                title=made.id,
                about=about,
                communities=communities,
                size_m=None if area is None else area.size_m,
                no_fly=() if area is None else [zone.model_dump() for zone in area.no_fly],
                buildings=() if area is None else area.build().buildings,
            )
            for made in plans
        }
        save_all(pictures, figure_dir)
    return plans, failure


def _plan_each(
    problems: Sequence[NamedProblem], method: Callable[[RoundProblem], Sortie]
) -> tuple[Sequence[NamedPlan], PlanError | None]:
    plans, failures = [], []
    for entry in problems:
        started = time.perf_counter()
        try:
            sortie = method(entry.problem)
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
