"""Flights judged together: one frame, one clock, and who came how near to whom.

Distances are least over continuous time: both fly straight from sample to sample. They count while
both are in the air; beside each other on the ground nobody is too near.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mission.analysis.airborne import TERMINATED, times_in_air
from mission.analysis.compare import RunComparison, names_of
from mission.analysis.holes import position_gaps
from mission.analysis.one_pass import AT_END_M
from mission.base import polyline
from mission.base.area import Area, on_globe
from mission.base.arrays import Bools, Floats
from mission.base.errors import InputError
from mission.base.gaps import inside
from mission.base.palette import community_colour
from mission.log.values import NS_PER_S, OURS, FlightData, PlanRecord, Track
from mission.log.world_files import Met, Seen

# Which axes (east, north, up) each distance has; by the name of its limit.
SEPARATIONS: Mapping[str, tuple[int, ...]] = {
    "separation_min_m": (0, 1, 2),
    "separation_horizontal_min_m": (0, 1),
    "separation_vertical_min_m": (2,),
}
# Of these two each counts only while the other one is below its limit.
_BESIDE = {"separation_horizontal_min_m": "separation_vertical_min_m"}
_BESIDE |= {other: name for name, other in _BESIDE.items()}
_FAR_M = 5000.0  # between the nearest places of flights of one world
_LOOKED_AT = 200  # places of each, for that
_CRITICAL = 2  # MAV_SEVERITY
_MARGIN_M = 50.0  # around all flights, for the map


@dataclass(frozen=True)
class Near:
    """The least of a distance, and when; infinite where it never counted."""

    away_m: float
    t_s: float = math.nan


@dataclass(frozen=True)
class Apart:
    """How far two are from each other, straight from instant to instant."""

    t_s: Floats  # (n,)
    away_m: Floats  # (n, 3) from one to the other: east, north, up
    known: Bools  # (n - 1,) between which instants; not in holes, nor where one is on the ground

    def near(self, axes: Sequence[int], beside: Sequence[int] = (), below_m: float = 0.0) -> Near:
        """The least distance along some axes; where others are given `beside` them, of the times
        in which the distance along those is below a bound."""
        start, end = self.away_m[:-1][self.known], self.away_m[1:][self.known]
        low, high = np.zeros(len(start)), np.ones(len(start))
        if beside:
            low, high = _below(start[:, beside], end[:, beside], below_m)
        start, way = start[:, axes], (end - start)[:, axes]
        square = (way**2).sum(axis=1)
        foot = np.divide(
            -(start * way).sum(axis=1), square, out=np.zeros(len(way)), where=square > 0.0
        )
        share = np.clip(foot, low, high)
        away_m = np.linalg.norm(start + share[:, None] * way, axis=1)
        away_m[low >= high] = math.inf
        if math.isinf(away_m.min(initial=math.inf)):
            return Near(math.inf)
        at = int(away_m.argmin())
        begin_s, end_s = self.t_s[:-1][self.known][at], self.t_s[1:][self.known][at]
        return Near(float(away_m[at]), float(begin_s + share[at] * (end_s - begin_s)))


_NEVER = Apart(np.zeros(0), np.zeros((0, 3)), np.zeros(0, dtype=bool))


def _below(start: Floats, end: Floats, bound: float) -> tuple[Floats, Floats]:
    """From which to which share (k,) of each piece the distance is below a bound; the former is not
    less where it never is."""
    way = end - start
    a, b = (way**2).sum(axis=1), (start * way).sum(axis=1)
    c = (start**2).sum(axis=1) - bound**2
    with np.errstate(all="ignore"):
        half = np.sqrt(np.where(a > 0.0, b**2 - a * c, np.nan))
        low, high = (-b - half) / a, (-b + half) / a
    still = (a == 0.0) & (c < 0.0)
    low, high = np.where(still, 0.0, low), np.where(still, 1.0, high)
    return np.clip(np.nan_to_num(low, nan=1.0), 0, 1), np.clip(np.nan_to_num(high, nan=0.0), 0, 1)


@dataclass(frozen=True)
class Pair:
    """Two flights, while both are in the air."""

    first: int  # of the flights, from 0
    second: int
    name: str
    flown: Apart
    planned: Apart  # as if each had kept to its plan from when it began; empty where none is timed
    lost_s: Floats  # (g, 2) begin and end of holes in the positions of one of them

    @property
    def known_s(self) -> float:
        """For how long both are in the air, and their places are known."""
        return float(np.diff(self.flown.t_s)[self.flown.known].sum())

    def lost(self, most_s: float = 0.0) -> str:
        """Words on the longest hole, if it is longer than `most_s`; else empty."""
        begin_s, end_s = max(self.lost_s.tolist(), key=lambda one: one[1] - one[0], default=(0, 0))
        if end_s - begin_s <= most_s:
            return ""
        return f"no positions of one of them at {begin_s:.1f}-{end_s:.1f} s"

    def over_time(self, near: Near) -> tuple[Floats, Floats]:
        """Times and distances, with the least one among them; NaN behind what is not known."""
        t_s, known = self.flown.t_s, np.append(self.flown.known, True)
        away_m = np.where(known, np.linalg.norm(self.flown.away_m, axis=1), math.nan)
        at = int(np.searchsorted(t_s, near.t_s))
        return np.insert(t_s, at, near.t_s), np.insert(away_m, at, near.away_m)

    def nearest(self, name: str, limits: Mapping[str, float]) -> Near:
        """The least of a distance under limits; with a limit of the other one, of the horizontal
        and the vertical one each counts only while the other is below its limit."""
        other = _BESIDE.get(name)
        beside = SEPARATIONS[other] if other in limits and other else ()
        return self.flown.near(SEPARATIONS[name], beside, limits.get(other or "", 0.0))


@dataclass(frozen=True)
class Together:
    """Flights in the frame and on the clock of the first."""

    flights: tuple[RunComparison, ...]
    names: tuple[str, ...]
    area: Area  # around all of them, with the home of the first
    tracks: tuple[Track, ...]
    added_s: tuple[float, ...]  # to the times of each
    by: tuple[str, ...]  # what each clock is known by
    plans: tuple[tuple[Floats, ...], ...]  # planned paths (P, 3) of each
    pairs: tuple[Pair, ...] = ()
    left_out: tuple[str, ...] = ()  # logs that are not among them, and why

    def middle_m(self, pair: Pair, t_s: float) -> Floats:
        """(3,) the place in the middle between two flights at an instant, in the area."""
        t_ns = np.array([round(t_s * NS_PER_S)])
        both = [self.tracks[n].at(t_ns).pos_m[0] for n in (pair.first, pair.second)]
        return np.asarray(np.mean(both, axis=0))

    @property
    def seen(self) -> list[Seen]:
        """Each flight with a colour of its own."""
        each = zip(self.names, self.tracks, self.plans, strict=True)
        return [Seen(of[0], community_colour(n), *of[1:]) for n, of in enumerate(each)]

    @property
    def met(self) -> list[Met]:
        """Where and when each two came nearest, as far as is known."""
        found = []
        for pair in self.pairs:
            near = pair.flown.near(SEPARATIONS["separation_min_m"])
            if math.isfinite(near.away_m):
                over_time = pair.over_time(near)
                at_m = self.middle_m(pair, near.t_s)
                found.append(Met(pair.name, at_m, near.t_s, near.away_m, *over_time))
        return found

    def on_map(self, points_m: Floats) -> Floats:
        """Places (n, 2) of the first flight's area in that of all."""
        shift = np.subtract(self.area.home_m, self.flights[0].run.data.area.home_m)
        return np.asarray(points_m + shift)

    def place(self, pair: Pair, t_s: float) -> dict[str, float]:
        """The same in degrees, and metres above the home of the first."""
        x, y, z = self.middle_m(pair, t_s).tolist()
        (place,) = on_globe(self.area, np.array([[x, y]]), z)
        return {"lat_deg": place.lat_deg, "lon_deg": place.lon_deg, "height_m": z}

    def _row(self, pair: Pair) -> dict[str, object]:
        row: dict[str, object] = {
            "first": self.names[pair.first],
            "second": self.names[pair.second],
            "known_s": pair.known_s,
        }
        for name, axes in SEPARATIONS.items():
            near, planned = pair.flown.near(axes), pair.planned.near(axes)
            key = name.removesuffix("_m")
            row[name] = math.nan if pair.lost() else near.away_m
            row[f"{key}_t_s"] = near.t_s
            row |= {f"{key}_{of}": value for of, value in self.place(pair, near.t_s).items()}
            row[f"plan_{name}"] = planned.away_m if pair.planned.known.any() else math.nan
            row[f"plan_{key}_t_s"] = planned.t_s
        return row

    @property
    def rows(self) -> list[dict[str, object]]:
        """The numbers of each pair: each least distance, when and where, and as planned. Where
        positions are missing, those flown are not known (NaN)."""
        return [self._row(pair) for pair in self.pairs]

    @property
    def lines(self) -> Iterator[str]:
        """What is said beside the table: losses, clocks, pairs that never meet, holes."""
        yield from (f"left out: {why}" for why in self.left_out)
        for name, flight, added_s in zip(self.names, self.flights, self.added_s, strict=True):
            data = flight.run.data
            if data.modes.names[-1:] == (TERMINATED,):
                t_ns = int(data.modes.t_ns[-1])
                said = [e.text for e in data.events if e.t_ns == t_ns and e.severity <= _CRITICAL]
                why = f": {said[0]}" if said else ""
                yield f"{name}: lost at {t_ns / NS_PER_S + added_s:.1f} s{why}"
        for name, added_s, by in zip(self.names, self.added_s, self.by, strict=True):
            if added_s:
                yield f"{name}: {added_s:+.3f} s on the clock of {self.names[0]}, by {by}"
        met = {(pair.first, pair.second) for pair in self.pairs}
        for pair in itertools.combinations(range(len(self.names)), 2):
            if pair not in met:
                both = " and ".join(self.names[n] for n in pair)
                yield f"{both}: never in the air at the same time"
        for each in self.pairs:
            if lost := each.lost():
                near = each.flown.near(SEPARATIONS["separation_min_m"])
                yield (
                    f"{each.name}: {lost}: how near they came is not known; "
                    f"{near.away_m:.2f} m at {near.t_s:.1f} s of what is known"
                )


