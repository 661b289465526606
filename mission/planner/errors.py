"""What can go wrong in planning."""

from typing import TYPE_CHECKING

from mission.base.errors import InputError, PlanError

if TYPE_CHECKING:
    from mission.planner.problem import RoundPlan, RoundProblem


class PlanInputError(InputError):
    """A planning problem that makes no sense as it was given: shapes, NaN, negative values."""


class SolverError(PlanError):
    """A convex solver gave no usable answer; another start or method may succeed."""

    def __init__(self, solver: str, status: str) -> None:
        super().__init__(f"{solver} ended with status {status!r} and no usable solution")
        self.solver = solver
        self.status = status


class BoundError(PlanError):
    """A plan that is worth more than what was proven of all plans: a defect of the planner.

    Attributes:
        problem: the problem that was planned for.
        plan: the plan that was made.
        bound: that no plan was to exceed.
    """

    def __init__(self, problem: "RoundProblem", plan: "RoundPlan", bound: float) -> None:
        super().__init__(
            f"a plan is worth {plan.value!r}, and none was to be worth more than {bound!r}: a "
            "defect of the planner; please report it with the configuration and its seed"
        )
        self.problem, self.plan, self.bound = problem, plan, bound


class InfeasiblePlanError(PlanError):
    """A plan that breaks a constraint of its problem; the message names which, and by how much."""
