"""The loop of a run: plan, fly, gate, learn, record; round by round."""

import asyncio
import math
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fl.federation import rounds as learning
from mission.base.errors import FlightError, LinkLostError
from mission.base.stopwatch import Stopwatch
from mission.base.user_code import users_code
from mission.flight.flight_plan import flight_of_round
from mission.flight.flyers.flyer import Flyer
from mission.flight.flyers.simulated import Tap
from mission.flight.track import Passage
from mission.log.records import Learnt, RoundRecord, UplinkRecord
from mission.planner.problem import RoundProblem
from mission.run.budget import Tally
from mission.run.checkpoint import RoundMemory
from mission.run.gate import slots, uplinks
from mission.run.learning import learn
from mission.run.round_result import Recorder, RoundResult
from mission.run.setup import World
from mission.scenario.custom_strategies import Known, Weighing
from mission.scenario.strategies import Strategy
from sitl.observer import VehicleObserver

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass
class Experiment:
    """One run's state between rounds."""

    world: World
    folder: Path  # of the run
    recorder: Recorder
    stopwatch: Stopwatch
    state: learning.FederationState  # with a memory: after the last round in it
    memory: Sequence[RoundMemory] = ()  # rounds to fly again, by the plans that they had
    observers: Sequence[VehicleObserver] = ()
    tap: Tap | None = None  # on the link between pilot and built-in autopilot
    workers: int = 1  # devices that train at a time; changes no result
    tally: Tally = field(init=False)
    _stage: str = field(default="", init=False)  # of the flight, for people

    def __post_init__(self) -> None:
        self.tally = Tally.of(len(self.world.devices_m))

    @property
    def finished(self) -> bool:
        """Whether the rounds or the path budget are spent."""
        return self.tally.is_over(self.world.config.mission)

    async def run(self) -> None:
        """All rounds, from take-off to landing; `ideal` needs no flight.

        Raises:
            FlightError, LinkLostError: see `Pilot`.
            PlanError: see the planner.
        """
        if self.world.strategy is None:
            while not self.finished:
                await self._ideal_round()
            return
        try:
            await self._fly(self.world.strategy)
        except (FlightError, LinkLostError) as error:
            if not self._stage:
                raise
            raise type(error)(f"{self._stage}, t {self.tally.sim_s:.1f} s: {error}") from error

    async def _fly(self, strategy: Strategy) -> None:
        flyers = self.world.flyers
        async with flyers.open(
            self.observers, folder=self.folder, tap=self.tap, say=self.recorder.notice
        ) as flyer:
            try:
                await self._sorties(flyer, strategy)
            finally:
                self.tally.sim_s = flyer.t_ns / 1e9

    async def _sorties(self, flyer: Flyer, strategy: Strategy) -> None:
        self._stage = "take-off"
        self.recorder.phase("take-off")
        with self.stopwatch("fly"):
            await flyer.take_off()
            if strategy.approach_m is not None:
                await flyer.go_to(strategy.approach_m)
        while not self.finished:
            self._stage = f"round {self.tally.number}"
            await self._flown_round(flyer, strategy)
        self._stage = "landing"
        self.recorder.phase("landing")
        with self.stopwatch("fly"):
            await flyer.land()

    async def _flown_round(self, flyer: Flyer, strategy: Strategy) -> None:
        world, number = self.world, self.tally.number
        recalled = self._recalled()
        with self.stopwatch("fly"):
            self.tally.battery_changes += await flyer.refresh(world.config.mission.battery_reserve)
        self._show("flying again" if recalled else "planning")
        start = flyer.here()
        problem = self._problem(start, strategy, recalled)
        if recalled is not None and recalled.sortie is not None:
            sortie = recalled.sortie
        else:
            with self.stopwatch("plan"):
                # In a thread, so that heartbeats go on; simulated time stands still.
                sortie = await asyncio.to_thread(strategy.sortie, number - 1, problem)
        flight_plan = flight_of_round(
            problem, sortie.plan, hold_s=sortie.hold_s, mission=flyer.mission
        )
        if recalled is None:
            self._show("flying")
        with self.stopwatch("fly"):
            try:
                await flyer.upload(flight_plan)
            finally:  # whoever looks into a refused mission needs its plan
                self.recorder.planned(flyer.t_ns, number, problem, sortie.plan, flight_plan)
            flight = await flyer.fly(flight_plan)
        passages = slots(flight_plan, flight)
        served = uplinks(
            number, problem, sortie.plan, passages,
            area=world.area, community_of=world.community_of,
            gate=world.config.channel.gate, rng=world.streams.generator(f"uplink/{number}"),
        )  # fmt: skip
        # Never more than the plan could have used: L_total pays for L_total / L_max rounds, also
        # where wind or overshot corners make the flight longer than the plan.
        flown_cost_m = min(flight.flown_m, problem.path_budget_m)
        cost_m = flown_cost_m if sortie.cost_m is None else sortie.cost_m
        # A first round may be all that L_total pays for, and less than a whole one.
        cost_m = min(cost_m, self.tally.left_m(world.config.mission))
        true_objective = sum(u.importance * _success(u.true_per) for u in served)
        if recalled is not None and recalled.true_objective != true_objective:
            raise FlightError(
                "flown again, the round differs from the first time (objective "
                f"{true_objective!r}, was {recalled.true_objective!r}): another machine or version "
                "computes otherwise, so this run cannot be resumed here"
            )

        scheduled, delivered = (np.zeros(len(world.devices_m), dtype=bool) for _ in range(2))
        scheduled[[u.device for u in served]] = True
        delivered[[u.device for u in served if u.delivered]] = True
        self.tally.last_heard[delivered] = number
        learnt = recalled.learnt if recalled else await self._learn(scheduled, delivered)
        record = RoundRecord(
            round=number,
            start_t_s=int(flight.t_ns[0]) / 1e9,
            duration_s=flight.duration_s,
            plan_objective=sortie.plan.value,
            est_objective=sum(u.importance * _success(u.est_per) for u in served),
            true_objective=true_objective,
            upper_bound=sortie.plan.upper_bound,
            plan_path_m=sortie.plan.path_m,
            flown_path_m=flight.flown_m,
            budget_used_m=self.tally.budget_used_m + cost_m,
            scheduled=len(served),
            delivered=int(delivered.sum()),
            battery_remaining=flight.battery_remaining,
            accuracy=learnt.accuracy,
            cov=learnt.cov,
        )
        memory = RoundMemory(problem.importance, sortie, learnt, true_objective)
        self._finish(record, served, memory, remembered=recalled is not None)

    def _problem(
        self, start: Passage, strategy: Strategy, recalled: RoundMemory | None
    ) -> RoundProblem:
        world, mission = self.world, self.world.config.mission
        importance = recalled.importance if recalled is not None else self._importance(strategy)
        return RoundProblem(
            devices_m=world.devices_m,
            importance=importance,
            start_m=world.area.from_ned(start.est_ned_m),
            steps=mission.steps,
            per_step=mission.devices_per_step,
            path_budget_m=min(mission.path_budget_m, self.tally.left_m(mission)),
            channel=world.channel,
        )

    def _importance(self, strategy: Strategy) -> Floats:
        federation, state = self.world.federation, self.state
        delta = learning.importance(federation, state, fairness=strategy.fairness)
        if not isinstance(strategy, Weighing):
            return delta
        of = federation.community_of
        known = Known(
            self.tally.number, delta, federation.p, state.cov[of], of, self.tally.last_heard.copy()
        )
        return strategy.importance(known)

    def _recalled(self) -> RoundMemory | None:
        done = self.tally.rounds_done
        return self.memory[done] if done < len(self.memory) else None

    async def _ideal_round(self) -> None:
        mission, recalled = self.world.config.mission, self._recalled()
        everyone = np.ones(len(self.world.devices_m), dtype=bool)
        if recalled is not None:
            importance, learnt = recalled.importance, recalled.learnt
        else:
            importance = learning.importance(self.world.federation, self.state, fairness=True)
            learnt = await self._learn(everyone, everyone)
        total = float(importance.sum())
        # Nothing is flown, but the ideal must not have more rounds than the budget pays for.
        cost_m = min(mission.path_budget_m, self.tally.left_m(mission))
        record = RoundRecord(
            round=self.tally.number, start_t_s=0.0, duration_s=0.0,
            plan_objective=total, est_objective=total, true_objective=total, upper_bound=total,
            plan_path_m=0.0, flown_path_m=0.0, budget_used_m=self.tally.budget_used_m + cost_m,
            scheduled=len(everyone), delivered=len(everyone), battery_remaining=1.0,
            accuracy=learnt.accuracy, cov=learnt.cov,
        )  # fmt: skip
        memory = RoundMemory(importance, None, learnt, total)
        self._finish(record, (), memory, remembered=recalled is not None)

    async def _learn(self, scheduled: Bools, delivered: Bools) -> Learnt:
        self._show("training")
        with self.stopwatch("learn"), self._users_networks():
            # In a thread, so that heartbeats go on; simulated time stands still.
            self.state, learnt = await asyncio.to_thread(
                learn,
                self.world.federation,
                self.state,
                scheduled=scheduled,
                delivered=delivered,
                workers=self.workers,
            )
        return learnt

    def _users_networks(self) -> AbstractContextManager[None]:
        """Where a network is the researcher's own, what fails while it is trained is theirs."""
        own = [c.network for c in self.world.config.communities if ":" in c.network]
        doing = f"training in round {self.tally.number}"
        if not own:
            return nullcontext()
        return users_code(own[0], key="communities.network", doing=doing)

    def _show(self, what: str) -> None:
        """Tell people what this round is about to do."""
        rounds = self.world.config.mission.rounds
        self.recorder.phase(f"round {self.tally.number}/{rounds}: {what}")

    def _finish(
        self,
        record: RoundRecord,
        served: tuple[UplinkRecord, ...],
        memory: RoundMemory,
        *,
        remembered: bool,
    ) -> None:
        with self.stopwatch("log"):
            self.recorder.finished(RoundResult(record, served, memory, self.state, remembered))
        self.tally.add(record)


def _success(per: float) -> float:
    """1 - PER; a slot that was never reached succeeds with certainty zero."""
    return 0.0 if math.isnan(per) else 1.0 - per
