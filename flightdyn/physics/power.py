"""Electrical power of the aircraft over airspeed and acceleration, and the battery it is from."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flightdyn.config import BatteryConfig
from flightdyn.native.library import Structure, air, power
from flightdyn.physics.air import pressure_pa, temperature_k
from flightdyn.physics.airframe.parameters import QUAD_X
from flightdyn.state import BatteryState, Vector

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


CELLS = 4
# Open-circuit volts per cell over the state of charge: usual lithium-polymer values, chosen.
_OPEN_CIRCUIT = (
    (0.00, 3.27),
    (0.05, 3.61),
    (0.10, 3.69),
    (0.20, 3.73),
    (0.40, 3.79),
    (0.60, 3.87),
    (0.80, 4.02),
    (1.00, 4.20),
)


def open_circuit_voltage(charge: float) -> float:
    """Volts of the unloaded pack at `charge` (0..1), linear between the table's rows."""
    charge = min(1.0, max(0.0, charge))
    for (low, low_v), (high, high_v) in pairwise(_OPEN_CIRCUIT):
        if charge <= high:
            return CELLS * (low_v + (high_v - low_v) * (charge - low) / (high - low))
    return CELLS * _OPEN_CIRCUIT[-1][1]


@dataclass(slots=True)
class Battery:
    """State of a battery pack: charge, current and terminal voltage."""

    config: BatteryConfig
    consumed_mah: float = 0.0
    current_a: float = 0.0
    voltage_v: float = 0.0

    def __post_init__(self) -> None:
        self.voltage_v = open_circuit_voltage(self.config.initial)

    @property
    def charge(self) -> float:
        """Share of the full charge that is left."""
        return max(0.0, self.config.initial - self.consumed_mah / self.config.capacity_mah)

    def draw(self, power_w: float, dt_s: float) -> float:
        """Give `power_w` for `dt_s`; returns the terminal voltage.

        The current solves I (E - R I) = P, E the open-circuit voltage; where the pack cannot give
        P, it gives its largest power at half of E.
        """
        open_v = open_circuit_voltage(self.charge)
        resistance = self.config.resistance_ohm
        if resistance > 0:
            root = open_v * open_v - 4 * resistance * power_w
            self.current_a = (open_v - max(0.0, root) ** 0.5) / (2 * resistance)
        else:
            self.current_a = power_w / open_v
        self.voltage_v = open_v - resistance * self.current_a
        self.consumed_mah += self.current_a * dt_s / 3.6
        return self.voltage_v

    def state(self) -> BatteryState:
        """Present voltage, current, charge consumed and charge left."""
        return BatteryState(
            voltage_v=self.voltage_v,
            current_a=self.current_a,
            consumed_mah=self.consumed_mah,
            remaining=self.charge,
        )
