"""What was flown: samples and waypoint passages, taken on the vehicle's side and clock."""

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from mission.base import polyline
from mission.base.arrays import Floats, Ints
from sitl.observer import VehicleEvent, VehicleSample


@dataclass(frozen=True, slots=True)
class Passage:
    """Truth and belief at one instant of a flight."""

    t_ns: int
    true_ned_m: Floats  # (3,)
    est_ned_m: Floats  # (3,)


@dataclass(frozen=True)
class Flight:
    """Record of one stretch of flight: true and believed track, passages of stops, battery."""

    t_ns: Ints  # (T,)
    true_ned_m: Floats  # (T, 3)
    est_ned_m: Floats  # (T, 3)
    battery_remaining: float
    passages: tuple[Passage | None, ...] = ()  # by stop of the plan; None: not reached
    energy_j: float = math.nan  # that the battery gave; NaN where nobody knows

    @classmethod
    def standing(cls, here: Passage, battery: float) -> Self:
        """A flight in which the aircraft did not move from its one stop."""
        true_ned_m, est_ned_m = here.true_ned_m[None], here.est_ned_m[None]
        return cls(np.array([here.t_ns]), true_ned_m, est_ned_m, battery, (here,), 0.0)

    @classmethod
    def joined(cls, flights: Sequence["Flight"]) -> "Flight":
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

    def at(self, t_ns: int) -> Passage:
        """Truth and belief at an instant, linear between samples, clamped to the flight."""
        tracks = self.true_ned_m, self.est_ned_m
        return Passage(t_ns, *(polyline.at(t_ns, self.t_ns, track) for track in tracks))


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
        self._reached: dict[int, Passage] = {}  # by mission item
        self._energy_j = 0.0

    def start(self, here: Passage, *, goes_on: bool = False) -> None:
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
            self._reached[event.seq] = Passage(
                event.t_ns, event.truth.pos_ned_m, event.belief.pos_ned_m
            )

    def finish(
        self, here: Passage, battery_remaining: float, *, items: Sequence[int] = ()
    ) -> Flight:
        """The flight since `start`, which ends here; its stops were the mission `items`."""
        self._keep(here.t_ns, here.true_ned_m, here.est_ned_m)
        flight = Flight(
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
            self._true_m.extend(true_ned_m.tolist())
            self._est_m.extend(est_ned_m.tolist())
