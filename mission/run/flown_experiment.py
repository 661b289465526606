"""The experiment in flight: plan, fly, gate, learn, record; round by round."""

import math
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from fl.federation import rounds as learning
from fl.federation.device_work import DeviceWork
from fl.federation.updates import begin_training
from fl.radio.learned import Heard
from mission.base.arrays import Bools, Floats
from mission.base.errors import FlightError, LinkLostError
from mission.base.interrupts import BACKGROUND, in_background
from mission.flight.flyers.base import CHARGED, Attached, Flyer
from mission.flight.missions.geofence import airspace_rings, fence_items
from mission.flight.missions.round_mission import FlightPlan, flight_of_round
from mission.flight.track import FlownTrack
from mission.log.records import LATE, AircraftRecord, RoundRecord, UplinkRecord
from mission.planner.flyable import share_of
from mission.planner.performance import Foreseen
from mission.planner.problem import RoundPlan, RoundProblem
from mission.run.checkpoint import RoundMemory
from mission.run.course import Course
from mission.run.experiment import Experiment
from mission.run.gate import slots, turns, uplinks
from mission.scenario.limits import Amount
from mission.scenario.strategies import Sortie, Strategy

PILOTS_NS = 1_000_000_000  # between two pilot tones


@dataclass
class _Flown:
    """State of a round in flight: course, flights and uplinks so far, replanned rests."""

    course: Course  # as it has become
    foreseen: Foreseen = field(init=False)  # of the whole of it
    flights: list[FlownTrack] = field(default_factory=list)
    served: list[UplinkRecord] = field(default_factory=list)
    rests: list[RoundPlan] = field(default_factory=list)  # planned at its stops, flown or not
    used_j: float = 0.0
    on_the_spot: int = 0  # rests that begin with a hover, which the whole has in the stop before


