"""What was flown: samples and waypoint passages, taken on the vehicle's side and clock, or found in
the estimated track afterwards. A vehicle steers by its own estimate; where that is the truth as
well, so are the instants of its passages."""

import math
from array import array
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from mission.base import polyline
from mission.base.arrays import Floats, Ints
from sitl.observer import VehicleEvent, VehicleSample

_ARRIVED_M = 1.0  # of the closest approach, where a hover follows


@dataclass(frozen=True, slots=True)
class TrackPoint:
    """Truth and belief at one instant of a flight."""

    t_ns: int
    true_ned_m: Floats  # (3,)
    est_ned_m: Floats  # (3,)


@dataclass(frozen=True)
class FlownTrack:
    """Record of one stretch of flight: true and believed track, passages of stops, battery."""

    t_ns: Ints  # (T,)
    true_ned_m: Floats  # (T, 3)
    est_ned_m: Floats  # (T, 3)
    battery_remaining: float
    passages: tuple[TrackPoint | None, ...] = ()  # by stop of the plan; None: not reached
    energy_j: float = math.nan  # that the battery gave; NaN where nobody knows

    @classmethod
    def standing(cls, here: TrackPoint, battery: float) -> Self:
        """A flight in which the aircraft did not move from its one stop."""
        true_ned_m, est_ned_m = here.true_ned_m[None], here.est_ned_m[None]
        return cls(np.array([here.t_ns]), true_ned_m, est_ned_m, battery, (here,), 0.0)

    @classmethod
    def joined(cls, flights: Sequence["FlownTrack"]) -> "FlownTrack":
        """Join consecutive flights into one without passages; a single one is returned as it is."""
        first, *others = flights
        if not others:
            return first
        t_ns, at = np.unique(np.concatenate([f.t_ns for f in flights]), return_index=True)
        true_ned_m, est_ned_m = (
            np.vstack([getattr(f, name) for f in flights])[at]
            for name in ("true_ned_m", "est_ned_m")
        )
        told_j = [f.energy_j for f in flights if not math.isnan(f.energy_j)]
        energy_j = math.fsum(told_j) if told_j else math.nan
        return cls(t_ns, true_ned_m, est_ned_m, flights[-1].battery_remaining, (), energy_j)

    @property
    def duration_s(self) -> float:
        """Simulated seconds from the first to the last sample."""
        return float(self.t_ns[-1] - self.t_ns[0]) / 1e9

    @property
    def flown_m(self) -> float:
        """Horizontal length of the true track."""
        return polyline.length(self.true_ned_m[:, :2])

    def at(self, t_ns: int) -> TrackPoint:
        """Truth and belief at an instant, linear between samples, clamped to the flight."""
        tracks = self.true_ned_m, self.est_ned_m
        return TrackPoint(t_ns, *(polyline.at(t_ns, self.t_ns, track) for track in tracks))


class FlightRecorder:
    """A vehicle observer that keeps the track of one stretch of flight at a time.

    In flat arrays, 56 bytes a sample: an hour of flight is 2 MB.
    """

    def __init__(self) -> None:
        self._consumed_mah = math.nan  # when last looked at
        self._forget()

    def _forget(self) -> None:
        self._t_ns = array("q")
        self._true_m = array("d")
        self._est_m = array("d")
        self._reached: dict[int, TrackPoint] = {}  # by mission item
        self._energy_j = 0.0

    def start(self, here: TrackPoint, *, goes_on: bool = False) -> None:
        """Forget the last flight; the next one begins here. Where it `goes_on` with that one, the
        energy since its end is not forgotten."""
        since_j = self._energy_j
        self._forget()
        if goes_on:
            self._energy_j = since_j
        self._keep(here.t_ns, here.true_ned_m, here.est_ned_m)

    def sampled(self, sample: VehicleSample) -> None:
        """Keep a sample that is newer than the last."""
        self._keep(sample.t_ns, sample.truth.pos_ned_m, sample.belief.pos_ned_m)
        battery = sample.battery
        self._energy_j += (battery.consumed_mah - self._consumed_mah) * 3.6 * battery.voltage_v
        self._consumed_mah = battery.consumed_mah

    def happened(self, event: VehicleEvent) -> None:
        """Keep the first passage of each mission item."""
        if event.kind == "reached" and event.seq is not None and event.seq not in self._reached:
            self._reached[event.seq] = TrackPoint(
                event.t_ns, event.truth.pos_ned_m, event.belief.pos_ned_m
            )

    def finish(
        self, here: TrackPoint, battery_remaining: float, *, items: Sequence[int] = ()
    ) -> FlownTrack:
        """The flight since `start`, which ends here; its stops were the mission `items`."""
        self._keep(here.t_ns, here.true_ned_m, here.est_ned_m)
        flight = FlownTrack(
            np.array(self._t_ns, dtype=np.int64),
            np.array(self._true_m).reshape(-1, 3),
            np.array(self._est_m).reshape(-1, 3),
            battery_remaining,
            tuple(self._reached.get(item) for item in items),
            self._energy_j if self._energy_j > 0.0 else math.nan,
        )
        self._forget()
        return flight

    def _keep(self, t_ns: int, true_ned_m: Floats, est_ned_m: Floats) -> None:
        if not self._t_ns or t_ns > self._t_ns[-1]:
            self._t_ns.append(t_ns)
            self._true_m.frombytes(true_ned_m.tobytes())
            self._est_m.frombytes(est_ned_m.tobytes())


def passages(
    flight: FlownTrack,
    stops_ned_m: Floats,
    *,
    reported_ns: Sequence[int | None],
    hovers: Sequence[bool],
) -> tuple[TrackPoint, ...]:
    """Return the passage of each stop (S, 3), NED in metres: closest approach in the track.

    A stop is looked for after the one before it and until the vehicle reported the next one, so
    that a track that crosses itself is not mistaken; a hover was reached when it began. Reports
    may be lost: the flight is over, so every stop was passed.
    """
    passed: list[TrackPoint] = []
    after_ns = int(flight.t_ns[0])
    for index in range(len(stops_ned_m)):
        later = (t_ns for t_ns in reported_ns[index + 1 :] if t_ns is not None)
        until_ns = max(next(later, int(flight.t_ns[-1])), after_ns)
        instant = _passage_ns(flight, stops_ned_m[index], after_ns, until_ns, hovers=hovers[index])
        passed.append(flight.at(instant))
        after_ns = instant
    return tuple(passed)


def reported_in_turn(
    reported_ns: Mapping[int, Sequence[int]], items: Sequence[int]
) -> list[int | None]:
    """Return the report (ns) of each visit in `items`; None for an item that has lost reports."""
    visits = Counter(items)
    each = {item: iter(told) for item, told in reported_ns.items() if len(told) == visits[item]}
    return [next(each.get(item, iter(())), None) for item in items]


def _passage_ns(
    flight: FlownTrack, stop: Floats, after_ns: int, until_ns: int, *, hovers: bool
) -> int:
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
