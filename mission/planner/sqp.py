"""All waypoints of a plan moved at once, by sequential quadratic programs (the home of osqp).

A program's variables are the step d of the free waypoints and the lengths l of the legs. It
maximises the reward of the present schedule, by its exact gradient and clipped, block-diagonal
Hessian, over a trust region |d| <= t. A leg is at least as long as its projection on each of
`_DEGREES` about its present direction, so that lengths are exact to first order and grow as the leg
turns. The legs keep to the metres that the round may fly.

The sparsity never changes: from step to step only numbers are updated, and OSQP starts warm. A step
is kept where the plan along the moved waypoints, scheduled anew, is worth more.
"""

import math
from dataclasses import dataclass

import numpy as np
import osqp
from scipy import sparse

from mission.base.arrays import Floats, Ints
from mission.base.errors import SolverError
from mission.planner.certified import ExploringPlanner, in_usual_size, reach_of
from mission.planner.evaluate import fit_budget, plan_along
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem
from mission.planner.reward import reward_table

_DEGREES = (0.0, 10.0, -10.0, 25.0, -25.0, 50.0, -50.0, 90.0, -90.0, 135.0, -135.0, 180.0)
_COSINES = np.array([math.cos(math.radians(angle)) for angle in _DEGREES])
_SINES = np.array([math.sin(math.radians(angle)) for angle in _DEGREES])
_MOST_STEPS = 25
_FIRST_TRUST_M, _LAST_TRUST_M = 30.0, 1.0
_GROW, _SHRINK = 1.5, 0.35
_RISE = 1e-4  # relative rise of the objective under which the steps end
_FLOOR = 1e-4  # of the Hessian, where the steepest slope is 1 a metre
_MOST_SPLITTINGS = 500
# A step only has to be good: it is kept if the true objective rises, however exact it is.
_USABLE = (
    osqp.SolverStatus.OSQP_SOLVED,
    osqp.SolverStatus.OSQP_SOLVED_INACCURATE,
    osqp.SolverStatus.OSQP_MAX_ITER_REACHED,
)


