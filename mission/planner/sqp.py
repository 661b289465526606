"""Large instances: sequential quadratic programming on the true objective (the home of osqp).

The program's variables are the step d of the free waypoints and the leg lengths l. Its objective
is the exact gradient and the clipped, block-diagonal Hessian of the reward under the present
assignment. A leg is at least as long as its projection on each of `DIRECTIONS` fixed directions
over cos(pi / DIRECTIONS), which errs on the safe side; all legs together keep the budget; a
trust region bounds d. The sparsity never changes: between iterations only the numbers are
updated, and OSQP starts warm from the step before.
"""

import math

import numpy as np
import osqp
from scipy import sparse
from scipy.spatial import cKDTree

from mission.base.arrays import Floats, Ints
from mission.planner.arrays import instance
from mission.planner.certified import STARTS, tries
from mission.planner.errors import SolverError
from mission.planner.evaluate import finish, fit_budget, plan_without_moving
from mission.planner.native.library import Devices, Limits, explore
from mission.planner.problem import RoundPlan, RoundProblem
from mission.planner.schedule import assign

DIRECTIONS = 12
MAX_ITERATIONS = 12
FIRST_TRUST_M = 5.0
LAST_TRUST_M = 0.5
RISE = 1e-4  # relative rise of the objective under which the iteration ends
LEAST_SHARE = 1e-3  # of the best f: beyond, a step and a device are no neighbours


MAX_SPLITTINGS = 500
# A step only has to be good: it is kept if the true objective rises, however exact it is.
USABLE = (
    osqp.SolverStatus.OSQP_SOLVED,
    osqp.SolverStatus.OSQP_SOLVED_INACCURATE,
    osqp.SolverStatus.OSQP_MAX_ITER_REACHED,
)


