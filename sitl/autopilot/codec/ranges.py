"""Allowed ranges of the numbers that come in over MAVLink: one table, checked on arrival.

A 32-bit float holds 3.4e38 m and NaN; what is accepted here can be computed with, flown and sent
back. NaN lies in no range: a field that may be left open says so where it is read.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Range:
    """A closed interval of allowed numbers, with their unit; of integers where it is `whole`."""

    low: float
    high: float
    unit: str = ""
    whole: bool = False

    def __contains__(self, value: object) -> bool:
        if not isinstance(value, int | float) or not self.low <= value <= self.high:
            return False
        return not self.whole or value == int(value)

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip()


LATITUDE = Range(-90.0, 90.0, "deg")
LONGITUDE = Range(-180.0, 180.0, "deg")
ALTITUDE = Range(-1_000.0, 20_000.0, "m above mean sea level")
HEIGHT = Range(-500.0, 10_000.0, "m above home")
SPEED = Range(0.1, 100.0, "m/s")
BELOW_ZERO = Range(-100.0, 0.0)
YAW = Range(-360.0, 360.0, "deg")
TURN_RATE = Range(0.0, 60.0, "deg/s")
HOLD = Range(0.0, 86_400.0, "s")
ACCEPTANCE = Range(0.0, 10_000.0, "m")
FENCE_RADIUS = Range(0.01, 1e6, "m")
CORNERS = Range(3, 5_000, whole=True)
ITEM = Range(0, 65_535, whole=True)
REPEATS = Range(0, 1_000_000, whole=True)
TURNS = Range(0.0, 1_000.0)
ORBIT_RADIUS = Range(1.0, 1_000.0, "m")
COUNTER_CLOCKWISE = Range(-1_000.0, -1.0, "m")  # its negative radius
ORBIT_SPEED = Range(-10.0, 10.0, "m/s")
ARC = Range(0.0, 6_284.0, "rad")
GROUP = Range(0, 255, whole=True)
INTERVAL = Range(2_000.0, 1e10, "us")
AWAY = Range(-100_000.0, 100_000.0, "m")  # of a setpoint, in the local frame
VELOCITY = Range(-100.0, 100.0, "m/s")
ACCELERATION = Range(-100.0, 100.0, "m/s2")
HEADING = Range(-4 * 3.1415927, 4 * 3.1415927, "rad")
SPIN = Range(-20.0, 20.0, "rad/s")
THRUST = Range(0.0, 1.0)