class SqpPlanner:
    """Planner for hundreds of devices: a heuristic path, improved by quadratic programs (SQP).

    No bound is proven: `upper_bound` is NaN where anything had to be decided.
    """

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanInputError: the problem makes no sense.
            SolverError: OSQP gave no solution.
        """
        if (plan := in_usual_size(self, problem)) is not None:
            return plan
        return ascended(problem, ExploringPlanner().plan(problem))


def ascended(problem: RoundProblem, plan: RoundPlan) -> RoundPlan:
    """Improve a plan by SQP steps, each of which must raise its value. Only for open airspace and
    without limits of time and energy.

    Raises:
        SolverError: OSQP gave no solution.
    """
    if problem.steps < 2 or plan.value <= 0.0:
        return plan
    program = StepProgram(problem.steps)
    trust_m, model = _FIRST_TRUST_M, surroundings(problem, plan)
    for _ in range(_MOST_STEPS):
        moved = plan.waypoints_m.copy()
        moved[1:] += program.solve(model, trust_m)
        other = plan_along(problem, fit_budget(moved, problem.path_budget_m))
        if not other.value > plan.value:
            trust_m *= _SHRINK
            if trust_m < _LAST_TRUST_M:
                break
            continue
        ended = other.value < plan.value * (1.0 + _RISE)
        plan, model = other, surroundings(problem, other)
        if ended:
            break
        trust_m *= _GROW
    return plan


@dataclass(frozen=True)
class Surroundings:
    """Local quadratic model of the reward about a plan of N waypoints, N - 1 legs."""

    gradient: Floats  # (N - 1, 2) of the reward, by free waypoint
    hessian: Floats  # (N - 1, 3) xx, xy, yy of minus the reward, positive semidefinite
    legs: Floats  # (N - 1, 2) that end there
    spare_m: float  # metres that the path may be longer


def surroundings(problem: RoundProblem, plan: RoundPlan) -> Surroundings:
    """Return the local quadratic model of the reward about a plan."""
    gradient, hessian = reward_model(problem, plan)
    legs = np.diff(plan.waypoints_m, axis=0)
    return Surroundings(gradient[1:], hessian[1:], legs, problem.path_budget_m - plan.path_m)


def reward_model(problem: RoundProblem, plan: RoundPlan) -> tuple[Floats, Floats]:
    """Gradient (N, 2) and negated, clipped Hessian blocks (N, 3: xx, xy, yy) of the reward."""
    steps, served = np.nonzero(plan.schedule[0])
    offset = plan.waypoints_m[steps] - problem.devices_m[served]
    r = np.hypot(*offset.T)
    _, f1, f2 = reward_table(problem.channel, reach_of(problem)).expanded(r)
    delta = problem.importance[served]
    nx, ny = (offset / np.maximum(r, 1e-9)[:, None]).T
    radial = delta * np.maximum(-f2, 0.0)
    across = np.where(r > 1e-6, delta * np.maximum(-f1, 0.0) / np.maximum(r, 1e-6), radial)
    gradient, hessian = np.zeros((problem.steps, 2)), np.zeros((problem.steps, 3))
    np.add.at(gradient, steps, np.stack([delta * f1 * nx, delta * f1 * ny], axis=1))
    blocks = [
        radial * nx * nx + across * ny * ny,
        (radial - across) * nx * ny,
        radial * ny * ny + across * nx * nx,
    ]
    np.add.at(hessian, steps, np.stack(blocks, axis=1))
    return gradient, hessian


class StepProgram:
    """The quadratic program of one number of steps; its sparsity is set up once.

    Made anew for every plan: a solver that has seen other problems would step differently.
    """

    def __init__(self, steps: int) -> None:
        self._legs = legs = steps - 1
        self._rows = rows = legs * len(_DEGREES)
        many = 3 * legs
        # Of every number that the constraints hold: its row, its column.
        row, leg = np.arange(rows), np.repeat(np.arange(legs), len(_DEGREES))
        entries: list[tuple[Ints, Ints]] = [(row, 2 * leg + axis) for axis in (0, 1)]
        entries += [(row[leg > 0], 2 * leg[leg > 0] - 2 + axis) for axis in (0, 1)]
        entries.append((row, 2 * legs + leg))
        entries.append((np.full(legs, rows), 2 * legs + np.arange(legs)))
        entries.append((rows + 1 + np.arange(2 * legs), np.arange(2 * legs)))
        i, j = (np.concatenate(column) for column in zip(*entries, strict=True))
        numbered = sparse.csc_matrix((np.arange(1, len(i) + 1), (i, j)))
        self._order = numbered.data - 1
        matrix = sparse.csc_matrix(
            (np.ones(len(i)), numbered.indices, numbered.indptr), numbered.shape
        )
        block = sparse.kron(sparse.eye(legs), np.ones((2, 2)))
        nothing = sparse.csc_matrix((legs, legs))
        pattern = sparse.triu(sparse.block_diag([block, nothing]), format="csc")
        pattern.sort_indices()
        self._lower, self._upper = np.full((2, matrix.shape[0]), [[-np.inf], [np.inf]])
        self._solver = osqp.OSQP()
        self._solver.setup(
            pattern, np.zeros(many), matrix, self._lower, self._upper, verbose=False,
            eps_abs=1e-3, eps_rel=1e-3, max_iter=_MOST_SPLITTINGS, polishing=False,
            # Counted in iterations; a timed interval would make plans differ between runs.
            adaptive_rho_interval=50,
        )  # fmt: skip

    def solve(self, model: Surroundings, trust_m: float) -> Floats:
        """Return the step (N - 1, 2) of the free waypoints in metres, each axis within `trust_m`.

        Raises:
            SolverError: OSQP gave no solution.
        """
        legs, lower, upper = self._legs, self._lower, self._upper
        length = np.hypot(*model.legs.T)[:, None]
        u = np.where(length > 0.0, model.legs / np.maximum(length, 1e-300), (1.0, 0.0))
        left = np.column_stack((-u[:, 1], u[:, 0]))
        # (legs, angles, 2)
        along = _COSINES[:, None] * u[:, None] + _SINES[:, None] * left[:, None]
        entries = [along[..., axis].ravel() for axis in (0, 1)]
        entries += [-along[1:, :, axis].ravel() for axis in (0, 1)]
        entries += [np.full(self._rows, -1.0), np.ones(legs), np.ones(2 * legs)]
        upper[: self._rows] = -(along * model.legs[:, None]).sum(axis=2).ravel()
        upper[self._rows] = length.sum() + model.spare_m
        lower[self._rows + 1 :], upper[self._rows + 1 :] = -trust_m, trust_m
        # The reward is scaled so that its steepest slope is 1 a metre.
        scale = 1.0 / max(float(np.abs(model.gradient).max()), 1e-300)
        xx, xy, yy = (model.hessian * scale).T
        curved = np.stack([xx + _FLOOR, xy, yy + _FLOOR], axis=1)  # by column: (0,0) (0,1) (1,1)
        cost = np.concatenate([-scale * model.gradient.ravel(), np.zeros(legs)])
        numbers = np.concatenate(entries)[self._order]
        self._solver.update(Px=curved.ravel(), Ax=numbers, q=cost, l=lower, u=upper)
        result = self._solver.solve(raise_error=False)
        if result.info.status_val not in _USABLE:
            raise SolverError("osqp", result.info.status)
        return np.asarray(result.x[: 2 * legs]).reshape(legs, 2)
