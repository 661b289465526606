"""Values that the aircraft hands out. SI units; world is NED at the take-off point, body is FRD."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GeodeticPoint:
    """A WGS84 position; altitude above mean sea level, taken equal to the ellipsoid."""

    lat_deg: float
    lon_deg: float
    alt_msl_m: float


@dataclass(frozen=True, slots=True)
class Kinematics:
    """Where a body is and how it moves: the truth, or what the estimator believes."""

    t_ns: int
    pos_ned_m: Vector  # (3,)
    vel_ned_mps: Vector  # (3,)
    q_frd_to_ned: Vector  # (4,) w, x, y, z; rotates body vectors into NED
    omega_frd_radps: Vector  # (3,)

    @property
    def alt_rel_m(self) -> float:
        """Height above the take-off point."""
        return -float(self.pos_ned_m[2])


@dataclass(frozen=True, slots=True)
class GnssFix:
    """One receiver solution, stamped with the instant that it describes (not its arrival)."""

    t_ns: int
    pos_ned_m: Vector  # (3,)
    vel_ned_mps: Vector  # (3,)
    std_horizontal_m: float
    std_vertical_m: float
    std_velocity_mps: float
    satellites: int


@dataclass(frozen=True, slots=True)
class BatteryState:
    voltage_v: float
    current_a: float
    consumed_mah: float
    remaining: float  # 0..1 of the capacity
