"""A flight cut into passes through its mission: by modes, by uploads, by the item flown to.

A pass is for a flight what a round is for a run: a plan, the track that belongs to it, and numbers.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mission.analysis.airborne import DISARMED, STANDING_M, airborne, flown_modes
from mission.analysis.holes import position_gaps
from mission.analysis.one_pass import AT_END_M, Pass, match_pass
from mission.base import polyline
from mission.base.arrays import Floats, Ints
from mission.base.errors import InputError
from mission.flight.missions.geofence import item_zones
from mission.flight.missions.mission_path import (
    RETURNS,
    MissionPath,
    items_of,
    leads_on,
    mission_path,
    place_m,
    returns,
)
from mission.log.values import NS_PER_S, ROVER, FlightData, PlannedPlaces, Track
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.flying.route import repeats

PLAN_FILE = "plan file"  # metadata of a log: the file that its mission was read from
_MISSION = ("MISSION", "AUTO")  # what autopilots call the mode that flies a mission
_RETURNS = ("RETURN", "RETURN_TO_LAUNCH", "RTL", "SMART_RTL")  # and those that may end one,
_ENDS = (*_RETURNS, "LAND")
_PAUSES = ("HOLD", "LOITER")
_PAUSE_M = 30.0  # at most from where a mission was left to where it goes on, braking included
_PAUSE_S = 60.0  # at most, before a return that belongs to the mission; who orders it may be slow
_TOLD_NS = 1_000_000_000  # after a mode, in which the log tells the item that is flown to
_LEAST_S = 2.0  # a pass, or a time outside, that is shorter is none
_FAR_M = 2000.0  # from the flight a plan is of another place


@dataclass(frozen=True)
class Plan:
    """A mission plan: its items, and the name of the file or log they were read from."""

    source: str
    items: tuple[MissionItem, ...]
    since_ns: int = 0
    logged: bool = True  # in the log itself, so that its numbers of items are those of the log


@dataclass(frozen=True)
class Judged:
    """Result of matching a flight with its plan: its passes, and what was left out."""

    data: FlightData
    passes: tuple[Pass, ...]
    apart: Mapping[str, float]  # seconds in the air, by mode
    left_out: Mapping[str, int]  # items of no path, by command


def judged(path: object, data: FlightData, given: Plan | None) -> Judged:
    """Match a flight with the plan `given`, or with the missions in its log, as passes.

    Raises:
        InputError: nothing was flown, there is no plan, or it is of another place.
    """
    if len(data.truth.t_ns) < 2:
        raise InputError(f"{path}: the log has no positions, so there is nothing to compare")
    flown = replace(data, modes=flown_modes(data))
    start_ns, end_ns = airborne(path, flown)
    plans = [given] if given is not None else _logged(data)
    if not any(plan.items for plan in plans):
        raise InputError(
            f"{path}: the log has no mission to compare with; give the plan that was flown (--plan "
            "FILE), or read the flight with aerofed log export"
        )
    stretches = list(_stretches(flown, plans, start_ns, end_ns))
    if not stretches and given is None:
        modes = ", ".join(dict.fromkeys(data.modes.names)) or "no mode that is known"
        raise InputError(
            f"{path}: its mission was never flown (modes: {modes}); --plan FILE compares the whole "
            "flight with a plan"
        )
    if not stretches:
        stretches = [(plans[0], start_ns, end_ns)]
    passes: list[Pass] = []
    left_out: Counter[str] = Counter()
    before = None
    for plan, times_ns in _joined(flown, stretches):
        for one in _passes(path, data, plan, times_ns, first=len(passes) + 1):
            if plan is before:
                passes[-1] = _left_at(data, passes[-1], one)
            passes.append(one)
            left_out |= Counter(one.path.left_out)
            before = plan
    if not passes:
        raise InputError(f"{path}: no stretch of its mission lasts {_LEAST_S:g} s")
    lists = [items_of(record) for record in data.missions if record.kind == "fence"]
    fence = data.fence
    try:
        fence = fence or item_zones(lists[-1] if lists else (), data.area)
    except InputError as error:
        left_out[str(error)] += 1
    places = {
        int(seq): point
        for one in passes
        for seq, point in zip(one.path.seqs, one.path.points_m, strict=True)
        if seq >= 0
    }
    passed = {p.seq for one in passes for p in one.passages if not math.isnan(p.t_s)}
    data = replace(
        data,
        fence=fence,
        plans=tuple(one.plan for one in passes),
        rounds=tuple(one.record for one in passes),
        planned=PlannedPlaces(
            ", ".join(dict.fromkeys(plan.source for plan in plans)),
            places,
            _rally_m(data),
            frozenset(passed),
            in_holes=any(len(position_gaps(data, *one.span_ns)) for one in passes),
        ),
    )
    return Judged(data, tuple(passes), _apart(flown, passes, start_ns, end_ns), left_out)


def _logged(data: FlightData) -> list[Plan]:
    source = data.metadata.get(PLAN_FILE, {}).get("name", "mission in the log")
    return [
        Plan(source, items_of(record), record.t_ns)
        for record in data.missions
        if record.kind == "mission"
    ]


def _rally_m(data: FlightData) -> tuple[Floats, ...]:
    lists = [items_of(record) for record in data.missions if record.kind == "rally"]
    return tuple(place_m(item, data.area) for items in lists[-1:] for item in items)


def _stretches(
    data: FlightData, plans: Sequence[Plan], start_ns: int, end_ns: int
) -> Iterator[tuple[Plan, int, int]]:
    """Yield plan, begin and end (ns) of each time in mission mode, cut at uploads of missions."""
    names = data.modes.names
    begins = [max(int(t_ns), start_ns) for t_ns in data.modes.t_ns]
    # The sample that tells has left it; damaged logs may tell of no mode at all.
    ends = [*(t_ns - 1 for t_ns in begins[1:]), *[end_ns][: len(begins)]]
    for index, (name, begin_ns, until_ns) in enumerate(zip(names, begins, ends, strict=True)):
        if name not in _MISSION:
            continue
        following = zip(names[index + 1 :], ends[index + 1 :], strict=True)
        home_ns = until_ns
        paused_ns = until_ns
        for other, other_ns in following:
            if other in _ENDS:
                home_ns = other_ns
            elif other not in _PAUSES or other_ns - paused_ns > _PAUSE_S * NS_PER_S:
                break
            paused_ns = other_ns
        for number, plan in enumerate(plans):
            later_ns = plans[number + 1].since_ns if number + 1 < len(plans) else end_ns
            first_ns = begin_ns if number == 0 else max(begin_ns, plan.since_ns)
            last_ns = min(until_ns, later_ns)
            told = [seq for t_ns, seq in zip(*_current(data, plan), strict=True) if t_ns <= last_ns]
            over = not told or not leads_on(plan.items, int(told[-1]))
            ends_home = last_ns == until_ns and returns(plan.items) and over
            last_ns = min(home_ns if ends_home else last_ns, end_ns)
            if plan.items and last_ns - first_ns >= _LEAST_S * NS_PER_S:
                yield plan, first_ns, last_ns


def _joined(
    data: FlightData, stretches: Sequence[tuple[Plan, int, int]]
) -> list[tuple[Plan, list[tuple[int, int]]]]:
    """Join stretches across pauses: each plan with the times (begin, end) in ns it was flown."""
    joined: list[tuple[Plan, list[tuple[int, int]]]] = []
    for plan, begin_ns, until_ns in stretches:
        before, times_ns = joined[-1] if joined else (None, [])
        if (
            before is plan
            and not _ended(data, times_ns[-1][0], begin_ns)
            and _goes_on(data, plan, times_ns[-1][1], begin_ns)
        ):
            times_ns.append((begin_ns, until_ns))
        else:
            joined.append((plan, [(begin_ns, until_ns)]))
    return joined


def _ended(data: FlightData, begin_ns: int, next_ns: int) -> bool:
    """Whether there is a return, a landing or disarming from the begin of a stretch to the next."""
    within = (data.modes.t_ns > begin_ns) & (data.modes.t_ns <= next_ns)
    ends = (*_ENDS, DISARMED)
    return any(data.modes.names[index] in ends for index in np.flatnonzero(within).tolist())


def _goes_on(data: FlightData, plan: Plan, left_ns: int, begin_ns: int) -> bool:
    """Whether a mission goes on where it was left before: at that place, and no earlier item."""
    # A plan file may number its items otherwise, but the log's numbers tell this, too.
    times, seqs = _current(data, replace(plan, logged=True))
    left, begun = seqs[times <= left_ns].tolist(), seqs[times <= begin_ns].tolist()
    if not left:
        return False
    done = [-1, *left][-2]  # what was flown to last may only be known from what was reached later
    told = begun[-1:] + seqs[(times > begin_ns) & (times <= begin_ns + _TOLD_NS)].tolist()
    left_m, begin_m = data.truth.at(np.array([left_ns, begin_ns])).pos_m
    return min(told) > done and float(np.linalg.norm(begin_m - left_m)) <= _PAUSE_M


def _passes(
    path: object, data: FlightData, plan: Plan, times_ns: Sequence[tuple[int, int]], *, first: int
) -> Iterator[Pass]:
    """A pass, or several where the vehicle went back to an earlier item on the way."""
    begin_ns, until_ns = times_ns[0][0], times_ns[-1][1]
    times, seqs = _current(data, plan)
    before = seqs[times <= begin_ns]
    item = int(before[-1]) if len(before) and before[-1] < len(plan.items) else 0
    cuts = [begin_ns]
    firsts = [item]
    for t_ns, seq in zip(times.tolist(), seqs.tolist(), strict=True):
        back = seq < item and not repeats(plan.items)
        if begin_ns < t_ns < until_ns and back:
            cuts.append(t_ns)
            firsts.append(seq)
        if begin_ns < t_ns < until_ns:
            item = seq
    for number, (start_ns, item) in enumerate(zip(cuts, firsts, strict=True)):
        end_ns = cuts[number + 1] if number + 1 < len(cuts) else until_ns
        track = data.truth.between(start_ns, end_ns)
        if end_ns - start_ns < _LEAST_S * NS_PER_S or len(track.t_ns) < 2:
            continue
        kept = [(track.t_ns >= since_ns) & (track.t_ns <= to_ns) for since_ns, to_ns in times_ns]
        track = track.at(track.t_ns[np.any(kept, axis=0)])
        items = plan.items
        if data.vehicle == ROVER:  # which has no heights
            items = tuple(replace(item, z=math.nan) for item in items)
        way = mission_path(
            items,
            data.area,
            track.pos_m[0],
            first=item,
            rally_m=_rally_m(data),
            climbs_straight=data.climbs_straight,
        )
        if data.vehicle == ROVER:
            way = replace(way, height_known=np.zeros(len(way.points_m), dtype=bool))
        if len(way.points_m) > 1:
            _check_place(path, plan, way, track)
            # Whoever ordered the flight knew what the vehicle makes of the mission.
            foreseen = [p.slot_s for p in data.plans if plan.logged and item == 0]
            yield match_pass(
                data,
                way,
                track,
                number=first,
                begin_ns=start_ns,
                current=(times, seqs),
                returns_ns=_returns_ns(data, plan, int(track.t_ns[0])),
                foreseen_s=[*foreseen, np.full(1, math.nan)][0],
            )
            first += 1


def _left_at(data: FlightData, left: Pass, following: Pass) -> Pass:
    """Return a pass without the places that it left to the next one, where that goes on with the
    mission; one that goes back to an earlier item has its places in both."""
    told = [(event.t_ns, event.seq + 1) for event in data.events if event.seq is not None]
    told = sorted([*told, *zip(*data.current, strict=True)])
    passed = sorted((p.t_s, p.seq + 1) for p in left.passages if not math.isnan(p.t_s))
    heading = [0, *(seq for _, seq in passed)]
    heading += [seq for t_ns, seq in told if t_ns <= left.track.t_ns[-1]]
    ahead = following.path.seqs[following.path.seqs >= 0].tolist()
    if not ahead or ahead[0] < heading[-1]:
        return left
    kept = (p for p in left.passages if not math.isnan(p.t_s) or p.seq not in ahead)
    return replace(left, passages=tuple(kept))


def _check_place(path: object, plan: Plan, way: MissionPath, track: Track) -> None:
    """Refuse a plan that no part of the flight comes near."""
    # Taking off on the spot and returning home say nothing of where a plan is.
    moved = polyline.legs(way.points_m[:, :2]) > AT_END_M
    led = (way.seqs >= 0) & way.height_known & np.concatenate(([False], moved))
    places = way.points_m[led][:, None, :2]
    away_m = np.linalg.norm(places - track.pos_m[None, ::10, :2], axis=2)
    if away_m.size and (nearest := float(away_m.min())) > _FAR_M:
        raise InputError(
            f"{path}: {plan.source} is of another place: its nearest item is "
            f"{nearest / 1000:.1f} km from the flight"
        )


def _current(data: FlightData, plan: Plan) -> tuple[Ints, Ints]:
    """Return times (ns) and the current mission item from each on, as far as the log says so."""
    times, seqs = data.current
    if not plan.logged or len(times):
        kept = times >= plan.since_ns if plan.logged else np.zeros(len(times), dtype=bool)
        return times[kept], seqs[kept]
    said = [event for event in data.events if event.seq is not None and event.t_ns >= plan.since_ns]
    # When a place was passed is better than when the vehicle said so.
    exact = [event for event in said if event.kind == "reached"]
    passed = sorted({(event.t_ns, event.seq) for event in exact or said})
    if not passed:
        return times, seqs
    # What was reached next is what was flown to.
    times, seqs = np.array(passed, dtype=np.int64).T
    return np.insert(times, 0, plan.since_ns), np.append(seqs, seqs[-1] + 1)


def _returns_ns(data: FlightData, flown: Plan, start_ns: int) -> float:
    """Return when the return of a plan first began after an instant, in ns, by mode or by mission
    item, as not every autopilot changes its mode for an item; infinity if none did. One that was
    ordered while the plan led on is none of it."""
    modes = zip(data.modes.t_ns.tolist(), data.modes.names, strict=True)
    begins_ns = [t_ns for t_ns, name in modes if name in _RETURNS]
    times, seqs = _current(data, flown)
    told = [(t_ns, seqs[times <= t_ns][-1:].tolist()) for t_ns in begins_ns]
    begins_ns = [t_ns for t_ns, at in told if not (at and leads_on(flown.items, at[0]))]
    for plan in _logged(data):
        times, seqs = _current(data, plan)
        begins_ns += times[
            np.isin(seqs, [i.seq for i in plan.items if i.command in RETURNS])
        ].tolist()
    return min((t_ns for t_ns in begins_ns if t_ns > start_ns), default=math.inf)


def _apart(
    data: FlightData, passes: Sequence[Pass], start_ns: int, end_ns: int
) -> Mapping[str, float]:
    """Return seconds in the air outside all passes, by mode, without standing at the end."""
    after = data.truth.between(int(passes[-1].track.t_ns[-1]), end_ns)
    if len(after.t_ns) and np.ptp(after.pos_m, axis=0).max() < STANDING_M:
        end_ns = int(after.t_ns[0])
    track = data.truth.between(start_ns, end_ns)
    outside = ~np.isin(track.t_ns, np.concatenate([item.track.t_ns[:-1] for item in passes]))
    t_ns = np.union1d(track.t_ns, data.modes.t_ns)  # a mode may change where the log pauses
    t_ns = t_ns[(t_ns >= start_ns) & (t_ns <= end_ns)]
    step_s = np.diff(t_ns, append=t_ns[-1:]) / NS_PER_S
    at = np.searchsorted(data.modes.t_ns, t_ns, side="right") - 1
    outside = outside[np.maximum(np.searchsorted(track.t_ns, t_ns, side="right") - 1, 0)]
    outside_s: dict[str, float] = {}
    for index in np.unique(at):
        name = data.modes.names[index] if index >= 0 else "mode unknown"
        outside_s[name] = outside_s.get(name, 0.0) + float(step_s[outside & (at == index)].sum())
    outside_s.pop(DISARMED, None)
    return {name: seconds for name, seconds in outside_s.items() if seconds >= _LEAST_S}
