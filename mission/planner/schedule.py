"""The optimal schedule for fixed positions: a transportation problem.

Its constraint matrix is totally unimodular, so the relaxation of omega to [0, 1] has integral
vertices; shortest augmenting paths find one directly.
"""

import numpy as np

from mission.base.arrays import Bools, Floats
from mission.planner.native import library


def assign(success: Floats, importance: Floats, per_step: int) -> Bools:
    """Maximise sum_n sum_k omega_k[n] success[n, k] importance[k].

    At most `per_step` devices a step, each device at most once. A pair that is worth nothing
    (no chance of success, or no importance) is never scheduled.

    Args:
        success: (N, K) probability that device k gets through at step n.
        importance: (K,) delta, not negative.
        per_step: K_bar.

    Returns:
        (N, K) the schedule omega.
    """
    worth = success * importance
    steps, devices = worth.shape
    schedule = np.zeros((steps, devices), dtype=np.bool_)
    served = library.assign(np.ascontiguousarray(worth.T), per_step)
    here = np.flatnonzero(served >= 0)
    schedule[served[here], here] = True
    return schedule & (worth > 0.0)
