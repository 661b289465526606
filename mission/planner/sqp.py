"""All waypoints of a plan moved at once, by sequential quadratic programs (the home of osqp).

A program's variables are the step d of the free waypoints and the lengths l of the legs. It
maximises the reward of the present schedule, by its exact gradient and clipped, block-diagonal
Hessian, over a trust region |d| <= t. A leg is at least as long as its projection on each of
`_DEGREES` about its present direction, so that lengths are exact to first order and grow as the leg
turns. The legs keep to the metres that the round may fly, and, where time or energy is limited, to
the seconds: those are the legs' lengths over the speed, and the gradient of what the flight's
corners take beyond that. Where the path leads around areas, a leg is what is straight of it at
either end.

The sparsity never changes: from step to step only numbers are updated, and OSQP starts warm. A step
is kept where the plan along the moved waypoints, made to fit and scheduled anew, is worth more.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import osqp
from scipy import sparse

from mission.base import polyline
from mission.base.arrays import Floats, Ints
from mission.planner.certified import ExploringPlanner, reach_of
from mission.planner.errors import SolverError
from mission.planner.evaluate import plan_along
from mission.planner.fitting import fitted
from mission.planner.flyable import share_of
from mission.planner.problem import Planner, RoundPlan, RoundProblem
from mission.planner.reward import reward_table
from mission.planner.stops import SAME_PLACE_M, stops_of

_DEGREES = (0.0, 10.0, -10.0, 25.0, -25.0, 50.0, -50.0, 90.0, -90.0, 135.0, -135.0, 180.0)
_COSINES = np.array([math.cos(math.radians(angle)) for angle in _DEGREES])
_SINES = np.array([math.sin(math.radians(angle)) for angle in _DEGREES])
_MOST_STEPS = 25
_FIRST_TRUST_M, _LAST_TRUST_M = 30.0, 1.0
_GROW, _SHRINK = 1.5, 0.35
_RISE = 1e-4  # relative rise of the objective under which the steps end
_CORRECTIONS = 2  # of a step whose corners took longer than linear
_NUDGE = 0.25  # of the trust region: how far stops are nudged to see what corners take
_FLOOR = 1e-4  # of the Hessian, where the steepest slope is 1 a metre
_MOST_SPLITTINGS = 500
# A step only has to be good: it is kept if the true objective rises, however exact it is.
_USABLE = (
    osqp.SolverStatus.OSQP_SOLVED,
    osqp.SolverStatus.OSQP_SOLVED_INACCURATE,
    osqp.SolverStatus.OSQP_MAX_ITER_REACHED,
)
_NONE = (
    osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE,
    osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE_INACCURATE,
)


class SqpPlanner:
    """Explored paths, the best of them improved by quadratic programs: for hundreds of devices.

    No bound is proven: `upper_bound` is NaN where anything had to be decided.
    """

    def __init__(self, explored: Planner | None = None) -> None:
        self._explored = explored or ExploringPlanner()

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanInputError: the problem makes no sense.
            SolverError: OSQP gave no solution.
        """
        return ascended(problem, self._explored.plan(problem))


def ascended(problem: RoundProblem, plan: RoundPlan, most_steps: int = _MOST_STEPS) -> RoundPlan:
    """The plan after steps of quadratic programs, each of which is worth more and fits.

    Raises:
        SolverError: OSQP gave no solution.
    """
    if problem.steps < 2 or plan.value <= 0.0:
        return plan
    problem = problem.at(plan.altitude_m)
    program = StepProgram(problem.steps, led=not problem.airspace.is_open)
    trust_m, model = _FIRST_TRUST_M, None
    for _ in range(most_steps):
        model = model or surroundings(problem, plan, trust_m)
        moved = _moved(problem, plan, program, model, trust_m)
        other = fitted(problem, moved, above=plan.value)
        if other is None:
            trust_m *= _SHRINK
            if trust_m < _LAST_TRUST_M:
                break
            continue
        ended = other.value < plan.value * (1.0 + _RISE)
        plan, model = replace(other, altitude_m=plan.altitude_m), None
        if ended:
            break
        trust_m *= _GROW
    return plan


