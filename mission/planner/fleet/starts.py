"""First plans of several aircraft: one after another, by sectors, by clusters of devices."""

from collections.abc import Iterator

import numpy as np

from mission.base.arrays import Floats, Ints
from mission.planner.native.library import assign

TURNS, DRAWS = 12, 8  # of the sweep, and of first centres of clusters
_MOVES = 8  # of centres


def partitions(devices_m: Floats, worth: Floats, starts_m: Floats) -> Iterator[Ints]:
    """Yield partitions (K,) of devices (K, 2) worth (K,) over aircraft that start at (A, 2):
    sectors about the middle of the starts, and clusters (k-means). Where starts differ, each part
    goes to an aircraft near it."""
    aircraft = len(starts_m)
    offset = devices_m - starts_m.mean(axis=0)
    bearing = np.arctan2(offset[:, 1], offset[:, 0])
    for turn in range(TURNS):
        order = np.argsort((bearing - 2.0 * np.pi * turn / TURNS) % (2.0 * np.pi), kind="stable")
        share = np.cumsum(worth[order]) - worth[order] / 2.0
        part = np.empty(len(worth), dtype=np.int64)
        part[order] = np.minimum(share / worth.sum() * aircraft, aircraft - 1).astype(np.int64)
        yield _to_nearest(part, devices_m, starts_m)
    for draw in range(DRAWS):
        centres = _first_centres(devices_m, aircraft, draw)
        for _ in range(_MOVES):
            part = _distances(devices_m, centres).argmin(axis=1)
            centres = _centres(part, devices_m, worth, centres)
        yield _to_nearest(part, devices_m, starts_m)


def _first_centres(devices_m: Floats, aircraft: int, draw: int) -> Floats:
    """(A, 2) places of devices; some twice where there are fewer."""
    order = np.random.Generator(np.random.PCG64(draw)).permutation(len(devices_m))
    return devices_m[np.resize(order, aircraft)]


def _centres(part: Ints, devices_m: Floats, worth: Floats, before: Floats) -> Floats:
    """(A, 2) centres of the parts; those of empty parts stay."""
    centres = before.copy()
    for a in np.unique(part[worth > 0.0]):
        mine = part == a
        centres[a] = worth[mine] @ devices_m[mine] / worth[mine].sum()
    return centres


def _to_nearest(part: Ints, devices_m: Floats, starts_m: Floats) -> Ints:
    """Number the parts so that they are as near to the starts of their aircraft as may be."""
    centres = _centres(part, devices_m, np.ones(len(part)), starts_m)
    far_m = _distances(centres, starts_m)  # of a part from a start
    given = assign(1.0 + far_m.max() - far_m, np.ones(len(starts_m)), 1)
    return np.asarray(given.argmax(axis=1)[part])


def _distances(a_m: Floats, b_m: Floats) -> Floats:
    return np.asarray(np.hypot(*np.moveaxis(a_m[:, None] - b_m[None], -1, 0)))