@dataclass(kw_only=True)
class FlownExperiment(Experiment):
    """The experiment in flight: learns from the devices whose update the radio lets through."""

    strategy: Strategy
    work: DeviceWork = field(init=False)  # of the devices, as the last round left it
    _most_drawn: float = field(default=0.0, init=False)  # of the battery (0..1), by a round so far
    _stage: str = field(default="", init=False)  # of the flight, for people
    _trainer: ThreadPoolExecutor = field(init=False)  # of devices, during the flight
    _heard: Heard = field(default_factory=Heard, init=False)  # of pilot tones, where it listens

    def __post_init__(self) -> None:
        super().__post_init__()
        self.work = self.scenario.work_before()
        # One thread: a core is left for the flight.
        self._trainer = ThreadPoolExecutor(1, thread_name_prefix=BACKGROUND)

    async def _run(self) -> None:
        run, recorder = self.recorder.run, self.recorder
        attached = Attached((recorder.log,), run.folder.path, recorder.notice)
        try:
            async with run.backend.open(attached) as flyer:
                try:
                    await self._rounds(flyer)
                finally:
                    self.totals.sim_s = flyer.t_ns / 1e9
        except (FlightError, LinkLostError) as error:
            if not self._stage:
                raise
            when = f"{self._stage}, t {self.totals.sim_s:.1f} s"
            raise error.in_words(f"{when}: {error}") from error.__cause__
        finally:
            self._trainer.shutdown(wait=False, cancel_futures=True)

    def distance_text(self) -> str:
        if self.scenario.config.mission.strategy == "barycenter":
            return f"hovering, {self.totals.used.metres:.0f} m of the path budget spent"
        none = self.scenario.config.mission.flight == "none"
        return f"{self.totals.flown_m:.0f} m {'planned' if none else 'flown'}"

    async def _rounds(self, flyer: Flyer) -> None:
        self._stage = "take-off"
        self.recorder.progress.phase("take-off")
        with self.stopwatch("fly"):
            if fence := fence_items(airspace_rings(self.scenario.area)):
                await flyer.set_fence(fence)
            await flyer.take_off()
            if self.strategy.approach_m is not None:
                await flyer.go_to(self.strategy.approach_m)
        while not self.finished:
            self._stage = f"round {self.totals.next_round}"
            await self._round(flyer)
        self._stage = "landing"
        self.recorder.progress.phase("landing")
        with self.stopwatch("fly"):
            await flyer.land()

    async def _round(self, flyer: Flyer) -> None:
        recalled = self._recalled()
        with self.stopwatch("fly"):
            self.totals.battery_changes += await flyer.refresh(self._needed_charge())
        charge = flyer.battery_remaining
        self._show("flying again" if recalled else "planning")
        problem = self._problem(flyer, recalled)
        sortie = await self._sortie(problem, recalled)
        problem = problem.at(sortie.plan.altitude_m)
        if recalled is None:
            self._show("flying")
        early = None
        if recalled is None and self.workers > 1:
            asked = self._mask(np.nonzero(sortie.plan.schedule)[2])
            early = begin_training(self._trainer, self.scenario.federation, self.state, asked)
        flown = await self._fly(flyer, problem, sortie, recalled)
        flight, served = FlownTrack.joined(flown.flights), tuple(flown.served)
        self._most_drawn = max(self._most_drawn, _known(charge - flight.battery_remaining))
        true_objective = sum(u.importance * _success(u.true_per) for u in served)
        if recalled is not None:
            _check_same(true_objective, recalled.true_objective)
        scheduled = self._mask(u.device for u in served)
        delivered = self._mask(u.device for u in served if u.delivered)
        self.totals.last_heard[delivered] = self.totals.next_round
        sent = self._mask(
            u.device for u in served if math.isfinite(u.slot_t_s) and u.outcome != LATE
        )
        late = self._mask(u.device for u in served if u.outcome == LATE) & ~sent
        self.work = self.work.round_ends(late=late, sent=sent)
        kept = self.work.kept(int(flight.t_ns[-1]))
        who = learning.Participation(scheduled, delivered, self.work.begun, kept)
        learnt = recalled.learnt if recalled else await self._learn(who, early)
        used = self._used(problem, sortie, flight, flown.foreseen)
        record = RoundRecord(
            round=self.totals.next_round,
            start_t_s=int(flight.t_ns[0]) / 1e9,
            duration_s=flight.duration_s,
            plan_objective=sortie.plan.value,
            est_objective=sum(u.importance * _success(u.est_per) for u in served),
            true_objective=true_objective,
            upper_bound=sortie.plan.upper_bound,
            plan_path_m=flown.course.plan.path_m,
            flown_path_m=flight.flown_m,
            budget_used_m=used.metres,
            scheduled=int(scheduled.sum()),
            delivered=int(delivered.sum()),
            battery_remaining=flight.battery_remaining,
            accuracy=learnt.accuracy,
            cov=learnt.cov,
            plan_altitude_m=math.nan if sortie.plan.altitude_m is None else sortie.plan.altitude_m,
            plan_duration_s=flown.foreseen.duration_s,
            plan_energy_j=flown.foreseen.energy_j,
            energy_j=flight.energy_j,
            time_used_s=used.seconds,
            energy_used_j=used.joules,
        )
        memory = RoundMemory(problem.importance, sortie, learnt, true_objective, tuple(flown.rests))
        (name,) = self.scenario.aircraft
        self._finish(record, memory, served, (AircraftRecord.alone(record, name),))

    def _needed_charge(self) -> float:
        """Charge (0..1) below which no round begins: the most that one took, and the reserve.

        External vehicles report charge but not power, so past rounds are the estimate for all.
        """
        reserve = self.scenario.config.mission.battery_reserve
        return min(reserve + self._most_drawn, CHARGED) if reserve > 0.0 else 0.0

    def _served(self, flown: _Flown, part: FlightPlan) -> list[UplinkRecord]:
        """Return the uplinks of the devices that the last flown part of a round serves.

        A device that is served again in a round gets a random stream of its own each time.
        """
        number, scenario, course = self.totals.next_round, self.scenario, flown.course
        here = np.zeros((course.problem.steps, 1), dtype=bool)
        here[[step for stop in part.stops for step in stop.steps]] = True
        plan = replace(course.plan, schedule=course.plan.schedule & here)
        flight = flown.flights[-1]
        passages = turns(course.problem, plan, slots(part, flight), flight)
        devices = [record.device for record in flown.served]
        before = np.bincount(devices, minlength=len(scenario.devices_m))
        records: list[UplinkRecord] = []
        for times in np.unique(before[plan.schedule.any(axis=(0, 1))]).tolist():
            again = f"/{times}" if times else ""
            records += uplinks(
                number,
                course.problem,
                replace(plan, schedule=plan.schedule & (before == times)),
                passages,
                area=scenario.area,
                community_of=scenario.community_of,
                radio=scenario.radio,
                gate=scenario.config.channel.gate,
                rng=scenario.streams.generator(f"uplink/{number}{again}"),
                work=self.work if scenario.device_times else None,
            )
        return sorted(records, key=lambda record: (record.step, record.device))

    def _listen(self, flight: FlownTrack, part: int, plan: RoundPlan) -> None:
        """Hear pilot tones of a part of a round, once a second, where a radio belief is learned."""
        listener = self.scenario.listener
        if listener is None:
            return
        instants = range(int(flight.t_ns[0]), int(flight.t_ns[-1]) + 1, PILOTS_NS)
        area, passages = self.scenario.area, [flight.at(t_ns) for t_ns in instants]
        rng = self.scenario.streams.generator(f"pilots/{self.totals.next_round}/{part}")
        est_m = np.array([area.xyz(passage.est_ned_m) for passage in passages])
        true_m = np.array([area.xyz(passage.true_ned_m) for passage in passages])
        every = self.scenario.config.radio.pilots != "scheduled"
        devices = np.asarray(plan.schedule.any(axis=(0, 1)) | every, dtype=bool)
        self._heard = listener.hear(self._heard, est_m, true_m, devices, rng)

    def _problem(self, flyer: Flyer, recalled: RoundMemory | None) -> RoundProblem:
        start = flyer.here()
        problem = self.scenario.problem(
            self._importance(start.t_ns) if recalled is None else recalled.importance,
            self.scenario.area.from_ned(start.est_ned_m),
            performance=flyer.performance,
            left=self.totals.left(self.budget),
            work=self.work.round_begins(self.totals.next_round, start.t_ns),
            t_ns=start.t_ns,
        )
        return self._as_heard(problem)

    def _as_heard(self, problem: RoundProblem) -> RoundProblem:
        """Return the problem with the radio belief as learned so far, where one is learned."""
        listener = self.scenario.listener
        if listener is None:
            return problem
        with self.stopwatch("plan"):
            return replace(problem, per_grid=listener.grid(self._heard))

    def _importance(self, t_ns: int) -> Floats:
        federation, state = self.scenario.federation, self.state
        return self.scenario.importance(
            self.totals.next_round,
            learning.importance(federation, state, fairness=self.strategy.fairness),
            cov=state.cov,
            accuracy=state.eps_received,
            last_heard=self.totals.last_heard,
            work=self.work,
            t_ns=t_ns,
        )

    async def _sortie(self, problem: RoundProblem, recalled: RoundMemory | None) -> Sortie:
        if recalled is not None and recalled.sortie is not None:
            return recalled.sortie
        with self.stopwatch("plan"):
            # Heartbeats go on; simulated time stands still.
            sortie = await in_background(self.strategy.sortie, self.totals.rounds_done, problem)
        return sortie if sortie.plan.schedule.any() else _waiting(problem, sortie)

    async def _fly(
        self, flyer: Flyer, problem: RoundProblem, sortie: Sortie, recalled: RoundMemory | None
    ) -> _Flown:
        """Fly a round's plan, and decide its uplinks; with `replan = "stop"` part by part, with the
        rest replanned at stops where an update was lost and that is better."""
        by_stop = self.scenario.config.mission.replan == "stop"
        if sortie.plan.altitude_m is not None:
            with self.stopwatch("fly"):
                await flyer.climb(sortie.plan.altitude_m)
        flown = _Flown(Course(problem, sortie.plan, problem, sortie.plan))
        while True:
            problem, plan, mission = flown.course.problem, flown.course.plan, flyer.mission
            whole = flight_of_round(problem, plan, hold_s=sortie.hold_s, mission=mission)
            rest = flown.course.flight(mission) if flown.course.begins else whole
            flown.on_the_spot += rest is not whole and rest.stops[0].hold_s > 0.0
            flown.foreseen = flyer.performance.with_hovers_begun(
                whole.foreseen(flyer.performance), flown.on_the_spot
            )
            logged = False
            for part in rest.parts(np.asarray(plan.schedule[0].any(axis=1))) if by_stop else [rest]:
                with self.stopwatch("fly"):
                    try:
                        await flyer.upload(part)
                    finally:  # whoever looks into a refused mission needs its plan
                        if not logged:
                            self.recorder.planned(
                                flyer.t_ns, self.totals.next_round, problem, plan, whole,
                                flown.foreseen,
                            )  # fmt: skip
                            logged = True
                    flight = await flyer.fly(part)
                if not flown.flights:
                    start_ns = int(flight.t_ns[0])
                    self.work = self.work.round_begins(self.totals.next_round, start_ns)
                flown.flights.append(flight)
                unknown = math.isnan(flight.energy_j)
                flown.used_j += (
                    part.foreseen(flyer.performance).energy_j if unknown else flight.energy_j
                )
                served = self._served(flown, part)
                flown.served += served
                self._listen(flight, len(flown.flights), plan)
                lost = not all(item.delivered for item in served)
                if by_stop and lost and await self._planned_anew(flyer, flown, recalled):
                    break
            else:
                return flown

    async def _planned_anew(
        self, flyer: Flyer, flown: _Flown, recalled: RoundMemory | None
    ) -> bool:
        """Replan the rest of a round, or recall it; return whether the course changed to it."""
        problem = flown.course.ahead(
            1 + flown.served[-1].step,
            self.scenario.area.from_ned(flyer.here().est_ned_m),
            heard=self._mask(item.device for item in flown.served if item.delivered),
            elapsed_s=(flyer.t_ns - int(flown.flights[0].t_ns[0])) / 1e9,
            used_j=flown.used_j,
        )
        if problem is None:
            return False
        problem = self._as_heard(problem)
        known = () if recalled is None else recalled.rests[len(flown.rests) :]
        if known:
            rest = known[0]
        else:
            self._show("planning")
            rest = (await self._sortie(problem, None)).plan
            self._show("flying")
        flown.rests.append(rest)
        course = flown.course.onwards(problem, rest)
        flown.course = course or flown.course
        return course is not None

    def _used(
        self, problem: RoundProblem, sortie: Sortie, flight: FlownTrack, foreseen: Foreseen
    ) -> Amount:
        """What is used of the budgets after a round.

        A round never costs more metres than its plan could have used: L_total pays for
        L_total / L_max rounds, also where wind or overshot corners make the flight longer than the
        plan. A first round may be all that a budget pays for, and less than a whole one. Seconds
        and joules are those that the flight took.
        """
        flown_m = min(flight.flown_m, problem.path_budget_m)
        cost = Amount(
            flown_m if sortie.cost_m is None else sortie.cost_m,
            flight.duration_s,
            foreseen.energy_j if math.isnan(flight.energy_j) else flight.energy_j,
        )
        return self.totals.used_with(cost, self.budget)

    def _mask(self, devices: Iterable[int]) -> Bools:
        """(K,) true at the given devices."""
        mask = np.zeros(len(self.scenario.devices_m), dtype=bool)
        mask[list(devices)] = True
        return mask


def _waiting(problem: RoundProblem, sortie: Sortie) -> Sortie:
    """Have a sortie that serves nobody hover until a first device is ready, if limits allow that.

    Without it time would stand still, and no device would ever be ready.
    """
    counting = problem.importance > 0.0
    if problem.ready_in_s is None or not counting.any():
        return sortie
    hold_s = max(sortie.hold_s, float(problem.ready_in_s[counting].min()))
    fits = share_of(problem, sortie.plan, hold_s=hold_s) <= 1.0
    return replace(sortie, hold_s=hold_s) if fits else sortie


def _check_same(objective: float, before: float) -> None:
    """Refuse to go on after a round that was flown again and differs in the last bit."""
    if objective != before:
        raise FlightError(
            f"flown again, the round differs from the first time (objective {objective!r}, was "
            f"{before!r}): another machine or version computes otherwise, so this run cannot be "
            "resumed here"
        )


def _known(drawn: float) -> float:
    """Charge (0..1) that was drawn; 0 where the vehicle does not tell it (NaN)."""
    return 0.0 if math.isnan(drawn) else drawn


def _success(per: float) -> float:
    """1 - PER; 0 for a slot that was never reached."""
    return 0.0 if math.isnan(per) else 1.0 - per
