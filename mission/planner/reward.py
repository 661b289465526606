"""What a device earns at a distance: f(r) = 1 - q_bar(r) as tables for the native loops.

`RewardTable` holds f, f' and f'' on a 1 m grid; a second-order expansion about the nearest
grid point is exact to 1e-4 of the whole (1e-6 on all presets).

`Conjugates` holds what the dual bound needs, for every interval [lo, hi] between chosen radii:

    H(s) = max over lo <= r <= hi of f(r) + s r,

a convex function, as coefficients of a uniform cubic B-spline. A spline whose coefficients are
samples of a convex function lies above that function (Schoenberg's operator), so it is a valid
and twice differentiable upper bound whatever the spacing.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from fl.radio.channel import Channel, average_per
from mission.base.arrays import Floats, Ints

Altitudes: TypeAlias = tuple[float, ...]  # metres above home

FINE_M = 0.25  # grid on which f is sampled and maximised
LEAST_PARTS, MOST_PARTS = 4, 250  # of the way between two altitudes, at which f is sampled
SLOPES = 48  # B-spline intervals of H over s
# A device served where f is below this share of its best is bounded as if left out.
NEGLIGIBLE = 5e-4
# Radii where f falls to these shares of its best may split a device's distance interval.
SHARES = (0.98, 0.9, 0.75, 0.5, 0.3, 0.2, 0.15, 0.1, 0.06, 0.03, 0.01, NEGLIGIBLE)
# A device is first decided about within the first of these, then between each and the next.
# Three rungs were the best of many on channels from sharp to heavy-tailed.
RUNGS = (0.15, 0.06, 0.01, NEGLIGIBLE)


@dataclass(frozen=True)
class RewardTable:
    """Reward f and its derivatives by distance: `rows` (R, 3) of f, f', f'', one row a metre."""

    rows: Floats
    fine: Floats  # f every FINE_M metres, over the same span

    def expanded(self, r: Floats) -> tuple[Floats, Floats, Floats]:
        """(f, f', f'') at distances, expanded about the nearest row."""
        index = np.minimum(np.rint(r).astype(np.int64), len(self.rows) - 1)
        d = r - index
        f, f1, f2 = np.moveaxis(self.rows[index], -1, 0)
        return f + (f1 + 0.5 * f2 * d) * d, f1 + f2 * d, f2

    def upper(self, from_m: Floats) -> Floats:
        """Return upper bounds of f over all distances r >= `from_m` (metres), entry by entry."""
        best = np.maximum.accumulate((self.fine + _between(self.fine))[::-1])[::-1]
        index = np.minimum((from_m / FINE_M).astype(np.int64), len(best) - 1)
        return np.asarray(best[index])


@dataclass(frozen=True)
class Conjugates:
    """Conjugates H of f as B-splines for all intervals of `radii_m`: (i, j) is row `row[i, j]`."""

    radii_m: Floats  # (B,) increasing, from 0 to the reach
    coefficients: Floats  # (rows, SLOPES + 3)
    spacing: Floats  # (rows,) of s
    ends: Ints  # (rows, 2) the interval, as indices of radii
    row: Ints  # (B, B), -1 where i >= j
    ladder: Ints  # (B,) by radius: the next rung, the index of a larger radius


@lru_cache(maxsize=256)
def reward_table(channel: Channel, reach_m: int, towards_m: Altitudes = ()) -> RewardTable:
    """The table out to `reach_m` whole metres.

    With `towards_m` f is raised by the most that it bends above its chord (`excess`) on the way
    from the channel's altitude to each of these.
    """
    r = _distances(reach_m)
    fine = 1.0 - average_per(channel, r)
    if towards_m:
        fine += np.maximum.reduce([excess(channel, reach_m, other_m) for other_m in towards_m])
    slope = np.gradient(fine, FINE_M, edge_order=2)
    bend = np.gradient(slope, FINE_M, edge_order=2)
    every = round(1.0 / FINE_M)
    rows = np.ascontiguousarray(np.stack([fine, slope, bend], axis=1)[::every])
    if towards_m:
        # Where one chord takes over from the other there is an edge, which the expansion rounds.
        lift = _expansion_shortfall(rows, fine)
        fine += lift
        rows[:, 0] += lift
    rows.flags.writeable = False
    fine.flags.writeable = False
    return RewardTable(rows, fine)


def excess(channel: Channel, reach_m: int, other_m: float) -> Floats:
    """Return e(r) every `FINE_M` metres: an upper bound on how far f at an altitude between the
    channel's and `other_m` lies above the chord between the two.

    f_h <= l f_a + (1 - l) f_b + e for every altitude h = l a + (1 - l) b. So a path is worth at
    most what it earns with f_a + e, or with f_b + e. Sampled as densely as f bends; what it may
    rise between samples is bounded as between distances (`_between`).
    """
    low_m, high_m = sorted((channel.altitude_m, other_m))
    return _excess(replace(channel, altitude_m=low_m), reach_m, high_m)


