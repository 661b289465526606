"""The paper's path step: one convex program, compiled once and reused (the home of cvxpy).

With the schedule fixed, device k is served at one step n(k). Around the present path the
program maximises a concave lower bound of sum_k w_k (1 - q_tilde_k):

    1 - 1 / (1 + S),   S = exp(b1 theta + b2) >= its tangent in theta,
    theta = arctan(H / r) >= its tangent in r,   r >= |v[n(k)] - u_k|  (the exact cone).

Both tangents lie below, since exp is convex and arctan(H / r) is convex in r > 0: each solution
is at least as good, in q_tilde, as the path it started from. The printed version replaces the
cone by its tangent, which makes r smaller than the distance and loses that property.
"""

import warnings
from functools import lru_cache

import cvxpy as cp
import numpy as np

from fl.radio.channel import LogisticFit
from mission.base.arrays import Bools, Floats
from mission.base.errors import SolverError
from mission.planner.problem import RoundProblem

# Beyond +-8 in the exponent q_tilde is within 3.4e-4 of 0 or 1. Taking the tangent at the limit
# instead keeps it a lower bound and the program well scaled.
EXPONENT_LIMIT = 8.0


class PathProgram:
    """Convex program (CVXPY) of a path step for one size (N, K); the rest are its parameters.

    Raises:
        cvxpy.error.DPPError: the program is not disciplined in its parameters, so that every
            solve would compile it anew.
    """

    def __init__(self, steps: int, devices: int, *, exact_cone: bool) -> None:
        self._exact_cone = exact_cone
        self._path = cp.Variable((steps, 2))
        distance = cp.Variable(devices, nonneg=True)
        plus_one = cp.Variable(devices)  # 1 + S
        loss = cp.Variable(devices)  # 1 / (1 + S)
        self._serves = cp.Parameter((devices, steps))
        self._serves_device = cp.Parameter((devices, 2))
        self._weight = cp.Parameter(devices, nonneg=True)
        self._intercept = cp.Parameter(devices)
        self._slope = cp.Parameter(devices, nonneg=True)
        self._start = cp.Parameter(2)
        self._budget = cp.Parameter(nonneg=True)
        offset = self._serves @ self._path - self._serves_device
        constraints = [
            self._path[0] == self._start,
            cp.sum(cp.norm(self._path[1:] - self._path[:-1], axis=1)) <= self._budget,
            plus_one <= self._intercept - cp.multiply(self._slope, distance),
            loss >= cp.inv_pos(plus_one),
        ]
        if exact_cone:
            constraints.append(distance >= cp.norm(offset, axis=1))
        else:
            self._direction_serves = [cp.Parameter((devices, steps)) for _ in range(2)]
            self._direction_device = cp.Parameter(devices)
            along = sum(self._direction_serves[i] @ self._path[:, i] for i in range(2))
            constraints.append(distance >= along - self._direction_device)
        self._problem = cp.Problem(cp.Minimize(self._weight @ loss), constraints)
        if not self._problem.is_dcp(dpp=True):
            raise cp.error.DPPError("the path program is not disciplined in its parameters")

    def solve(
        self, problem: RoundProblem, fit: LogisticFit, waypoints_m: Floats, schedule: Bools
    ) -> Floats:
        """(N, 2) the best path of the program built around `waypoints_m`.

        Raises:
            SolverError: no solution.
        """
        step_of = schedule.argmax(axis=0)
        serves = np.zeros((len(problem.devices_m), problem.steps))
        serves[np.arange(len(step_of)), step_of] = 1.0
        offset = waypoints_m[step_of] - problem.devices_m
        around = np.hypot(offset[:, 0], offset[:, 1])
        self._serves.value = serves
        self._serves_device.value = problem.devices_m
        weight = np.where(schedule.any(axis=0), problem.importance, 0.0)
        self._weight.value = weight / max(float(weight.max(initial=0.0)), 1e-300)
        self._intercept.value, self._slope.value = tangent(
            fit, around, height_m=problem.channel.altitude_m
        )
        self._start.value = problem.start_m
        self._budget.value = problem.path_budget_m
        if not self._exact_cone:
            # Right overhead the printed gradient is undefined; 0 leaves r free there.
            direction = offset / np.where(around > 0.0, around, 1.0)[:, None]
            for i in range(2):
                self._direction_serves[i].value = serves * direction[:, i, None]
            self._direction_device.value = (direction * problem.devices_m).sum(axis=1)
        with warnings.catch_warnings():
            # "Solution may be inaccurate": the caller evaluates every path by itself.
            warnings.simplefilter("ignore", UserWarning)
            try:
                # A warm solver keeps the scaling of the data it met first, and the plan would
                # depend on what was planned before.
                self._problem.solve(solver=cp.CLARABEL, enforce_dpp=True, warm_start=False)
            except cp.error.SolverError as error:
                raise SolverError("clarabel", str(error)) from error
        if self._problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
            raise SolverError("clarabel", self._problem.status)
        path = np.array(self._path.value)
        path[0] = problem.start_m
        return path


path_program = lru_cache(maxsize=16)(PathProgram)  # of a size, for all rounds and planners


def tangent(fit: LogisticFit, around_m: Floats, *, height_m: float) -> tuple[Floats, Floats]:
    """(intercept, slope) of the lower bound 1 + S >= intercept - slope r, for each distance."""
    b1 = max(fit.b1_per_rad, 1e-9)
    theta = np.arctan2(height_m, around_m)
    theta_at = np.clip(theta, (-EXPONENT_LIMIT - fit.b2) / b1, (EXPONENT_LIMIT - fit.b2) / b1)
    s = np.exp(b1 * theta_at + fit.b2)
    # theta >= theta - H / (H^2 + around^2) (r - around)
    falls = height_m / (height_m**2 + around_m**2)
    slope = s * b1 * falls
    return 1.0 + s * (1.0 + b1 * (theta - theta_at)) + slope * around_m, slope
