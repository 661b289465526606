"""The C interface of planning (`planner.h`), every size and pointer checked once."""

import ctypes
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fl.radio.per_grid import PerGrid
from mission.base.arrays import Bools, Floats, Ints
from mission.planner.reward import Conjugates, RewardTable
from native.building import library
from native.headers import Structure, columns
from native.loading import address, interface

PLANNER = interface(library("planner"))
MOST_DEVICES: int = PLANNER.MOST_DEVICES  # of a search
HOPE: float = PLANNER.HOPE_PERCENT / 100  # of success: with less nobody is asked to send
POINT = columns(PLANNER.Point, "x y")


def grid_as_c(grid: PerGrid | None, devices: int) -> Structure | None:
    """Return the C structure of a PER grid, which must outlive it; None without a grid.

    Raises:
        ValueError: it is of another number of devices, or of too few places.
    """
    if grid is None:
        return None
    rows, columns = grid.success.shape[1:]
    if min(rows, columns) < 2 or not grid.cell_m > 0.0:
        raise ValueError(f"no grid: {rows} x {columns} places every {grid.cell_m} m")
    at, (x, y) = address(grid.success, np.float64, (devices, rows, columns)), grid.first_m
    made: Structure = PLANNER.Grid(
        success=at, rows=rows, columns=columns, first=PLANNER.Point(x=x, y=y), cell=grid.cell_m
    )
    return made


@dataclass(frozen=True)
class Devices:
    """The devices worth something, in coordinates with the start at the origin."""

    u: Floats  # (K, 2) positions in metres
    delta: Floats  # (K,) importance, above 0
    rows: Floats  # (R, 3) f, f', f'' of the channel, one row a metre
    grid: PerGrid | None = None  # of their success, in place of the rows; about the start
    price: Floats | None = None  # (K,) what serving each costs, below delta
    # Where hovers and turns count, for bounds only:
    hover: Floats | None = None  # (K,) metres of the length that go while each sends
    after: Floats | None = None  # (K,) most metres of time from its turn on, its hover included
    sends: Floats | None = None  # (K,) metres that could be flown while each sends

    def as_c(self) -> Any:
        """The structure as C takes it; the arrays have to outlive it."""
        count, rows = len(self.delta), len(self.rows)
        if not count or not rows:
            raise ValueError("no device, or an empty table")
        return PLANNER.Devices(
            count=count,
            at=address(self.u, np.float64, (count, POINT)),
            delta=address(self.delta, np.float64, (count,)),
            rows=rows,
            table=address(self.rows, np.float64, (rows, 3)),
            grid=None if self._grid is None else ctypes.addressof(self._grid),
            **{
                name: address(metres, np.float64, (count,))
                for name in ("price", "hover", "after", "sends")
                if (metres := getattr(self, name)) is not None
            },
        )

    def brought(self, served: Ints, places_m: Floats) -> Floats:
        """Return what devices `served` (S,) bring from places (S, 2), before any price."""
        if self.grid is not None:
            return (1.0 - self.grid.per(served, places_m)) * self.delta[served]
        far_m = np.hypot(*(self.u[served] - places_m).T)
        return RewardTable(self.rows, self.rows[:0]).expanded(far_m)[0] * self.delta[served]

    @cached_property
    def _grid(self) -> Structure | None:
        return grid_as_c(self.grid, len(self.delta))


@dataclass(frozen=True)
class PathLimits:
    """Constraints of a plan: steps, devices a step, path length."""

    steps: int  # N
    per_step: int  # K_bar
    length: float  # L_max, metres
    # Metres that a stop takes at least beyond its leg, and from a leg of another length on, as many
    # more: of the length, and of what comes after a device's turn.
    stop: tuple[float, float] = (0.0, 0.0)
    turn: tuple[float, float] = (0.0, 0.0)

    def as_c(self) -> Any:
        """The structure as C takes it."""
        if self.steps < 2 or self.per_step < 1 or not 0.0 < self.length < np.inf:
            raise ValueError(f"nothing to move for: {self}")
        stop, turn = (
            PLANNER.Stopping(least=least, brake=brake) for least, brake in (self.stop, self.turn)
        )
        return PLANNER.Limits(
            steps=self.steps, per_step=self.per_step, length=self.length, stop=stop, turn=turn
        )


