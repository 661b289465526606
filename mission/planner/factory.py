"""Factory of planners: the one that the configuration's `kind` names."""

from dataclasses import replace

from fl.plugins import PlugIn
from mission.base.errors import InfeasiblePlanError, PlanError
from mission.base.explain import shown
from mission.planner.altitudes import CertifiedAltitudes, SampledAltitudes
from mission.planner.certified import CertifiedPlanner, ExploringPlanner
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.fleet.planner import FleetPlanner
from mission.planner.limited import LimitedPlanner
from mission.planner.native.library import Goal
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
        own = _of_kind(config)
        planner = SampledAltitudes(own)
        joint = own if getattr(own, "several", False) else None
        return FleetPlanner(LimitedPlanner(planner, planner), joint=joint)
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
    from mission.planner.paper import PaperPlanner

    return PaperPlanner(literal=config.kind == "paper_literal")


class CustomPlanner(PlugIn):
    """A researcher's own planner, every plan of which is checked."""

    setting = "planner.factory"
    members = ("plan",)

    @property
    def several(self) -> bool:
        """Whether it plans for several aircraft at once."""
        several = getattr(self.inner, "several", False)
        if not isinstance(several, bool):
            self.refuse(f"several is {shown(several)}: must be True or False")
        return several

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round with the researcher's planner, and check the plan, but for distances of
        aircraft: those that come too near are mended.

        Raises:
            PlanError: the plan breaks a constraint, or claims a value that it has not.
        """
        plan = self.of_kind(self.ask("plan", problem), RoundPlan, "plan()")
        try:
            with self.guarded("its plan"):
                check_plan(replace(problem, separation_m=0.0), plan)
        except InfeasiblePlanError as error:
            raise PlanError(f"{self.key} = {self.name!r}: {error}") from None
        return plan
