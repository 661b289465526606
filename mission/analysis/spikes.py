"""Spikes of a flight's errors, with the events of their time that may explain them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mission.analysis.holes import position_gaps
from mission.analysis.measure import Measured, gnss_gaps
from mission.base.arrays import Floats
from mission.log.values import NS_PER_S, FlightData

# A spike is farther off than this, and than three times the usual; and where it begins and ends.
_SPIKE_M, _USUAL, _EDGE = 1.0, 3.0, 0.5
_CUT_M = 10.0  # PX4's NAV_ACC_RAD: so far from the plan near a corner, a cut is as it was ordered
_JOIN_S = 1.0  # spikes so close are one
_AFTER_S = 5.0  # an event explains what begins so soon after its end
_KINDS = ("mode", "failsafe", "fault", "armed")
_WARNING = 4  # MAV_SEVERITY, and lower ones


@dataclass(frozen=True)
class Event:
    """An event of a flight, instantaneous or with a duration."""

    start_s: float
    end_s: float
    text: str


@dataclass(frozen=True)
class Spike:
    """An interval of unusually large error, its peak, and the events during it."""

    start_s: float
    end_s: float
    what: str
    peak_m: float
    peak_s: float
    number: int  # of its pass
    leg: int
    during: tuple[str, ...]

    @property
    def words(self) -> str:
        """One line of text: times, kind and peak of the spike, its leg, and the events."""
        during = "; ".join(f'"{text}"' for text in self.during)
        return (
            f"at {self.start_s:.1f}-{self.end_s:.1f} s {self.what} {self.peak_m:.1f} m, leg "
            f"{self.leg}" + (f", during {during}" if during else "")
        )


def events(run: FlightData, start_s: float, end_s: float) -> list[Event]:
    """Return the events between two instants in seconds, in order of their start."""
    happened = [
        (event.t_ns, f"{event.kind}: {event.text}")
        for event in run.events
        if event.kind in _KINDS or (event.kind == "status" and event.severity <= _WARNING)
    ]
    happened += [(item.t_ns, f"{item.kind} uploaded") for item in run.missions]
    events = [Event(t_ns / NS_PER_S, t_ns / NS_PER_S, text) for t_ns, text in happened]
    for what, gaps in ("GNSS lost", gnss_gaps), ("no positions", position_gaps):
        for begin, end in gaps(run, int(start_s * NS_PER_S), int(end_s * NS_PER_S)).tolist():
            events.append(Event(begin, end, f"{what} {begin:.1f}-{end:.1f} s"))
    for begin, long_s in run.dropouts_s.tolist():
        events.append(Event(begin, begin + long_s, f"log dropout of {long_s:.2f} s"))
    inside = [event for event in events if event.end_s >= start_s and event.start_s <= end_s]
    return sorted(inside, key=lambda event: event.start_s)


def spikes(run: FlightData, all_measured: Sequence[Measured]) -> tuple[Spike, ...]:
    """Return intervals of unusually large cross-track, height or estimation error, by start time.

    Corners that are cut do not count as cross-track error.
    """
    found: list[Spike] = []
    for measured in all_measured:
        t_s = measured.truth.t_ns / NS_PER_S
        happened = events(run, float(t_s[0]) - _AFTER_S, float(t_s[-1]))
        cut = np.isnan(measured.straight) & (measured.cross_m <= _CUT_M)
        for what, values in (
            ("cross-track", np.where(cut, np.nan, measured.cross_m)),
            ("height error", np.abs(measured.height_m)),
            ("estimate off by", measured.estimate_m),
        ):
            if len(values) != len(t_s):
                continue
            for first, last in _stretches(t_s, np.nan_to_num(values)):
                peak = first + int(np.nanargmax(values[first : last + 1]))
                start, end = float(t_s[first]), float(t_s[last])
                during = [
                    event.text
                    for event in happened
                    if event.start_s <= end and event.end_s >= start - _AFTER_S
                ]
                at = float(values[peak]), float(t_s[peak])
                where = measured.record.round, int(measured.leg[peak])
                found.append(Spike(start, end, what, *at, *where, tuple(dict.fromkeys(during))))
    return tuple(sorted(found, key=lambda spike: spike.start_s))


def _stretches(t_s: Floats, values: Floats) -> Iterator[tuple[int, int]]:
    """Yield first and last index of each stretch above half the bound whose peak exceeds it."""
    bound = max(_SPIKE_M, _USUAL * float(np.median(values)))
    high = np.flatnonzero(values > _EDGE * bound)
    for group in np.split(high, np.flatnonzero(np.diff(t_s[high]) > _JOIN_S) + 1):
        if values[group].max(initial=0.0) > bound:
            yield int(group[0]), int(group[-1])