@dataclass(frozen=True, kw_only=True)
class Relaxation(Conjugates):
    """Tables of the dual bound."""

    promise: Floats  # (K, B) bound of delta f for a device out of reach of radius b

    def as_c(self, devices: int) -> Any:
        """The structure as C takes it; the arrays have to outlive it."""
        rows, splines = self.coefficients.shape
        radii = len(self.radii_m)
        if splines < 4 or radii > np.iinfo(np.int8).max:
            raise ValueError(f"splines of {splines} coefficients between {radii} radii")
        made = PLANNER.Relaxation(
            radii=radii,
            splines=splines,
            coefficients=address(self.coefficients, np.float64, (rows, splines)),
            spacing=address(self.spacing, np.float64, (rows,)),
            ends=address(self.ends, np.int64, (rows, 2)),
            row=address(self.row, np.int64, (radii, radii)),
            ladder=address(self.ladder, np.int64, (radii,)),
            radius_m=address(self.radii_m, np.float64, (radii,)),
            promise=address(self.promise, np.float64, (devices, radii)),
        )
        _check_range("ends", self.ends, radii)
        _check_range("ladder", self.ladder, radii)
        _check_range("row", self.row[np.triu_indices(radii, 1)], rows)
        return made


def _check_range(name: str, indices: Ints, end: int) -> None:
    if indices.size and not 0 <= indices.min() <= indices.max() < end:
        raise ValueError(f"{name} must be from 0 to {end - 1}")


_ENDED = {
    PLANNER.DONE: "after {nodes} nodes nothing was left to divide",
    PLANNER.OUT_OF_NODES: "it ended after {nodes} nodes, as many as it may look into",
    PLANNER.TOO_SLOW: "it ended after {nodes} of {most} nodes, as at its pace the rest of them "
    "would not do",
}


def explore(
    devices: Devices, limits: PathLimits, *, starts: int, tries: int
) -> tuple[float, Floats, Ints]:
    """Plan heuristically: insert towards `starts` devices, then `tries` ruin-and-recreate steps.

    Returns:
        What the plan earns, its path (N, 2), and who is served at which step (K,), -1: nobody.

    Raises:
        ValueError: arrays that do not fit together.
        MemoryError: there is too little memory.
    """
    way, assigned = np.zeros((limits.steps, 2)), np.full(len(devices.delta), -1, dtype=np.int64)
    shared = devices.as_c(), limits.as_c()
    value = PLANNER.explore(
        *map(ctypes.addressof, shared),
        min(starts, len(devices.delta)),
        tries,
        way.ctypes.data,
        assigned.ctypes.data,
    )
    return enough_memory(value), way, assigned


