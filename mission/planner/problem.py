"""One round's planning problem and its answer: values only, no solver."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from numbers import Real
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from fl.radio.channel import Channel
from fl.radio.per_grid import PerGrid
from fl.radio.place import AverageRadio, Radio
from mission.base import polyline
from mission.base.airspace import OPEN, Airspace
from mission.base.arrays import Bools, Floats, Ints, given_alone
from mission.base.errors import PlanError
from mission.base.explain import shown
from mission.planner.errors import PlanInputError
from mission.planner.limits import RoundLimits
from mission.planner.native.rounds import CandidatePlan, Round
from mission.planner.performance import Foreseen, acceptance_radii

Own = TypeVar("Own")

MOST_COUNT = 1_000_000  # steps, and devices a step: places are counted in 64 bits
_SLOWER = 1.1  # times what legs take that each begin and end at rest: no round lasts longer


@dataclass(frozen=True)
class Start:
    """What is one aircraft's own in a round: where it is, and what it may take.

    Lists and tuples become arrays.

    Raises:
        PlanInputError: the place is no array of numbers.
    """

    start_m: Floats  # (2,) v_I, which is v[1]: where the aircraft is
    path_budget_m: float  # L_max, metres, 0 or more
    limits: RoundLimits | None = None  # of time and energy; None: metres alone count
    # (lowest, highest) height above home in metres: the plan has the best of them. None: one
    # height, `altitude_m`.
    altitudes_m: tuple[float, float] | None = None
    altitude_m: float | None = None  # None: the channel's

    def __post_init__(self) -> None:
        _make_arrays(self, "start_m")


@dataclass(frozen=True)
class RoundProblem:
    """Maximise sum_a sum_n sum_k omega_k^a[n] (1 - q_bar_k(v^a[n])) delta_k over the paths and the
    schedule of A aircraft, A = 1 being the ordinary case.

    Coordinates are area coordinates in metres (x east, y north). Lists and tuples become arrays.
    Of one aircraft, `start_m`, `path_budget_m`, `limits` and `altitudes_m` can be read here, too,
    and `channel` has its altitude.

    Raises:
        PlanInputError: something that is to be an array is none of numbers, or there is no
            `Start` for an aircraft.
    """

    devices_m: Floats  # (K, 2) where the devices stand
    importance: Floats  # (K,) delta, 0 or more
    starts: tuple[Start, ...]  # (A,) of each aircraft
    steps: int  # N, time steps of each aircraft, 1 or more
    per_step: int  # K_bar, devices that one step serves at most, 1 or more
    channel: Channel  # of each aircraft its own; `altitude_m` is of those that name none
    airspace: Airspace = OPEN  # where may be flown, at any of the altitudes
    # (K,) how long an aircraft hovers for each device that it serves; None: it does not
    upload_s: Floats | None = None
    # (K,) seconds into the round from which each has an update to send: served before, it is worth
    # nothing. None: all have one from the start. It needs `limits`, which know how fast is flown.
    ready_in_s: Floats | None = None
    # What is believed of the radio at each place, in place of the channel's average; of one
    # altitude, the channel's.
    per_grid: PerGrid | None = None
    # Metres that aircraft keep from each other, up and down included, at all times of their flights
    # as foreseen; 0: not looked at. It needs `limits`, which know how fast is flown. A pair that
    # starts nearer counts from when it is so far apart, or one of the two so far from where the
    # other started.
    separation_m: float = 0.0

    __getstate__ = given_alone

    def __new__(cls, *_: object, **given: object) -> Self:
        _refuse_old_form(
            given, Start, "starts", "of a problem, problem.with_own({}=...) changes it"
        )
        return super().__new__(cls)

    def __post_init__(self) -> None:
        _make_arrays(self, "devices_m", "importance")
        for name in ("upload_s", "ready_in_s"):
            if getattr(self, name) is not None:
                _make_arrays(self, name)
        _make_tuple(self, "starts", Start, "Start(start_m, path_budget_m)")
        if len(self.starts) == 1 and isinstance(self.start.altitude_m, Real):
            channel = replace(self.channel, altitude_m=float(self.start.altitude_m))
            object.__setattr__(self, "channel", channel)

    def alone(self, aircraft: int) -> Self:
        """The problem that one aircraft has if the others serve nobody."""
        if len(self.starts) == 1 and aircraft == 0:
            return self
        return replace(self, starts=(self.starts[aircraft],))

    def with_own(self, **own: Any) -> Self:
        """The problem of one aircraft with other fields of its `Start`."""
        return replace(self, starts=(replace(self.start, **own),))

    @property
    def start(self) -> Start:
        """Start of the only aircraft.

        Raises:
            PlanError: there are several.
        """
        return _only(self.starts)

    @property
    def start_m(self) -> Floats:
        """(2,) where the only aircraft is."""
        return self.start.start_m

    @property
    def path_budget_m(self) -> float:
        """Metres that the only aircraft may fly."""
        return self.start.path_budget_m

    @property
    def limits(self) -> RoundLimits | None:
        """Limits of time and energy of the only aircraft."""
        return self.start.limits

    @property
    def altitudes_m(self) -> tuple[float, float] | None:
        """Altitudes that the only aircraft may choose from; None: the channel's."""
        return self.start.altitudes_m

    @cached_property
    def radio(self) -> Radio:
        """Radio model that plans are valued with: the PER grid, else the channel's average."""
        return self.per_grid or AverageRadio(self.channel, self.devices_m)

    @cached_property
    def most_m(self) -> float:
        """Upper bound in metres on the length of a path within budget and limits."""
        if self.limits is None:
            return self.path_budget_m
        return min(self.path_budget_m, self.limits.longest_m(self.legs))

    @property
    def legs(self) -> float:
        """Upper bound on a path's straight legs; infinity where it may lead around areas."""
        return self.steps - 1 if self.airspace.is_open else math.inf

    @property
    def longest_s(self) -> float:
        """Upper bound in seconds on a round's duration; needs `limits`."""
        limits, legs = self.limits, self.steps - 1
        assert limits is not None
        most_s = limits.longest_s
        if not self.airspace.is_open:  # any number of corners between waypoints
            return most_s
        flown_s = legs * limits.performance.least_s(self.most_m / legs) if legs else 0.0
        sent_s = 0.0 if self.upload_s is None else float(self.upload_s.sum())
        return min(most_s, _SLOWER * flown_s + sent_s)

    @cached_property
    def unlimited(self) -> Self:
        """The problem without areas, limits and devices that have to get ready."""
        free = self.with_own(limits=None)
        return replace(free, airspace=OPEN, ready_in_s=None, separation_m=0.0)

    @cached_property
    def as_judged(self) -> Round:
        """C view of the round that evaluates its plans, with the hovers of `upload_s` alone."""
        return self.judged_with()

    def judged_with(
        self, *, hold_s: float = 0.0, widest_m: float | None = None, price: Floats | None = None
    ) -> Round:
        """Return the C view of the round with a hover of `hold_s` at every stop, and acceptance
        radii up to `widest_m` (None: that of the limits), half of the airspace's margin at most,
        and a `price` (K,) on serving each device."""
        limits = self.limits
        if widest_m is None:
            widest_m = 1.0 if limits is None else limits.performance.widest_m
        if not self.airspace.is_open:
            widest_m = min(widest_m, self.airspace.margin_m / 2.0)
        return Round(
            self.devices_m, self.importance, steps=self.steps, per_step=self.per_step,
            channel=self.channel.constants, altitude_m=self.channel.altitude_m, grid=self.per_grid,
            airspace=self.airspace, radii_m=acceptance_radii(widest_m),
            flying=None if limits is None else limits.flying, upload_s=self.upload_s,
            ready_in_s=self.ready_in_s, hold_s=hold_s, price=price,
        )  # fmt: skip

    def at(self, altitude_m: float | None) -> Self:
        """The same problem at one altitude; None: the channel's."""
        if altitude_m is None:
            return self
        return self.with_own(altitudes_m=None, altitude_m=altitude_m)


