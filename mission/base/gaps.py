"""Gaps in what ought to come regularly: fixes of satellites, positions."""

from collections.abc import Sequence

import numpy as np

from mission.base.arrays import Bools, Floats, Ints

HOLE = 5.0  # usual intervals of positions: none for longer is a hole
LEAST_S = 1.0  # of any


def gaps(
    t_ns: Ints, during_ns: tuple[int, int], *, usual: float, ends_ns: Sequence[int] = ()
) -> Floats:
    """Begin and end (g, 2) in seconds of the gaps that overlap with a stretch of time: longer than
    a second, and than `usual` median intervals. At `ends_ns`, if they lie outside, some end."""
    if len(t_ns) < 2:
        return np.zeros((0, 2))
    times_s, during_s = np.unique(np.append(t_ns, ends_ns)) / 1e9, np.divide(during_ns, 1e9)
    longest_s = max(LEAST_S, usual * float(np.median(np.diff(t_ns))) / 1e9)
    begin_s, end_s = times_s[:-1], times_s[1:]
    found = (end_s - begin_s > longest_s) & (end_s > during_s[0]) & (begin_s < during_s[1])
    return np.column_stack((begin_s[found], end_s[found]))


def inside(t_s: Floats, found: Floats) -> Bools:
    """(n,) which instants lie between begin and end of one of the gaps (g, 2)."""
    begin_s, end_s = found.T[..., None]
    return np.asarray(((begin_s < t_s) & (t_s < end_s)).any(axis=0))


def outside(values: Floats, t_s: Floats, found: Floats) -> list[Floats]:
    """Return what lies before, between and after the gaps (g, 2) of values (n, k) at instants (n,);
    parts without any are left out."""
    known, after = ~inside(t_s, found), np.searchsorted(found.mean(axis=1), t_s)
    parts = [values[known & (after == number)] for number in range(len(found) + 1)]
    return [part for part in parts if len(part)]
