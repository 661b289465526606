"""Rounds planned without flying them."""

from collections.abc import Mapping
from pathlib import Path

from mission.api.configuring import Source, config, folder
from mission.base.errors import InputError
from mission.base.explain import Blame, explained, shown
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import check_problem
from mission.planner.plan import Planner, RoundPlan
from mission.planner.problem import RoundProblem


def plan(
    problem: "RoundProblem | Mapping[str, object]",
    planner: "str | Planner" = "certified",
    **options: float,
) -> "RoundPlan":
    """Plan one round; the plan is checked against every constraint of the problem.

    Args:
        problem: where devices stand and what they are worth; see `first_problem`. Or the keys of a
            problem as `problems.json` has them (docs/planner.md); `id` may be missing.
        planner: "certified", "sqp", "paper", "paper_literal", or an object with `plan(problem)`.
        options: keys of the table `planner` of a configuration: `gap=0.001`.

    Raises:
        InputError: no such planner, an option is refused, or the problem makes no sense.
        PlanError: the plan breaks a constraint.
    """
    from mission.planner.factory import make_planner

    if isinstance(problem, Mapping):
        from mission.planner.files import problems_of

        (entry,) = problems_of([{"id": "problem", **problem}], "problem")
        problem = entry.problem
    check_problem(problem)
    if isinstance(planner, str):
        given = {"kind": planner, **options}
        with explained(PlannerConfig, given, Blame("planner")):
            method = make_planner(PlannerConfig.model_validate(given))
    elif options:
        raise InputError(f"planner: {', '.join(options)}: options belong to a planner by name")
    elif isinstance(planner, type) or not callable(getattr(planner, "plan", None)):
        raise InputError(
            f"planner = {shown(planner)}: must be a planner's name, or an object with plan(problem)"
        )
    else:
        method = planner
    made = method.plan(problem)
    if not isinstance(made, RoundPlan):
        raise InputError(
            f"planner: plan(problem) gave {shown(made)}: must be a RoundPlan, such as finish() "
            "makes"
        )
    check_plan(problem, made)
    return made


def first_problem(
    source: Source = "quickstart",
    overrides: Mapping[str, object] | None = None,
    *,
    data_dir: Path | str | None = None,
) -> "RoundProblem":
    """The planning problem of a configuration's first round: from where its strategy begins, with
    the importance that it gives devices.

    `problem.with_own(path_budget_m=400.0)` makes others of it.

    Raises:
        InputError: the configuration is refused, or its data are missing or damaged.
    """
    from mission.scenario.scenario import build_scenario

    resolved = config(source, overrides)
    return build_scenario(resolved, data_dir=folder(data_dir)).first_problem()
