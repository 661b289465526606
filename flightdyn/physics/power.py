"""Electrical power of the aircraft over airspeed and acceleration."""

import numpy as np

from flightdyn.native.library import Structure, air, power
from flightdyn.physics.airframe.parameters import QUAD_X
from flightdyn.physics.atmosphere import pressure_pa, temperature_k
from flightdyn.state import Vector

_STILL = (0.0, 0.0, 0.0)
_LEVEL_W = np.array(QUAD_X.level_power_w)
_LEAST_W = np.minimum.accumulate(_LEVEL_W[::-1])[::-1].copy()


def density_ratio(alt_msl_m: float) -> float:
    """Density of the standard atmosphere's air at an altitude, over that at sea level."""
    sea_level = pressure_pa(0.0) / temperature_k(0.0)
    return pressure_pa(alt_msl_m) / temperature_k(alt_msl_m) / sea_level


def power_w(speed_mps: Vector, *, accel_mps2: Vector | float = 0.0, density: float = 1.0) -> Vector:
    """Watts of the whole aircraft, by speed in still air and size of the acceleration.

    Level flight at constant speed is a table measured in JSBSim (`Airframe.level_power_w`); other
    air scales it by equivalent airspeed. Rotors that also accelerate the mass push with
    m sqrt(g^2 + a^2). That adds what it adds in a hover, where power goes with thrust to 3/2
    (momentum theory). Kinetic energy is not counted: braking returns it, so that it cancels
    from rest to rest.

    Args:
        speed_mps: (n,) horizontal speed.
        accel_mps2: (n,), or the same for all.
        density: of the air, over that at sea level.
    """
    speeds, accels = np.broadcast_arrays(speed_mps, accel_mps2)
    return power(air_of(density), speeds.astype(np.float64), accels.astype(np.float64))


def least_power_w(speed_mps: Vector, *, density: float = 1.0) -> Vector:
    """Watts (n,) of level flight at these speeds or faster: convex, and nowhere falling."""
    still = air(_LEAST_W, density=density, wind_mps=_STILL)
    return power(still, speed_mps, np.zeros(speed_mps.shape))


def air_of(density: float, wind_mps: tuple[float, float, float] = _STILL) -> Structure:
    """Make the air for C: density over that at sea level, wind (NED), power of flight in it."""
    return air(_LEVEL_W, density=density, wind_mps=wind_mps)
