"""What a device earns at a distance: f(r) = 1 - q_bar(r) as tables for the native loops.

`RewardTable` holds f, f' and f'' on a 1 m grid; a second-order expansion about the nearest
grid point is exact to 1e-4 of the whole (1e-6 on all presets).

`Conjugates` holds what the dual bound needs, for every interval [lo, hi] between chosen radii:

    H(s) = max over lo <= r <= hi of f(r) + s r,

a convex function, as coefficients of a uniform cubic B-spline. A spline whose coefficients are
samples of a convex function lies above that function (Schoenberg's operator), so it is a valid
and twice differentiable upper bound whatever the spacing.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fl.radio.channel import Channel, average_per
from mission.base.arrays import Floats, Ints

FINE_M = 0.25  # grid on which f is sampled and maximised
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
    """f, f', f'' in the columns of (R, 3), one row a metre; 0 beyond the last row."""

    rows: Floats
    fine: Floats  # f every FINE_M metres, over the same span

    def upper(self, from_m: Floats) -> Floats:
        """Bound of f over all r >= from_m, for each entry."""
        best = np.maximum.accumulate((self.fine + _between(self.fine))[::-1])[::-1]
        index = np.minimum((from_m / FINE_M).astype(np.int64), len(best) - 1)
        return np.asarray(best[index])


@dataclass(frozen=True)
class Conjugates:
    """B-splines of H for all intervals between `radii_m`; interval (i, j) is row `row[i, j]`."""

    radii_m: Floats  # (B,) increasing, from 0 to the reach
    coefficients: Floats  # (rows, SLOPES + 3)
    spacing: Floats  # (rows,) of s
    ends: Ints  # (rows, 2) the interval, as indices of radii
    row: Ints  # (B, B), -1 where i >= j
    ladder: Ints  # (B,) by radius: the next rung, the index of a larger radius


@lru_cache(maxsize=64)
def reward_table(channel: Channel, reach_m: int) -> RewardTable:
    """The table out to `reach_m` whole metres."""
    r = np.arange(0.0, reach_m + 2.0, FINE_M)
    fine = 1.0 - average_per(channel, r)
    slope = np.gradient(fine, FINE_M, edge_order=2)
    bend = np.gradient(slope, FINE_M, edge_order=2)
    every = round(1.0 / FINE_M)
    rows = np.ascontiguousarray(np.stack([fine, slope, bend], axis=1)[::every])
    rows.flags.writeable = False
    fine.flags.writeable = False
    return RewardTable(rows, fine)


@lru_cache(maxsize=64)
def conjugates(channel: Channel, reach_m: int) -> Conjugates:
    """H for all intervals of distance up to where f gets negligible, at most `reach_m`."""
    fine = reward_table(channel, reach_m).fine
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
    """What f may exceed its samples by next to each of them: |f''| h^2 / 8, twice for safety."""
    bend = np.abs(np.diff(fine, 2))
    return np.asarray(np.maximum(np.r_[bend[:1], bend, 0.0], np.r_[0.0, bend, bend[-1:]]) / 4.0)


def _conjugate(r: Floats, f: Floats) -> tuple[Floats, float]:
    """Samples of H at s = -ds, 0, ds, ... and ds; past the last one H is a straight line."""
    # H gets straight once s outweighs the steepest chord to the outer end.
    steepest = float(((f[:-1] - f[-1]) / (r[-1] - r[:-1])).max())
    ds = max(steepest, 1e-9) * 1.02 / (SLOPES - 1)
    s = np.abs(np.arange(-1, SLOPES + 2)) * ds
    return np.asarray((f[None, :] + s[:, None] * r[None, :]).max(axis=1)), ds
