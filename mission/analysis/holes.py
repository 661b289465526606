"""Holes in a log: times without positions, of which nobody knows what was flown."""

from dataclasses import dataclass

import numpy as np

from mission.base.area import on_globe
from mission.base.arrays import Ints
from mission.base.gaps import HOLE, Gaps, gaps
from mission.log.values import NS_PER_S, FlightData, Track

_LOW_M = 1.0  # below this a flight begins on the ground


@dataclass(frozen=True)
class Hole:
    """A time without positions in a pass or a round, and the places before and after it."""

    number: int  # of its pass or round
    leg: int  # on which it begins
    start_s: float
    end_s: float
    from_deg: tuple[float, float]  # latitude, longitude
    to_deg: tuple[float, float]

    @property
    def words(self) -> str:
        """One line of text: times, length, leg, and places before and after."""
        places = " to ".join(f"{lat:.7f}, {lon:.7f}" for lat, lon in (self.from_deg, self.to_deg))
        return (
            f"at {self.start_s:.1f}-{self.end_s:.1f} s no positions for "
            f"{self.end_s - self.start_s:.1f} s, leg {self.leg}, {places}: what was flown there is "
            "not known"
        )


def position_gaps(run: FlightData, start_ns: int, end_ns: int) -> Gaps:
    """Return begin and end (s) of the holes in a stretch of the true track, also where the log goes
    on after its last position, or tells of a time before a first one in the air."""
    t_ns = run.truth.t_ns
    if not len(t_ns):
        return []
    told = np.concatenate((t_ns, run.modes.t_ns, run.battery.t_ns, [e.t_ns for e in run.events]))
    flies = run.truth.pos_m[0, 2] > _LOW_M
    ends_ns = int(told.min() if flies else t_ns[0]), int(told.max())
    return gaps(t_ns, (start_ns, end_ns), usual=HOLE, ends_ns=ends_ns)


def holes(run: FlightData, number: int, track: Track, leg: Ints, found: Gaps) -> tuple[Hole, ...]:
    """Describe the gaps `found` in the track (n,) of a pass or a round, whose samples were on the
    legs `leg` (n,)."""
    ends = run.truth.at(np.round(np.array(found) * NS_PER_S).astype(np.int64).ravel()).pos_m
    places = [(p.lat_deg, p.lon_deg) for p in on_globe(run.area, ends[:, :2], ends[:, 2])]
    first = np.searchsorted(track.t_ns / NS_PER_S, [begin_s for begin_s, _ in found])
    return tuple(
        Hole(number, int(leg[min(at, len(leg) - 1)]), *gap, *two)
        for at, gap, two in zip(
            first, found, zip(places[::2], places[1::2], strict=True), strict=True
        )
    )
