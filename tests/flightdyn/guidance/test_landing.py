"""The land detector's rules, each by itself."""

import numpy as np

from flightdyn.native.library import Structure, land
from flightdyn.native.ticks import FLIGHT

DT_S = 0.02


def standing() -> Structure:
    return FLIGHT.Guide(touching=True, contact=True, landed=True)


def airborne() -> Structure:
    detector = standing()
    update(detector, 1, descend=0.0, sink=-1.0, lift=1.2)
    assert not detector.landed
    return detector


def update(
    detector: Structure,
    steps: int,
    *,
    armed: bool = True,
    descend: float = 0.7,
    sink: float = 0.0,
    lift: float = 0.9,
    knock: float = 0.0,
) -> None:
    detector.armed, detector.descend, detector.sink = armed, descend, sink
    detector.lift, detector.knock = lift, knock
    for _ in range(steps):
        land(detector, DT_S)


class InPython:
    """The same rules in other words."""

    def __init__(self) -> None:
        self.quiet, self.contact, self.landed = 0.0, True, True

    @property
    def touching(self) -> bool:
        return self.contact or self.quiet >= 0.08

    def update(
        self, *, armed: bool, descend: float, sink: float, lift: float, knock: float
    ) -> None:
        still = abs(sink) < 0.25
        if self.landed:
            if armed and (lift > 1.02 or sink < -0.5):
                self.contact = self.landed = False
                self.quiet = 0.0
            return
        if not armed:
            self._count(still)
            self.contact = self.landed = self.quiet >= 0.4
            return
        ordered = descend > 0.15
        if self.contact:
            self._count(still)
            if sink > 0.9 or not ordered:
                self.contact = False
                self.quiet = 0.0
            self.landed = self.contact and self.quiet >= 0.3
            return
        self._count(ordered and still and lift < 0.95)
        if self.quiet >= 0.4 or (ordered and knock > 8.0):
            self.contact = True
            self.quiet = 0.0

    def _count(self, quiet: bool) -> None:
        self.quiet = self.quiet + DT_S if quiet else 0.0


def test_the_rules_in_c_are_those_in_python() -> None:
    """Over long random stretches of what descents, touches, knocks and climbs look like."""
    rng = np.random.default_rng(5)
    native, python, seen = standing(), InPython(), set()
    for _ in range(4000):
        armed = bool(rng.random() < 0.8)
        now = {
            "descend": float(rng.choice([0.0, 0.15, 0.7])),
            "sink": float(rng.choice([-0.6, -0.1, 0.0, 0.24, 0.5, 1.0, 8.0])),
            "lift": float(rng.choice([0.0, 0.9, 0.96, 1.0, 1.1])),
            "knock": float(rng.choice([0.0, 9.0], p=[0.9, 0.1])),
        }
        for _ in range(int(rng.integers(1, 40))):
            update(native, 1, armed=armed, **now)
            python.update(armed=armed, **now)
            state = bool(native.touching), bool(native.contact), bool(native.landed)
            assert state == (python.touching, python.contact, python.landed)
            assert native.quiet == python.quiet
            seen.add(state)
    assert len(seen) == 4  # all that are possible


def test_a_knock_while_descending_is_the_ground_at_once() -> None:
    detector = airborne()
    update(detector, 1, sink=0.6, lift=1.0, knock=20.0)
    assert detector.contact
    assert not detector.landed
    update(detector, 20, sink=0.05, lift=0.0)
    assert detector.landed


def test_a_knock_in_cruise_is_not() -> None:
    detector = airborne()
    update(detector, 5, descend=0.0, lift=1.0, knock=20.0)
    assert not detector.contact


def test_falling_on_after_the_knock_was_no_ground() -> None:
    detector = airborne()
    update(detector, 1, sink=0.6, knock=20.0)
    update(detector, 1, sink=1.2, lift=0.0)
    assert not detector.contact
    assert not detector.landed


def test_a_soft_touch_takes_its_time() -> None:
    detector = airborne()
    update(detector, 4)
    assert detector.touching
    assert not detector.contact
    update(detector, 40)
    assert detector.landed


def test_an_updraught_that_stops_the_descent_for_a_moment_is_no_ground() -> None:
    detector = airborne()
    update(detector, 10)
    update(detector, 1, sink=0.5)
    assert not detector.touching
    update(detector, 10)
    assert not detector.contact


def test_hovering_is_not_landing() -> None:
    detector = airborne()
    update(detector, 500, descend=0.0, lift=1.0)
    assert not detector.touching


def test_disarmed_and_still_is_landed() -> None:
    detector = airborne()
    update(detector, 10, armed=False, descend=0.0, sink=8.0)
    assert not detector.landed
    update(detector, 25, armed=False, descend=0.0, lift=0.0)
    assert detector.landed


def test_lift_leaves_the_ground() -> None:
    detector = standing()
    update(detector, 50, descend=0.0, lift=0.8)
    assert detector.landed
    update(detector, 1, descend=0.0, lift=1.1)
    assert not detector.landed
    update(detector, 50, armed=False, descend=0.0, lift=1.5)
