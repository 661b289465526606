"""Holes in a log: times without positions, of which nobody knows what was flown."""

from dataclasses import dataclass

import numpy as np

from mission.base.area import on_globe
from mission.base.arrays import Floats, Ints
from mission.base.gaps import HOLE, gaps
from mission.log.values import NS_PER_S, FlightData, Track

_LOW_M = 1.0  # below this a flight begins on the ground


@dataclass(frozen=True)
class Hole:
    """A time without positions, and the places (latitude, longitude) before and after it."""

    number: int  # of its pass or round
    leg: int  # on which it begins
    start_s: float
    end_s: float
    from_deg: tuple[float, float]
    to_deg: tuple[float, float]

    @property
    def words(self) -> str:
        """One line of text: times, length, leg, and places before and after."""
        start_s, end_s = self.start_s, self.end_s
        here, there = (f"{lat:.7f}, {lon:.7f}" for lat, lon in (self.from_deg, self.to_deg))
        return (
            f"at {start_s:.1f}-{end_s:.1f} s no positions for {end_s - start_s:.1f} s, leg "
            f"{self.leg}, {here} to {there}: what was flown there is not known"
        )


def position_gaps(run: FlightData, start_ns: int, end_ns: int) -> Floats:
    """Begin and end (g, 2) in seconds of the holes in a stretch of the true track, also where the
    log goes on after its last position, or tells of a time before a first one in the air."""
    t_ns = run.truth.t_ns
    told = [
        *t_ns[:1],
        *t_ns[-1:],
        *run.modes.t_ns,
        *run.battery.t_ns,
        *(e.t_ns for e in run.events),
    ]
    flies = (run.truth.pos_m[:1, 2] > _LOW_M).any()
    ends_ns = (min(told) if flies else t_ns[0], max(told)) if len(t_ns) else ()
    return gaps(t_ns, (start_ns, end_ns), usual=HOLE, ends_ns=ends_ns)


def holes(run: FlightData, number: int, track: Track, leg: Ints, found: Floats) -> tuple[Hole, ...]:
    """Describe the gaps (g, 2) in a pass or a round, whose samples (n,) were on the legs `leg`."""
    ends = run.truth.at(np.round(found * NS_PER_S).astype(np.int64).ravel()).pos_m
    places = [(p.lat_deg, p.lon_deg) for p in on_globe(run.area, ends[:, :2], ends[:, 2])]
    first = np.minimum(np.searchsorted(track.t_ns / NS_PER_S, found[:, 0]), len(leg) - 1)
    rows = zip(leg[first].tolist(), found.tolist(), places[::2], places[1::2], strict=True)
    return tuple(Hole(number, on, *times, *where) for on, times, *where in rows)
