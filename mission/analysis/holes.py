"""Holes in a log: times without positions, of which nobody knows what was flown."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mission.base.area import on_globe
from mission.base.arrays import Floats, Ints
from mission.base.gaps import HOLE, LEAST_S, gaps
from mission.log.values import HEIGHTS, NS_PER_S, FlightData, Track

LOW_M = 1.0  # below this a flight begins on the ground


@dataclass(frozen=True)
class Hole:
    """A time without positions, and the places (latitude, longitude) before and after it; NaN of a
    log that has heights only."""

    number: int  # of its pass or round
    leg: int | None  # on which it begins; None: outside, where only events are hidden
    start_s: float
    end_s: float
    from_deg: tuple[float, float]
    to_deg: tuple[float, float]
    mode: str = ""  # of a flight without passes

    @property
    def words(self) -> str:
        """One line of text: times, length, leg, and places before and after."""
        start_s, end_s = self.start_s, self.end_s
        where = self.mode or ("outside the plan" if self.leg is None else f"leg {self.leg}")
        if not math.isnan(self.from_deg[0]):
            here, there = (f"{lat:.7f}, {lon:.7f}" for lat, lon in (self.from_deg, self.to_deg))
            where += f", {here} to {there}"
        return (
            f"at {start_s:.1f}-{end_s:.1f} s no positions for {end_s - start_s:.1f} s, "
            f"{where}: what was flown there is not known"
        )


def position_gaps(run: FlightData, start_ns: int, end_ns: int) -> Floats:
    """Begin and end (g, 2) in seconds of the holes in a stretch of the true track, also where the
    log goes on after its last position, or tells of a time before a first one in the air; but for
    times between two flights, in which many vehicles log nothing."""
    t_ns = run.truth.t_ns
    told = [
        *t_ns[:1],
        *t_ns[-1:],
        *run.modes.t_ns,
        *run.battery.t_ns,
        *(e.t_ns for e in run.events),
    ]
    flies = (run.truth.pos_m[:1, 2] > LOW_M).any()
    ends_ns = (min(told) if flies else t_ns[0], max(told)) if len(t_ns) else ()
    return while_armed(run, gaps(t_ns, (start_ns, end_ns), usual=HOLE, ends_ns=ends_ns))


def while_armed(run: FlightData, found: Floats) -> Floats:
    """What is left of gaps (g, 2) in seconds without the times between being disarmed and armed."""
    for (_, off_ns), (on_ns, _) in pairwise(run.armed_ns):
        before, after = found.copy(), found.copy()
        before[:, 1] = np.minimum(before[:, 1], off_ns / NS_PER_S)
        after[:, 0] = np.maximum(after[:, 0], on_ns / NS_PER_S)
        found = np.unique(np.vstack((before, after)), axis=0)
        found = found[np.diff(found)[:, 0] > LEAST_S]
    return found


def holes(
    run: FlightData, every: Floats, *, hidden: Floats, number: int, track: Track, leg: Ints
) -> Iterator[Hole]:
    """Describe `every` gap (g, 2) in the time of a pass or a round, whose samples (n,) were on the
    legs `leg`; those that are not `hidden` in it are on none."""
    for gap in every.tolist():
        ends = run.truth.at(np.round(np.multiply(gap, NS_PER_S)).astype(np.int64)).pos_m
        places = [(p.lat_deg, p.lon_deg) for p in on_globe(run.area, ends[:, :2], ends[:, 2])]
        if run.source.only == HEIGHTS:
            places = [(math.nan, math.nan)] * 2
        at = min(int(np.searchsorted(track.t_ns / NS_PER_S, gap[0])), len(leg) - 1)
        on = int(leg[at]) if gap in hidden.tolist() else None
        yield Hole(number, on, *gap, *places)
