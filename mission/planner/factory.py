"""Factory of planners: the one that the configuration's `kind` names."""

from fl.plugins import PlugIn
from mission.base.errors import InfeasiblePlanError, PlanError
from mission.planner.altitudes import CertifiedAltitudes, SampledAltitudes
from mission.planner.certified import CertifiedPlanner, ExploringPlanner, Goal
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.fleet.planner import FleetPlanner
from mission.planner.limited import LimitedPlanner
from mission.planner.plan import Planner, RoundPlan
from mission.planner.problem import RoundProblem

_STARTS, _TRIES = 16, 8  # of paths that are only begun with
_FEW_NODES, _SEARCHES = 500, 10  # where a proof of many altitudes would take longer than the plan


def make_planner(config: PlannerConfig) -> Planner:
    """Return the planner of `config.kind`, wrapped to keep to airspace and a round's limits.

    CVXPY and OSQP are imported here, by the planners that use them.

    Raises:
        UsersCodeError: a planner of the user's own cannot be imported or is none.
    """
    if config.kind != "certified":
        planner = SampledAltitudes(_of_kind(config))
        return FleetPlanner(LimitedPlanner(planner, planner))
    certified = CertifiedPlanner(gap=config.gap, max_nodes=config.max_nodes)
    drawing = ExploringPlanner(starts=_STARTS, tries=_TRIES)
    few = CertifiedPlanner(gap=config.gap, max_nodes=min(config.max_nodes, _FEW_NODES))
    brief = CertifiedAltitudes(few, searches=_SEARCHES)
    inner = LimitedPlanner(CertifiedAltitudes(certified), drawing, certified.goal, brief)
    shares = LimitedPlanner(brief, drawing, Goal(config.gap, 0))
    return FleetPlanner(inner, certified.goal, shares)


def _of_kind(config: PlannerConfig) -> Planner:
    """A planner that proves nothing, for one altitude."""
    if config.factory is not None:
        return CustomPlanner.made(config.factory)
    if config.kind == "sqp":
        from mission.planner.sqp import SqpPlanner

        return SqpPlanner()
    from mission.planner.paper.alternation import PaperPlanner

    return PaperPlanner(literal=config.kind == "paper_literal")


class CustomPlanner(PlugIn):
    """A researcher's own planner, every plan of which is checked."""

    setting = "planner.factory"
    members = ("plan",)

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round with the researcher's planner, and check the plan.

        Raises:
            PlanError: the plan breaks a constraint, or claims a value that it has not.
        """
        plan = self.of_kind(self.ask("plan", problem), RoundPlan, "plan()")
        try:
            with self.guarded("its plan"):
                check_plan(problem, plan)
        except InfeasiblePlanError as error:
            raise PlanError(f"{self.key} = {self.name!r}: {error}") from None
        return plan
