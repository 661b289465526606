"""Interface to the C library that fits, varies and evaluates a round's plans (`flown.h`)."""

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fl.radio.per_grid import PerGrid
from mission.base.airspace import OPEN, Airspace
from mission.base.arrays import Bools, Floats, Ints
from mission.planner.native.library import PLANNER, POINT, enough_memory, grid_as_c
from native.headers import Structure
from native.loading import address

_NO_RADII = np.zeros(0)
_CHANNEL = ctypes.sizeof(PLANNER.Channel) // 8


COUNTED: int = PLANNER.COUNTED  # of a flight: how many amounts


def flying(limits: Sequence[tuple[float, Sequence[float]]] = (), **values: Any) -> Structure:
    """C structure of flight performance and a round's limits, `Flying` of `planner.h`: each limit
    is at most so much, and weighs what is counted (COUNTED,)."""
    rows = [PLANNER.Limit(most=most, of=tuple(weights)) for most, weights in limits]
    table = (PLANNER.Limit * PLANNER.MOST_LIMITS)(*rows)
    made: Structure = PLANNER.Flying(limits=len(rows), limit=table, **values)
    return made


class CandidatePlan(NamedTuple):
    """A plan: its route (P, 2), which points of it are the waypoints (N,), the schedule (N, K), and
    seconds of hover before it leaves."""

    route: Floats
    at: Ints
    schedule: Bools
    value: float
    wait_s: float = 0.0


class Evaluation(NamedTuple):
    """Evaluation of a plan's flight; `share` and `begins_s` are 0 for a round without limits."""

    radius_m: float  # acceptance radius
    share: float  # of the tightest limit
    stop_of: Ints  # (P,) the stop of each point
    hold_s: Floats  # (P,) hover at each stop
    offset_s: Floats  # (N,) when each step begins, after the arrival at its stop
    begins_s: Floats  # (N,) when it begins at the earliest, in seconds into the round


