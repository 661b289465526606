"""Times at which a vehicle passed its stops, from its estimated track.

It steers by its own estimate; where that is the truth as well, so are the instants.
"""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from mission.base import polyline
from mission.base.arrays import Floats
from mission.flight.track import Flight, Passage

_ARRIVED_M = 1.0  # of the closest approach, where a hover follows


def passages(
    flight: Flight,
    stops_ned_m: Floats,
    *,
    reported_ns: Sequence[int | None],
    hovers: Sequence[bool],
) -> tuple[Passage, ...]:
    """Return the passage of each stop (S, 3), NED in metres: closest approach in the track.

    A stop is looked for after the one before it and until the vehicle reported the next one, so
    that a track that crosses itself is not mistaken; a hover was reached when it began. Reports
    may be lost: the flight is over, so every stop was passed.
    """
    found: list[Passage] = []
    after_ns = int(flight.t_ns[0])
    for index in range(len(stops_ned_m)):
        later = (t_ns for t_ns in reported_ns[index + 1 :] if t_ns is not None)
        until_ns = max(next(later, int(flight.t_ns[-1])), after_ns)
        instant = _passage_ns(flight, stops_ned_m[index], after_ns, until_ns, hovers=hovers[index])
        found.append(flight.at(instant))
        after_ns = instant
    return tuple(found)


def reported_in_turn(
    reported_ns: Mapping[int, Sequence[int]], items: Sequence[int]
) -> list[int | None]:
    """Return the report (ns) of each visit in `items`; None for an item that has lost reports."""
    visits = Counter(items)
    each = {item: iter(told) for item, told in reported_ns.items() if len(told) == visits[item]}
    return [next(each.get(item, iter(())), None) for item in items]


def _passage_ns(flight: Flight, stop: Floats, after_ns: int, until_ns: int, *, hovers: bool) -> int:
    """Return the time (ns) of closest approach to a stop in a window, or of reaching its hover."""
    inside = (flight.t_ns > after_ns) & (flight.t_ns < until_ns)
    instants = np.concatenate(([after_ns], flight.t_ns[inside], [until_ns]))
    points = np.array([flight.at(int(t_ns)).est_ned_m for t_ns in instants]) - stop
    away_m, share = polyline.to_segments(np.zeros(3), points[:-1], points[1:])
    t_ns = np.round(instants[:-1] + share * np.diff(instants)).astype(np.int64).tolist()
    reach_m = np.linalg.norm(np.vstack((points[:1], away_m)), axis=1).tolist()
    nearest: list[tuple[float, int]] = list(zip(reach_m, [after_ns, *t_ns], strict=True))
    closest_m, instant = min(nearest)
    if hovers:
        return next(t_ns for away_m, t_ns in nearest if away_m <= closest_m + _ARRIVED_M)
    return instant
