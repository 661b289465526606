"""Steady wind and gusts."""

import math

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