@lru_cache(maxsize=256)
def _excess(low: Channel, reach_m: int, high_m: float) -> Floats:
    parts = math.ceil((high_m - low.altitude_m) / _bend_m(low))
    share = np.linspace(0.0, 1.0, min(max(parts, LEAST_PARTS), MOST_PARTS) + 1)
    heights = low.altitude_m + share * (high_m - low.altitude_m)
    f = np.stack([1.0 - average_per(low, _distances(reach_m), height_m=h) for h in heights])
    above = f - ((1.0 - share)[:, None] * f[0] + share[:, None] * f[-1])
    slack = np.abs(np.diff(f, 2, axis=0)).max(axis=0) / 4.0
    over = np.maximum(above.max(axis=0), 0.0) + slack
    over.flags.writeable = False
    return np.asarray(over)


def _bend_m(low: Channel) -> float:
    """Metres of altitude, from the channel's own on, within which f bends little.

    A standard deviation of the shadowing is sigma d / alpha >= sigma H / alpha of distance, and
    no less of altitude; the probability of line of sight changes over 2 / a1 of elevation, which
    changes by r / (H^2 + r^2) <= 1 / (2 H) a metre.
    """
    shares = (low.sigma_los / low.alpha_los, low.sigma_nlos / low.alpha_nlos, 2.0 / low.a1_per_rad)
    return low.altitude_m * min(shares)


def _distances(reach_m: int) -> Floats:
    return np.arange(0.0, reach_m + 2.0, FINE_M)


def _expansion_shortfall(rows: Floats, fine: Floats) -> float:
    """The most by which f exceeds its expansion about the nearest row."""
    every = round(1.0 / FINE_M)
    at = np.arange(len(fine))
    nearest = np.minimum((at + every // 2) // every, len(rows) - 1)
    d = (at - nearest * every) * FINE_M
    expanded = rows[nearest, 0] + (rows[nearest, 1] + 0.5 * rows[nearest, 2] * d) * d
    return max(0.0, float((fine - expanded).max()))


@lru_cache(maxsize=256)
def conjugates(channel: Channel, reach_m: int, towards_m: Altitudes = ()) -> Conjugates:
    """H for all intervals of distance up to where f gets negligible, at most `reach_m`.

    `towards_m` as in `reward_table`.
    """
    fine = reward_table(channel, reach_m, towards_m).fine
    falling = np.maximum.accumulate(fine[::-1])[::-1]
    r: Floats = np.arange(len(fine), dtype=np.float64) * FINE_M
    marks, rungs = [0.0], []
    for share in SHARES:
        below = np.flatnonzero(falling < share * falling[0])
        mark = float(r[below[0]]) if len(below) else float(r[-1])
        if mark > marks[-1] + 1.0:
            marks.append(mark)
        if share in RUNGS and len(marks) > 1:
            rungs.append(len(marks) - 1)
    if len(marks) == 1:  # a channel that reaches nowhere: one interval will do
        marks.append(float(r[-1]))
        rungs.append(1)
    radii, count = np.array(marks), len(marks)
    slack = _between(fine)
    row = np.full((count, count), -1, dtype=np.int64)
    coefficients: list[Floats] = []
    spacing: list[float] = []
    ends: list[tuple[int, int]] = []
    for i in range(count):
        for j in range(i + 1, count):
            inside = slice(round(radii[i] / FINE_M), round(radii[j] / FINE_M) + 1)
            samples, step = _conjugate(r[inside], fine[inside])
            row[i, j] = len(ends)
            coefficients.append(samples + float(slack[inside].max()))
            spacing.append(step)
            ends.append((i, j))
    ladder = [min((rung for rung in rungs if rung > i), default=count - 1) for i in range(count)]
    return Conjugates(
        radii, np.array(coefficients), np.array(spacing), np.array(ends), row, np.array(ladder)
    )


def _between(fine: Floats) -> Floats:
    """Return how far f may exceed its samples near each: |f''| h^2 / 8, twice for safety."""
    bend = np.abs(np.diff(fine, 2))
    return np.asarray(np.maximum(np.r_[bend[:1], bend, 0.0], np.r_[0.0, bend, bend[-1:]]) / 4.0)


def _conjugate(r: Floats, f: Floats) -> tuple[Floats, float]:
    """Samples of H at s = -ds, 0, ds, ... and ds; past the last one H is a straight line."""
    # H gets straight once s outweighs the steepest chord to the outer end.
    steepest = float(((f[:-1] - f[-1]) / (r[-1] - r[:-1])).max())
    ds = max(steepest, 1e-9) * 1.02 / (SLOPES - 1)
    s = np.abs(np.arange(-1, SLOPES + 2)) * ds
    return np.asarray((f[None, :] + s[:, None] * r[None, :]).max(axis=1)), ds
