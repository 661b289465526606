"""The truth of the last while, for those who learn of an instant after it is over."""

import ctypes
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


class _Past(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_void_p) for name in ("rows", "instants")) + tuple(
        (name, ctypes.c_int64) for name in ("count", "interval_ns", "newest")
    )


class Past:
    """The truth at each guidance interval of the plant, the newest 80 s of it.

    One thread keeps, by `keep` in `bridge.c`; others may ask at any time.
    """

    def __init__(self, plant: Plant) -> None:
        """Begins with the truth of this instant."""
        self._plant = plant
        self._interval_ns = plant.interval * plant.dt_ns
        self._first = plant.t_ns // self._interval_ns
        self._rows, self._instants = np.zeros((_KEPT, _NUMBERS)), np.zeros(_KEPT, dtype=np.int64)
        self._memory = _Past(
            address(self._rows, np.float64, (_KEPT, _NUMBERS), written=True),
            address(self._instants, np.int64, (_KEPT,), written=True),
            _KEPT,
            self._interval_ns,
            self._first,
        )
        self.address = ctypes.addressof(self._memory)
        slot = self._first % _KEPT
        self._rows[slot], self._instants[slot] = plant.vehicle.all.read(), plant.t_ns
        self._batteries = [plant.battery] * (_KEPT // _BATTERY_EVERY + 1)
        self._battery = 0  # number of the newest
        self.keep_battery(exchanged=True)

    def keep_battery(self, *, exchanged: bool = False) -> None:
        """Keep the battery's state where it is time to, or if it was exchanged."""
        number, rest = divmod(self._plant.t_ns, _BATTERY_EVERY * self._interval_ns)
        if rest == 0 or exchanged:
            self._batteries[number % len(self._batteries)] = self._plant.battery
            self._battery = number

    @property
    def newest(self) -> Moment:
        """The newest truth."""
        truth = self._kept(self._memory.newest)
        return _between(truth, truth, truth.t_ns)

    def at(self, t_ns: int) -> Moment:
        """The truth at an instant: between two kept by both, else by the nearest one's velocity."""
        last = self._memory.newest
        # The oldest may be overwritten at any time.
        first = max(self._first, last - _KEPT + 8)
        index = min(max(t_ns // self._interval_ns, first), last)
        before = self._kept(index)
        after = self._kept(min(index + 1, last))
        return _between(before, after, t_ns)

    def _kept(self, interval: int) -> _Truth:
        slot = interval % _KEPT
        n, e, d, vn, ve, vd, roll, pitch, yaw, p, q, r, wn, we, wd = self._rows[slot].tolist()
        number = min(interval // _BATTERY_EVERY, self._battery)
        return _Truth(
            int(self._instants[slot]), (n, e, d), (vn, ve, vd), (roll, pitch, yaw), (p, q, r),
            (wn, we, wd), self._batteries[number % len(self._batteries)],
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
