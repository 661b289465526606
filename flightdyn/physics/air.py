"""The air: the standard atmosphere's troposphere (ICAO 7488), steady wind and gusts."""

import math

from flightdyn.config import GustConfig, WindConfig
from flightdyn.frames import Triple

_T0_K = 288.15
_P0_PA = 101_325.0
_LAPSE_K_PER_M = 0.0065
_GAS_CONSTANT = 287.05287  # J/kg/K, dry air
_G0 = 9.80665
FT_M = 0.3048
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


def steady_wind_ned(config: WindConfig) -> Triple:
    """Velocity of the air (m/s, NED) of the steady wind; it moves away from `from_deg`."""
    angle = math.radians(config.from_deg)
    return (-config.speed_mps * math.cos(angle), -config.speed_mps * math.sin(angle), 0.0)


def wind_at_20ft(config: WindConfig) -> float:
    """Wind speed (m/s) at 20 ft above ground, which sets the strength of low turbulence."""
    return config.speed_mps if config.wind_at_20ft_mps is None else config.wind_at_20ft_mps


def gust_ned(gusts: tuple[GustConfig, ...], t_s: float) -> Triple:
    """Sum of the gusts (m/s, NED) at simulated time `t_s`."""
    north = east = down = 0.0
    for gust in gusts:
        phase = (t_s - gust.start_s) / gust.duration_s
        if 0 < phase < 1:
            share = (1 - math.cos(math.tau * phase)) / 2
            north += share * gust.north_mps
            east += share * gust.east_mps
            down += share * gust.down_mps
    return north, east, down
