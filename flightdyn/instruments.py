"""Sensor readings and actuator orders of the aircraft at one instant, for logs and telemetry.

Nothing of it is needed to fly; it is put together when it is asked for.
"""

from dataclasses import dataclass
from typing import NamedTuple

from flightdyn.frames import Quaternion, Triple
from flightdyn.guidance.control import Setpoint
from flightdyn.state import Vector


class Readings(NamedTuple):
    """Latest sensor readings (FRD, SI units), the estimated biases taken off the IMU's."""

    rates_radps: Triple
    specific_force_mps2: Triple
    pressure_pa: float
    field_gauss: Triple | None  # None where there is no magnetometer
    vibration_mps2: Triple  # std of the specific force within the last guidance interval
    stds: Vector | None  # (9,) of position, velocity (NED), attitude (rad); None for exact ones


@dataclass(frozen=True, slots=True)
class Instruments:
    """Sensor readings and actuator orders of one instant."""

    readings: Readings
    setpoint: Setpoint | None  # the guidance's, None while it has none
    q_wanted: Quaternion  # attitude setpoint of the outer loop
    throttle: float  # speed of the rotors that it orders, 1 = full
    motors: tuple[float, ...]  # speed of each rotor, 1 = full
    wind_ned_mps: Vector  # true velocity of the air
    true_force_mps2: Triple  # specific force without errors, FRD
