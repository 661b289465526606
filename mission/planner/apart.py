"""How near the aircraft of a round come to each other, as their flights are foreseen."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np

from mission.base.arrays import Floats
from mission.planner.flyable import acceptance_radius, cut_behind, stops_of
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem

# (T, 3) where an aircraft is every `STEP_S`, of each part of its flight: behind each it waits for
# the others.
Track: TypeAlias = Sequence[Floats]

# Between instants, ways are taken for straight: at 10 m/s2 of two that turn, 3 mm.
STEP_S = 0.05
_LATE_STEPS = 5  # between delays that are looked at
TOLERANCE_M = 0.01
_CLOSER_M = 1.0  # than it starts: what a pair may come before it has parted
LAYER_M = 10.0  # between altitudes of aircraft that are parted by height, at least


@dataclass(frozen=True)
class Nearest:
    """Where two aircraft of a round are nearest to each other, as foreseen."""

    pair: tuple[str, str]
    away_m: float
    t_s: float  # into the round
    short_m: float  # of what the two are to keep, 0 or less where they keep it

    @property
    def words(self) -> str:
        """For people."""
        pair = " and ".join(self.pair)
        return f"{pair} come within {self.away_m:.1f} m of each other at {self.t_s:.1f} s"


def height_of(problem: RoundProblem, plan: RoundPlan) -> float:
    """Height above home of one aircraft's plan, in metres."""
    return problem.channel.altitude_m if plan.altitude_m is None else plan.altitude_m


