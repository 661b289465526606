"""Parts of the plan search by themselves: C that is compiled with the first test that asks."""

import ctypes
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from mission.base.arrays import Floats, Ints
from mission.planner.native.library import Devices, PathLimits, Relaxation
from native import building


@cache
def _parts() -> Any:
    library = building.Library("parts", Path(__file__).parent, None, "search_parts.c")
    compiler, planner = next(building.compilers()), building.library("planner")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder, "parts.so")
        building.compile_to(target, library, compiler, flags=(f"-I{planner.folder}", "-O1"))
        loaded = ctypes.CDLL(str(target))
    for function in (
        loaded.order_bound, loaded.square_bound, loaded.conjugate, loaded.away_from_way,
        loaded.limit_of_step, loaded.queued,
    ):  # fmt: skip
        function.restype = ctypes.c_double
    return loaded


def order_bound(
    devices: Devices,
    limits: PathLimits,
    relaxation: Relaxation,
    *,
    interval: Ints,
    merged: Ints,
    eps: float,
    outwards: float = 0.0,
) -> float:
    """The dual bound of the devices in their order, -1 if it was not minimised.

    `interval` (K,) are rows of distance intervals, `merged` (K,) is 1 where a stop is one with the
    stop before it, `eps` is the weight of the barrier. With `outwards`
    steps begin again there, but so far (1: all) of the way to the boundary of the cones.
    """
    shared = devices.as_c(), limits.as_c(), relaxation.as_c(len(devices.delta))
    indices = [np.ascontiguousarray(each, dtype=np.int64) for each in (interval, merged)]
    bound: float = _parts().order_bound(
        *map(ctypes.byref, shared),
        *(ctypes.c_void_p(each.ctypes.data) for each in indices),
        ctypes.c_double(eps),
        ctypes.c_double(outwards),
    )
    return bound


def square_bound(devices: Devices, limits: PathLimits, x: float, y: float, half: float) -> float:
    """Bound of what a stop earns somewhere in the square around (x, y), its side 2 `half` long."""
    shared = devices.as_c(), limits.as_c()
    bound: float = _parts().square_bound(
        *map(ctypes.byref, shared), *map(ctypes.c_double, (x, y, half))
    )
    return bound


def conjugate(relaxation: Relaxation, row: int, s: Floats) -> Floats:
    """Values of the conjugate H of a distance interval at s >= 0."""
    shared = relaxation.as_c(len(relaxation.promise))
    found = [
        _parts().conjugate(ctypes.byref(shared), ctypes.c_int64(row), ctypes.c_double(each))
        for each in s
    ]
    return np.array(found)


def away_from_way(x: float, y: float, way: Floats, count: int) -> float:
    """Distance of (x, y) from the polyline through the first `count` points of a way (n, 2)."""
    way = np.ascontiguousarray(way, dtype=np.float64)
    away: float = _parts().away_from_way(
        *map(ctypes.c_double, (x, y)), ctypes.c_void_p(way.ctypes.data), ctypes.c_int64(count)
    )
    return away


def chain_bounds(
    devices: Devices, limits: PathLimits, first: Ints, squares: Floats, *, mu: float, lean: Floats
) -> tuple[Floats, Floats, Floats]:
    """Bounds (n,) of a stop in each of the squares (n, 3) alone, of all up to there, and of what
    follows; those of a stop begin at `first` (stops + 1,). A metre costs `mu`, and legs lean as
    `lean` (stops, 2) says."""
    shared = devices.as_c(), limits.as_c()
    found = np.zeros((3, len(squares)))
    arrays = [np.ascontiguousarray(each) for each in (first, squares, lean, *found)]
    at = [ctypes.c_void_p(each.ctypes.data) for each in arrays]
    _parts().chain_bounds(*map(ctypes.byref, shared), *at[:2], ctypes.c_double(mu), *at[2:])
    stop, ahead, behind = found
    return stop, ahead, behind