def _moved(
    problem: RoundProblem,
    plan: RoundPlan,
    program: "StepProgram",
    model: "Surroundings",
    trust_m: float,
) -> Floats:
    """The waypoints after a step; where their flight takes longer than the program had it, after
    one that takes less by as much."""
    moved = plan.waypoints_m.copy()
    for _ in range(_CORRECTIONS + 1):
        step = program.solve(model, trust_m)
        if step is None:
            break
        moved[1:] = plan.waypoints_m[1:] + step
        if problem.limits is None:
            break
        other = plan_along(problem, moved)
        if other.value < plan.value:
            break
        over = share_of(problem, other) - 1.0
        if over <= 0.0:
            break
        model = replace(model, spare_s_m=model.spare_s_m - over * model.whole_s_m)
    return moved


@dataclass(frozen=True)
class Surroundings:
    """What a quadratic program knows of a plan: N waypoints, N - 1 legs."""

    gradient: Floats  # (N - 1, 2) of the reward, by free waypoint
    hessian: Floats  # (N - 1, 3) xx, xy, yy of minus the reward, positive semidefinite
    last: Floats  # (N - 1, 2) of each leg the straight that ends at its waypoint
    first: Floats  # (N - 1, 2) the one that leaves the waypoint before
    whole: Floats  # (N - 1,) 1 where these are one, else 0
    spare_m: float  # metres that the path may be longer
    tied: Floats  # (N - 1,) 1 where a waypoint moves with the one before: flown as one
    slope: Floats  # (N - 1, 2) metres that corners cost, by free waypoint
    whole_s_m: float  # metres at the speed, in the time that the flight may take
    spare_s_m: float  # those of the time that is left


def surroundings(problem: RoundProblem, plan: RoundPlan, trust_m: float) -> Surroundings:
    """The model of a plan that a step is made by."""
    gradient, hessian = reward_model(problem, plan)
    route, at = plan.route_m, plan.stops_at
    last = route[at[1:]] - route[at[1:] - 1]
    first = route[at[:-1] + 1] - route[at[:-1]]
    slope, whole_s_m, spare_s_m = _corners(problem, plan, _NUDGE * trust_m)
    together = np.hypot(*np.diff(plan.waypoints_m, axis=0).T) <= SAME_PLACE_M
    tied = np.where(together & (problem.limits is not None), 1.0, 0.0)
    return Surroundings(
        gradient[1:], hessian[1:], last, first, np.where(np.diff(at) == 1, 1.0, 0.0),
        problem.most_m - plan.path_m, tied, slope, whole_s_m, spare_s_m,
    )  # fmt: skip


def reward_model(problem: RoundProblem, plan: RoundPlan) -> tuple[Floats, Floats]:
    """Gradient (N, 2) and negated, clipped Hessian blocks (N, 3: xx, xy, yy) of the reward."""
    steps, served = np.nonzero(plan.schedule)
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


def _corners(problem: RoundProblem, plan: RoundPlan, nudge_m: float) -> tuple[Floats, float, float]:
    """What the corners of a flight take, by free waypoint (N - 1, 2), beyond the lengths of its
    legs, what it may take in all, and what is left of that, in metres at its speed; no end of it
    without limits."""
    if problem.limits is None:
        return np.zeros((problem.steps - 1, 2)), np.inf, np.inf
    performance = problem.limits.performance
    stops = stops_of(plan, upload_s=problem.upload_s)
    points, hold_s = np.array([stop.xy_m for stop in stops]), [stop.hold_s for stop in stops]
    verdict, speed = problem.as_judged.judged(plan.as_flown), performance.speed_mps

    def flown_m() -> float:
        return performance.foresee(points, hold_s, verdict.radius_m).duration_s * speed

    still_m, free = flown_m(), np.zeros((problem.steps, 2))
    beyond_m = still_m - polyline.length(points)
    for index, stop in enumerate(stops):
        if index == 0 or not stop.steps:
            continue
        for axis in (0, 1):
            here_m = points[index, axis]
            points[index, axis] += nudge_m
            longer_m = flown_m() - polyline.length(points) - beyond_m
            free[stop.steps[0], axis] = longer_m / nudge_m
            points[index, axis] = here_m
    # Joules count as the seconds that they last at the flight's mean power.
    taken = verdict.share
    whole_m = still_m / taken if taken > 0.0 else problem.most_m
    return free[1:], whole_m, whole_m * (1.0 - taken)


