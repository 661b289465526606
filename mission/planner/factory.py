"""From the configuration's `kind` to a planner."""

from mission.planner.config import PlannerConfig
from mission.planner.problem import Planner


def make_planner(config: PlannerConfig) -> Planner:
    """The planner of that kind. Its solver library is imported here, not before."""
    from mission.planner.paper import LiteralPlanner, PaperPlanner

    return LiteralPlanner() if config.kind == "paper_literal" else PaperPlanner()
