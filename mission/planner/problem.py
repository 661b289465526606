"""One round's planning problem and its answer: values only, no solver."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Real
from typing import Any, Protocol, Self

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
from mission.planner.native.rounds import CandidatePlan, Round
from mission.planner.performance import Foreseen, RoundLimits, acceptance_radii

MOST_COUNT = 1_000_000  # steps, and devices a step: places are counted in 64 bits
_SLOWER = 1.1  # times what legs take that each begin and end at rest: no round lasts longer


@dataclass(frozen=True)
class RoundProblem:
    """Maximise sum_n sum_k omega_k[n] (1 - q_bar_k[n]) delta_k over path and schedule.

    Coordinates are area coordinates in metres (x east, y north). Lists and tuples become arrays.

    Raises:
        PlanInputError: something that is to be an array is none of numbers.
    """

    devices_m: Floats  # (K, 2) where the devices stand
    importance: Floats  # (K,) delta, 0 or more
    start_m: Floats  # (2,) v_I, which is v[1]: where the aircraft is
    steps: int  # N, time steps, 1 or more
    per_step: int  # K_bar, devices that one step serves at most, 1 or more
    path_budget_m: float  # L_max, metres, 0 or more
    channel: Channel  # with the planned height in altitude_m
    airspace: Airspace = OPEN  # where may be flown, at any of the altitudes
    limits: RoundLimits | None = None  # of time and energy; None: metres alone count
    # (lowest, highest) height above home in metres: the plan has the best of them, and the
    # channel's own means nothing. None: the channel's.
    altitudes_m: tuple[float, float] | None = None
    # (K,) how long the aircraft hovers for each device that it serves; None: it does not
    upload_s: Floats | None = None
    # (K,) seconds into the round from which each has an update to send: served before, it is worth
    # nothing. None: all have one from the start. It needs `limits`, which know how fast is flown.
    ready_in_s: Floats | None = None
    # What is believed of the radio at each place, in place of the channel's average; of one
    # altitude, the channel's.
    per_grid: PerGrid | None = None

    __getstate__ = given_alone

    def __post_init__(self) -> None:
        _make_arrays(self, "devices_m", "importance", "start_m")
        for name in ("upload_s", "ready_in_s"):
            if getattr(self, name) is not None:
                _make_arrays(self, name)

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
        most_s = min(limits.duration_s, limits.energy_j / limits.performance.least_w)
        if not self.airspace.is_open:  # any number of corners between waypoints
            return most_s
        flown_s = legs * limits.performance.least_s(self.most_m / legs) if legs else 0.0
        sent_s = 0.0 if self.upload_s is None else float(self.upload_s.sum())
        return min(most_s, _SLOWER * flown_s + sent_s)

    @cached_property
    def unlimited(self) -> Self:
        """The problem without areas, limits and devices that have to get ready."""
        return replace(self, airspace=OPEN, limits=None, ready_in_s=None)

    @cached_property
    def as_judged(self) -> Round:
        """C view of the round that evaluates its plans, with the hovers of `upload_s` alone."""
        return self.judged_with()

    def judged_with(self, *, hold_s: float = 0.0, widest_m: float | None = None) -> Round:
        """Return the C view of the round with a hover of `hold_s` at every stop, and acceptance
        radii up to `widest_m` (None: that of the limits); half of the airspace's margin at most."""
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
            ready_in_s=self.ready_in_s, hold_s=hold_s,
        )  # fmt: skip

    def at(self, altitude_m: float | None) -> Self:
        """The same problem at one altitude; None: the channel's."""
        if altitude_m is None:
            return self
        channel = replace(self.channel, altitude_m=altitude_m)
        return replace(self, channel=channel, altitudes_m=None)


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


@dataclass(frozen=True, repr=False)
class RoundPlan:
    """A feasible path and schedule with its true objective (exact average PER).

    Lists and tuples become arrays.

    Raises:
        PlanInputError: waypoints or schedule are no arrays of numbers, or of a wrong shape; value,
            upper bound or altitude is no number.
    """

    waypoints_m: Floats  # (N, 2) area coordinates in metres; the first is the start
    schedule: Bools  # (N, K) device k transmits as step n is passed; each device once at most
    value: float  # its objective, checked to 1e-9
    upper_bound: float = field(default=float("nan"))  # NaN where the method proves none
    nodes: int = 0  # of a search, for people
    # (N - 1) of (C, 2): corners to fly over between a waypoint and the next; empty: none at all.
    via_m: tuple[Floats, ...] = ()
    # Height above home in metres, chosen within the problem's limits; None: those name one.
    altitude_m: float | None = None
    foreseen: Foreseen | None = None  # what its flight takes, where time or energy is limited
    ended: str = ""  # why less is proven than was asked for; empty where the gap is met

    def __post_init__(self) -> None:
        object.__setattr__(self, "waypoints_m", as_waypoints(self.waypoints_m))
        schedule = _as_array("schedule", self.schedule, np.bool_)
        if schedule.ndim != 2 or len(schedule) != len(self.waypoints_m):
            raise PlanInputError(
                f"schedule has shape {schedule.shape}: must be ({len(self.waypoints_m)}, K), for "
                "each step who transmits then"
            )
        object.__setattr__(self, "schedule", schedule)
        for name in ("value", "upper_bound", "altitude_m"):
            number = getattr(self, name)
            if not isinstance(number, Real) and not (name == "altitude_m" and number is None):
                raise PlanInputError(f"{name} = {shown(number)}: must be a number")

    def __repr__(self) -> str:
        # Without its arrays, which are as long as there are steps and devices.
        height = "" if self.altitude_m is None else f", altitude_m={self.altitude_m:g}"
        return (
            f"RoundPlan(value={self.value:.6g}, upper_bound={self.upper_bound:.6g}, "
            f"path_m={self.path_m:.1f}{height}; {self.schedule.any(axis=0).sum()} of "
            f"{self.schedule.shape[-1]} devices served in {len(self.waypoints_m)} steps)"
        )

    @property
    def gap(self) -> float:
        """(upper bound - value) / upper bound; 0 for a bound of 0, NaN without a bound."""
        return relative_gap(self.value, self.upper_bound)

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

    @property
    def as_candidate(self) -> CandidatePlan:
        """Plan as the `CandidatePlan` tuple that the C library takes."""
        return CandidatePlan(self.route_m, self.stops_at, self.schedule, self.value)

    @cached_property
    def path_m(self) -> float:
        """Length of the planned polyline in metres."""
        return polyline.length(self.route_m)


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
    """Anything that turns a round's problem into a plan."""

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round. The same problem gives the same plan on every machine."""
