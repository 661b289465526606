"""One round's planning problem: values only, no solver."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from numbers import Real
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from fl.radio.channel import Channel
from fl.radio.per_grid import PerGrid
from fl.radio.place import AverageRadio, Radio
from mission.base.airspace import OPEN, Airspace
from mission.base.arrays import Floats, given_alone
from mission.base.errors import PlanError, PlanInputError
from mission.base.explain import shown
from mission.planner.limits import RoundLimits
from mission.planner.native.rounds import Round
from mission.planner.performance import acceptance_radii

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
    name: str = ""  # for people; empty: aircraft are counted from 0

    def __post_init__(self) -> None:
        make_arrays(self, "start_m")


def only_one(several: tuple[Own, ...]) -> Own:
    """Return what the only aircraft has."""
    if len(several) != 1:
        raise PlanError(
            f"there are {len(several)} aircraft, where what plans or asks knows one: alone(a) of a "
            "problem or a plan is that of aircraft a"
        )
    return several[0]


class OfOnly(Generic[Own]):
    """Descriptor: what the only aircraft has, of those that `each` names. PlanError of several."""

    def __init__(self, each: str) -> None:
        self._each = each

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, item: object, owner: type) -> Own:
        found: Own = getattr(only_one(getattr(item, self._each)), self._name)
        return found


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
    # as foreseen; 0: not looked at. It needs `limits`, which know how fast is flown.
    separation_m: float = 0.0
    late_s: float = 0.0  # kept also where one is by up to so many seconds later than another
    # Of a pair that starts nearer: it keeps as much as it starts with, and no less than `least_m`.
    # None: it counts from when it is so far apart, or one of the two so far from where the other
    # started.
    least_m: float | None = None
    # Whether they wait for each other at every stop that serves somebody, and go on at one instant.
    in_step: bool = False
    # (M, 3) of the rest of a round in the air, whose heights stay as they are: where others hover
    # until it is over, which is kept away from, too. None: of a whole round.
    hovering_m: Floats | None = None

    __getstate__ = given_alone

    def __new__(cls, *_: object, **given: object) -> Self:
        refuse_old_form(given, Start, "starts", "of a problem, problem.with_own({}=...) changes it")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        make_arrays(self, "devices_m", "importance")
        for name in ("upload_s", "ready_in_s", "hovering_m"):
            if getattr(self, name) is not None:
                make_arrays(self, name)
        make_tuple(self, "starts", Start, "Start(start_m, path_budget_m)")
        if len(self.starts) == 1 and isinstance(self.start.altitude_m, Real):
            channel = replace(self.channel, altitude_m=float(self.start.altitude_m))
            object.__setattr__(self, "channel", channel)

    def alone(self, aircraft: int) -> Self:
        """The problem that one aircraft has if the others serve nobody."""
        if len(self.starts) == 1 and aircraft == 0:
            return self
        return replace(self, starts=(self.starts[aircraft],))

    def name_of(self, aircraft: int) -> str:
        """What people call an aircraft."""
        return self.starts[aircraft].name or f"aircraft {aircraft}"

    def with_own(self, **own: Any) -> Self:
        """The problem of one aircraft with other fields of its `Start`."""
        return replace(self, starts=(replace(self.start, **own),))

    @property
    def start(self) -> Start:
        """Start of the only aircraft.

        Raises:
            PlanError: there are several.
        """
        return only_one(self.starts)

    # Of the only aircraft:
    start_m = OfOnly[Floats]("starts")
    path_budget_m = OfOnly[float]("starts")
    limits = OfOnly[RoundLimits | None]("starts")
    altitudes_m = OfOnly[tuple[float, float] | None]("starts")

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
        if altitude_m not in self._at:
            self._at[altitude_m] = self.with_own(altitudes_m=None, altitude_m=altitude_m)
        return self._at[altitude_m]

    @cached_property
    def _at(self) -> dict[float, Self]:
        """The problem at altitudes that were asked for: the same ones again and again."""
        return {}


def refuse_old_form(given: Mapping[str, object], each: type, name: str, way: str) -> None:
    """Refuse arguments that each aircraft has of its own."""
    for field_ in fields(each):
        if field_.name in given:
            raise PlanInputError(
                f"{field_.name}: each aircraft has its own: {name}=({each.__name__}"
                f"({fields(each)[0].name}, ...),) has them; {way.format(field_.name)}"
            )


def make_tuple(item: object, name: str, each: type, example: str) -> None:
    """Make a tuple of a frozen dataclass's field that holds one object for each aircraft."""
    given = getattr(item, name)
    listed = tuple(given) if isinstance(given, tuple | list) else ()
    if not listed or not all(isinstance(one, each) for one in listed):
        raise PlanInputError(
            f"{name} = {shown(given)}: must be a tuple of {each.__name__}, one for each aircraft, "
            f"such as ({example},)"
        )
    object.__setattr__(item, name, listed)


def as_array(name: str, value: object, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    try:
        given: NDArray[np.generic] = np.asarray(value)
    except ValueError:  # rows of different lengths
        given = np.empty(0, dtype=object)
    # Row by row, as C reads it: a user's may be reversed or transposed.
    made = given.astype(dtype, order="C", copy=False) if given.dtype.kind in "biuf" else None
    if made is None or (dtype is np.bool_ and (made != given).any()):
        kind = "truth values" if dtype is np.bool_ else "numbers"
        raise PlanInputError(f"{name} = {shown(value)}: must be an array of {kind}")
    return made


def make_arrays(item: object, *names: str) -> None:
    """Make arrays of numbers of a frozen dataclass's fields, which may be lists and tuples."""
    for name in names:
        object.__setattr__(item, name, as_array(name, getattr(item, name)))
