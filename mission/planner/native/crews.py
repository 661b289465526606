"""The C library's search of orders (`search.h`), and ascent from given paths, of any aircraft.

A plan of several aircraft has paths (A, N, 2), each in coordinates with its own start at the
origin, and numbers its steps through all of them: step n of aircraft a is a N + n.
"""

import ctypes
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mission.base.arrays import Floats, Ints
from mission.planner.native.library import (
    MOST_DEVICES,
    PLANNER,
    POINT,
    Devices,
    Effort,
    Found,
    PathLimits,
    Relaxation,
    enough_memory,
    searched,
)
from native.loading import address

MOST_AIRCRAFT: int = PLANNER.MOST_AIRCRAFT


@dataclass(frozen=True)
class Crews:
    """What each of A aircraft may do, and how it sees the same devices from its own start."""

    devices: tuple[Devices, ...]
    limits: tuple[PathLimits, ...]
    relaxations: tuple[Relaxation, ...]  # with the same radii and promises

    def __post_init__(self) -> None:
        shapes = {(len(each.delta), limit.steps, limit.per_step) for each, limit in self._pairs}
        if not 1 <= len(self.devices) <= MOST_AIRCRAFT or len(shapes) != 1:
            raise ValueError(f"1 to {MOST_AIRCRAFT} aircraft with the same devices and steps")
        if not len(self.devices) == len(self.limits) == len(self.relaxations):
            raise ValueError("an aircraft without limits or relaxation")

    @property
    def _pairs(self) -> list[tuple[Devices, PathLimits]]:
        return list(zip(self.devices, self.limits, strict=True))

    @property
    def alike(self) -> Ints:
        """(A,) the first aircraft that each is equal to, to the bit."""
        seen: dict[tuple[bytes, ...], int] = {}
        keys = [
            (each.u.tobytes(), each.rows.tobytes(), np.float64(limits.length).tobytes())
            for each, limits in self._pairs
        ]
        return np.array([seen.setdefault(key, a) for a, key in enumerate(keys)], dtype=np.int64)

    def polished(self, ways: Floats) -> tuple[float, Floats, Ints]:
        """Return the best plan near paths (A, N, 2): its value, paths and assignment (K,)."""
        way, (devices, limits) = np.array(ways, dtype=np.float64, order="C"), self._as_c()
        assigned = np.full(len(self.devices[0].delta), -1, dtype=np.int64)
        value = PLANNER.polish(
            len(self.devices), ctypes.addressof(devices), ctypes.addressof(limits),
            address(way, np.float64, self._shape, written=True), assigned.ctypes.data,
        )  # fmt: skip
        return enough_memory(value), way, assigned

    def search(self, plan: Found, effort: Effort) -> Found:
        """Improve on a plan, whose paths are (A, N, 2), by branching on the orders of visits.

        Raises:
            ValueError: too many devices, or arrays that do not fit together.
            MemoryError: there is too little memory.
        """
        count, aircraft = len(self.devices[0].delta), len(self.devices)
        if count > MOST_DEVICES:
            raise ValueError(f"{count} devices: a search takes at most {MOST_DEVICES}")
        relaxations = (PLANNER.Relaxation * aircraft)(
            *(each.as_c(count) for each in self.relaxations)
        )
        shared, alike = (*self._as_c(), relaxations), self.alike
        given = aircraft, *map(ctypes.addressof, shared), alike.ctypes.data
        search = PLANNER.search_orders
        return searched(search, given, plan, effort, shape=self._shape, devices=count)

    @property
    def _shape(self) -> tuple[int, int, int]:
        return len(self.devices), self.limits[0].steps, POINT

    def _as_c(self) -> tuple[Any, Any]:
        aircraft = len(self.devices)
        return (
            (PLANNER.Devices * aircraft)(*(each.as_c() for each in self.devices)),
            (PLANNER.Limits * aircraft)(*(each.as_c() for each in self.limits)),
        )


def search_orders(
    devices: Devices, limits: PathLimits, relaxation: Relaxation, *, plan: Found, effort: Effort
) -> Found:
    """Improve on a plan of one aircraft, whose path is (N, 2), as `Crews.search` does."""
    crew = Crews((devices,), (limits,), (relaxation,))
    found = crew.search(replace(plan, way=plan.way[None]), effort)
    return replace(found, way=found.way[0])