def _only(several: tuple[Own, ...]) -> Own:
    """Return what the only aircraft has."""
    if len(several) != 1:
        raise PlanError(
            f"there are {len(several)} aircraft, where what plans or asks knows one: alone(a) of a "
            "problem or a plan is that of aircraft a"
        )
    return several[0]


def _refuse_old_form(given: Mapping[str, object], each: type, name: str, way: str) -> None:
    """Refuse arguments that each aircraft has of its own."""
    for field_ in fields(each):
        if field_.name in given:
            raise PlanInputError(
                f"{field_.name}: each aircraft has its own: {name}=({each.__name__}"
                f"({fields(each)[0].name}, ...),) has them; {way.format(field_.name)}"
            )


def _make_tuple(item: object, name: str, each: type, example: str) -> None:
    """Make a tuple of a frozen dataclass's field that holds one object for each aircraft."""
    given = getattr(item, name)
    listed = tuple(given) if isinstance(given, tuple | list) else ()
    if not listed or not all(isinstance(one, each) for one in listed):
        raise PlanInputError(
            f"{name} = {shown(given)}: must be a tuple of {each.__name__}, one for each aircraft, "
            f"such as ({example},)"
        )
    object.__setattr__(item, name, listed)


def relative_gap(value: float, upper_bound: float) -> float:
    """(upper bound - value) / upper bound; 0 for a bound of 0, NaN without a bound."""
    return 0.0 if upper_bound == 0.0 else (upper_bound - value) / upper_bound


