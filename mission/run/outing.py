"""What one aircraft does in a round, while it is flown and when it is over; and what all did."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mission.flight.flyers.base import Flyer
from mission.flight.missions.round_mission import FlightPlan, flight_of_round
from mission.flight.track import FlownTrack
from mission.log.records import RoundRecord, UplinkRecord
from mission.planner.evaluate import in_time, objective
from mission.planner.flyable import Stop
from mission.planner.performance import Foreseen
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem
from mission.run.course import Course
from mission.scenario.limits import Aircraft, Amount
from mission.scenario.strategies import Sortie


@dataclass
class Outing:
    """One aircraft's part of a round: course, flights and uplinks so far, replanned rests."""

    number: int  # of the aircraft
    aircraft: Aircraft
    flyer: Flyer
    hold_s: float  # of hover at each stop
    course: Course  # as it has become
    foreseen: Foreseen = field(init=False)  # of the whole of it
    ordered: FlightPlan = field(init=False)  # the whole of it as it is flown
    flights: list[FlownTrack] = field(default_factory=list)
    told: list[FlightPlan] = field(default_factory=list)  # of each of them, what it was to fly
    served: list[UplinkRecord] = field(default_factory=list)
    reached: int = -1  # the last step of its plan that it has flown
    idle_s: float = 0.0  # of hover after the last stop of its flights, until others had finished
    used_j: float = 0.0
    on_the_spot: int = 0  # rests that begin with a hover, which the whole has in the stop before
    lost: bool = False
    done: bool = False  # nothing is left of its round

    @property
    def height_m(self) -> float:
        """Above home, at which it flies."""
        return self.course.problem.channel.altitude_m

    def order(self) -> FlightPlan:
        """Return the flight of the course, or of what is left of it; foresee the whole."""
        course, mission = self.course, self.flyer.mission
        if self.done:
            return self.waiting
        self.ordered = rest = flight_of_round(
            course.problem, course.plan, hold_s=self.hold_s, mission=mission
        )
        if course.begins:
            rest = course.flight(mission)
            self.on_the_spot += rest.stops[0].hold_s > 0.0
        self.foreseen = self.flyer.performance.with_hovers_begun(
            self.ordered.foreseen(self.flyer.performance), self.on_the_spot
        )
        return rest

    @property
    def waiting(self) -> FlightPlan:
        """A part in which it waits where it is for the others, after all of its own."""
        here = Stop(self.ordered.stops[-1].xy_m, ())
        return replace(self.ordered, stops=(here,), is_part=True, goes_on=True)

    def parts(self, rest: FlightPlan) -> list[FlightPlan]:
        """What `order` gave, cut behind each stop that serves somebody."""
        if self.done:
            return [rest]
        serves = np.asarray(self.course.plan.schedule[0].any(axis=1))
        return list(rest.parts(serves))

    def flew(self, part: FlightPlan, flight: FlownTrack) -> None:
        """Add the flight of a part of the course."""
        self.flights.append(flight)
        self.told.append(part)
        passed, stop = flight.passages, part.stops[-1]
        if not passed or passed[-1] is None:
            self.idle_s = math.nan
        else:
            done_ns = passed[-1].t_ns + round(1e9 * stop.hold_s)
            self.idle_s += max(0.0, (int(flight.t_ns[-1]) - done_ns) / 1e9)
        if stop.steps:
            self.reached = stop.steps[-1]
        unknown = math.isnan(flight.energy_j)
        self.used_j += (
            part.foreseen(self.flyer.performance).energy_j if unknown else flight.energy_j
        )

    @cached_property
    def flight(self) -> FlownTrack:
        """All of its flights as one, once they are over."""
        return FlownTrack.joined(self.flights)

    @property
    def cost(self) -> Amount:
        """What it has used of the budgets.

        A round never costs more metres than its plan could have used: L_total pays for
        L_total / L_max rounds, also where wind or overshot corners make the flight longer than the
        plan. A first round may be all that a budget pays for, and less than a whole one. Seconds
        and joules are those that the flight took.
        """
        flight = self.flight
        return Amount(
            min(flight.flown_m, self.course.problem.path_budget_m),
            flight.duration_s,
            self.foreseen.energy_j if math.isnan(flight.energy_j) else flight.energy_j,
        )


def outings_of(
    fleet: Sequence[Aircraft], aloft: Mapping[int, Flyer], problem: RoundProblem, sortie: Sortie
) -> list[Outing]:
    """What each aircraft that is aloft is to do in a round."""
    found = []
    for at, (number, flyer) in enumerate(aloft.items()):
        plan = sortie.plan.alone(at)
        own = problem.alone(at).at(plan.altitude_m)
        if len(aloft) > 1:
            in_turn = plan.schedule & in_time(own, plan, hold_s=sortie.hold_s)
            plan = replace(plan, value=objective(own, plan.waypoints_m, in_turn[0]))
        course = Course(own, plan, own, plan)
        found.append(Outing(number, fleet[number], flyer, sortie.hold_s, course))
    return found


def round_record(outings: Sequence[Outing], plan: RoundPlan, beside: RoundRecord) -> RoundRecord:
    """Return the record of a round of some aircraft: metres and joules of all together, seconds of
    the longest, charge of the emptiest. What they do not know is as in `beside`."""
    flights = [one.flight for one in outings]
    served = [record for one in outings for record in one.served]
    chosen_m = {one.course.plan.altitude_m for one in outings}
    chosen = chosen_m.pop() if len(chosen_m) == 1 else None
    return replace(
        beside,
        start_t_s=int(flights[0].t_ns[0]) / 1e9,
        duration_s=max(flight.duration_s for flight in flights),
        plan_objective=plan.value,
        est_objective=sum(record.importance * success(record.est_per) for record in served),
        true_objective=sum(record.importance * success(record.true_per) for record in served),
        upper_bound=plan.upper_bound,
        plan_path_m=sum(one.course.plan.path_m for one in outings),
        flown_path_m=sum(flight.flown_m for flight in flights),
        scheduled=len({record.device for record in served}),
        delivered=len({record.device for record in served if record.delivered}),
        battery_remaining=min(flight.battery_remaining for flight in flights),
        plan_altitude_m=math.nan if chosen is None else chosen,
        plan_duration_s=max(one.foreseen.duration_s for one in outings),
        plan_energy_j=sum(one.foreseen.energy_j for one in outings),
        energy_j=sum(flight.energy_j for flight in flights),
    )


def alone(outing: Outing, whole: RoundRecord) -> RoundRecord:
    """Return the record of a round as that of one of several aircraft."""
    return round_record([outing], outing.course.plan, whole)


def success(per: float) -> float:
    """1 - PER; 0 for a slot that was never reached."""
    return 0.0 if math.isnan(per) else 1.0 - per
