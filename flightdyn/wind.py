"""Steady wind, gusts, and how strong turbulence is at a height above ground."""

import math
from dataclasses import dataclass

from flightdyn.config import GustConfig, WindConfig
from flightdyn.frames import Triple

FT_M = 0.3048


def steady_wind_ned(config: WindConfig) -> Triple:
    """Velocity of the air (m/s, NED) of the steady wind; it moves away from `from_deg`."""
    angle = math.radians(config.from_deg)
    return (-config.speed_mps * math.cos(angle), -config.speed_mps * math.sin(angle), 0.0)


def wind_at_20ft(config: WindConfig) -> float:
    """Wind speed (m/s) at 20 ft above ground, which sets the strength of low turbulence."""
    return config.speed_mps if config.wind_at_20ft_mps is None else config.wind_at_20ft_mps


@dataclass(frozen=True, slots=True)
class TurbulenceScale:
    """Standard deviations (m/s) and length scales (m) of the Dryden model at one height."""

    sigma_horizontal_mps: float
    sigma_vertical_mps: float
    length_horizontal_m: float
    length_vertical_m: float


def low_altitude_turbulence(height_m: float, *, wind_20ft_mps: float) -> TurbulenceScale:
    """MIL-F-8785C, 3.7.3.4 and figures 10, 11: turbulence below 1000 ft above ground."""
    h = min(1000.0, max(10.0, height_m / FT_M))
    shape = 0.177 + 0.000823 * h
    sigma_w = 0.1 * wind_20ft_mps
    return TurbulenceScale(
        sigma_horizontal_mps=sigma_w / shape**0.4,
        sigma_vertical_mps=sigma_w,
        length_horizontal_m=h / shape**1.2 * FT_M,
        length_vertical_m=h * FT_M,
    )


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
