"""Which point of a planned path each sample of a flown track belongs to."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission.base import polyline
from mission.base.arrays import Floats

_SPACING_M = 0.5
_MOST_NODES = 4000  # so that memory stays small: 500 bytes a sample


@dataclass(frozen=True)
class Alignment:
    """Sample by sample: how far along the path, and how far from it."""

    along_m: Floats  # (n,) never falls
    cross_m: Floats  # (n,) distance to the path near there
    corners_m: Floats  # (c,) where along the path it turns
    corner_points_m: Floats  # (c, 2)
    length_m: float


def align(track_m: Floats, waypoints_m: Floats, *, turn_deg: float = 5.0) -> Alignment:
    """Match a flown track (n, 2) to a planned polyline (N, 2), both in metres.

    Progress along the path may not fall, and the sum of squared distances is the least that is
    possible under that: so a path that crosses or retraces itself is matched leg by leg, which
    the nearest point of the whole path would not do. Solved exactly on path nodes at most 0.5 m
    apart (more on paths beyond 2 km) by dynamic programming, then refined between the nodes; so
    where two legs are about equally near, the leg that is up to 0.25 m farther may be taken.

    Corners are interior waypoints at which the path turns by more than `turn_deg`; waypoints
    that coincide count once.
    """
    points = _distinct(waypoints_m)
    legs = np.diff(points, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    at_m = np.concatenate(([0.0], np.cumsum(lengths)))
    nodes, along = _nodes(points, at_m)
    index = _monotone(track_m, nodes)
    cross_m, along_m = _refine(track_m, nodes, along, index)
    if len(legs) > 1:
        unit = legs / lengths[:, None]
        turn = np.degrees(np.arccos(np.clip((unit[1:] * unit[:-1]).sum(axis=1), -1.0, 1.0)))
        corner = np.flatnonzero(turn > turn_deg) + 1
    else:
        corner = np.zeros(0, dtype=np.intp)
    return Alignment(
        along_m=np.maximum.accumulate(along_m),
        cross_m=cross_m,
        corners_m=at_m[corner],
        corner_points_m=points[corner],
        length_m=float(at_m[-1]),
    )


def closest_approach(track_m: Floats, point_m: Floats) -> float:
    """Least distance from a point to a flown track (n, 2), straight between its samples."""
    if len(track_m) == 1:
        return float(np.linalg.norm(track_m[0] - point_m))
    return float(_to_segments(point_m[None], track_m[:-1], track_m[1:])[0].min())


def _distinct(points: Floats) -> Floats:
    moved = polyline.legs(points) > 1e-6
    return points[np.concatenate(([True], moved))]


def _nodes(points: Floats, at_m: Floats) -> tuple[Floats, Floats]:
    """The path's points and points between them, with where along the path they are."""
    spacing = max(_SPACING_M, float(at_m[-1]) / _MOST_NODES)
    pieces = [
        np.linspace(start, end, math.ceil((end - start) / spacing), endpoint=False)
        for start, end in itertools.pairwise(at_m)
    ]
    along = np.concatenate((*pieces, at_m[-1:]))
    nodes = np.column_stack([np.interp(along, at_m, points[:, axis]) for axis in range(2)])
    return nodes, along


def _monotone(track: Floats, nodes: Floats) -> NDArray[np.intp]:
    """For each sample a node index, never falling, with the least sum of squared distances."""
    # By sample, a bit a node: whether the least sum up to this node ends in the node itself.
    ends = np.empty((len(track), math.ceil(len(nodes) / 8)), dtype=np.uint8)
    cost = np.zeros(len(nodes))
    for i, sample in enumerate(track):
        best = np.minimum.accumulate(cost)
        ends[i] = np.packbits(cost == best)
        cost = best + ((nodes - sample) ** 2).sum(axis=1)
    index = np.empty(len(track), dtype=np.intp)
    j = int(cost.argmin())
    for i in range(len(track) - 1, -1, -1):
        index[i] = j
        j -= int(np.unpackbits(ends[i], count=j + 1)[::-1].argmax())
    return index


def _refine(
    track: Floats, nodes: Floats, along: Floats, index: NDArray[np.intp]
) -> tuple[Floats, Floats]:
    """Distance to the two path pieces that meet in the node, and where along the path."""
    if len(nodes) == 1:
        return np.linalg.norm(track - nodes[0], axis=1), np.zeros(len(track))
    before = np.clip(index - 1, 0, len(nodes) - 2)
    after = np.clip(index, 0, len(nodes) - 2)
    options = []
    for piece in (before, after):
        away, share = _to_segments(track, nodes[piece], nodes[piece + 1])
        options.append((away, along[piece] + share * (along[piece + 1] - along[piece])))
    (first, first_at), (second, second_at) = options
    nearer = first <= second
    return np.where(nearer, first, second), np.where(nearer, first_at, second_at)


def _to_segments(points: Floats, start: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Distance from points to segments, row by row, and the share of the segment there."""
    way = end - start
    square = (way**2).sum(axis=1)
    along = ((points - start) * way).sum(axis=1)
    share = np.clip(np.divide(along, square, out=np.zeros(len(way)), where=square > 0), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * way, axis=1), share
