"""The round loop that all experiments share, and the experiment `ideal`, which flies nothing."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fl.federation import rounds as learning
from fl.federation.state import FederationState
from fl.federation.updates import Begun
from mission.base.console import RunConsole, Stopwatch
from mission.base.interrupts import in_background
from mission.base.record_file import RecordFile
from mission.base.tables import count
from mission.log.records import UNKNOWN_ROUND, RoundRecord
from mission.run.apart import pairs_of, row
from mission.run.budget import RunTotals
from mission.run.callbacks import RoundReport
from mission.run.checkpoint import RoundMemory
from mission.run.outing import Outing
from mission.run.recorded import Summary
from mission.run.recorder import FolderRecorder
from mission.scenario.limits import Budget
from mission.scenario.scenario import Scenario


@dataclass(kw_only=True)
class Experiment(ABC):
    """A run as a loop over rounds, with its state between them; base class of all kinds."""

    recorder: FolderRecorder
    stopwatch: Stopwatch
    workers: int = 1  # devices that train at a time; changes no result
    scenario: Scenario = field(init=False)
    state: FederationState = field(init=False)  # with a memory: after the last round in it
    totals: RunTotals = field(init=False)
    budget: Budget = field(init=False)

    def __post_init__(self) -> None:
        self.scenario, self.state = self.recorder.run.scenario, self.recorder.run.state
        self.memory = self.recorder.run.memory  # rounds to go through again as they were
        self.totals = RunTotals(np.zeros(len(self.scenario.devices_m), dtype=np.int64))
        self.budget = self.scenario.budget

    @property
    def finished(self) -> bool:
        """Whether the rounds or one of the budgets are spent."""
        return self.totals.is_over(self.budget)

    @property
    def files(self) -> Sequence[RecordFile]:
        """Log and tables."""
        recorder = self.recorder
        tables = recorder.rounds, recorder.aircraft, recorder.uplinks, recorder.devices
        return *(log.file for log in recorder.logs), *(table.file for table in tables)

    async def run(self) -> None:
        """Record the untrained models, then go through all rounds.

        Raises:
            AerofedError: what ends the run before that.
        """
        federation = self.scenario.federation
        # A resumed run has the last round's models, and records the first ones again.
        state = self.state if self.state.rounds == 0 else learning.init(federation)
        untrained = learning.untrained(federation, state)
        self.totals.untrained = dict(untrained.accuracy)
        self.recorder.learnt(0, untrained)
        await self._run()

    def conclude(self, summary: Summary) -> None:
        """Add to the summary which budget ended the run before its last round, if one did."""
        if why := self.totals.why_over(self.budget):
            summary.add(ended_by=why)

    def show(self, console: RunConsole) -> None:
        """Print the totals of the run."""
        phases = ", ".join(f"{name} {wall_s:.1f}" for name, wall_s in self.stopwatch.wall_s.items())
        took = f"{self.stopwatch.total_s:.1f} s: {phases}"
        totals, done = self.totals, self.totals.rounds_done
        if done < len(self.memory):
            console.say(
                f"{count(len(self.memory), 'round')} of the run before are kept, {done} of them "
                f"flown again by now\n{took}"
            )
            return
        if why := totals.why_over(self.budget):
            console.say(why)
        if loose := self.scenario.config.planner.loosely_proven(totals.gaps):
            console.say(loose)
        console.say(
            f"{count(done, 'round')}, {self.distance_text()}, "
            f"{totals.delivered}/{totals.scheduled} updates delivered\n{took}"
        )

    @abstractmethod
    async def _run(self) -> None:
        """Go through all rounds, from the first to the last."""

    @abstractmethod
    def distance_text(self) -> str:
        """Distance flown, in words."""

    def _recalled(self) -> RoundMemory | None:
        """What the checkpoint kept of the next round; None where it was not flown before."""
        done = self.totals.rounds_done
        return self.memory[done] if done < len(self.memory) else None

    async def _learn(
        self, who: learning.Participation, early: Begun | None = None
    ) -> learning.RoundLearning:
        self._show("training")
        state, federation = self.state, self.scenario.federation
        with self.stopwatch("learn"):
            # Heartbeats go on; simulated time stands still.
            self.state, learnt = await in_background(
                learning.play_round, federation, state, who, workers=self.workers, early=early
            )
        return learnt

    def _show(self, what: str) -> None:
        """Show the phase of the round that begins, in words."""
        rounds = self.scenario.config.mission.rounds
        self.recorder.progress.phase(f"round {self.totals.next_round}/{rounds}: {what}")

    def _finish(
        self,
        record: RoundRecord,
        memory: RoundMemory,
        outings: Sequence[Outing] = (),
    ) -> None:
        again = self._recalled() is not None
        served = tuple(item for one in outings for item in one.served)
        # How far apart a pair is from when on its distance counts: homes may be nearer.
        apart_m = self.scenario.config.mission.separation_m
        pairs = pairs_of(outings, leaving_m=apart_m if record.round == 1 else None)
        rows = tuple(row(one, record, pairs) for one in outings)
        report = RoundReport(record, served, memory.learnt, rows, again=again)
        with self.stopwatch("log"):
            self.recorder.finished(report, memory, self.state, outings, pairs)
        self.totals.add(record)


@dataclass(kw_only=True)
class IdealExperiment(Experiment):
    """The upper bound `ideal`: nothing is flown, and every update of every round arrives.

    It has as many rounds as its budgets would have paid for.
    """

    async def _run(self) -> None:
        while not self.finished:
            await self._round()

    def distance_text(self) -> str:
        return "nothing flown"

    async def _round(self) -> None:
        recalled = self._recalled()
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
            time_used_s=used.seconds,
            energy_used_j=used.joules,
        )
        self._finish(record, RoundMemory(importance, None, learnt, total))
