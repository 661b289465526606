"""The truth of the last while, for those who learn of an instant after it is over."""

from array import array
from typing import NamedTuple

import numpy as np

from flightdyn.frames import Triple, frozen, quaternion_from_euler, wrap_pi
from flightdyn.plant import Plant
from flightdyn.state import BatteryState, Kinematics, Moment
from native.loading import address

_KEPT = 4096  # guidance intervals, 80 s
_BATTERY_EVERY = 5  # of them
_NUMBERS = 15  # of an instant, as `Multirotor.all` reads them


class _Truth(NamedTuple):
    """As the physics says it: what few ask for is worked out when they do."""

    t_ns: int
    position_ned: Triple
    velocity_ned: Triple
    euler: Triple
    rates: Triple
    wind_ned: Triple
    battery: BatteryState


class Past:
    """The truth at each guidance interval of the plant, the newest 80 s of it.

    One thread keeps; others may ask at any time.
    """

    def __init__(self, plant: Plant) -> None:
        """Begins with the truth of this instant."""
        self._plant = plant
        self._interval_ns = plant.interval * plant.dt_ns
        self._first = self._last = plant.t_ns // self._interval_ns
        # By interval, modulo their number; a row is in place before it is the newest. Memory that
        # is used again and again stays near the processor, tuples would not.
        self._rows = np.zeros((_KEPT, _NUMBERS))
        self._rows_at = address(self._rows, np.float64, self._rows.shape, written=True)
        self._instants = array("q", bytes(8 * _KEPT))  # ns
        self._battery = plant.battery
        self._batteries = [self._battery] * _KEPT
        self.keep()

    def keep(self, *, battery: bool = False) -> None:
        """Keep the truth of this instant, at the end of an interval; the battery's every few of
        them, or if told.
        """
        plant = self._plant
        t_ns = plant.t_ns
        last = t_ns // self._interval_ns
        if battery or last % _BATTERY_EVERY == 0:
            self._battery = plant.battery
        slot = last % _KEPT
        self._batteries[slot] = self._battery
        self._instants[slot] = t_ns
        plant.vehicle.all.read_to(self._rows_at + slot * self._rows.strides[0])
        self._last = last

    @property
    def newest(self) -> Moment:
        """The newest truth."""
        truth = self._kept(self._last)
        return _between(truth, truth, truth.t_ns)

    def at(self, t_ns: int) -> Moment:
        """The truth at an instant: between two kept by both, else by the nearest one's velocity."""
        last = self._last
        # The oldest may be overwritten at any time.
        first = max(self._first, last - _KEPT + 8)
        index = min(max(t_ns // self._interval_ns, first), last)
        before = self._kept(index)
        after = self._kept(min(index + 1, last))
        return _between(before, after, t_ns)

    def _kept(self, interval: int) -> _Truth:
        slot = interval % _KEPT
        n, e, d, vn, ve, vd, roll, pitch, yaw, p, q, r, wn, we, wd = self._rows[slot].tolist()
        return _Truth(
            self._instants[slot], (n, e, d), (vn, ve, vd), (roll, pitch, yaw), (p, q, r),
            (wn, we, wd), self._batteries[slot],
        )  # fmt: skip


def _between(before: _Truth, after: _Truth, t_ns: int) -> Moment:
    """The truth at an instant between two, or near the first, by its velocity."""
    place, speed = frozen(before.position_ned), frozen(before.velocity_ned)
    since_ns, gap_ns = t_ns - before.t_ns, after.t_ns - before.t_ns
    if since_ns <= 0 or gap_ns <= 0:
        place, nearer = frozen(place + since_ns * 1e-9 * speed), before
    else:
        share = since_ns / gap_ns
        place = frozen(place + share * (frozen(after.position_ned) - place))
        speed = frozen(speed + share * (frozen(after.velocity_ned) - speed))
        nearer = after if share > 0.5 else before
    roll, pitch, yaw = nearer.euler
    turned = frozen(quaternion_from_euler(roll, pitch, wrap_pi(yaw)))
    kinematics = Kinematics(t_ns, place, speed, turned, frozen(nearer.rates))
    return Moment(kinematics, nearer.battery, frozen(nearer.wind_ned))
