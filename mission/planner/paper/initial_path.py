"""The paper's initial path: a greedy walk over the points above the devices."""

from collections.abc import Callable

import numpy as np

from mission.base.arrays import Floats
from mission.planner.problem import RoundProblem

# What a step of the walk is rated by: worth per metre^power. 0 is the paper's walk; the others
# are the further starts of the alternation.
METRE_POWERS = (0.0, 0.5, 1.0)


def greedy_walk(
    problem: RoundProblem, success: Callable[[Floats], Floats], *, metre_power: float = 0.0
) -> Floats:
    """(N, 2) waypoints from v_I over devices, each step going where most is to be won.

    The edge into node j is worth the best total of success x delta over at most K_bar devices
    not served yet; they count as served once the walk has been there. The walk ends when no
    step is left, no node is in reach or none is worth anything; what is left of the N steps
    stays at the last position.

    Args:
        problem: the round.
        success: probability of success as a function of horizontal distance in metres.
        metre_power: 0 rates a step by its worth, 1 by its worth per metre.
    """
    devices = problem.devices_m
    between = np.hypot(*(devices[:, None, :] - devices[None, :, :]).transpose(2, 0, 1))
    worth = success(between) * problem.importance  # (node, device)
    served = np.zeros(len(devices), dtype=np.bool_)
    waypoints = np.tile(problem.start_m, (problem.steps, 1))
    position, budget = problem.start_m, problem.path_budget_m
    take = min(problem.per_step, len(devices))
    for n in range(1, problem.steps):
        open_worth = np.where(served, 0.0, worth)
        best = np.sort(open_worth, axis=1)[:, len(devices) - take :].sum(axis=1)
        metres = np.hypot(*(devices - position).T)
        rating = np.where(metres <= budget, best / np.maximum(metres, 1.0) ** metre_power, -1.0)
        node = int(np.argmax(rating))
        if rating[node] <= 0.0:
            waypoints[n:] = position
            break
        served[np.argsort(-open_worth[node], kind="stable")[:take]] = True
        position, budget = devices[node], budget - metres[node]
        waypoints[n] = position
    return waypoints