def flown(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> Track:
    """Return where one aircraft is as foreseen, in one part, or where aircraft go `in_step` in
    those between its waits; needs limits; `hold_s` as in `stops_of`."""
    assert problem.limits is not None
    performance, track = problem.limits.performance, list[Floats]()
    stops = stops_of(plan, hold_s=hold_s, upload_s=problem.upload_s)
    radius_m = acceptance_radius(problem, plan, performance.widest_m)
    parts = cut_behind(stops, plan.schedule[0].any(axis=1)) if problem.in_step else [stops]
    for part in parts:
        points_m, hold = np.array([stop.xy_m for stop in part]), [stop.hold_s for stop in part]
        duration_s = performance.foresee(points_m, hold, radius_m).duration_s
        count = math.ceil(duration_s / STEP_S) + 2
        at_m = performance.follow(points_m, hold, radius_m, step_s=STEP_S, count=count)
        track.append(np.column_stack((at_m, np.full(count, height_of(problem, plan)))))
    return track


def hovering(problem: RoundProblem) -> list[Track]:
    """Return where those are that hover until the rest of a round is over."""
    return [] if problem.hovering_m is None else [[at[None]] for at in problem.hovering_m]


def tracks_of(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> list[Track]:
    """Return where each aircraft is until the last has finished, then where others hover."""
    each = [
        flown(problem.alone(a), plan.alone(a), hold_s=hold_s) for a in range(len(problem.starts))
    ]
    return _aligned([*each, *hovering(problem)])


def _aligned(tracks: Sequence[Track]) -> list[Track]:
    """Let each wait where it is for the others at the end of each part."""
    parts = range(max(map(len, tracks)))
    counts = [max(len(track[n]) for track in tracks if n < len(track)) for n in parts]

    def waited(track: Track, n: int) -> Floats:
        part = track[n] if n < len(track) else track[-1][-1:]
        return np.concatenate((part, np.repeat(part[-1:], counts[n] - len(part), axis=0)))

    return [[waited(track, n) for n in parts] for track in tracks]


def nearest_of(
    first: Track, second: Track, apart_m: float, *, late_s: float = 0.0, parting: bool = False
) -> tuple[float, float]:
    """Return how near two aircraft come, in metres, and when, in seconds: at the least, where one
    may be up to `late_s` later than the other.

    A pair that starts nearer than `apart_m` counts from when it is so far apart, or one of them so
    far from where the other started, or if `parting` until then; infinity where there is no such
    time.
    """
    most = round(late_s / STEP_S)
    delays = sorted({0, most, -most, *range(-most, most, _LATE_STEPS)}, key=abs)
    pairs = [_aligned([_later(first, -by), _later(second, by)]) for by in delays]
    return min(
        _nearest_of(np.concatenate(one), np.concatenate(other), apart_m, parting)
        for one, other in pairs
    )


def _later(track: Track, steps: int) -> Track:
    """Return the track of an aircraft that stays so many steps before it begins each part."""
    return [np.concatenate((np.repeat(part[:1], max(0, steps), axis=0), part)) for part in track]


def _nearest_of(
    first: Floats, second: Floats, apart_m: float, parting: bool
) -> tuple[float, float]:
    away = second - first
    far = [np.linalg.norm(way, axis=1) for way in (away, first - second[0], second - first[0])]
    gone = np.max(far, axis=0) >= apart_m
    parted = int(gone.argmax()) if gone.any() else len(away)
    begin, away = (0, away[: parted + 1]) if parting else (parted, away[parted:])
    if len(away) < 2:
        return math.inf, 0.0
    here, way = away[:-1], np.diff(away, axis=0)
    square = np.maximum((way**2).sum(axis=1), 1e-12)
    share = np.clip(-(here * way).sum(axis=1) / square, 0.0, 1.0)
    distance = np.linalg.norm(here + share[:, None] * way, axis=1)
    at = int(distance.argmin())
    return float(distance[at]), (begin + at + float(share[at])) * STEP_S


def pair_of(problem: RoundProblem, first: Track, second: Track) -> tuple[float, float, float]:
    """Return how near two aircraft of a round come, when, and how many metres less than they are
    to keep that is: 0 or less where they keep apart. Until a pair counts, it comes hardly nearer
    than it starts."""
    kept, least, late_s = problem.separation_m, problem.least_m, problem.late_s
    begun_m = float(np.linalg.norm(first[0][0] - second[0][0]))
    if least is not None:
        kept = min(kept, max(least, begun_m))
    counts_m = kept if least is None else 0.0
    away_m, t_s = nearest_of(first, second, counts_m, late_s=late_s)
    short_m = kept - TOLERANCE_M - away_m
    if begun_m < counts_m:
        near_m, at_s = nearest_of(first, second, counts_m, late_s=late_s, parting=True)
        closer_m = begun_m - _CLOSER_M - near_m
        if closer_m > max(0.0, short_m):
            return near_m, at_s, closer_m
    return away_m, t_s, short_m


def _pairs(problem: RoundProblem, plan: RoundPlan, hold_s: float) -> Iterator[Nearest]:
    """Yield each pair of a plan that counts."""
    tracks, flying = tracks_of(problem, plan, hold_s=hold_s), len(problem.starts)
    names = [problem.name_of(a) for a in range(flying)] + ["one that hovers"] * len(tracks)
    for a, b in combinations(range(len(tracks)), 2):
        if a < flying:
            one = Nearest((names[a], names[b]), *pair_of(problem, tracks[a], tracks[b]))
            if one.away_m < math.inf:
                yield one


def nearest(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> Nearest | None:
    """Return where aircraft of a plan are nearest to each other; None where no pair counts."""
    return min(_pairs(problem, plan, hold_s), key=lambda one: one.away_m, default=None)


def too_near(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> Nearest | None:
    """Return where aircraft come too near to each other; None where they keep apart."""
    short = _short(problem, plan, hold_s)
    return max(short, key=lambda one: one.short_m, default=None)


def keep_apart(problem: RoundProblem, plan: RoundPlan, *, hold_s: float = 0.0) -> bool:
    """Whether aircraft keep apart, known by the first pair that does not."""
    return next(_short(problem, plan, hold_s), None) is None


def _short(problem: RoundProblem, plan: RoundPlan, hold_s: float) -> Iterator[Nearest]:
    """Yield each pair that comes too near."""
    if problem.separation_m and len(problem.starts) + len(hovering(problem)) > 1:
        yield from (one for one in _pairs(problem, plan, hold_s) if one.short_m > 0.0)


def layer_m(problem: RoundProblem) -> float:
    """Metres between altitudes of aircraft that are parted by height."""
    return max(LAYER_M, problem.separation_m)


def layered_by(problem: RoundProblem) -> float:
    """By how many metres an aircraft may be put above or below its fixed altitude: not where areas
    or what is believed of the radio may be others there, nor once a round has begun."""
    begun = problem.hovering_m is not None
    fixed = begun or problem.per_grid is not None or not problem.airspace.is_open
    if fixed or not problem.separation_m:
        return 0.0
    return (len(problem.starts) - 1) / 2.0 * layer_m(problem)
