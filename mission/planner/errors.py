"""What can go wrong in planning."""

from mission.base.errors import InputError, PlanError


class PlanInputError(InputError):
    """A planning problem that makes no sense as it was given: shapes, NaN, negative values."""


class SolverError(PlanError):
    """A convex solver gave no usable answer; another start or method may succeed."""

    def __init__(self, solver: str, status: str) -> None:
        super().__init__(f"{solver} ended with status {status!r} and no usable solution")
        self.solver = solver
        self.status = status


class InfeasiblePlanError(PlanError):
    """A plan that breaks a constraint of its problem; the message names which, and by how much."""
