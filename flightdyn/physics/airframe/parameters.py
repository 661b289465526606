"""Numbers of the airframe that the autopilot and the tests use; the XML files hold the same."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Airframe:
    """One multirotor."""

    name: str  # folder and file of JSBSim
    mass_kg: float
    rest_height_m: float  # of the centre of gravity above ground, legs compressed
    rotor_max_thrust_n: float  # of the mixer's scale: static, sea level
    arm_m: float  # from the centre of gravity to a rotor's axis, at 45 degrees to the nose
    torque_per_thrust_m: float  # of a rotor at hover: Cp D / (2 pi Ct)
    motor_full_voltage_v: float  # JSBSim's maxvolts
    idle_collective: float  # motors turning, no lift to speak of
    reach_m: float  # farthest part that touches the ground, from the centre of gravity
    drag: tuple[float, float, float]  # across the thrust, see `airspeed`; from steady flights
    impact_limit_mps: float  # the legs break where the ground is met faster than that


QUAD_X = Airframe(
    name="quad_x",
    mass_kg=1.6,
    rest_height_m=0.12 - 1.6 * 9.81 / (4 * 1500.0),
    rotor_max_thrust_n=16.6,
    arm_m=0.25,
    torque_per_thrust_m=0.0450 * 0.254 / (2 * math.pi * 0.1150),
    motor_full_voltage_v=16.8,
    idle_collective=0.03,
    reach_m=0.327,
    drag=(0.106, 0.0062, 0.0001),
    impact_limit_mps=4.0,
)
