"""The standard atmosphere's troposphere (ICAO 7488)."""

import math

_T0_K = 288.15
_P0_PA = 101_325.0
_LAPSE_K_PER_M = 0.0065
_GAS_CONSTANT = 287.05287  # J/kg/K, dry air
_G0 = 9.80665
_EXPONENT = _G0 / (_GAS_CONSTANT * _LAPSE_K_PER_M)


def temperature_k(alt_m: float) -> float:
    """Temperature at an altitude."""
    return _T0_K - _LAPSE_K_PER_M * alt_m


def pressure_pa(alt_m: float) -> float:
    """Static pressure at an altitude."""
    return _P0_PA * math.pow(temperature_k(alt_m) / _T0_K, _EXPONENT)


def altitude_m(pressure: float) -> float:
    """The altitude at which the atmosphere has that pressure (Pa)."""
    return _T0_K / _LAPSE_K_PER_M * (1 - math.pow(pressure / _P0_PA, 1 / _EXPONENT))


def pressure_slope(pressure: float) -> float:
    """Return how much static pressure falls by height (Pa/m), where it is `pressure` (Pa)."""
    return pressure * _G0 / (_GAS_CONSTANT * temperature_k(altitude_m(pressure)))