def limit_of_step(cone: Floats, y: Floats, step: Floats, *, mu: float, mu_step: float) -> float:
    """The share of a step (m, 2), and of that of mu, that is gone from multipliers y (m, 2) within
    cones |y| < c mu, of which `cone` (m,) are the c^2."""
    arrays = [np.ascontiguousarray(each, dtype=np.float64) for each in (cone, y, step)]
    limit: float = _parts().limit_of_step(
        ctypes.c_int64(len(cone)),
        *(ctypes.c_void_p(each.ctypes.data) for each in arrays),
        ctypes.c_double(mu),
        ctypes.c_double(mu_step),
    )
    return limit


def newton_step(
    gradient: Floats, cross: Floats, block: Floats, device: Floats, *, slope: float, bend: float
) -> tuple[Floats, float, float]:
    """The Newton step (m, 2), that of mu and the decrement: of gradients and rows of mu (m, 2),
    and of xx, xy, yy (m, 3) of the blocks of stops and of devices."""
    step, of_mu = np.zeros_like(gradient), np.zeros(2)
    arrays = [np.ascontiguousarray(each) for each in (gradient, cross, block, device)]
    _parts().newton_step(
        ctypes.c_int64(len(gradient)),
        *(ctypes.c_void_p(each.ctypes.data) for each in arrays),
        ctypes.c_double(slope),
        ctypes.c_double(bend),
        *(ctypes.c_void_p(each.ctypes.data) for each in (step, of_mu)),
    )
    return step, float(of_mu[0]), float(of_mu[1])


def barrier_at(
    cone: Floats, y: Floats, *, mu: float, eps: float, length: float
) -> tuple[Floats, Floats]:
    """Bound, barrier and two derivatives by mu (4,) of their sum where multipliers are y (m, 2),
    and of each stop (m, 7) gradient, its derivative by mu, and xx, xy, yy of its block."""
    whole, parts = np.zeros(4), np.zeros((len(cone), 7))
    arrays = [np.ascontiguousarray(each, dtype=np.float64) for each in (cone, y)]
    _parts().barrier_at(
        ctypes.c_int64(len(cone)),
        *(ctypes.c_void_p(each.ctypes.data) for each in arrays),
        *map(ctypes.c_double, (mu, eps, length)),
        *(ctypes.c_void_p(each.ctypes.data) for each in (whole, parts)),
    )
    return whole, parts


def hopeless(
    look: tuple[int, float], nodes: int, gap: float, *, goal: float, most_nodes: int
) -> tuple[bool, int, float]:
    """Whether a search would not end in time, at which node and with which gap it looks again;
    `look` has both of its last look."""
    seen = np.array(look, dtype=np.float64)
    found: int = _parts().hopeless(
        ctypes.c_void_p(seen.ctypes.data), ctypes.c_int64(nodes), ctypes.c_double(gap),
        ctypes.c_double(goal), ctypes.c_int64(most_nodes),
    )  # fmt: skip
    return bool(found), int(seen[0]), float(seen[1])


def queued(bounds: Floats, room: int) -> tuple[Floats, float]:
    """The bounds of open nodes in the order that they are taken, -1 where there are no more, and
    the largest of those for which there is no `room`."""
    found = bounds.astype(np.float64)
    closed: float = _parts().queued(
        ctypes.c_int64(len(found)), ctypes.c_void_p(found.ctypes.data), ctypes.c_int64(room)
    )
    return found, closed


def merged_run(edges: list[int], size: int, edge: int) -> int:
    """How many devices would be at one stop if an edge of the first `size` were merged."""
    kinds = np.array(edges, dtype=np.int64)
    parts = _parts()
    parts.merged_run.restype = ctypes.c_int64
    found: int = parts.merged_run(
        ctypes.c_int64(size), ctypes.c_int64(len(kinds)), ctypes.c_void_p(kinds.ctypes.data),
        ctypes.c_int64(edge),
    )  # fmt: skip
    return found
