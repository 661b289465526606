"""The experiment in flight: plan, fly, gate, learn, record; round by round."""

import math
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from fl.federation import rounds as learning
from fl.federation.device_work import DeviceWork
from fl.federation.updates import begin_training
from fl.radio.learned import Heard
from mission.base.arrays import Bools, Floats
from mission.base.errors import FlightError, LinkLostError, UnansweredError
from mission.base.interrupts import BACKGROUND, in_background
from mission.flight.flyers.base import CHARGED, Fleet, Flyer
from mission.flight.missions.geofence import airspace_rings, fence_items
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.track import FlownTrack
from mission.log.records import LATE, UNKNOWN_ROUND
from mission.planner.apart import too_near
from mission.planner.flyable import share_of
from mission.planner.performance import Performance
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem
from mission.run.checkpoint import RoundMemory
from mission.run.course import ahead_of_all, is_better
from mission.run.experiment import Experiment
from mission.run.gate import listened, served_in
from mission.run.outing import Outing, outings_of, round_record, success
from mission.scenario.limits import Amount, separation
from mission.scenario.strategies import Sortie, Strategy


@dataclass(kw_only=True)
class FlownExperiment(Experiment):
    """The experiment in flight: learns from the devices whose update the radio lets through."""

    strategy: Strategy
    work: DeviceWork = field(init=False)  # of the devices, as the last round left it
    _most_drawn: float = field(default=0.0, init=False)  # of the battery (0..1), by a round so far
    _stage: str = field(default="", init=False)  # of the flight, for people
    _trainer: ThreadPoolExecutor = field(init=False)  # of devices, during the flight
    _rests: list[RoundPlan] = field(default_factory=list, init=False)  # of the round, flown or not
    _heard: Heard = field(default_factory=Heard, init=False)  # of pilot tones, where it listens

    def __post_init__(self) -> None:
        super().__post_init__()
        self.work = self.scenario.work_before()
        # One thread: a core is left for the flight.
        self._trainer = ThreadPoolExecutor(1, thread_name_prefix=BACKGROUND)

    async def _run(self) -> None:
        try:
            async with self.recorder.run.backend.fleet(self.recorder.attached()) as fleet:
                try:
                    await self._rounds(fleet)
                finally:
                    self.totals.sim_s = fleet.t_ns / 1e9
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

    async def _rounds(self, fleet: Fleet) -> None:
        self._stage = "take-off"
        self.recorder.progress.phase("take-off")
        with self.stopwatch("fly"):
            await self._each(fleet, self._begin)
        while not self.finished:
            self._stage = f"round {self.totals.next_round}"
            await self._round(fleet)
        self._stage = "landing"
        self.recorder.progress.phase("landing")
        with self.stopwatch("fly"):
            await self._each(fleet, lambda flyer: flyer.land())

    async def _begin(self, flyer: Flyer) -> None:
        if fence := fence_items(airspace_rings(self.scenario.area)):
            await flyer.set_fence(fence)
        await flyer.take_off()
        if self.strategy.approach_m is not None:
            await flyer.go_to(self.strategy.approach_m)

    async def _each(self, fleet: Fleet, order: Callable[[Flyer], Awaitable[None]]) -> None:
        """Give an order to one aircraft after another, while the others wait."""
        for number, flyer in tuple(fleet.aloft.items()):
            try:
                await order(flyer)
            except (FlightError, LinkLostError) as error:
                self._lose(fleet, number, error)

    def _lose(self, fleet: Fleet, number: int, error: FlightError | LinkLostError) -> None:
        """Go on without an aircraft.

        Raises:
            FlightError: no other is left, or one that is lost is to end the run; or it is not lost,
                but did not answer in time, which depends on the machine.
            LinkLostError: it fell silent, which does, too.
        """
        mission = self.scenario.config.mission
        name = "" if len(self.scenario.fleet) == 1 else f"{self.scenario.aircraft[number]}: "
        ends = len(fleet.aloft) == 1 or mission.when_lost == "end"
        if ends or isinstance(error, LinkLostError | UnansweredError):
            raise error.in_words(f"{name}{error}") from error.__cause__
        del fleet.aloft[number]
        others = ", ".join(self.scenario.aircraft[other] for other in fleet.aloft)
        go = "goes" if len(fleet.aloft) == 1 else "go"
        self.recorder.notice(f"{self._stage}: {name}{error}; {others} {go} on")

    async def _refresh(self, flyer: Flyer) -> None:
        self.totals.battery_changes += await flyer.refresh(self._needed_charge())

    async def _round(self, fleet: Fleet) -> None:
        recalled = self._recalled()
        with self.stopwatch("fly"):
            await self._each(fleet, self._refresh)
        charges = {number: flyer.battery_remaining for number, flyer in fleet.aloft.items()}
        self._show("flying again" if recalled else "planning")
        problem = self._problem(fleet, recalled)
        sortie = await self._sortie(problem, recalled)
        self._tell_mended(sortie.plan)
        if recalled is None:
            self._show("flying")
        early = None
        if recalled is None and self.workers > 1:
            asked = self._mask(np.nonzero(sortie.plan.schedule)[2])
            early = begin_training(self._trainer, self.scenario.federation, self.state, asked)
        outings = outings_of(self.scenario.fleet, fleet.aloft, problem, sortie)
        await self._fly(fleet, outings, recalled)
        outings = [one for one in outings if one.flights]  # others were lost before
        for one in outings:
            drawn = charges[one.number] - one.flight.battery_remaining
            self._most_drawn = max(self._most_drawn, _known(drawn))
        served = tuple(record for one in outings for record in one.served)
        scheduled = self._mask(u.device for u in served)
        delivered = self._mask(u.device for u in served if u.delivered)
        self.totals.last_heard[delivered] = self.totals.next_round
        sent = self._mask(
            u.device for u in served if math.isfinite(u.slot_t_s) and u.outcome != LATE
        )
        late = self._mask(u.device for u in served if u.outcome == LATE) & ~sent
        self.work = self.work.round_ends(late=late, sent=sent)
        kept = self.work.kept(max(int(one.flight.t_ns[-1]) for one in outings))
        who = learning.Participation(scheduled, delivered, self.work.begun, kept)
        # Before the training, which may take long.
        true_objective = sum(u.importance * success(u.true_per) for u in served)
        if recalled is not None:
            _check_same(true_objective, recalled.true_objective)
        learnt = recalled.learnt if recalled else await self._learn(who, early)
        used = self._used(sortie, outings)
        known = replace(
            UNKNOWN_ROUND,
            round=self.totals.next_round,
            budget_used_m=used.metres,
            time_used_s=used.seconds,
            energy_used_j=used.joules,
            accuracy=learnt.accuracy,
            cov=learnt.cov,
        )
        record = round_record(outings, sortie.plan, known)
        rests = tuple(self._rests)
        memory = RoundMemory(problem.importance, sortie, learnt, true_objective, rests)
        self._finish(record, memory, outings)

    def _needed_charge(self) -> float:
        """Charge (0..1) below which no round begins: the most that one took, and the reserve.

        External vehicles report charge but not power, so past rounds are the estimate for all.
        """
        reserve = self.scenario.config.mission.battery_reserve
        return min(reserve + self._most_drawn, CHARGED) if reserve > 0.0 else 0.0

    def _problem(self, fleet: Fleet, recalled: RoundMemory | None) -> RoundProblem:
        begins: list[tuple[Floats, Performance] | None] = [None] * len(self.scenario.fleet)
        for number, flyer in fleet.aloft.items():
            here_m = flyer.area.from_ned(flyer.here().est_ned_m)
            begins[number] = here_m, flyer.performance
        t_ns = fleet.t_ns
        problem = self.scenario.problem(
            self._importance(t_ns) if recalled is None else recalled.importance,
            begins,
            left=self.totals.left(self.budget),
            work=self.work.round_begins(self.totals.next_round, t_ns),
            t_ns=t_ns,
            leaving=self.totals.next_round == 1,
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

    def _tell_mended(self, plan: RoundPlan) -> None:
        if plan.mended:
            self.recorder.notice(f"{self._stage}: {plan.mended}")

    async def _fly(
        self, fleet: Fleet, outings: Sequence[Outing], recalled: RoundMemory | None
    ) -> None:
        """Fly a round's plan, and decide its uplinks; with `replan = "stop"` part by part, with the
        rest replanned where an update was lost and that is better. Several wait for each other at
        the end of each part."""
        by_stop = self.scenario.config.mission.replan == "stop"
        by_number = {one.number: one for one in outings}
        self._rests = []
        with self.stopwatch("fly"):
            for one in outings:
                await self._tell(fleet, one, one.flyer.climb(one.height_m))
        while True:
            rests = {n: one.order() for n, one in by_number.items() if n in fleet.aloft}
            cut = {n: by_number[n].parts(rest) if by_stop else [rest] for n, rest in rests.items()}
            for nth in range(max(map(len, cut.values()), default=0)):
                part = {
                    n: own[nth] if nth < len(own) else by_number[n].waiting
                    for n, own in cut.items()
                }
                with self.stopwatch("fly"):
                    await self._upload(fleet, by_number, part, begins=nth == 0)
                    flights = await fleet.fly({n: part[n] for n in fleet.aloft})
                if not self._rests and nth == 0:
                    start_ns = min(int(flight.t_ns[0]) for flight in flights.flown.values())
                    self.work = self.work.round_begins(self.totals.next_round, start_ns)
                missed = False
                for number, flight in flights.flown.items():
                    missed |= self._heard_of(by_number[number], part[number], flight)
                for number, error in flights.lost.items():
                    by_number[number].lost = True
                    self._lose(fleet, number, error)
                if by_stop and missed and await self._planned_anew(fleet, outings, recalled):
                    break
            else:
                return

    def _heard_of(self, one: Outing, part: FlightPlan, flight: FlownTrack) -> bool:
        """Add the flight of a part, and what was heard in it; return whether somebody was not."""
        one.flew(part, flight)
        number = self.totals.next_round
        served = served_in(one, part, self.scenario, number, self.work)
        if served:
            one.reached = served[-1].step
        one.served += served
        self._heard = listened(self._heard, one, self.scenario, number)
        return not all(item.delivered for item in served)

    async def _upload(
        self,
        fleet: Fleet,
        by_number: Mapping[int, Outing],
        part: Mapping[int, FlightPlan],
        *,
        begins: bool,
    ) -> None:
        """Upload what each aircraft flies next, while time stands still, and record its plan."""
        for number, plan in part.items():
            one = by_number[number]
            try:
                await self._tell(fleet, one, one.flyer.upload(plan))
            finally:  # whoever looks into a refused mission needs its plan
                if begins:
                    self.recorder.planned(one.flyer.t_ns, self.totals.next_round, one)

    async def _tell(self, fleet: Fleet, one: Outing, order: Awaitable[None]) -> None:
        """Give an order to one aircraft, which may be lost by it."""
        try:
            await order
        except (FlightError, LinkLostError) as error:
            one.lost = True
            self._lose(fleet, one.number, error)

    async def _planned_anew(
        self, fleet: Fleet, outings: Sequence[Outing], recalled: RoundMemory | None
    ) -> bool:
        """Replan the rest of all that are aloft, or recall it; return whether that is flown."""
        heard = self._mask(u.device for one in outings for u in one.served if u.delivered)
        left, hovering = list[tuple[Outing, RoundProblem]](), list[tuple[float, ...]]()
        for one in outings:
            here_m = one.aircraft.area.from_ned(one.flyer.here().est_ned_m)
            elapsed_s = (fleet.t_ns - int(one.flights[0].t_ns[0])) / 1e9
            step, used_j = one.reached + 1, one.used_j
            problem = one.course.ahead(
                step, here_m, heard=heard, elapsed_s=elapsed_s, used_j=used_j
            )
            if one.number not in fleet.aloft:
                continue
            if one.done or problem is None:
                hovering.append((*here_m, one.height_m))
            else:
                left.append((one, self._as_heard(problem)))
        if not left:
            return False
        problem = ahead_of_all([own for _, own in left])
        if problem.separation_m:
            others_m = np.reshape(hovering, (-1, 3))
            apart = separation(self.scenario.config.mission, leaving=False)
            problem = replace(problem, hovering_m=others_m, **apart)
        known = () if recalled is None else recalled.rests[len(self._rests) :]
        if known:
            rest = known[0]
        else:
            self._show("planning")
            rest = (await self._sortie(problem, None)).plan
            self._show("flying")
        self._rests.append(rest)
        as_planned = sum(one.course.as_planned(own) for one, own in left)
        if not is_better(rest, as_planned, sum(one.course.plan.value for one in outings)):
            return False
        if too_near(problem, rest) is not None:  # what is flown keeps apart, and goes on
            return False
        self._tell_mended(rest)
        for one in outings:
            one.done = True
        for at, (one, _) in enumerate(left):
            plan = rest.alone(at)
            one.course = one.course.onwards(problem.alone(at), plan, one.reached + 1)
            one.done = False
        return True

    def _used(self, sortie: Sortie, outings: Sequence[Outing]) -> Amount:
        """What is used of the budgets after a round, which are each aircraft's own: of each, what
        the one took that took most."""
        metres, seconds, joules = zip(*(one.cost for one in outings), strict=True)
        cost = Amount(
            max(metres) if sortie.cost_m is None else sortie.cost_m, max(seconds), max(joules)
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
    fits = too_near(problem, sortie.plan, hold_s=hold_s) is None and all(
        share_of(problem.alone(a), sortie.plan.alone(a), hold_s=hold_s) <= 1.0
        for a in range(len(problem.starts))
    )
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
