"""A flight leg by leg, and its spikes beside what happened: one time line."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mission.analysis.alignment import leg_of
from mission.analysis.measure import Measured, gnss_gaps
from mission.base.arrays import Bools, Floats, Ints
from mission.log.values import NS_PER_S, FlightData

if TYPE_CHECKING:
    from mission.analysis.passes import Judged, Pass

_LEAST_M = 0.5  # a leg that is shorter is none
# A spike is farther off than this, and than three times the usual; and where it begins and ends.
_SPIKE_M, _USUAL, _EDGE = 1.0, 3.0, 0.5
_JOIN_S = 1.0  # spikes so close are one
_AFTER_S = 5.0  # an event explains what begins so soon after its end
_KINDS = ("mode", "failsafe", "fault", "armed")
_WARNING = 4  # MAV_SEVERITY, and lower ones


@dataclass(frozen=True)
class Leg:
    """One leg of the plan as it was flown; NaN where it was not."""

    number: int  # of its pass, or round
    leg: int  # from 1
    item: int | None  # the mission item that it leads to
    length_m: float
    start_s: float
    end_s: float
    cross_track_rms_m: float
    cross_track_max_m: float
    height_max_m: float
    speed_mean_mps: float


@dataclass(frozen=True)
class Event:
    """Something that happened, or lasted."""

    start_s: float
    end_s: float
    text: str


@dataclass(frozen=True)
class Spike:
    """Where a flight was farther off than usual, and what happened then."""

    start_s: float
    end_s: float
    what: str
    peak_m: float
    peak_s: float
    number: int
    leg: int
    during: tuple[str, ...]

    @property
    def words(self) -> str:
        """A line for people."""
        during = "; ".join(f'"{text}"' for text in self.during)
        return (
            f"at {self.start_s:.1f}-{self.end_s:.1f} s {self.what} {self.peak_m:.1f} m, leg "
            f"{self.leg}" + (f", during {during}" if during else "")
        )


def legs(measured: Sequence[Measured], judged: "Judged") -> tuple[Leg, ...]:
    """Every leg of every pass, in order."""
    pairs = zip(measured, judged.passes, strict=False)
    return tuple(leg for one, found in pairs for leg in _legs(one, found))


def _legs(measured: Measured, found: "Pass") -> Iterator[Leg]:
    t_s = measured.truth.t_ns / NS_PER_S
    numbers = leg_numbers(measured, found)
    at_m, names = measured.fit.waypoints_at_m, _numbers(found)
    for number in np.unique(names):
        ends = np.flatnonzero(names == number) + 1
        length_m = float(at_m[ends[-1]] - at_m[ends[0] - 1])
        if length_m < _LEAST_M:
            continue
        here = np.flatnonzero(numbers == number)
        seq = int(found.path.seqs[ends[-1]])
        flown = len(here) > 1
        cross, height = measured.cross_m[here], np.abs(measured.height_m[here])
        known = height[~np.isnan(height)]
        yield Leg(
            number=measured.record.round,
            leg=int(number),
            item=seq if seq >= 0 else None,
            length_m=length_m,
            start_s=float(t_s[here[0]]) if flown else math.nan,
            end_s=float(t_s[here[-1]]) if flown else math.nan,
            cross_track_rms_m=float(np.sqrt((cross**2).mean())) if flown else math.nan,
            cross_track_max_m=float(cross.max()) if flown else math.nan,
            height_max_m=float(known.max()) if flown and len(known) else math.nan,
            speed_mean_mps=float(measured.speed_mps[here].mean()) if flown else math.nan,
        )


def _numbers(found: "Pass") -> Ints:
    """(L,) the number, from 1, of what each piece of the path belongs to: a leg to an item."""
    ends = found.path.seqs[1:] >= 0
    return np.concatenate(([1], 1 + np.cumsum(ends)[:-1]))


def leg_numbers(measured: Measured, found: "Pass | None") -> Ints:
    """(n,) on which leg each sample was, from 1; a leg leads to an item, or else to a corner."""
    pieces = leg_of(measured.fit)
    return _numbers(found)[pieces] if found is not None else pieces + 1


def events(run: FlightData, start_s: float, end_s: float) -> list[Event]:
    """What happened between two instants, in order of time."""
    found = [
        Event(event.t_ns / NS_PER_S, event.t_ns / NS_PER_S, f"{event.kind}: {event.text}")
        for event in run.events
        if event.kind in _KINDS or (event.kind == "status" and event.severity <= _WARNING)
    ]
    found += [
        Event(item.t_ns / NS_PER_S, item.t_ns / NS_PER_S, f"{item.kind} uploaded")
        for item in run.missions
    ]
    found += [
        Event(begin, end, f"GNSS lost {begin:.1f}-{end:.1f} s")
        for begin, end in gnss_gaps(run, int(start_s * NS_PER_S), int(end_s * NS_PER_S))
    ]
    inside = [event for event in found if event.end_s >= start_s and event.start_s <= end_s]
    return sorted(inside, key=lambda event: event.start_s)


def spikes(
    run: FlightData, all_measured: Sequence[Measured], judged: "Judged | None"
) -> tuple[Spike, ...]:
    """Where the flight was farther from its plan, or from where it believed to be, than usual."""
    found: list[Spike] = []
    for index, measured in enumerate(all_measured):
        way = judged.passes[index] if judged is not None else None
        t_s = measured.truth.t_ns / NS_PER_S
        happened = events(run, float(t_s[0]) - _AFTER_S, float(t_s[-1]))
        numbers = leg_numbers(measured, way)
        for what, values in (
            ("cross-track", measured.cross_m),
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
                found.append(
                    Spike(
                        start, end, what, float(values[peak]), float(t_s[peak]),
                        measured.record.round, int(numbers[peak]), tuple(dict.fromkeys(during)),
                    )
                )  # fmt: skip
    return tuple(sorted(found, key=lambda spike: spike.start_s))


def _stretches(t_s: Floats, values: Floats) -> Iterator[tuple[int, int]]:
    """First and last sample of each stretch far above the usual value, out to half of the bound."""
    bound = max(_SPIKE_M, _USUAL * float(np.median(values)))
    high = _runs(values > _EDGE * bound, t_s)
    for first, last in high:
        if values[first : last + 1].max() > bound:
            yield first, last


def _runs(inside: Bools, t_s: Floats) -> Sequence[tuple[int, int]]:
    found: list[tuple[int, int]] = []
    for index in np.flatnonzero(inside).tolist():
        if found and t_s[index] - t_s[found[-1][1]] <= _JOIN_S:
            found[-1] = (found[-1][0], index)
        else:
            found.append((index, index))
    return found
