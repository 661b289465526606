"""What flying takes of the battery: electrical power over speed and acceleration."""

import numpy as np

from flightdyn.physics.airframe.parameters import QUAD_X
from flightdyn.physics.atmosphere import pressure_pa, temperature_k
from flightdyn.state import Vector

_GRAVITY_MPS2 = 9.81


def density_ratio(alt_msl_m: float) -> float:
    """Density of the standard atmosphere's air at an altitude, over that at sea level."""
    sea_level = pressure_pa(0.0) / temperature_k(0.0)
    return pressure_pa(alt_msl_m) / temperature_k(alt_msl_m) / sea_level


def power_w(speed_mps: Vector, *, accel_mps2: Vector | float = 0.0, density: float = 1.0) -> Vector:
    """Watts of the whole aircraft, by speed in still air and size of the acceleration.

    Level flight at constant speed is a table measured in JSBSim (`Airframe.level_power_w`); other
    air scales it by equivalent airspeed. Rotors that also accelerate the mass push with
    m sqrt(g^2 + a^2), and their power goes with thrust to 3/2 (momentum theory). What speed itself
    takes is had back when braking, from rest to rest nothing is left of it.

    Args:
        speed_mps: (n,) horizontal speed.
        accel_mps2: (n,), or the same for all.
        density: of the air, over that at sea level.
    """
    root = density**0.5
    table = QUAD_X.level_power_w
    level = np.interp(speed_mps * root, np.arange(len(table), dtype=np.float64), table) / root
    return np.asarray(level * (1.0 + (accel_mps2 / _GRAVITY_MPS2) ** 2) ** 0.75)
