"""The land detector's rules, each by itself."""

from flightdyn.guidance.landing import LandDetector


def airborne() -> LandDetector:
    detector = LandDetector(dt_s=0.02)
    update(detector, 1, descend=0.0, sink=-1.0, lift=1.2)
    assert not detector.landed
    return detector


def update(
    detector: LandDetector,
    steps: int,
    *,
    armed: bool = True,
    descend: float = 0.7,
    sink: float = 0.0,
    lift: float = 0.9,
    knock: float = 0.0,
) -> None:
    for _ in range(steps):
        detector.update(
            armed=armed, descend_mps=descend, sink_mps=sink, lift=lift, knock_mps2=knock
        )


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
    detector = LandDetector(dt_s=0.02)
    update(detector, 50, descend=0.0, lift=0.8)
    assert detector.landed
    update(detector, 1, descend=0.0, lift=1.1)
    assert not detector.landed
    update(detector, 50, armed=False, descend=0.0, lift=1.5)
