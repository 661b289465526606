"""The experiment without flight: every round, every device is heard."""

from dataclasses import dataclass, replace

import numpy as np

from fl.federation import rounds as learning
from mission.log.records import UNKNOWN_ROUND
from mission.run.budget import optional_columns
from mission.run.checkpoint import RoundMemory
from mission.run.experiment import Experiment


@dataclass(kw_only=True)
class IdealExperiment(Experiment):
    """What learning comes to where the radio loses nothing.

    It has as many rounds as the path budget would have paid for.
    """

    async def _run(self) -> None:
        while not self.finished:
            await self._round()

    def flown(self) -> str:
        return "nothing flown"

    async def _round(self) -> None:
        mission, recalled = self.scenario.config.mission, self._recalled()
        everyone = np.ones(len(self.scenario.devices_m), dtype=bool)
        if recalled is not None:
            importance, learnt = recalled.importance, recalled.learnt
        else:
            importance = learning.importance(self.scenario.federation, self.state, fairness=True)
            learnt = await self._learn(learning.Participation(everyone, everyone))
        total = float(importance.sum())
        # Nothing is flown, but the ideal must not have more rounds than the budgets pay for.
        used = self.totals.used_with(self.budget.whole_round, self.budget)
        record = replace(
            UNKNOWN_ROUND,
            round=self.totals.next_round,
            start_t_s=0.0,
            duration_s=0.0,
            plan_objective=total,
            est_objective=total,
            true_objective=total,
            upper_bound=total,
            plan_path_m=0.0,
            flown_path_m=0.0,
            budget_used_m=used.metres,
            scheduled=len(everyone),
            delivered=len(everyone),
            battery_remaining=1.0,
            accuracy=learnt.accuracy,
            cov=learnt.cov,
            optional=optional_columns(mission, used),
        )
        self._finish(record, RoundMemory(importance, None, learnt, total))
