"""The C library's search of orders (`search.h`), and ascent from given paths, of any aircraft.

A plan of several aircraft has paths (A, N, 2), each in coordinates with its own start at the
origin, and numbers its steps through all of them: step n of aircraft a is a N + n.
"""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mission.base.arrays import Floats, Ints
from mission.planner.native.library import (
    MOST_DEVICES,
    PLANNER,
    POINT,
    Devices,
    Found,
    Goal,
    PathLimits,
    Relaxation,
    enough_memory,
    searched,
)
from native.loading import address

MOST_AIRCRAFT: int = PLANNER.MOST_AIRCRAFT


@dataclass(frozen=True)
class Crew:
    """One aircraft: how it sees the devices from its start, what its path may be, and the tables of
    its dual bound."""

    devices: Devices
    limits: PathLimits
    relaxation: Relaxation


def alike(crews: Sequence[Crew]) -> Ints:
    """(A,) the first aircraft that each is equal to, to the bit."""
    seen: dict[tuple[bytes, ...], int] = {}
    keys = [
        (of.devices.u.tobytes(), of.devices.rows.tobytes(), np.float64(of.limits.length).tobytes())
        for of in crews
    ]
    return np.array([seen.setdefault(key, a) for a, key in enumerate(keys)], dtype=np.int64)


def polished(crews: Sequence[Crew], ways: Floats) -> tuple[float, Floats, Ints]:
    """Return the best plan near paths (A, N, 2), or that of one aircraft near its path (N, 2): its
    value, paths and assignment (K,)."""
    way, shape = np.array(ways, dtype=np.float64, order="C"), _shape(crews, ways)
    assigned = np.full(len(crews[0].devices.delta), -1, dtype=np.int64)
    devices, limits = _as_c(crews)
    value = PLANNER.polish(
        len(crews), ctypes.addressof(devices), ctypes.addressof(limits),
        address(way, np.float64, shape, written=True), assigned.ctypes.data,
    )  # fmt: skip
    return enough_memory(value), way, assigned


def search_orders(crews: Sequence[Crew], *, plan: Found, goal: Goal) -> Found:
    """Improve on a plan, whose paths are (A, N, 2), or (N, 2) of one aircraft, by branching on the
    orders of visits. All relaxations have the same radii and promises.

    Raises:
        ValueError: too many devices, or arrays that do not fit together.
        MemoryError: there is too little memory.
    """
    count = len(crews[0].devices.delta)
    if count > MOST_DEVICES:
        raise ValueError(f"{count} devices: a search takes at most {MOST_DEVICES}")
    relaxations = (of.relaxation.as_c(count) for of in crews)
    shared = *_as_c(crews), (PLANNER.Relaxation * len(crews))(*relaxations)
    first = alike(crews)
    given = len(crews), *map(ctypes.addressof, shared), first.ctypes.data
    shape = _shape(crews, plan.way)
    return searched(PLANNER.search_orders, given, plan, goal, shape=shape, devices=count)


def _shape(crews: Sequence[Crew], ways: Floats) -> tuple[int, ...]:
    """The shape that paths must have."""
    path = crews[0].limits.steps, POINT
    return path if len(crews) == 1 and ways.ndim == 2 else (len(crews), *path)


def _as_c(crews: Sequence[Crew]) -> tuple[Any, Any]:
    """Arrays of the structures of devices and limits."""
    sizes = {(len(of.devices.delta), of.limits.steps, of.limits.per_step) for of in crews}
    if not 1 <= len(crews) <= MOST_AIRCRAFT or len(sizes) != 1:
        raise ValueError(f"1 to {MOST_AIRCRAFT} aircraft with the same devices and steps")
    return (
        (PLANNER.Devices * len(crews))(*(of.devices.as_c() for of in crews)),
        (PLANNER.Limits * len(crews))(*(of.limits.as_c() for of in crews)),
    )
