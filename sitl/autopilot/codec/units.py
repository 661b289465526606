"""Conversion of SI units and degrees to MAVLink's integer fields, clamped to their ranges."""

import math
from collections.abc import Callable
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


def _scaled(scale: float, low: int, high: int) -> Callable[[float], int]:
    """Return a function that multiplies by `scale`, rounds, and clamps to [low, high]."""
    return lambda value: clamped(value * scale, low, high)


int16 = _scaled(1, -_INT16 - 1, _INT16)
mg = _scaled(1e3 / 9.80665, -_INT16 - 1, _INT16)  # of metres per second squared
int32 = _scaled(1, -_INT32 - 1, _INT32)
mm = _scaled(1e3, -_INT32 - 1, _INT32)  # of metres
umm = _scaled(1e3, 0, 2**32 - 1)  # of metres, or metres per second
cm_s = _scaled(1e2, -_INT16 - 1, _INT16)  # of metres per second
ucm_s = _scaled(1e2, 0, _UINT16 - 1)  # of metres per second; 65535 is "unknown" to MAVLink
mv = _scaled(1e3, 0, _UINT16 - 1)  # of volts; 65535 is "unknown" to MAVLink
ca = _scaled(1e2, 0, _INT16)  # hundredths of amperes; -1 is "unknown" to MAVLink
percent = _scaled(1e2, 0, 100)  # of a fraction


def deg_e7(angle_deg: float) -> int:
    """Convert degrees to 1e-7 degrees; NaN to the "unknown" of MAVLink (INT32_MAX)."""
    return _INT32 if math.isnan(angle_deg) else int32(angle_deg * 1e7)


def from_int32(value: int) -> float:
    """Return a whole number as it is; the "unknown" of MAVLink (INT32_MAX) as NaN."""
    return math.nan if value == _INT32 else float(value)


def from_deg_e7(value: int) -> float:
    """Convert 1e-7 degrees to degrees; the "unknown" of MAVLink (INT32_MAX) to NaN."""
    return from_int32(value) * 1e-7


def cdeg(angle_rad: float) -> int:
    """Convert radians to a course of 0..35999 hundredths of a degree."""
    return round(math.degrees(angle_rad) * 100) % 36000


def us(t_ns: int) -> int:
    """Convert nanoseconds to microseconds; a time before zero becomes zero."""
    return max(t_ns, 0) // 1_000


def ms(t_ns: int) -> int:
    """Convert nanoseconds to milliseconds, modulo 2**32; a time before zero becomes zero."""
    return max(t_ns, 0) // 1_000_000 % 2**32


def sparse(kind: type[mav.MAVLink_message], **fields: Any) -> mav.MAVLink_message:
    """A message with these fields; all others are zero, MAVLink's "not provided" for them."""
    sizes = zip(kind.ordered_fieldnames, kind.array_lengths, strict=True)
    zeros = {name: [0] * size if size else 0 for name, size in sizes}
    return kind(**(zeros | fields))
