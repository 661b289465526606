"""Numbers of the airframe that the autopilot and the tests use; the XML files hold the same."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Airframe:
    """Physical constants of a multirotor: mass, rotors, motors."""

    name: str = "quad_x"  # folder and file of JSBSim
    mass_kg: float = 1.6
    # Of the centre of gravity above ground, legs compressed.
    rest_height_m: float = 0.12 - 1.6 * 9.81 / (4 * 1500.0)
    rotor_max_thrust_n: float = 16.6  # of the mixer's scale: static, sea level
    arm_m: float = 0.25  # from the centre of gravity to a rotor's axis, at 45 degrees to the nose
    # Of a rotor at hover: Cp D / (2 pi Ct).
    torque_per_thrust_m: float = 0.0450 * 0.254 / (2 * math.pi * 0.1150)
    motor_full_voltage_v: float = 16.8  # JSBSim's maxvolts
    idle_collective: float = 0.03  # motors turning, no lift to speak of
    reach_m: float = 0.327  # farthest part that touches the ground, from the centre of gravity
    # Across the thrust, see `airspeed`; from steady flights.
    drag: tuple[float, float, float] = (0.106, 0.0062, 0.0001)
    impact_limit_mps: float = 4.0  # the legs break where the ground is met faster than that
    # Electrical, at 0, 1, 2, ... m/s, sea level: flown in JSBSim.
    level_power_w: tuple[float, ...] = (
        156.6, 156.7, 156.9, 157.4, 158.1,
        159.1, 160.6, 162.5, 164.9, 168.0,
        171.8, 176.6, 183.7, 192.2, 202.5,
        214.9, 230.3, 248.7, 270.6, 296.5,
        327.0, 362.8, 403.8, 449.7, 502.5,
        562.2,
    )  # fmt: skip


QUAD_X = Airframe()
