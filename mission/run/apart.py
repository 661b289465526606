"""How near the aircraft of a round come to each other, as planned and as flown."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from mission.analysis.together import Apart, Near
from mission.base.arrays import Floats, Ints
from mission.log.records import AircraftRecord, RoundRecord
from mission.log.values import NS_PER_S, Track
from mission.planner.apart import STEP_S
from mission.run.outing import Outing, alone

_XYZ = (0, 1, 2)
_STEP_NS = 100_000_000  # at least so often it is looked whether a pair has left its homes


@dataclass(frozen=True)
class PairApart:
    """The least distances of two aircraft in a round."""

    names: tuple[str, str]
    flown: Near
    planned: Near
    parting: Near  # as flown, before they count


def pairs_of(outings: Sequence[Outing], *, leaving_m: float | None) -> list[PairApart]:
    """Measure each pair of a round, straight from instant to instant.

    `leaving_m`: a pair counts from when it is so far apart, as homes may be nearer; None: at once.
    """
    if len(outings) < 2:
        return []
    end_ns = max(int(one.flight.t_ns[-1]) for one in outings)
    tracks = [(_flown(one), _planned(one, end_ns)) for one in outings]
    found = []
    for (one, its), (other, others) in combinations(zip(outings, tracks, strict=True), 2):
        (flown, parting), (planned, _) = (
            _near(*both, leaving_m) for both in zip(its, others, strict=True)
        )
        found.append(PairApart((one.aircraft.name, other.aircraft.name), flown, planned, parting))
    return found


def row(one: Outing, whole: RoundRecord, pairs: Sequence[PairApart]) -> AircraftRecord:
    """Return the row of an aircraft in a round's record."""
    name = one.aircraft.name
    own = AircraftRecord.alone(alone(one, whole) if pairs else whole, name)
    its = [pair for pair in pairs if name in pair.names]
    if not its:
        return own
    nearest = min(its, key=lambda pair: pair.flown.away_m)
    first, second = nearest.names
    return replace(
        own,
        idle_s=one.idle_s,
        nearest=second if name == first else first,
        nearest_m=nearest.flown.away_m,
        nearest_t_s=nearest.flown.t_s,
        plan_nearest_m=min(pair.planned.away_m for pair in its),
    )


def told(
    outings: Sequence[Outing], pairs: Sequence[PairApart], separation_m: float | None
) -> Iterator[str]:
    """Yield a line on each of several aircraft of a round, and one on the closest pair."""
    if len(outings) > 1:
        wide = max(len(one.aircraft.name) for one in outings)
    for one in outings if len(outings) > 1 else ():
        heard = {item.device for item in one.served if item.delivered}
        arrived = f"{len(heard)}/{len({item.device for item in one.served})}"
        busy_s = one.flight.duration_s - (0.0 if math.isnan(one.idle_s) else one.idle_s)
        energy = "" if math.isnan(one.flight.energy_j) else f"{one.flight.energy_j / 1e3:6.1f} kJ"
        yield (
            f"  {one.aircraft.name:{wide}}  {arrived:>5}  {one.flight.flown_m:5.0f} m  "
            f"{busy_s:5.1f} s {energy}{'  lost' if one.lost else ''}".rstrip()
        )
    if not pairs:
        return
    begun_s = min(int(one.flight.t_ns[0]) for one in outings) / NS_PER_S

    def nearest(pair: PairApart, near: Near, planned: str = "") -> str:
        return f"{'-'.join(pair.names)} {near.away_m:.1f} m{planned} at {near.t_s - begun_s:.1f} s"

    least = min(pairs, key=lambda pair: pair.flown.away_m)
    if math.isfinite(near_m := least.flown.away_m):
        broken = (
            f": nearer than mission.separation_m = {separation_m:g}"
            if separation_m is not None and near_m < separation_m
            else ""
        )
        planned = f" (planned {least.planned.away_m:.1f})"
        yield f"  closest: {nearest(least, least.flown, planned)}{broken}"
    first = min(pairs, key=lambda pair: pair.parting.away_m)
    if math.isfinite(first.parting.away_m):
        yield f"  before they were {separation_m:g} m apart: {nearest(first, first.parting)}"


def _flown(one: Outing) -> Track:
    return Track(one.flight.t_ns, one.aircraft.area.xyz(one.flight.true_ned_m))


def _planned(one: Outing, end_ns: int) -> Track:
    """Where it is when by its plan, as its flights are foreseen from when each begins."""
    starts_ns = [int(flight.t_ns[0]) for flight in one.flights]
    times_ns, places_m = list[Ints](), list[Floats]()
    for part, start_ns, next_ns in zip(one.told, starts_ns, (*starts_ns[1:], None), strict=True):
        until_ns = end_ns if next_ns is None else next_ns
        count = math.ceil((until_ns - start_ns) / NS_PER_S / STEP_S) + 2
        at_m = one.flyer.performance.follow(
            part.points_m,
            [stop.hold_s for stop in part.stops],
            part.acceptance_m,
            step_s=STEP_S,
            count=count,
        )
        t_ns = start_ns + np.arange(count) * round(STEP_S * NS_PER_S)
        its = slice(None) if next_ns is None else t_ns < next_ns
        times_ns.append(t_ns[its])
        places_m.append(np.column_stack((at_m, np.full(count, part.alt_rel_m)))[its])
    return Track(np.concatenate(times_ns), np.concatenate(places_m))


def _near(first: Track, second: Track, leaving_m: float | None) -> tuple[Near, Near]:
    """How near two come from when they count, and before; see `pairs_of`."""
    end_ns = max(int(first.t_ns[-1]), int(second.t_ns[-1]))
    even_ns = np.arange(int(first.t_ns[0]), end_ns, _STEP_NS)
    t_ns = np.unique(np.concatenate((first.t_ns, second.t_ns, even_ns)))
    away_m = second.at(t_ns).pos_m - first.at(t_ns).pos_m
    counts = np.ones(len(t_ns) - 1, dtype=bool)
    if leaving_m is not None:
        far = np.linalg.norm(away_m, axis=1) >= leaving_m
        counts[: far.argmax() if far.any() else len(far)] = False
    counted, before = (Apart(t_ns / NS_PER_S, away_m, of).near(_XYZ) for of in (counts, ~counts))
    return counted, before
