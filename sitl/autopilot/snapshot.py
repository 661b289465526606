"""The vehicle at one instant, as telemetry reports it. SI units, degrees for positions."""

from dataclasses import dataclass

from flightdyn.state import BatteryState, GeodeticPoint, GnssFix, Kinematics, Vector
from sitl.autopilot.enums import LandedState, Sensor, SystemState


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything that telemetry messages are made from."""

    t_ns: int
    belief: Kinematics
    position: GeodeticPoint  # of `belief`
    truth: Kinematics
    true_position: GeodeticPoint  # of `truth`
    origin: GeodeticPoint  # of the local frame
    home: GeodeticPoint
    home_ned_m: Vector
    gnss: GnssFix | None  # the last solution, None where there is no current one
    gnss_position: GeodeticPoint | None
    battery: BatteryState
    battery_low: bool
    battery_critical: bool
    custom_mode: int
    armed: bool
    system_state: SystemState
    landed_state: LandedState
    sensors_present: Sensor
    sensors_healthy: Sensor
    armed_t_ns: int  # when it was armed last; 0 for never
    flights: int  # how often it was armed