class SqpPlanner:
    """Explored first plan, then sequential quadratic programs; hundreds of devices.

    No bound is proven: `upper_bound` is NaN where anything had to be decided.

    Args:
        starts: devices that first paths are built towards.
        tries: how often the best of them are cut and mended; by default more for more devices.
    """

    def __init__(self, *, starts: int = STARTS, tries: int | None = None) -> None:
        self._starts = starts
        self._tries = tries

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanInputError: the problem makes no sense.
            SolverError: OSQP gave no solution.
        """
        if (at_rest := plan_without_moving(problem)) is not None:
            return at_rest
        devices, limits = instance(problem)
        attempts = tries(len(devices.delta)) if self._tries is None else self._tries
        _, way, _ = explore(devices, limits, starts=self._starts, tries=attempts)
        way = ascend(way, devices, limits)
        return finish(problem, fit_budget(problem.start_m + way, problem.path_budget_m))


def ascend(way: Floats, devices: Devices, limits: Limits) -> Floats:
    """Sequential quadratic programming from `way` (N, 2), the start at the origin.

    Every accepted step raises the true objective under its optimal assignment.

    Raises:
        SolverError: OSQP gave no solution.
    """
    program = StepProgram(limits.steps)
    value, steps, served = match(way, devices, limits)
    trust = FIRST_TRUST_M
    for _ in range(MAX_ITERATIONS):
        gradient, hessian = model(way, steps, served, devices)
        step = program.solve(way, gradient, hessian, budget_m=limits.length, trust_m=trust)
        trial = way.copy()
        trial[1:] += step
        trial = fit_budget(trial, limits.length)
        better, new_steps, new_served = match(trial, devices, limits)
        if better <= value:
            trust *= 0.3
            if trust < LAST_TRUST_M:
                break
            continue
        small = better - value < RISE * value
        way, value, steps, served = trial, better, new_steps, new_served
        if small:
            break
        trust *= 1.5
    return way


def match(way: Floats, devices: Devices, limits: Limits) -> tuple[float, Ints, Ints]:
    """(value, steps, devices) of the optimal assignment, looking at neighbours only."""
    share = devices.rows[:, 0]
    beyond = np.flatnonzero(share < LEAST_SHARE * share[0])
    reach = float(beyond[0]) if len(beyond) else float(len(share))
    distance, _ = cKDTree(way).query(devices.u, distance_upper_bound=reach)
    near = np.flatnonzero(np.isfinite(distance))
    offset = way[:, None, :] - devices.u[near][None, :, :]
    f, _, _ = reward(np.hypot(offset[..., 0], offset[..., 1]), devices.rows)
    schedule = assign(f, devices.delta[near], limits.per_step)
    steps, columns = np.nonzero(schedule)
    served = near[columns]
    return float((f[steps, columns] * devices.delta[served]).sum()), steps, served


def reward(r: Floats, rows: Floats) -> tuple[Floats, Floats, Floats]:
    """(f, f', f'') from the 1 m table, expanded about the nearest row."""
    index = np.minimum(np.rint(r).astype(np.int64), len(rows) - 1)
    d = r - index
    f, f1, f2 = rows[index].T
    f, f1, f2 = f.T, f1.T, f2.T
    return f + (f1 + 0.5 * f2 * d) * d, f1 + f2 * d, f2


def model(way: Floats, steps: Ints, served: Ints, devices: Devices) -> tuple[Floats, Floats]:
    """Gradient (N, 2) and negated, clipped Hessian blocks (N, 3: xx, xy, yy) of the reward."""
    offset = way[steps] - devices.u[served]
    r = np.hypot(offset[:, 0], offset[:, 1])
    _, f1, f2 = reward(r, devices.rows)
    delta = devices.delta[served]
    nx, ny = (offset / np.maximum(r, 1e-9)[:, None]).T
    radial = delta * np.maximum(-f2, 0.0)
    across = np.where(r > 1e-6, delta * np.maximum(-f1, 0.0) / np.maximum(r, 1e-6), radial)
    gradient, hessian = np.zeros((len(way), 2)), np.zeros((len(way), 3))
    np.add.at(gradient, steps, np.stack([delta * f1 * nx, delta * f1 * ny], axis=1))
    blocks = np.stack(
        [
            radial * nx * nx + across * ny * ny,
            (radial - across) * nx * ny,
            radial * ny * ny + across * nx * nx,
        ],
        axis=1,
    )
    np.add.at(hessian, steps, blocks)
    return gradient, hessian


class StepProgram:
    """The quadratic program of one path size; its sparsity is set up once.

    Made anew for every plan: a solver that has seen other problems would step differently.
    """

    def __init__(self, steps: int) -> None:
        self._legs = legs = steps - 1
        angles = 2.0 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
        self._directions = np.stack([np.cos(angles), np.sin(angles)], axis=1) / math.cos(
            math.pi / DIRECTIONS
        )
        # Waypoint n ends leg n and begins leg n + 1; the start does not move.
        difference = sparse.eye(legs) - sparse.eye(legs, k=-1)
        project = sparse.kron(difference, self._directions)
        lengths = -sparse.kron(sparse.eye(legs), np.ones((DIRECTIONS, 1)))
        total = sparse.hstack([sparse.csc_matrix((1, 2 * legs)), np.ones((1, legs))])
        box = sparse.hstack([sparse.eye(2 * legs), sparse.csc_matrix((2 * legs, legs))])
        matrix = sparse.vstack([sparse.hstack([project, lengths]), total, box], format="csc")
        block = sparse.kron(sparse.eye(legs), np.ones((2, 2)))
        pattern = sparse.block_diag([block, sparse.csc_matrix((legs, legs))])
        self._pattern = sparse.triu(pattern, format="csc")
        self._pattern.sort_indices()
        self._rows = legs * DIRECTIONS
        self._bounds = np.full((2, matrix.shape[0]), -np.inf)
        self._bounds[1] = np.inf
        self._solver = osqp.OSQP()
        self._solver.setup(
            self._pattern,
            np.zeros(3 * legs),
            matrix,
            self._bounds[0],
            self._bounds[1],
            verbose=False,
            eps_abs=1e-3,
            eps_rel=1e-3,
            max_iter=MAX_SPLITTINGS,
            polishing=False,
            # Counted in iterations; a timed interval would make plans differ between runs.
            adaptive_rho_interval=50,
        )

    def solve(
        self, way: Floats, gradient: Floats, hessian: Floats, *, budget_m: float, trust_m: float
    ) -> Floats:
        """(N - 1, 2) the best step of the free waypoints.

        Raises:
            SolverError: no solution.
        """
        legs = self._legs
        # The reward is scaled so that its steepest slope is 1 a metre.
        scale = 1.0 / max(float(np.abs(gradient[1:]).max()), 1e-300)
        xx, xy, yy = (hessian[1:] * scale).T
        floor = 1e-4
        entries = np.stack([xx + floor, xy, yy + floor], axis=1)  # by column: (0,0) (0,1) (1,1)
        cost = np.concatenate([-scale * gradient[1:].ravel(), np.zeros(legs)])
        lower, upper = self._bounds
        upper[: self._rows] = -(np.diff(way, axis=0) @ self._directions.T).ravel()
        # A feasible path stays feasible under the polygon's excess: not moving is a solution.
        polygon = float((np.diff(way, axis=0) @ self._directions.T).max(axis=1).sum())
        upper[self._rows] = max(budget_m, polygon * (1.0 + 1e-9))
        lower[self._rows + 1 :] = -trust_m
        upper[self._rows + 1 :] = trust_m
        self._solver.update(Px=entries.ravel(), q=cost, l=lower, u=upper)
        result = self._solver.solve(raise_error=False)
        if result.info.status_val not in USABLE:
            raise SolverError("osqp", result.info.status)
        return np.asarray(result.x[: 2 * legs]).reshape(legs, 2)
