"""Alignment of a flown track with its planned path, by dynamic programming."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mission.base import polyline
from mission.base.arrays import Bools, Floats, Ints
from mission.log.values import Track

LEAST_LEG_M = 0.5  # a leg that is shorter is none
_SPACING_M = 0.5
_MOST_NODES = 4000  # so that memory stays small: 500 bytes a sample
_TURN_DEG = 5.0  # a path that turns by more has a corner
_HALVINGS = 16  # of the time between two samples
_AT_ONCE = 4  # samples whose distances from all pieces are found together
_PARTS = 33  # instants from one sample to the next, where whole legs lie between them


@dataclass(frozen=True)
class Alignment:
    """Alignment of a track with a path: along-track progress and cross-track error by sample."""

    along_m: Floats  # (n,) never falls
    cross_m: Floats  # (n,) horizontal distance to the path near there
    corners_m: Floats  # (c,) where along the path it turns
    corner_points_m: Floats  # (c, 2)
    length_m: float
    waypoints_at_m: Floats  # (N,) where along the path its points are
    above_m: Floats  # (n,) height above the path near there; zero on the plane


def align(
    track_m: Floats, waypoints_m: Floats, *, between: tuple[Floats, Floats] | None = None
) -> Alignment:
    """Match a flown track (n, 2) to a planned polyline (N, 2), both in metres, or both in space.

    Progress along the path may not fall, and the sum of squared distances is the least that is
    possible under that: so a path that crosses or retraces itself is matched leg by leg, which
    the nearest point of the whole path would not do. Solved exactly by dynamic programming on
    pieces of the path at most 0.5 m long (more on paths beyond 2 km), in each of which progress
    may fall.

    Corners are interior waypoints at which the path turns by more than 5 degrees; waypoints
    that coincide count once. Climbs turn nowhere. Where it is known from elsewhere, `between` says
    least and greatest progress of each sample (n,).
    """
    points = _distinct(waypoints_m)
    legs = np.diff(points, axis=0)
    at_m = polyline.along(points)
    nodes, along = _nodes(points, at_m)
    low, high = (0.0, along[-1]) if between is None else between
    first = np.minimum(np.searchsorted(along, np.subtract(low, 1e-6)), len(along) - 2)
    last = np.maximum(np.searchsorted(along, np.add(high, 1e-6)) - 1, first + 1)
    piece = _monotone(
        track_m, nodes, np.broadcast_to(first, len(track_m)), np.broadcast_to(last, len(track_m))
    )
    away_m, share = polyline.to_segments(track_m, nodes[piece], nodes[piece + 1])
    along_m = along[piece] + share * (along[piece + 1] - along[piece])
    if len(legs) > 1:
        flat = legs[:, :2]
        level = np.linalg.norm(flat, axis=1)
        unit = flat / np.maximum(level, 1e-6)[:, None]
        turn = np.degrees(np.arccos(np.clip((unit[1:] * unit[:-1]).sum(axis=1), -1.0, 1.0)))
        turns = (turn > _TURN_DEG) & (level[1:] > 1e-6) & (level[:-1] > 1e-6)
        corner = np.flatnonzero(turns) + 1
    else:
        corner = np.zeros(0, dtype=np.intp)
    return Alignment(
        along_m=np.maximum.accumulate(along_m),
        cross_m=np.asarray(np.linalg.norm(away_m[:, :2], axis=1)),
        corners_m=at_m[corner],
        corner_points_m=points[corner, :2],
        length_m=float(at_m[-1]),
        waypoints_at_m=polyline.along(waypoints_m),
        above_m=away_m[:, 2] if away_m.shape[1] > 2 else np.zeros(len(away_m)),
    )


def matched(
    track: Track, path_m: Floats, *, between: tuple[Floats, Floats] | None = None
) -> tuple[Track, Alignment]:
    """Return a track with a sample interpolated at each change of leg, and its alignment. Such a
    sample is equally far from both legs: the cross-track error at a cut corner peaks there."""
    pos_m = track.pos_m[:, : path_m.shape[1]]
    fit = align(pos_m, path_m, between=between)
    leg = leg_of(fit)
    passed_m = fit.waypoints_at_m[leg[1:]] - fit.waypoints_at_m[leg[:-1] + 1]
    if len(at := np.flatnonzero(passed_m > LEAST_LEG_M)):  # whole legs lie between two samples
        finer_ns = np.linspace(track.t_ns[at], track.t_ns[at + 1], _PARTS).astype(np.int64)
        finer = track.at(np.union1d(track.t_ns, finer_ns))
        if between is not None:
            before = np.searchsorted(track.t_ns, finer.t_ns, side="right") - 1
            between = between[0][before], between[1][np.searchsorted(track.t_ns, finer.t_ns)]
        track, pos_m = finer, finer.pos_m[:, : path_m.shape[1]]
        fit = align(pos_m, path_m, between=between)
        leg = leg_of(fit)
    at = np.flatnonzero(np.diff(leg))
    left, entered = ((path_m[legs], path_m[legs + 1]) for legs in (leg[at], leg[at + 1]))
    early, late = np.zeros(len(at)), np.ones(len(at))
    for _ in range(_HALVINGS):
        share = (early + late) / 2
        place = pos_m[at] + share[:, None] * (pos_m[at + 1] - pos_m[at])
        away_m, _ = polyline.to_segments(place, *left)
        ahead_m, _ = polyline.to_segments(place, *entered)
        before = (away_m**2).sum(axis=1) < (ahead_m**2).sum(axis=1) - 1e-9  # beyond, they are alike
        early, late = np.where(before, share, early), np.where(before, late, share)
    t_ns = track.t_ns[at] + (share * np.diff(track.t_ns)[at]).astype(np.int64)
    new = (t_ns > track.t_ns[at]) & (t_ns < track.t_ns[at + 1])
    after, away_m = at[new] + 1, away_m[new]
    above_m = away_m[:, 2] if away_m.shape[1] > 2 else 0.0
    entered_m = fit.waypoints_at_m[leg[after]]
    return track.at(np.insert(track.t_ns, after, t_ns[new])), replace(
        fit,
        along_m=np.insert(fit.along_m, after, entered_m),
        cross_m=np.insert(fit.cross_m, after, np.linalg.norm(away_m[:, :2], axis=1)),
        above_m=np.insert(fit.above_m, after, above_m),
    )


def leg_of(fit: Alignment) -> Ints:
    """(n,) index from 0 of the leg that each sample lies on; the next one at a leg's end."""
    leg = np.searchsorted(fit.waypoints_at_m, fit.along_m + 1e-6, side="right") - 1
    return np.clip(leg, 0, len(fit.waypoints_at_m) - 2)


