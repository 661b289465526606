"""Values that the aircraft hands out. SI units; world is NED at the take-off point, body is FRD."""

import math
from dataclasses import dataclass
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
_THIRTEEN = Struct("13d")


@dataclass(frozen=True, slots=True)
class GeodeticPoint:
    """A WGS84 position; altitude above mean sea level, taken equal to the ellipsoid."""

    lat_deg: float
    lon_deg: float
    alt_msl_m: float


class Kinematics(NamedTuple):
    """Position, velocity, attitude and body rates of the aircraft: the truth, or an estimate."""

    t_ns: int
    pos_ned_m: Vector  # (3,)
    vel_ned_mps: Vector  # (3,)
    q_frd_to_ned: Vector  # (4,) w, x, y, z; rotates body vectors into NED
    omega_frd_radps: Vector  # (3,)

    @classmethod
    def of(cls, t_ns: int, *numbers: float) -> "Kinematics":
        """Make it of thirteen numbers: position, velocity, attitude (w, x, y, z), body rates."""
        all_of_them = np.frombuffer(_THIRTEEN.pack(*numbers))  # read-only, as its bytes are
        return cls(t_ns, all_of_them[:3], all_of_them[3:6], all_of_them[6:10], all_of_them[10:])

    @property
    def alt_rel_m(self) -> float:
        """Height above the take-off point."""
        return -float(self.pos_ned_m[2])


class GnssFix(NamedTuple):
    """One receiver solution, stamped with the instant that it describes (not its arrival)."""

    t_ns: int
    pos_ned_m: Vector  # (3,)
    vel_ned_mps: Vector  # (3,)
    std_horizontal_m: float
    std_vertical_m: float
    std_velocity_mps: float
    satellites: int


class Innovation(NamedTuple):
    """One measurement against the filter's prediction of it, before it was used."""

    t_ns: int  # the instant that the filter was at
    kind: str  # "gnss position" (m, NED), "gnss velocity" (m/s, NED), "baro" (m), "heading" (rad)
    values: tuple[float, ...]
    stds: tuple[float, ...]  # expected of the values, in their units
    nis: float  # normalised innovation squared; on average as many as `values`, by the model
    gate: float  # the filter refuses a measurement whose `nis` reaches it

    @property
    def accepted(self) -> bool:
        """Whether the measurement was used."""
        return self.nis < self.gate

    @property
    def ratio(self) -> float:
        """Size of the innovation divided by the largest that is accepted; refused from 1 on."""
        return math.sqrt(max(self.nis, 0.0) / self.gate)


class BatteryState(NamedTuple):
    voltage_v: float
    current_a: float
    consumed_mah: float
    remaining: float  # 0..1 of the capacity


@dataclass(frozen=True, slots=True)
class Moment:
    """The aircraft and its surroundings at one instant."""

    kinematics: Kinematics
    battery: BatteryState
    wind_ned_mps: Vector | None  # velocity of the air there; None where nobody knows
