"""The altitude of a round by a planner that proves nothing: the best of several."""

from dataclasses import dataclass

import numpy as np

from mission.planner.evaluate import finish
from mission.planner.problem import Planner, RoundPlan, RoundProblem


@dataclass(frozen=True)
class SampledAltitudes:
    """A planner for one altitude, asked at several: the best of these plans, without a bound."""

    inner: Planner
    altitudes: int = 9

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round.

        Raises:
            PlanError: what the planner itself raises.
        """
        if problem.altitudes_m is None:
            return self.inner.plan(problem)
        best = None
        for altitude_m in np.linspace(*problem.altitudes_m, self.altitudes).tolist():
            made = finish(problem, self.inner.plan(problem.at(altitude_m)).waypoints_m)
            if best is None or made.value > best.value:
                best = made
        assert best is not None
        again = finish(problem, self.inner.plan(problem.at(best.altitude_m)).waypoints_m)
        return max(best, again, key=lambda plan: plan.value)
