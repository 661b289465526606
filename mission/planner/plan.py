"""The answer to a round's planning problem: values only, no solver, and who gives it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Real
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from mission.base import polyline
from mission.base.arrays import Bools, Floats, Ints
from mission.base.errors import PlanError, PlanInputError
from mission.base.explain import shown
from mission.planner.native.rounds import CandidatePlan
from mission.planner.performance import Foreseen
from mission.planner.problem import (
    OfOnly,
    RoundProblem,
    as_array,
    make_tuple,
    only_one,
    refuse_old_form,
)


def relative_gap(value: float, upper_bound: float) -> float:
    """(upper bound - value) / upper bound; 0 for a bound of 0, NaN without a bound."""
    return 0.0 if upper_bound == 0.0 else (upper_bound - value) / upper_bound


def as_waypoints(value: ArrayLike, steps: int | None = None) -> Floats:
    """Return waypoints as an array (N, 2), where N must be `steps` if that is given.

    Raises:
        PlanInputError: they are no such array.
    """
    made = as_array("waypoints_m", value)
    if made.ndim != 2 or made.shape[1] != 2 or steps not in (None, len(made)):
        rows = "N" if steps is None else steps
        raise PlanInputError(
            f"waypoints_m has shape {made.shape}: must be ({rows}, 2), x and y in metres at each "
            "step"
        )
    return made


@dataclass(frozen=True)
class PlannedPath:
    """Where one aircraft flies in a round. Lists and tuples become arrays.

    Raises:
        PlanInputError: the waypoints are no array (N, 2) of numbers; the altitude is no number.
    """

    waypoints_m: Floats  # (N, 2) area coordinates in metres; the first is the start
    # (N - 1) of (C, 2): corners to fly over between a waypoint and the next; empty: none at all.
    via_m: tuple[Floats, ...] = ()
    # Height above home in metres, chosen within the problem's limits; None: those name one.
    altitude_m: float | None = None
    foreseen: Foreseen | None = None  # what its flight takes, where time or energy is limited
    wait_s: float = 0.0  # seconds of hover at the start, before it leaves

    def __post_init__(self) -> None:
        object.__setattr__(self, "waypoints_m", as_waypoints(self.waypoints_m))
        if self.altitude_m is not None:
            _must_be_number("altitude_m", self.altitude_m)
        _must_be_number("wait_s", self.wait_s)

    @cached_property
    def route_m(self) -> Floats:
        """(P, 2) the polyline to fly: the waypoints, and the corners between them."""
        if not self.via_m:
            return self.waypoints_m
        legs = zip(self.waypoints_m, (*self.via_m, np.empty((0, 2))), strict=True)
        return np.vstack([points for leg in legs for points in leg])

    @cached_property
    def stops_at(self) -> Ints:
        """(N,) indices of the waypoints in `route_m`."""
        corners = [len(leg) for leg in self.via_m] or [0] * (len(self.waypoints_m) - 1)
        return np.concatenate(([0], np.cumsum(np.array(corners, dtype=np.int64) + 1)))

    @cached_property
    def path_m(self) -> float:
        """Length of the planned polyline in metres."""
        return polyline.length(self.route_m)


@dataclass(frozen=True, repr=False)
class RoundPlan:
    """Feasible paths of A aircraft and a schedule, with their true objective (exact average PER).

    Lists and tuples become arrays. Of one aircraft, what its path has can be read here, too.

    Raises:
        PlanInputError: the schedule is no array of truth values, or of a wrong shape; value or
            upper bound is no number; there is no `PlannedPath` for an aircraft.
    """

    paths: tuple[PlannedPath, ...]  # (A,) of each aircraft
    # (A, N, K) device k transmits as aircraft a passes step n; each device once at most over all.
    schedule: Bools
    value: float  # the objective of all, checked to 1e-9
    upper_bound: float = field(default=float("nan"))  # NaN where the method proves none
    nodes: int = 0  # of a search, for people
    ended: str = ""  # why less is proven than was asked for; empty where the gap is met
    mended: str = ""  # how aircraft that came too near to each other were parted, and at what cost

    def __new__(cls, *_: object, **given: object) -> Self:
        refuse_old_form(given, PlannedPath, "paths", "of a plan, plan.with_own({}=...) changes it")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        make_tuple(self, "paths", PlannedPath, "PlannedPath(waypoints_m)")
        schedule = as_array("schedule", self.schedule, np.bool_)
        of_all = len(self.paths), len(self.paths[0].waypoints_m)
        if schedule.ndim != 3 or schedule.shape[:2] != of_all:
            raise PlanInputError(
                f"schedule has shape {schedule.shape}: must be ({of_all[0]}, {of_all[1]}, K), for "
                "each aircraft and step who transmits then"
            )
        object.__setattr__(self, "schedule", schedule)
        for name in ("value", "upper_bound"):
            _must_be_number(name, getattr(self, name))

    def __repr__(self) -> str:
        # Without its arrays, which are as long as there are steps and devices.
        metres = ", ".join(f"{path.path_m:.1f}" for path in self.paths)
        heights = ", ".join(f"{h:g}" for path in self.paths if (h := path.altitude_m) is not None)
        _, steps, devices = self.schedule.shape
        return (
            f"RoundPlan(value={self.value:.6g}, upper_bound={self.upper_bound:.6g}, "
            f"path_m={metres}{heights and f', altitude_m={heights}'}; "
            f"{self.schedule.any(axis=(0, 1)).sum()} of {devices} devices served in {steps} steps)"
        )

    @classmethod
    def together(cls, plans: Sequence[Self]) -> Self:
        """The plan of several aircraft, from plans of one each that serve other devices."""
        return cls(
            tuple(plan.path for plan in plans),
            np.concatenate([plan.schedule for plan in plans]),
            sum(plan.value for plan in plans),
        )

    def alone(self, aircraft: int) -> Self:
        """The plan of one aircraft, whose share of the value is not told: NaN."""
        if len(self.paths) == 1 and aircraft == 0:
            return self
        schedule = self.schedule[aircraft, None]
        return type(self)((self.paths[aircraft],), schedule, math.nan)

    def with_own(self, **own: Any) -> Self:
        """The plan of one aircraft with other fields of its `PlannedPath`."""
        return replace(self, paths=(replace(self.path, **own),))

    @property
    def gap(self) -> float:
        """(upper bound - value) / upper bound; 0 for a bound of 0, NaN without a bound."""
        return relative_gap(self.value, self.upper_bound)

    @property
    def path(self) -> PlannedPath:
        """Path of the only aircraft.

        Raises:
            PlanError: there are several.
        """
        return only_one(self.paths)

    # Of the only aircraft:
    waypoints_m = OfOnly[Floats]("paths")
    via_m = OfOnly[tuple[Floats, ...]]("paths")
    altitude_m = OfOnly[float | None]("paths")
    foreseen = OfOnly[Foreseen | None]("paths")
    route_m = OfOnly[Floats]("paths")
    stops_at = OfOnly[Ints]("paths")

    @property
    def path_m(self) -> float:
        """Metres that are planned, of all aircraft."""
        return sum(path.path_m for path in self.paths)

    @property
    def as_candidate(self) -> CandidatePlan:
        """Plan of one aircraft as the `CandidatePlan` tuple that the C library takes."""
        wait_s = self.path.wait_s
        return CandidatePlan(self.route_m, self.stops_at, self.schedule[0], self.value, wait_s)


def _must_be_number(name: str, value: object) -> None:
    if not isinstance(value, Real):
        raise PlanInputError(f"{name} = {shown(value)}: must be a number")


class BoundError(PlanError):
    """A plan is worth more than the proven upper bound: a defect of the planner.

    Attributes:
        problem: the problem that was planned for.
        plan: the plan that was made.
        bound: the upper bound that the plan exceeds.
    """

    def __init__(self, problem: RoundProblem, plan: RoundPlan, bound: float) -> None:
        super().__init__(
            f"a plan is worth {plan.value!r}, and none was to be worth more than {bound!r}: a "
            "defect of the planner; please report it with the configuration and its seed"
        )
        self.problem, self.plan, self.bound = problem, plan, bound


class Planner(Protocol):
    """Anything that turns a round's problem into a plan: for all aircraft, or for one.

    Of several aircraft a planner that a configuration names is asked for one after another, each
    for devices that are left to it; with `several = True` for all at once.

    A planner of one's own, which leaves each aircraft where it is:

    >>> from dataclasses import replace
    >>> import aerofed, numpy as np
    >>> class Staying:
    ...     several = True
    ...
    ...     def plan(self, problem):
    ...         plans = []
    ...         for a, start in enumerate(problem.starts):
    ...             here = np.tile(start.start_m, (problem.steps, 1))
    ...             plans.append(aerofed.finish(problem.alone(a), here))
    ...             served = plans[-1].schedule.any(axis=(0, 1))
    ...             left = np.where(served, 0.0, problem.importance)
    ...             problem = replace(problem, importance=left)
    ...         return aerofed.RoundPlan.together(plans)
    >>> two = aerofed.RoundProblem(
    ...     devices_m=[(0, 0), (30, 0), (900, 0)],
    ...     importance=[1.0, 2.0, 1.0],
    ...     starts=(aerofed.Start((0, 0), 400.0), aerofed.Start((900, 0), 400.0)),
    ...     steps=2,
    ...     per_step=1,
    ...     channel=aerofed.channel("suburban"),
    ... )
    >>> aerofed.plan(two, Staying()).schedule.any(axis=1).tolist()
    [[True, True, False], [False, False, True]]
    """

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round. The same problem gives the same plan on every machine."""
