"""The reference that follows a target, by hand: 4 m/s2 for each m/s that is missing, 1.2 m/s for
each metre near a place, and half of what may be accelerated to brake from afar."""

import math

import pytest

from flightdyn.config import LimitsConfig
from flightdyn.guidance.pursuit import Target, pursue, wanted_velocity

NAN, REST = math.nan, (0.0, 0.0, 0.0)
LIMITS = LimitsConfig(
    acceleration_mps2=5.0, vertical_acceleration_mps2=2.5, speed_mps=10.0, climb_mps=3.0,
    descent_mps=2.0,
)  # fmt: skip


@pytest.mark.parametrize(
    ("to", "acceleration"),
    [
        (Target(vel=(0.3, 0.4, 0.2)), (1.2, 1.6, 0.8)),
        (Target(vel=(3.0, 4.0, 0.0)), (3.0, 4.0, 0.0)),  # of (12, 16) all that is allowed
        (Target(vel=(-8.0, 6.0, 1.5)), (-4.0, 3.0, 2.5)),  # of (-32, 24, 6)
        (Target(vel=(6.0, -8.0, -2.0)), (3.0, -4.0, -2.5)),
        (Target(acc=(1.0, -2.0, 0.5)), (1.0, -2.0, 0.5)),  # flown by acceleration alone
        (Target(vel=(0.1, NAN, NAN), acc=(0.6, 2.0, NAN)), (1.0, 2.0, 0.0)),  # fed forward
    ],
)
def test_a_velocity_is_gathered_within_the_limits(
    to: Target, acceleration: tuple[float, float, float]
) -> None:
    p, v, a = pursue((7.0, -3.0, -20.0), REST, to, limits=LIMITS, dt_s=0.1)
    assert a == pytest.approx(acceleration)
    assert v == pytest.approx([0.1 * part for part in acceleration])
    assert p == pytest.approx(
        [
            7.0 + 0.01 * acceleration[0],
            -3.0 + 0.01 * acceleration[1],
            -20.0 + 0.01 * acceleration[2],
        ]
    )


def test_a_step_begins_with_the_speed_there_was() -> None:
    p, v, a = pursue(REST, (2.0, 1.0, -1.0), Target(vel=(2.5, 1.0, -1.2)), limits=LIMITS, dt_s=0.2)
    assert a == pytest.approx((2.0, 0.0, -0.8))
    assert v == pytest.approx((2.4, 1.0, -1.16))
    assert p == pytest.approx((0.48, 0.2, -0.232))


@pytest.mark.parametrize(
    ("to", "wanted"),
    [
        (Target(pos=(0.6, 0.8, NAN)), (0.72, 0.96, 0.0)),  # 1 m away: 1.2 m/s
        # Half of 5 m/s2 brakes from afar: sqrt(5 (d - 0.868)) at 4.068 m.
        (Target(pos=(0.0, -(3.2 + 1.25 / 1.44), NAN)), (0.0, -4.0, 0.0)),
        (Target(pos=(60.0, 80.0, NAN)), (6.0, 8.0, 0.0)),  # no faster than 10 m/s
        (Target(pos=(60.0, 80.0, NAN), speed_mps=5.0), (3.0, 4.0, 0.0)),
        (Target(pos=(0.6, 0.8, NAN), vel=(1.0, -1.0, NAN)), (1.72, -0.04, 0.0)),  # which moves on
        (Target(pos=(NAN, NAN, -0.5)), (0.0, 0.0, -0.6)),
        # Of height it is half of 2.5 m/s2: sqrt(2.5 (d - 0.434)) at 1.334 m.
        (Target(pos=(NAN, NAN, -(0.9 + 0.625 / 1.44))), (0.0, 0.0, -1.5)),
        (Target(pos=(NAN, NAN, -50.0)), (0.0, 0.0, -3.0)),
        (Target(pos=(NAN, NAN, 50.0)), (0.0, 0.0, 2.0)),
        (Target(pos=(NAN, NAN, 50.0), descent_mps=0.5), (0.0, 0.0, 0.5)),
        (Target(pos=(NAN, NAN, -50.0), climb_mps=1.0), (0.0, 0.0, -1.0)),
        (Target(), REST),
    ],
)
def test_the_speed_towards_a_place_leaves_room_to_brake(
    to: Target, wanted: tuple[float, float, float]
) -> None:
    assert wanted_velocity(REST, REST, to, LIMITS) == pytest.approx(wanted)
