"""A round's plan while it is flown: its remaining steps are replanned where updates were lost."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mission.base import polyline
from mission.base.arrays import Bools, Floats
from mission.config.models import MissionConfig
from mission.flight.missions.round_mission import FlightPlan, flight_of_round
from mission.planner.evaluate import objective
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem
from mission.scenario.limits import SHORT_M

_GAIN = 0.01  # of what the round is worth: for less no mission is replaced


@dataclass(frozen=True)
class Course:
    """A round in flight: its whole plan as of now, and the plan of the steps still to be flown."""

    problem: RoundProblem  # of the whole round, at its altitude, as believed at its last plan
    plan: RoundPlan  # of the whole round, whose bound holds for rounds that are not planned anew
    rest_problem: RoundProblem
    rest: RoundPlan  # from where the aircraft is: the last steps of `plan`
    begins: int = 0  # with this step of the round

    def flight(self, mission: MissionConfig) -> FlightPlan:
        """The flight of the rest, its steps numbered as those of the round."""
        ordered = flight_of_round(self.rest_problem, self.rest, hold_s=0.0, mission=mission)
        stops = tuple(
            replace(stop, steps=tuple(step + self.begins for step in stop.steps))
            for stop in ordered.stops
        )
        return replace(ordered, stops=stops, goes_on=True)

    def ahead(
        self, step: int, start_m: Floats, *, heard: Bools, elapsed_s: float, used_j: float
    ) -> RoundProblem | None:
        """Return the planning problem of the rest of the round, from `step` and `start_m` (2,) on;
        None where no step, time or energy is left.

        Devices `heard` (K,) are not served again. Metres are those of the plan, so that the
        whole path keeps to its budget; seconds and joules are those that the flight took so far.
        """
        whole, route_m = self.problem, self.plan.route_m[: self.plan.stops_at[step - 1] + 1]
        limits, ready_in_s = whole.limits, whole.ready_in_s
        flown_m = polyline.length(np.vstack((route_m, start_m)))
        if step >= whole.steps:
            return None
        if limits is not None:
            taken = {"duration_s": elapsed_s, "energy_j": used_j, "flown_m": flown_m}
            limits = limits.less(taken)
            if any(limit.most < limit.least(SHORT_M) for limit in limits.each):
                return None
        left_m = max(0.0, whole.path_budget_m - flown_m)
        return replace(
            whole.with_own(start_m=start_m, path_budget_m=left_m, limits=limits),
            importance=np.where(heard, 0.0, whole.importance),
            steps=whole.steps - step,
            ready_in_s=None if ready_in_s is None else np.maximum(0.0, ready_in_s - elapsed_s),
        )

    def as_planned(self, problem: RoundProblem) -> float:
        """What the remaining plan is worth in a `problem` of the rest of the round."""
        step, (ordered,) = self.problem.steps - problem.steps, self.plan.schedule
        return objective(problem, self.plan.waypoints_m[step:], ordered[step:])

    def onwards(self, problem: RoundProblem, rest: RoundPlan, step: int) -> "Course":
        """Return the course with `rest`, a plan of `problem`, as its plan from `step` on.

        A device that is lost and served again is in the plan of the round twice, and counts in its
        value for each time.
        """
        waypoints_m = np.vstack((self.plan.waypoints_m[:step], rest.waypoints_m))
        schedule = np.vstack((self.plan.schedule[0][:step], *rest.schedule))
        via_m = () if self.problem.airspace.is_open else (
            *self.plan.via_m[: step - 1], np.empty((0, 2)), *rest.via_m
        )  # fmt: skip
        # As it is believed now. Others may have had more steps left.
        whole = replace(self.problem, per_grid=problem.per_grid, steps=len(waypoints_m))
        path = replace(self.plan.path, waypoints_m=waypoints_m, via_m=via_m, foreseen=None)
        plan = RoundPlan((path,), schedule[None], objective(whole, waypoints_m, schedule))
        return Course(whole, plan, problem, rest, step)


def ahead_of_all(each: Sequence[RoundProblem]) -> RoundProblem:
    """Return the problem of the rest of a round of several aircraft, from those of each: with the
    steps that the one has left that has most."""
    steps = max(problem.steps for problem in each)
    return replace(each[0], starts=tuple(problem.start for problem in each), steps=steps)


def is_better(rest: RoundPlan, as_planned: float, whole: float) -> bool:
    """Whether a plan of the rest gains more than 1 % of what the round's plan is worth."""
    return rest.value - as_planned > _GAIN * whole