class Round:
    """A round in the C library's form, with a hover of `hold_s` seconds at every stop."""

    def __init__(
        self,
        devices_m: Floats,
        importance: Floats,
        *,
        steps: int,
        per_step: int,
        channel: Floats | None = None,
        altitude_m: float = 0.0,
        grid: PerGrid | None = None,
        airspace: Airspace = OPEN,
        radii_m: Floats = _NO_RADII,
        flying: Structure | None = None,
        upload_s: Floats | None = None,
        ready_in_s: Floats | None = None,
        hold_s: float = 0.0,
        price: Floats | None = None,
    ) -> None:
        """Keep the arrays and build the C structure. `channel` (9,) is `Channel.constants`, which
        `grid` replaces; `radii_m` has the widest first; `price` (K,) is what serving
        each costs. Stops need none of these.

        Raises:
            ValueError: arrays that do not fit together.
        """
        count = len(devices_m)
        self._size = steps, count
        self._room = steps * (1 if airspace.is_open else airspace.outlines.corners + 1)
        given = {  # with the shape of each
            "at": (devices_m, (count, POINT)), "importance": (importance, (count,)),
            "price": (price, (count,)),
            "upload": (upload_s, (count,)), "ready": (ready_in_s, (count,)),
            "channel": (channel, (_CHANNEL,)), "radius": (radii_m, (len(radii_m),)),
        }  # fmt: skip
        arrays = {
            name: (np.ascontiguousarray(values, dtype=np.float64), shape)
            for name, (values, shape) in given.items()
            if values is not None
        }
        as_c = grid_as_c(grid, count)
        self._kept = arrays, flying, airspace, grid, as_c
        self._round = PLANNER.Round(
            devices=count, steps=steps, per_step=per_step, altitude=altitude_m,
            grid=None if as_c is None else ctypes.addressof(as_c),
            space=None if airspace.is_open else airspace.outlines.at,
            radii=len(radii_m), hold=hold_s,
            flying=None if flying is None else ctypes.addressof(flying),
            **{name: address(array, np.float64, shape) for name, (array, shape) in arrays.items()},
        )  # fmt: skip
        self.at = ctypes.addressof(self._round)

    def fitted(
        self,
        waypoints_m: Floats,
        metres: float,
        *,
        above: float,
        limited: bool,
        wait_s: float = 0.0,
    ) -> CandidatePlan | None:
        """Return the plan along waypoints (N, 2) after a hover of `wait_s` at the first, shortened
        to `metres` and, if `limited`, to the limits; None where it is worth no more than `above`,
        or where a few cuts find no length that fits.

        Raises:
            MemoryError: there is too little memory.
        """
        steps = self._size[0]
        waypoints_m = np.ascontiguousarray(waypoints_m, dtype=np.float64)
        plan = self._with_room(
            np.zeros((0, 2)), np.zeros(steps, np.int64), np.zeros(self._size, np.bool_), 0.0, wait_s
        )
        given = self._as_c(plan)
        fits = PLANNER.fit(
            self.at, address(waypoints_m, np.float64, (steps, POINT)), ctypes.addressof(given),
            metres, above, limited,
        )  # fmt: skip
        return self._made(plan, given) if enough_memory(fits) else None

    def varied(
        self,
        plan: CandidatePlan,
        metres: float,
        changes: int,
        *,
        tolerance: float,
        seed: int,
        limited: bool,
    ) -> CandidatePlan:
        """Return the best plan of a local search (threshold accepting) with `changes` random moves,
        each of which may lose up to a share `tolerance` of the value, falling to 0 in the end;
        `metres` and `limited` as in `fitted`.

        Raises:
            MemoryError: there is too little memory.
        """
        other = self._with_room(*plan)
        given = self._as_c(other, len(plan.route))
        at = ctypes.addressof(given)
        enough_memory(PLANNER.vary(self.at, at, metres, changes, tolerance, seed, limited))
        return self._made(other, given)

    def _with_room(
        self, route: Floats, at: Ints, schedule: Bools, value: float, wait_s: float
    ) -> CandidatePlan:
        longest = np.empty((self._room, 2))
        longest[: len(route)] = route
        return CandidatePlan(longest, at.copy(), schedule.copy(), value, wait_s)

    def serving_fewer(self, plan: CandidatePlan) -> CandidatePlan:
        """Return the plan without devices for whose upload the limits leave no time or energy.

        Raises:
            MemoryError: there is too little memory.
        """
        plan = plan._replace(schedule=plan.schedule.copy())
        given = self._as_c(plan)
        enough_memory(PLANNER.leave_out(self.at, ctypes.addressof(given)))
        return plan._replace(value=given.value)

    def judged(self, plan: CandidatePlan) -> Evaluation:
        """Evaluate a plan: acceptance radius, stops, hovers and share of the limits.

        Raises:
            MemoryError: there is too little memory.
        """
        points, steps = len(plan.route), self._size[0]
        kept = np.empty(points, np.int64), np.empty(points), np.empty(steps), np.zeros(steps)
        stop, hold, offset, begins = (array.ctypes.data for array in kept)
        evaluation = PLANNER.Evaluation(stop=stop, hold=hold, offset=offset, begins=begins)
        given = self._as_c(plan)
        enough_memory(PLANNER.judge(self.at, ctypes.addressof(given), ctypes.addressof(evaluation)))
        return Evaluation(evaluation.radius, evaluation.share, *kept)

    def _as_c(self, plan: CandidatePlan, points: int | None = None) -> Any:
        room = len(plan.route)
        return PLANNER.CandidatePlan(
            points=room if points is None else points,
            route=address(plan.route, np.float64, (room, POINT)),
            at=address(plan.at, np.int64, self._size[:1]),
            schedule=address(plan.schedule, np.bool_, self._size),
            value=plan.value,
            wait=plan.wait_s,
        )

    def _made(self, plan: CandidatePlan, given: Structure) -> CandidatePlan:
        return plan._replace(route=plan.route[: given.points].copy(), value=given.value)


class ForeseenFlight:
    """A flight through stops (S, 2) with a hover at each, in the C library's form."""

    def __init__(
        self, flying: Structure, stops_m: Floats, hold_s: Sequence[float], radius_m: float
    ) -> None:
        """Raises ValueError where there is no stop, or not a hover for each."""
        self._stops = np.ascontiguousarray(stops_m, dtype=np.float64)
        self._holds, count = np.array(hold_s, dtype=np.float64), len(stops_m)
        if not count:
            raise ValueError("a flight has at least one stop")
        self._given = (
            ctypes.addressof(flying), count, address(self._stops, np.float64, (count, POINT)),
            address(self._holds, np.float64, (count,)), radius_m,
        )  # fmt: skip

    def foreseen(self) -> tuple[Floats, Floats]:
        """Predict arrival times (S,) in s, and what is counted of it (COUNTED,).

        Raises:
            MemoryError: there is too little memory.
        """
        arrived_s, counted = np.empty(len(self._stops)), np.empty(COUNTED)
        enough_memory(PLANNER.foresee(*self._given, arrived_s.ctypes.data, counted.ctypes.data))
        return arrived_s, counted

    def followed(self, *, step_s: float, count: int) -> Floats:
        """Return where it is (count, 2), every `step_s` from its start; where it ends it stays.

        Raises:
            MemoryError: there is too little memory.
        """
        at = np.empty((count, POINT))
        enough_memory(PLANNER.follow(*self._given, step_s, count, at.ctypes.data))
        return at