def together(
    flights: Sequence[RunComparison],
    offsets: Mapping[str, float] | None = None,
    *,
    of_run: bool = False,
    at_once: bool = False,
) -> Together:
    """Put flights into the frame and on the clock of the first, and measure all pairs.

    `offsets`: seconds to add to the times of a log, by its name, in place of what it tells.
    `of_run`: they are of one run, drawn in its area. `at_once`: they were flown at once, so that
    they are together also where they are far apart or one was in the air alone.

    Raises:
        InputError: clocks that cannot be aligned, flights of no or other places or of other times,
            or an offset of no log.
    """
    names = names_of(flights)
    given = _given(flights, names, offsets or {})
    first = flights[0].run.data
    for name, flight in zip(names, flights, strict=True):
        if not flight.run.data.source.on_globe:
            raise InputError(
                f"{name}: the log has no places on the globe, so nobody knows where it flew among "
                "others; leave --together out to see them side by side"
            )
    found = [_clock(flight.run.data, first, given.get(n)) for n, flight in enumerate(flights)]
    for name, clock in zip(names, found, strict=True):
        if clock is None:
            raise InputError(
                f"{name}: its clock cannot be aligned with that of {names[0]}: not both tell UTC "
                f"or GPS time; --offset {name}=SECONDS says what to add to its times"
            )
    clocks = [clock for clock in found if clock is not None]
    tracks = [
        _track(flight.run.data.truth, flight.run.data.area, first.area, added_s)
        for flight, (added_s, _) in zip(flights, clocks, strict=True)
    ]
    some = [t.pos_m[:: max(1, len(t.t_ns) // _LOOKED_AT), :2] for t in tracks]
    for name, of in zip(names[1:], some[1:], strict=True):
        away_m = float(np.linalg.norm(of[:, None] - some[0][None], axis=2).min())
        if away_m > _FAR_M and not at_once:
            raise InputError(
                f"{name}: {away_m / 1000:.1f} km from {names[0]}: flights of other places; leave "
                "--together out to see them side by side"
            )
    area = first.area  # that of a run's tables
    if not of_run:
        every = np.vstack([area.to_ned(t.pos_m[:, :2], t.pos_m[:, 2]) for t in tracks])
        area = Area.around(area.home, every, margin_m=_MARGIN_M)
    shift = np.append(np.subtract(area.home_m, first.area.home_m), 0.0)
    tracks = [Track(t.t_ns, t.pos_m + shift) for t in tracks]
    added_s, by = zip(*clocks, strict=True)
    plans = tuple(
        tuple(_moved(plan.route_3d_m, flight.run.data.area, first.area) + shift for plan in of)
        for flight, of in ((flight, flight.run.data.plans) for flight in flights)
    )
    made = Together(tuple(flights), tuple(names), area, tuple(tracks), added_s, by, plans)
    made = replace(made, pairs=tuple(_pairs(made, first.area)))
    for n, name in enumerate(names):
        if not at_once and all(n not in (pair.first, pair.second) for pair in made.pairs):
            raise InputError(
                f"{name}: in the air when none of the others is; leave --together out to see them "
                f"side by side, or --offset {name}=SECONDS says what to add to its times"
            )
    return made


def _given(
    flights: Sequence[RunComparison], names: Sequence[str], offsets: Mapping[str, float]
) -> dict[int, float]:
    """The offsets by number of the flight; a log's path stands for its name, too."""
    found = {}
    for key, seconds in offsets.items():
        called = [n for n, name in enumerate(names) if key in (name, str(flights[n].run.path))]
        if not called:
            raise InputError(f"--offset {key}: no such log (there are: {', '.join(names)})")
        if not math.isfinite(seconds):
            raise InputError(f"--offset {key}={seconds}: must be a number of seconds")
        found[called[0]] = seconds
    return found


def _clock(data: FlightData, first: FlightData, given: float | None) -> tuple[float, str] | None:
    """Seconds to add to a log's times for those of the first, and by what they are known; None
    where they are not."""
    if given is not None:
        return given, "--offset"
    if data is first or (_simulated(data) and _simulated(first)):
        return 0.0, data.source.clock
    utc_ns, first_ns = data.source.utc_ns, first.source.utc_ns
    if utc_ns is None or first_ns is None:
        return None
    return (utc_ns - first_ns) / NS_PER_S, "UTC"


def _simulated(data: FlightData) -> bool:
    external = data.config.get("link", {}).get("kind") == "external"
    return data.source.clock == OURS.clock and not external


def _moved(points_m: Floats, area: Area, to: Area) -> Floats:
    """Places (n, 3) of an area in another one, of each of which only home and its place count."""
    ned = area.to_ned(points_m[:, :2], points_m[:, 2])
    up_m = points_m[:, 2] + area.home.alt_msl_m - to.home.alt_msl_m
    ned[:, 2] += area.frame.drop_m(ned[:, 0], ned[:, 1])
    return np.column_stack((to.from_ned(area.frame.in_frame(ned, to.frame)), up_m))


def _track(track: Track, area: Area, to: Area, added_s: float) -> Track:
    """A track of an area in another one, and on its clock."""
    return Track(track.t_ns + round(added_s * NS_PER_S), _moved(track.pos_m, area, to))


def _pairs(world: Together, area: Area) -> Iterator[Pair]:
    """Yield all pairs that are in the air at the same time."""
    air, lost, planned = list[Floats](), list[Floats](), list[list[Track]]()
    for flight, added_s in zip(world.flights, world.added_s, strict=True):
        data = flight.run.data
        air.append(np.array(times_in_air(flight.run.path, data)) + added_s)
        begin_ns, end_ns = data.truth.t_ns[[0, -1]].tolist()
        lost.append(position_gaps(data, begin_ns - 1, end_ns + 1) + added_s)
        tracks = [_planned(data, p) for p in data.plans if np.isfinite(p.slot_s).all()]
        planned.append([_track(track, data.area, area, added_s) for track in tracks])
    for a, b in itertools.combinations(range(len(world.flights)), 2):
        spans = np.array([
            (max(one[0], two[0]), min(one[1], two[1])) for one in air[a] for two in air[b]
        ]).reshape(-1, 2)  # fmt: skip
        spans = spans[spans[:, 0] < spans[:, 1]]
        if not len(spans):
            continue
        both = np.vstack((lost[a], lost[b]))
        begin_s, end_s = both.T[..., None]
        # Touching, too: a log may go on after its last position.
        hides = ((begin_s <= spans[:, 1]) & (end_s >= spans[:, 0])).any(axis=1)
        flown = _apart(world.tracks[a], world.tracks[b], spans, both)
        name = f"{world.names[a]} and {world.names[b]}"
        yield Pair(a, b, name, flown, _apart_planned(planned[a], planned[b]), both[hides])


def _planned(data: FlightData, plan: PlanRecord) -> Track:
    """Where a plan leads when, straight from place to place; that of a flight begins with what is
    flown, a metre after it was to."""
    places_m, begin_s = plan.route_3d_m[plan.stops_at], 0.0
    if data.planned is not None:
        begin_s = float(np.interp(AT_END_M, polyline.along(places_m), plan.slot_s))
    t_ns = np.round((plan.slot_s - begin_s) * NS_PER_S).astype(np.int64)
    return Track(plan.t_ns + t_ns, places_m)


def _apart_planned(first: Sequence[Track], second: Sequence[Track]) -> Apart:
    """How far two are apart while both are on a plan."""
    none = np.zeros((0, 2))
    found = []
    for one, other in itertools.product(first, second):
        ends_s = np.array([track.t_ns[[0, -1]] / NS_PER_S for track in (one, other)])
        span_s = np.array([[ends_s[:, 0].max(), ends_s[:, 1].min()]])
        if np.diff(span_s) > 0:
            found.append(_apart(one, other, span_s, none))
    return _joined(found)


def _apart(first: Track, second: Track, spans_s: Floats, lost_s: Floats) -> Apart:
    """How far two tracks are apart in times (g, 2), but for holes (h, 2)."""
    times, found = np.union1d(first.t_ns, second.t_ns), []
    for begin_ns, end_ns in np.round(spans_s * NS_PER_S).astype(np.int64).tolist():
        within = times[(times > begin_ns) & (times < end_ns)]
        t_ns = np.concatenate(([begin_ns], within, [end_ns]))
        t_s = t_ns / NS_PER_S
        known = ~inside((t_s[:-1] + t_s[1:]) / 2, lost_s)
        found.append(Apart(t_s, second.at(t_ns).pos_m - first.at(t_ns).pos_m, known))
    return _joined(found)


def _joined(parts: Sequence[Apart]) -> Apart:
    """Times one after another; between them nothing is known."""
    if not parts:
        return _NEVER
    known = np.concatenate([np.append(part.known, False) for part in parts])[:-1]
    t_s, away_m = (np.concatenate([getattr(p, of) for p in parts]) for of in ("t_s", "away_m"))
    return Apart(t_s, away_m, known)
