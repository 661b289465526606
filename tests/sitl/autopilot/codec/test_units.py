"""Every unit of MAVLink's integer fields: its scale, its ends, and what stands for unknown."""

import math
from collections.abc import Callable

import pytest

from sitl.autopilot.codec import ranges
from sitl.autopilot.codec import units as u

LARGE, NAN = 1e12, math.nan


@pytest.mark.parametrize(
    ("unit", "value", "number", "least", "most"),
    [
        (u.int16, 12.6, 13, -32768, 32767),
        (u.int32, -12.6, -13, -2147483648, 2147483647),
        (u.mg, 9.80665, 1000, -32768, 32767),
        (u.mg, -0.0980665, -10, -32768, 32767),
        (u.mm, 1.5004, 1500, -2147483648, 2147483647),
        (u.umm, 1.5004, 1500, 0, 4294967295),
        (u.cm_s, -3.456, -346, -32768, 32767),
        (u.ucm_s, 3.456, 346, 0, 65534),
        (u.mv, 15.8704, 15870, 0, 65534),
        (u.ca, 11.254, 1125, 0, 32767),
        (u.percent, 0.614, 61, 0, 100),
    ],
)
def test_units_are_scaled_rounded_and_clamped(
    unit: Callable[[float], int], value: float, number: int, least: int, most: int
) -> None:
    assert [unit(each) for each in (value, -LARGE, LARGE, NAN)] == [number, least, most, 0]


def test_degrees_and_what_is_unknown() -> None:
    known = [(47.1234567, 471234567), (-180.0, -1800000000), (NAN, 2147483647)]
    for degrees, number in known:
        assert u.deg_e7(degrees) == number
        assert u.from_deg_e7(number) == pytest.approx(degrees, abs=1e-12, nan_ok=True)
    assert [u.from_int32(n) for n in (-5, 2147483646)] == [-5.0, 2147483646.0]
    assert math.isnan(u.from_int32(2147483647))
    radians = (0.0, math.pi / 2, -math.pi / 2, -1e-6, math.tau - 1e-4)
    assert [u.cdeg(angle) for angle in radians] == [0, 9000, 27000, 0, 35999]


def test_times_begin_at_zero_and_are_cut_off() -> None:
    assert [u.us(t) for t in (-5000, 0, 999, 1000, 1999)] == [0, 0, 0, 1, 1]
    assert [u.ms(t) for t in (-5_000_000, 0, 999_999, 1_000_000)] == [0, 0, 0, 1]
    assert u.ms(2**32 * 1_000_000 + 7_000_000) == 7


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("LATITUDE", -90, 90), ("LONGITUDE", -180, 180), ("ALTITUDE", -1000, 20_000),
        ("HEIGHT", -500, 10_000), ("SPEED", 0.1, 100), ("BELOW_ZERO", -100, 0), ("YAW", -360, 360),
        ("TURN_RATE", 0, 60), ("HOLD", 0, 86_400), ("ACCEPTANCE", 0, 10_000),
        ("FENCE_RADIUS", 0.01, 1_000_000), ("CORNERS", 3, 5000), ("ITEM", 0, 65_535),
        ("REPEATS", 0, 1_000_000), ("TURNS", 0, 1000), ("ORBIT_RADIUS", 1, 1000),
        ("COUNTER_CLOCKWISE", -1000, -1), ("ORBIT_SPEED", -10, 10), ("ARC", 0, 6284),
        ("GROUP", 0, 255), ("INTERVAL", 2000, 10_000_000_000), ("AWAY", -100_000, 100_000),
        ("VELOCITY", -100, 100), ("ACCELERATION", -100, 100), ("SPIN", -20, 20), ("THRUST", 0, 1),
    ],
)  # fmt: skip
def test_what_comes_in_lies_in_its_range(name: str, low: float, high: float) -> None:
    allowed: ranges.Range = getattr(ranges, name)
    step = 1e-9 * max(1.0, abs(low), abs(high))
    assert low in allowed
    assert high in allowed
    assert low - step not in allowed
    assert high + step not in allowed
    assert NAN not in allowed
    assert (low + 0.5 in allowed) == (name not in {"CORNERS", "ITEM", "REPEATS", "GROUP"})


def test_a_heading_is_up_to_two_turns_of_single_precision() -> None:
    assert 12.5663708 in ranges.HEADING
    assert -12.5663708 in ranges.HEADING
    assert 12.56638 not in ranges.HEADING
    assert -12.56638 not in ranges.HEADING
