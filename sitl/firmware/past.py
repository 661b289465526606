"""The truth of the last while, for those who learn of an instant after it is over."""

from typing import NamedTuple

from flightdyn.frames import Triple, frozen, quaternion_from_euler, wrap_pi
from flightdyn.plant import Plant
from flightdyn.state import BatteryState, Kinematics, Moment
from sitl.firmware.native import rows
from sitl.firmware.native.rows import Rows

_BATTERY_EVERY = 5  # guidance intervals


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

    One thread keeps, by `keep` in `bridge.c`; others may ask at any time.
    """

    def __init__(self, plant: Plant, kept: Rows) -> None:
        """Begins with the truth of this instant; `kept` is where C keeps it."""
        self._plant = plant
        self._interval_ns = plant.interval * plant.dt_ns
        self._rows = kept
        self._first = self._rows.newest
        self._batteries = [plant.battery] * (rows.KEPT // _BATTERY_EVERY + 1)
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
        truth = self._kept(self._rows.newest)
        return _between(truth, truth, truth.t_ns)

    def at(self, t_ns: int) -> Moment:
        """The truth at an instant: between two kept by both, else by the nearest one's velocity."""
        last = self._rows.newest
        # The oldest may be overwritten at any time.
        first = max(self._first, last - rows.KEPT + 8)
        index = min(max(t_ns // self._interval_ns, first), last)
        before = self._kept(index)
        after = self._kept(min(index + 1, last))
        return _between(before, after, t_ns)

    def _kept(self, interval: int) -> _Truth:
        t_ns, numbers = self._rows.of(interval)
        n, e, d, vn, ve, vd, roll, pitch, yaw, p, q, r, wn, we, wd = numbers
        number = min(interval // _BATTERY_EVERY, self._battery)
        motion = (n, e, d), (vn, ve, vd), (roll, pitch, yaw), (p, q, r)
        return _Truth(t_ns, *motion, (wn, we, wd), self._batteries[number % len(self._batteries)])


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