class StepProgram:
    """The quadratic program of one number of steps; its sparsity is set up once.

    Made anew for every plan: a solver that has seen other problems would step differently.
    """

    def __init__(self, steps: int, *, led: bool) -> None:
        self._legs = legs = steps - 1
        self._parts = parts = 1 + led  # straights of a leg
        rows, many = parts * legs * len(_DEGREES), (2 + parts) * legs
        self._rows = rows
        # Of every number that the constraints hold: its row, its column.
        leg = np.repeat(np.arange(legs), len(_DEGREES))
        entries: list[tuple[Ints, Ints]] = []
        for part in range(parts):
            row = part * len(leg) + np.arange(len(leg))
            entries += [(row, 2 * leg + axis) for axis in (0, 1)]
            entries += [(row[leg > 0], 2 * leg[leg > 0] - 2 + axis) for axis in (0, 1)]
            entries.append((row, (2 + part) * legs + leg))
        every = np.arange(many)
        entries += [(np.full(many, rows + limit), every) for limit in (0, 1)]
        entries.append((rows + 2 + every[: 2 * legs], every[: 2 * legs]))
        entries.append((rows + 2 + every[2 : 2 * legs], every[: 2 * legs - 2]))
        i, j = (np.concatenate(column) for column in zip(*entries, strict=True))
        numbered = sparse.csc_matrix((np.arange(1, len(i) + 1), (i, j)))
        self._order = numbered.data - 1
        matrix = sparse.csc_matrix(
            (np.ones(len(i)), numbered.indices, numbered.indptr), numbered.shape
        )
        block = sparse.kron(sparse.eye(legs), np.ones((2, 2)))
        nothing = sparse.csc_matrix((parts * legs, parts * legs))
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

    def solve(self, model: Surroundings, trust_m: float) -> Floats | None:
        """(N - 1, 2) the best step of the free waypoints; None where there is none, as the flight
        would have to get shorter than it can within the trust region.

        Raises:
            SolverError: OSQP gave no solution.
        """
        legs, parts, lower, upper = self._legs, self._parts, self._lower, self._upper
        entries: list[Floats] = []
        straights = (model.last, model.first)[:parts]
        for part, straight in enumerate(straights):
            length = np.hypot(*straight.T)[:, None]
            u = np.where(length > 0.0, straight / np.maximum(length, 1e-300), (1.0, 0.0))
            left = np.column_stack((-u[:, 1], u[:, 0]))
            # (legs, angles, 2)
            along = _COSINES[:, None] * u[:, None] + _SINES[:, None] * left[:, None]
            # Waypoint n ends leg n and begins leg n + 1, where that is one straight.
            ends = along * (1.0 if part == 0 else model.whole[:, None, None])
            begins = along[1:] * (model.whole[1:, None, None] if part == 0 else 1.0)
            entries += [ends[..., axis].ravel() for axis in (0, 1)]
            entries += [-begins[..., axis].ravel() for axis in (0, 1)]
            entries.append(np.full(legs * len(_DEGREES), -1.0))
            at = part * legs * len(_DEGREES)
            projected = (along * straight[:, None]).sum(axis=2)
            upper[at : at + projected.size] = -projected.ravel()
        counted = np.ones((parts, legs))
        counted[1:] = 1.0 - model.whole  # what is one straight counts once
        lengths = np.hypot(*np.stack(straights).transpose(2, 0, 1)) * counted
        entries += [np.zeros(2 * legs), counted.ravel(), model.slope.ravel(), counted.ravel()]
        tied = np.repeat(model.tied, 2)
        entries += [np.ones(2 * legs), -tied[2:]]
        upper[self._rows : self._rows + 2] = lengths.sum() + np.array(
            [model.spare_m, model.spare_s_m]
        )
        reach = trust_m * (1.0 - tied)
        lower[self._rows + 2 :], upper[self._rows + 2 :] = -reach, reach
        # The reward is scaled so that its steepest slope is 1 a metre.
        scale = 1.0 / max(float(np.abs(model.gradient).max()), 1e-300)
        xx, xy, yy = (model.hessian * scale).T
        curved = np.stack([xx + _FLOOR, xy, yy + _FLOOR], axis=1)  # by column: (0,0) (0,1) (1,1)
        cost = np.concatenate([-scale * model.gradient.ravel(), np.zeros(parts * legs)])
        numbers = np.concatenate(entries)[self._order]
        self._solver.update(Px=curved.ravel(), Ax=numbers, q=cost, l=lower, u=upper)
        result = self._solver.solve(raise_error=False)
        if result.info.status_val in _NONE:
            return None
        if result.info.status_val not in _USABLE:
            raise SolverError("osqp", result.info.status)
        return np.asarray(result.x[: 2 * legs]).reshape(legs, 2)