@dataclass(frozen=True)
class Goal:
    """Gap at which a search stops, and its caps of nodes."""

    gap: float  # relative gap (bound - value) / bound that is enough
    max_nodes: int  # nodes that are looked into at most
    slack: float = 0.0  # bound - value that is enough, whatever the gap
    scale: float = 0.0  # size of a value that bounds are worked out for; 0: that of the plan
    max_open: int = 50_000  # nodes that are open at most; others are closed with their bound

    def __post_init__(self) -> None:
        if not 0.0 <= self.gap < 1.0 or self.max_nodes < 0 or self.max_open < 1:
            raise ValueError(f"nothing to search for: {self}")

    def met_by(self, found: "Found") -> bool:
        """Whether the bound is near enough to the plan."""
        most = max(found.value / (1.0 - self.gap), found.value + self.slack)
        return found.bound <= most * (1.0 + 1e-9)

    def left(self, plan: "Found", max_nodes: int, aircraft: int = 1) -> "Goal | None":
        """Return what is left for a search up to `max_nodes` in all; None: it need not begin."""
        left = min(max_nodes, self.max_nodes) - plan.nodes
        if left <= 0 or not max(plan.value, self.scale) > 0.0 or self.met_by(plan):
            return None
        most_open = max(1, min(self.max_open // aircraft, left * (len(plan.assigned) + 2)))
        return replace(self, max_nodes=left, max_open=most_open)

    def as_c(self) -> Any:
        """Gap, slack and scale as C takes them."""
        return PLANNER.Target(gap=self.gap, slack=self.slack, scale=self.scale)


@dataclass(frozen=True)
class Found:
    """A plan in the C library's form, with the upper bound on all plans and search statistics."""

    value: float  # what it earns
    way: Floats  # (N, 2) its path
    assigned: Ints  # (K,) who is served at which step, -1: nobody
    bound: float  # that no plan exceeds
    nodes: int = 0  # looked into
    ended: str = ""  # why a search has proven less than was asked for

    @property
    def gap(self) -> float:
        """(bound - value) / bound; 0 for a bound of 0."""
        return (self.bound - self.value) / self.bound if self.bound else 0.0


def search_places(devices: Devices, limits: PathLimits, *, plan: Found, goal: Goal) -> Found:
    """Improve on a plan by branching on where its stops are: for few of them.

    For a plan that earns something.

    Raises:
        ValueError: arrays that do not fit together.
        MemoryError: there is too little memory.
    """
    shared = devices.as_c(), limits.as_c()
    given = tuple(map(ctypes.addressof, shared))
    shape, count = (limits.steps, POINT), len(devices.delta)
    return searched(PLANNER.search_places, given, plan, goal, shape=shape, devices=count)


def searched(
    function: Any,
    given: tuple[int, ...],
    plan: Found,
    goal: Goal,
    *,
    shape: tuple[int, ...],
    devices: int,
) -> Found:
    """Improve on a plan by a search of the library's with these arguments first; the plan's paths
    have `shape` (N, 2), or (A, N, 2) of several aircraft."""
    if not max(plan.value, goal.scale) > 0.0:
        raise ValueError(f"nothing to search for: {plan.value=}")
    _check_range("assigned", plan.assigned + 1, math.prod(shape[:-1]) + 1)
    way, assigned = plan.way.copy(), plan.assigned.copy()
    value, bound, ended = ctypes.c_double(plan.value), ctypes.c_double(), ctypes.c_int64()
    target = goal.as_c()
    nodes = function(
        *given,
        ctypes.addressof(target),
        goal.max_nodes,
        goal.max_open,
        ctypes.addressof(value),
        address(way, np.float64, shape, written=True),
        address(assigned, np.int64, (devices,), written=True),
        ctypes.addressof(bound),
        ctypes.addressof(ended),
    )
    if nodes < 0:
        raise MemoryError("too little memory to search for a plan")
    lower, all_nodes = min(plan.bound, bound.value), plan.nodes + nodes
    found = Found(value.value, way, assigned, lower, all_nodes)
    if goal.met_by(found):
        return found
    why = _ENDED[ended.value].format(nodes=all_nodes, most=plan.nodes + goal.max_nodes)
    return replace(found, ended=why)


def assign(success: Floats, importance: Floats, per_step: int) -> Bools:
    """(N, K) the schedule omega that maximises sum_n sum_k omega_k[n] success[n, k] importance[k].

    A transportation problem: its constraint matrix is totally unimodular, so the relaxation of
    omega to [0, 1] has integral vertices, and shortest augmenting paths find one directly.
    At most `per_step` devices a step, each device at most once. A pair that is worth nothing
    (no chance of success, or no importance) is never scheduled.

    Raises:
        ValueError: what pairs are worth is not finite.
        MemoryError: there is too little memory.
    """
    worth = success * importance
    steps, devices = worth.shape
    schedule = np.zeros((steps, devices), dtype=np.bool_)
    if not devices or not steps or per_step < 1:
        return schedule
    if not np.isfinite(worth).all():
        raise ValueError("what assignments are worth must be finite")
    by_device, served = np.ascontiguousarray(worth.T), np.empty(devices, dtype=np.int64)
    at = address(by_device, np.float64, (devices, steps))
    if PLANNER.assign(devices, steps, per_step, at, served.ctypes.data):
        raise MemoryError("too little memory to assign devices")
    here = np.flatnonzero(served >= 0)
    schedule[served[here], here] = True
    return schedule & (worth > 0.0)


def match(devices: Devices, limits: PathLimits, way: Floats) -> tuple[float, Ints]:
    """The best assignment of devices to the steps of a path (N, 2), and what it earns."""
    assigned = np.full(len(devices.delta), -1, dtype=np.int64)
    shared = devices.as_c(), limits.as_c()
    value = PLANNER.match(
        *map(ctypes.addressof, shared),
        address(way, np.float64, (limits.steps, POINT)),
        assigned.ctypes.data,
    )
    return enough_memory(value), assigned


def enough_memory(found: float) -> float:
    """Return a result of the C library; raise MemoryError where it is NaN or -1."""
    if found != found or found == -1:
        raise MemoryError("too little memory to plan")
    return found