def as_waypoints(value: ArrayLike, steps: int | None = None) -> Floats:
    """Return waypoints as an array (N, 2), where N must be `steps` if that is given.

    Raises:
        PlanInputError: they are no such array.
    """
    made = _as_array("waypoints_m", value)
    if made.ndim != 2 or made.shape[1] != 2 or steps not in (None, len(made)):
        rows = "N" if steps is None else steps
        raise PlanInputError(
            f"waypoints_m has shape {made.shape}: must be ({rows}, 2), x and y in metres at each "
            "step"
        )
    return made


def _as_array(name: str, value: object, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    try:
        given: NDArray[np.generic] = np.asarray(value)
    except ValueError:  # rows of different lengths
        given = np.empty(0, dtype=object)
    made = given.astype(dtype, copy=False) if given.dtype.kind in "biuf" else None
    if made is None or (dtype is np.bool_ and (made != given).any()):
        kind = "truth values" if dtype is np.bool_ else "numbers"
        raise PlanInputError(f"{name} = {shown(value)}: must be an array of {kind}")
    return made


def _make_arrays(item: object, *names: str) -> None:
    """Make arrays of numbers of a frozen dataclass's fields, which may be lists and tuples."""
    for name in names:
        object.__setattr__(item, name, _as_array(name, getattr(item, name)))


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
        _refuse_old_form(given, PlannedPath, "paths", "of a plan, plan.with_own({}=...) changes it")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        _make_tuple(self, "paths", PlannedPath, "PlannedPath(waypoints_m)")
        schedule = _as_array("schedule", self.schedule, np.bool_)
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
        return _only(self.paths)

    @property
    def waypoints_m(self) -> Floats:
        """(N, 2) waypoints of the only aircraft."""
        return self.path.waypoints_m

    @property
    def via_m(self) -> tuple[Floats, ...]:
        """Corners between the waypoints of the only aircraft."""
        return self.path.via_m

    @property
    def altitude_m(self) -> float | None:
        """Altitude that was chosen for the only aircraft."""
        return self.path.altitude_m

    @property
    def foreseen(self) -> Foreseen | None:
        """What the flight of the only aircraft takes, where time or energy is limited."""
        return self.path.foreseen

    @property
    def route_m(self) -> Floats:
        """(P, 2) the polyline that the only aircraft flies."""
        return self.path.route_m

    @property
    def stops_at(self) -> Ints:
        """(N,) indices of the waypoints in `route_m`, of the only aircraft."""
        return self.path.stops_at

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

    A planner of one's own, which leaves each aircraft where it is:

    >>> from dataclasses import replace
    >>> import aerofed, numpy as np
    >>> class Staying:
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
