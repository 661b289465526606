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
    hull_m: float = 0.25 + 0.254 / 2  # to a rotor's tip
    # Across the thrust, see `airspeed`; from steady flights.
    drag: tuple[float, float, float] = (0.112, 0.0031, 0.00023)
    impact_limit_mps: float = 4.0  # the legs break where the ground is met faster than that
    # Electrical, at 0, 1, 2, ... m/s, sea level: flown in JSBSim.
    level_power_w: tuple[float, ...] = (
        156.6, 155.7, 153.4, 149.8, 145.4,
        140.6, 136.1, 132.5, 130.4, 130.0,
        131.7, 135.2, 140.0, 146.8, 156.3,
        168.6, 183.9, 203.0, 225.8, 252.7,
        285.3, 323.3, 364.6, 412.9, 468.6,
        532.3,
    )  # fmt: skip


QUAD_X = Airframe()
