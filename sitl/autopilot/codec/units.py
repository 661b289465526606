"""From SI units and degrees to the integers of MAVLink's fields, clamped to what they hold."""

import math
from typing import Any

from pymavlink.dialects.v20 import common as mav

_INT16 = 2**15 - 1
_UINT16 = 2**16 - 1
_INT32 = 2**31 - 1


def clamped(value: float, low: int, high: int) -> int:
    """`value` rounded to the nearest integer in [low, high]; NaN becomes 0."""
    if math.isnan(value):
        return 0
    return round(min(max(value, low), high))


def int16(value: float) -> int:
    """A plain number, signed 16 bit."""
    return clamped(value, -_INT16 - 1, _INT16)


def int32(value: float) -> int:
    """A plain number, signed 32 bit."""
    return clamped(value, -_INT32 - 1, _INT32)


def deg_e7(angle_deg: float) -> int:
    """Degrees to 1e-7 degrees; NaN to the "unknown" of MAVLink (INT32_MAX)."""
    return _INT32 if math.isnan(angle_deg) else int32(angle_deg * 1e7)


def from_deg_e7(value: int) -> float:
    """1e-7 degrees to degrees; the "unknown" of MAVLink (INT32_MAX) to NaN."""
    return math.nan if value == _INT32 else value * 1e-7


def mm(length_m: float) -> int:
    """Metres to millimetres, signed 32 bit."""
    return int32(length_m * 1e3)


def umm(length_m: float) -> int:
    """Metres (or metres per second) to thousandths, unsigned 32 bit."""
    return clamped(length_m * 1e3, 0, 2**32 - 1)


def cm_s(speed_mps: float) -> int:
    """Metres per second to centimetres per second, signed 16 bit."""
    return clamped(speed_mps * 1e2, -_INT16 - 1, _INT16)


def ucm_s(speed_mps: float) -> int:
    """Metres per second to centimetres per second, unsigned; 65535 is "unknown" to MAVLink."""
    return clamped(speed_mps * 1e2, 0, _UINT16 - 1)


def cdeg(angle_rad: float) -> int:
    """Radians to a course of 0..35999 hundredths of a degree."""
    return round(math.degrees(angle_rad) * 100) % 36000


def mv(voltage_v: float) -> int:
    """Volts to millivolts; 65535 is "unknown" to MAVLink."""
    return clamped(voltage_v * 1e3, 0, _UINT16 - 1)


def ca(current_a: float) -> int:
    """Amperes to hundredths of an ampere; -1 is "unknown" to MAVLink."""
    return clamped(current_a * 1e2, 0, _INT16)


def percent(fraction: float) -> int:
    """0..1 to whole percent."""
    return clamped(fraction * 1e2, 0, 100)


def us(t_ns: int) -> int:
    """Nanoseconds to microseconds, unsigned; what lies before time zero becomes zero."""
    return max(t_ns, 0) // 1_000


def ms(t_ns: int) -> int:
    """Nanoseconds to milliseconds, unsigned 32 bit."""
    return max(t_ns, 0) // 1_000_000 % 2**32


def sparse(kind: type[mav.MAVLink_message], **fields: Any) -> mav.MAVLink_message:
    """A message with these fields; all others are zero, MAVLink's "not provided" for them."""
    sizes = zip(kind.ordered_fieldnames, kind.array_lengths, strict=True)
    zeros = {name: [0] * size if size else 0 for name, size in sizes}
    return kind(**(zeros | fields))
