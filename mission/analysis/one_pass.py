"""One pass of a flight, matched with its mission: which leg each sample is on, and when each place
was passed.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from mission.analysis.alignment import Alignment, leg_of, matched
from mission.analysis.holes import position_gaps
from mission.base import polyline
from mission.base.arrays import Bools, Floats, Ints
from mission.flight.missions.mission_path import MissionPath
from mission.log.records import UNKNOWN_ROUND, RoundRecord
from mission.log.values import NS_PER_S, FlightData, PlanRecord, Track

AT_END_M = 1.0  # of the path's end: what is flown there belongs to it no more
_REACHED_M = 10.0  # passed no farther than this, a place counts as reached
_BY_SAMPLE = ("along_m", "cross_m", "above_m")  # of a match
_HERE_M = 1e-5  # before a place, so that what is there is on the leg that leads to it
_CLOSE_M, _STAY_S = 1.0, 1.0  # what belongs to a closest approach
_Headed: TypeAlias = Mapping[int, tuple[int, int]] | None
_SURE_S = 5.0  # by which a return that is told may differ from one that shows


@dataclass(frozen=True)
class Passage:
    """Time and miss vector of passing an item; NaN if not passed, the miss also on a return."""

    seq: int
    t_s: float
    miss_m: Floats  # (3,)


@dataclass(frozen=True)
class Pass:
    """One pass through a mission, from one of its items on: plan, track and their alignment."""

    plan: PlanRecord
    record: RoundRecord
    begin_ns: int  # of its time in the mission mode; where nothing was flown, before its track
    track: Track
    path: MissionPath
    fit: Alignment
    passages: tuple[Passage, ...]
    known_height: Bools  # (n,) samples at which the plan says how high

    @property
    def span_ns(self) -> tuple[int, int]:
        """From when to when a hole hides something of it. A mode is told a second after a hole at
        most: the pass may have begun in it."""
        return self.begin_ns - NS_PER_S, int(self.track.t_ns[-1]) + 1


def match_pass(
    data: FlightData,
    way: MissionPath,
    track: Track,
    *,
    number: int,
    begin_ns: int,
    current: tuple[Ints, Ints],
    returns_ns: float,
    foreseen_s: Floats,
) -> Pass:
    """Match the track of a pass with the way of its mission.

    Args:
        data: the flight: its truth, battery and holes.
        way: where the mission leads from the pass's first item on.
        track: the true positions flown in it.
        number: of the pass, from 1.
        begin_ns: of its time in the mission mode.
        current: times (ns), and the item that was flown to from each on.
        returns_ns: when a return began; infinity if none did.
        foreseen_s: when it was to pass each point, by the plan; of other points if nobody said.
    """
    at_m = polyline.along(way.points_m)
    if way.given == len(at_m):
        returns_ns = math.inf  # what it returns by is in the mission
    # Each log tells of a return in its own time: it begins where its place is passed meanwhile.
    told = np.abs(track.t_ns - returns_ns) < _SURE_S * NS_PER_S
    there = way.points_m[way.given - 1, :2]
    sure_ns, miss_m = _closest(track.t_ns, track.pos_m[:, :2] - there, told)
    if np.linalg.norm(miss_m) <= _REACHED_M:
        track = track.at(np.union1d(track.t_ns, np.int64(sure_ns)))
    else:
        sure_ns = returns_ns
    low, high, headed = _windows(way, at_m, track, *current)
    # Which items it flew to in a hole is told only after it.
    for begin_s, end_s in position_gaps(data, int(track.t_ns[0]), int(track.t_ns[-1])):
        told_ns = min(current[0][current[0] >= end_s * NS_PER_S].tolist(), default=math.inf)
        first, last = np.searchsorted(track.t_ns, (begin_s * NS_PER_S, told_ns))
        high[first:last] = high[last] if last < len(high) else at_m[-1]
    low[track.t_ns >= sure_ns] = at_m[way.given - 1]
    if math.isfinite(sure_ns):
        high[track.t_ns < sure_ns] = np.minimum(high, at_m[way.given - 1])[track.t_ns < sure_ns]
    track, fit = matched(track, way.points_m, between=(low, np.maximum(low, high)))
    # To stand before the start and to hover at the end are no part of the way.
    begin, end = _crossing(fit.along_m, AT_END_M), _end(track, fit, way, len(way.points_m) - 1)
    rows = np.arange(len(track.t_ns))
    kept = np.unique(np.concatenate(([begin], rows[(rows > begin) & (rows < end)], [end])))
    times = np.round(np.interp(kept, rows, track.t_ns)).astype(np.int64)
    kept = kept[np.unique(times, return_index=True)[1]]  # none twice: speeds are between them
    track = track.at(np.unique(times))
    numbers = {name: np.interp(kept, rows, getattr(fit, name)) for name in _BY_SAMPLE}
    fit = replace(fit, **numbers)
    fit = _of_what_is_given(track, fit, way, sure_ns)
    start_ns, end_ns = int(track.t_ns[0]), int(track.t_ns[-1])
    slot_s = np.append(np.full(len(way.points_m) - 1, math.nan), foreseen_s[-1])
    if len(foreseen_s) == len(slot_s):  # else it began elsewhere
        slot_s = foreseen_s
    plan = PlanRecord.of_flight(number, start_ns, way.points_m, slot_s=slot_s)
    duration_s = (end_ns - start_ns) / NS_PER_S
    flown_m, energy_j = polyline.length(track.pos_m[:, :2]), data.battery.energy_j(start_ns, end_ns)
    record = replace(
        UNKNOWN_ROUND,
        round=number,
        start_t_s=start_ns / NS_PER_S,
        duration_s=duration_s,
        plan_path_m=plan.path_m,
        flown_path_m=flown_m,
        budget_used_m=flown_m,
        time_used_s=duration_s,
        energy_j=energy_j,
        energy_used_j=energy_j,
        battery_remaining=data.battery.left(end_ns),
    )
    leg = leg_of(fit)
    known = way.height_known[1:][leg] & way.height_known[:-1][leg]
    later = data.truth.between(end_ns + 1, end_ns + int(_SURE_S * NS_PER_S))
    passages = tuple(_passages(way, fit, track, later, headed))
    return Pass(plan, record, begin_ns, track, way, fit, passages, known)


def _crossing(values: Floats, bound: float) -> float:
    """Return the fractional index at which nondecreasing values reach `bound`, interpolated; the
    last index where none does."""
    index = min(int(np.searchsorted(values, bound)), len(values) - 1)
    before, after = values[max(index - 1, 0)], values[index]
    return index - float(np.clip((after - bound) / ((after - before) or 1.0), 0.0, min(index, 1)))


def _end(track: Track, fit: Alignment, way: MissionPath, index: int) -> float:
    """Return the fractional sample index at which point `index` of the path is reached: on arrival,
    or the closest approach after it if its height is known; the last sample if it never is."""
    there = _crossing(fit.along_m, float(fit.waypoints_at_m[index]) - AT_END_M)
    if not way.height_known[index]:
        return there
    away_m = np.linalg.norm(track.pos_m[:, :2] - way.points_m[index, :2], axis=1)
    farther = np.flatnonzero(np.diff(away_m[math.ceil(there) :], append=math.inf) >= 0.0)
    return float(math.ceil(there) + farther[0])


def _of_what_is_given(
    track: Track, fit: Alignment, way: MissionPath, returns_ns: float
) -> Alignment:
    """Return the alignment with errors set to NaN on a return, whose way the vehicle chooses."""
    last = way.given - 1
    if way.given == len(way.points_m):
        return fit
    returning = track.t_ns >= returns_ns
    returning[math.floor(_end(track, fit, way, last)) + 1 :] = True
    returning |= fit.along_m >= fit.waypoints_at_m[last]
    # A hover before it is still on the way there.
    before = (track.t_ns < returns_ns) & math.isfinite(returns_ns)
    most_m = np.where(before, fit.waypoints_at_m[last] - _HERE_M, math.inf)
    corners = fit.corners_m < fit.waypoints_at_m[last] - AT_END_M
    return replace(
        fit,
        along_m=np.minimum(fit.along_m, most_m),
        cross_m=np.where(returning, math.nan, fit.cross_m),
        above_m=np.where(returning, math.nan, fit.above_m),
        corners_m=fit.corners_m[corners],
        corner_points_m=fit.corner_points_m[corners],
    )


def _windows(
    way: MissionPath, at_m: Floats, track: Track, times: Ints, seqs: Ints
) -> tuple[Floats, Floats, _Headed]:
    """(n,) and (n,) bounds of each sample's progress in metres: from the leg before the one to the
    current item, to the leg after it; the whole path where the log does not name the item. And from
    when to when (ns) it was headed for which points; None where the log does not say."""
    stops = np.flatnonzero(way.seqs >= 0)
    inside = (times > track.t_ns[0]) & (times <= track.t_ns[-1])
    if not inside.any():
        return np.zeros(len(track.t_ns)), np.full(len(track.t_ns), at_m[-1]), None
    towards = np.zeros(len(track.t_ns), dtype=np.int64)
    stop, headed, since_ns = 0, dict[int, tuple[int, int]](), int(track.t_ns[0])
    for t_ns, seq in zip(times[inside].tolist(), seqs[inside].tolist(), strict=True):
        # An item without a place lies between two that have one.
        ahead = [k for k in range(stop, len(stops)) if way.seqs[stops[k]] >= seq > 0]
        if ahead:
            exact = [k for k in ahead if way.seqs[stops[k]] == seq]
            if (exact or ahead)[0] != stop:
                headed[int(stops[stop])] = since_ns, t_ns
                since_ns = t_ns
            stop = (exact or ahead)[0]
        towards[track.t_ns >= t_ns] = stop
    end_ns = int(track.t_ns[-1])
    headed |= dict.fromkeys(stops[stop:].tolist(), (end_ns, end_ns))  # as far as the log tells
    headed |= dict.fromkeys(stops[stop : stop + 1].tolist(), (since_ns, end_ns))
    ends = np.concatenate(([0.0, 0.0], at_m[stops], at_m[-1:]))
    return ends[towards], ends[np.minimum(towards + 3, len(ends) - 1)], headed


def _passages(
    way: MissionPath, fit: Alignment, track: Track, later: Track, headed: _Headed
) -> Iterator[Passage]:
    """Yield for each item with a place when the matched track passed it, and its miss vector: near
    it, or on its way past a point that it was `headed` for. It may stay at the last one in what is
    flown `later`."""
    every = headed is None
    headed = headed or {}
    whole_ns = np.append(track.t_ns, later.t_ns)
    whole_m = np.concatenate((track.pos_m, later.pos_m))
    for index in np.flatnonzero(way.seqs >= 0).tolist():
        at_m, place = fit.waypoints_at_m[index], way.points_m[index]
        near = np.flatnonzero(np.abs(fit.along_m[:-1] - at_m) <= 3 * _REACHED_M)
        pos_m = whole_m - place
        if not way.height_known[index]:
            pos_m[:, 2] = 0.0
        rows = slice(near[0], near[-1] + 2) if len(near) else slice(0)
        if rows.stop == len(track.t_ns):
            rows = slice(rows.start, None)
        t_ns, miss_m = _closest(whole_ns[rows], pos_m[rows])
        passed = len(near) > 0 and (
            ((every or index in headed) and _led_past(fit, track, int(near[-1]), at_m))
            or float(np.linalg.norm(miss_m)) <= _REACHED_M
        )
        if not passed and index in headed:  # on a way of its own, as from an item that was left out
            since_ns, until_ns = headed[index]
            t_ns, miss_m = _closest(whole_ns, pos_m, (whole_ns >= since_ns) & (whole_ns < until_ns))
            passed = float(np.linalg.norm(miss_m)) <= _REACHED_M
        if not passed:
            yield Passage(int(way.seqs[index]), math.nan, np.full(3, math.nan))
            continue
        # At which height a landing begins nobody knows; it ends on the ground.
        if not way.height_known[index] and index == len(way.seqs) - 1 and len(near):
            t_ns = float(track.t_ns[near[-1] + 1])
        if index >= way.given:
            miss_m = np.full(3, math.nan)
        yield Passage(int(way.seqs[index]), t_ns / NS_PER_S, miss_m)


def _closest(t_ns: Ints, pos_m: Floats, among: Bools | slice = slice(None)) -> tuple[float, Floats]:
    """Return when a track (n,), (n, 2 or 3), straight between samples, passed the origin, and its
    nearest point, of what begins at one of the samples `among`; NaN where there is none.

    Where it was nearest may be anywhere in a hover or a turn. So the time is the middle of that in
    which it was not `_CLOSE_M` farther, and `_STAY_S` after the begin of it at most.
    """
    rows = np.arange(len(t_ns))[among]
    rows = rows[rows < len(t_ns) - 1]
    if not len(rows):
        return math.nan, np.full(pos_m.shape[1], math.nan)
    away_m, share = polyline.to_segments(np.zeros(pos_m.shape[1]), pos_m[:-1], pos_m[1:])
    reach_m, far_m = (np.linalg.norm(m, axis=1) for m in (away_m, pos_m))
    best = int(rows[reach_m[rows].argmin()])
    at_ns = t_ns[best] + share[best] * (t_ns[best + 1] - t_ns[best])
    left_ns = []
    for side in (slice(best, None, -1), slice(best + 1, None)):
        rising_m = np.maximum.accumulate(np.append(reach_m[best], far_m[side]))
        at = _crossing(rising_m, reach_m[best] + _CLOSE_M)
        left_ns.append(np.interp(at, np.arange(len(rising_m)), np.append(at_ns, t_ns[side])))
    since_ns, until_ns = left_ns
    passed_ns = since_ns + min((until_ns - since_ns) / 2, _STAY_S * NS_PER_S)
    return round(passed_ns), -away_m[best]


def _led_past(fit: Alignment, track: Track, last: int, at_m: float) -> bool:
    """Whether a flight goes on past `at_m` from sample `last`, and not from before it to a later
    part of the path, as where it is aborted on the way there."""
    here_m, next_m = fit.along_m[last : last + 2]
    jump_m = next_m - here_m - np.linalg.norm(np.diff(track.pos_m[last : last + 2], axis=0))
    beyond = here_m if jump_m > 3 * _REACHED_M else fit.along_m[-1]
    return bool(beyond > at_m + AT_END_M)
