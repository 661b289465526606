"""Gaps in what ought to come regularly: fixes of satellites, positions."""

import itertools
from collections.abc import Sequence

import numpy as np

from mission.base.arrays import Bools, Floats, Ints

Gaps = Sequence[tuple[float, float]]  # begin and end of each, in seconds

HOLE = 5.0  # usual intervals of positions: none for longer is a hole
_LEAST_S = 1.0
_NS_PER_S = 1_000_000_000


def gaps(
    t_ns: Ints, during_ns: tuple[float, float], *, usual: float, ends_ns: Sequence[int] = ()
) -> Gaps:
    """Return the gaps that overlap with a stretch of time, not clipped to it: longer than a second,
    and than `usual` median intervals. At `ends_ns`, if they are outside, gaps end, too."""
    if len(t_ns) < 2:
        return []
    longest_s = max(_LEAST_S, usual * float(np.median(np.diff(t_ns))) / _NS_PER_S)
    times_s = np.unique(np.concatenate((t_ns, np.array(ends_ns, dtype=np.int64)))) / _NS_PER_S
    return [
        (begin_s, end_s)
        for begin_s, end_s in itertools.pairwise(times_s.tolist())
        if end_s - begin_s > longest_s
        and end_s > during_ns[0] / _NS_PER_S
        and begin_s < during_ns[1] / _NS_PER_S
    ]


def inside(t_s: Floats, found: Gaps) -> Bools:
    """(n,) which instants lie within gaps: after the begin, and before the end of one."""
    within = np.zeros(len(t_s), dtype=bool)
    for begin_s, end_s in found:
        within |= (t_s > begin_s) & (t_s < end_s)
    return within