def leg_numbers(at_m: Floats, ends: Bools) -> Ints:
    """(L,) the number, from 1, of the leg that each piece of a path belongs to.

    A leg leads to an item: `ends` (L,) says which pieces do. Items at one place share a leg.
    """
    numbers, number, begin_m = [], 1, float(at_m[0])
    for end_m, is_end in zip(at_m[1:].tolist(), ends.tolist(), strict=True):
        numbers.append(number)
        if is_end and end_m - begin_m >= LEAST_LEG_M:
            number, begin_m = number + 1, end_m
    return np.array(numbers, dtype=np.int64)


def _distinct(points: Floats) -> Floats:
    moved = polyline.legs(points) > 1e-6
    return points[np.concatenate(([True], moved))]


def _nodes(points: Floats, at_m: Floats) -> tuple[Floats, Floats]:
    """Return the path's points and evenly spaced ones between, (k, 2 or 3), two at least, and how
    far along the path they are, (k,)."""
    if len(points) == 1:
        return np.repeat(points, 2, axis=0), np.zeros(2)
    spacing = max(_SPACING_M, float(at_m[-1]) / _MOST_NODES)
    pieces = [
        np.linspace(start, end, math.ceil((end - start) / spacing), endpoint=False)
        for start, end in itertools.pairwise(at_m)
    ]
    along = np.concatenate((*pieces, at_m[-1:]))
    return polyline.at(along, at_m, points), along


def _monotone(
    track: Floats, nodes: Floats, first: NDArray[np.intp], last: NDArray[np.intp]
) -> NDArray[np.intp]:
    """(n,) index of the piece between two nodes that each sample is matched with: nondecreasing,
    with the least sum of squared distances (dynamic programming).

    Sample i may have pieces `first[i]` to `last[i]` - 1; neither bound may fall.
    """
    way = np.diff(nodes, axis=0)
    half = np.linalg.norm(way, axis=1) / 2
    unit = way / np.maximum(2 * half, 1e-9)[:, None]
    middle = nodes[:-1] + way / 2
    middle_at = (middle * unit).sum(axis=1)
    piece = np.arange(len(way))
    # By sample, a bit a piece: whether the least sum up to this piece ends in the piece itself.
    ends = np.empty((len(track), math.ceil(len(way) / 8)), dtype=np.uint8)
    # Of sums that are equal, the one that stays behind: the first of several laps.
    behind = piece * 1e-9
    cost, best = np.zeros(len(way)), np.empty(len(way))
    for some in np.split(np.arange(len(track)), range(_AT_ONCE, len(track), _AT_ONCE)):
        samples = track[some]
        from_middle = np.abs(samples @ unit.T - middle_at)
        own = sum(np.subtract.outer(*axis) ** 2 for axis in zip(samples.T, middle.T, strict=True))
        own += np.maximum(from_middle - half, 0.0) ** 2 - from_middle**2 + behind
        own[(piece < first[some, None]) | (piece >= last[some, None])] = math.inf
        least = np.empty(own.shape, dtype=bool)
        for here, added in zip(least, own, strict=True):
            np.minimum.accumulate(cost, out=best)
            np.equal(cost, best, out=here)
            np.add(best, added, out=cost)
        ends[some] = np.packbits(least, axis=1)
    index = np.empty(len(track), dtype=np.intp)
    j = int(cost.argmin())
    for i in range(len(track) - 1, -1, -1):
        index[i] = j
        j -= int(np.unpackbits(ends[i], count=j + 1)[::-1].argmax())
    return index
